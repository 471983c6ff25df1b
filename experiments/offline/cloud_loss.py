# SPDX-License-Identifier: BSD-3-Clause
"""Figures 12 to 14: point clouds with datagrams lost, and how evenly; points over loss as in Figure 11."""
import pathlib
from typing import Dict, List, Mapping, Sequence, Union

import numpy as np

from evaluation.clouds import distance, message_of, points_of
from evaluation.linear_fit import linear_fit
from evaluation.offline_link import Receiver, Sender, datagram_count, received, wire_size
from evaluation.recordings import RECORDINGS, cloud_points
from smokebot_udp.arrays import Array, BoolArray, Float32Array
from smokebot_udp.simulation import mounts
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.lidar import Lidar
from smokebot_udp.simulation.world import building
from smokebot_udp.udpros.datagram import HEADER
from smokebot_udp.udpros.frame import Frame

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'Point clouds with datagrams lost (Figures 12 to 14)'

EXPLANATION = """
A scan of some 20 000 points is decimated to one point for each voxel of 0.1 m, and split into datagrams of at most 80
points, each useful without the others. Here some of them are lost at random, without a network in between.

If a datagram held points *in a row*, a lost one would be a hole in the cloud. This package *deals* them like cards, so
that a lost one thins the cloud evenly. The measure is the **distance** from each point of the whole cloud to the
nearest received one, 99th percentile.
"""

ENCODINGS = 'float32', 'packed', 'sorted'
SHARES = 1.0, 0.5, 0.1
LOSSES = 0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95
DRAWS, QUICK_DRAWS = 20, 3
FRAGMENT = 1472 - HEADER.size
"""Bytes of a whole cloud in each of its datagrams."""

RECORDED = 'vlp16_einride_indoor_10hz'
SCAN_TIME = 12.0
"""When the simulated robot scans: it is in a room, with the door in sight [s]."""

VIEWPOINT = 25, 35
"""Direction of the perspective view: to the side of straight ahead, and down [degree]."""


def clouds() -> Dict[str, Float32Array]:
    """{name: (n, 3) points [m]}"""
    points = Lidar(building(1), mounts.LIDAR, 1).scan(Drive().pose(SCAN_TIME), SCAN_TIME)
    found = {'simulated': np.stack([points[axis] for axis in 'xyz'], axis=1)}
    for path in sorted(RECORDINGS.joinpath('lidar', RECORDED).glob('*.pcd'))[:1]:
        found['recorded VLP-16'] = cloud_points(path)
    return found


def run(run: Run) -> None:
    """Lose chunks of each cloud: sizes.csv, losses.csv, and SHARES of each cloud in NAME.npz."""
    random, sizes, rows = np.random.RandomState(run.seed), [], []
    senders = {encoding: Sender('cloud', encoding=encoding) for encoding in ENCODINGS}
    receiver, found = Receiver('cloud'), clouds()
    for name, loss in run.steps([(name, loss) for name in found for loss in LOSSES], lambda case: case[0]):
        frames = {encoding: sender.frames(message_of(found[name])) for encoding, sender in senders.items()}
        sent = frames['float32']
        chunks = datagram_count(sent)
        whole = points_of(received(receiver, sent, np.ones(chunks, bool)))
        if loss == LOSSES[0]:
            sizes.append(size_row(name, found[name], whole, frames))
            shown = {str(share): points_of(received(receiver, sent, subset(chunks, share, random)))
                     for share in SHARES}
            np.savez_compressed(str(run.folder / (name + '.npz')), **shown)
        in_a_row = np.array_split(whole, chunks)
        for _ in range(QUICK_DRAWS if run.quick else DRAWS):
            arrived = random.random_sample(chunks) >= loss
            dealt = points_of(received(receiver, sent, arrived))
            rowed = np.concatenate([part for part, here in zip(in_a_row, arrived) if here] or [whole[:0]])
            rows.append({'cloud': name, 'loss [%]': 100 * loss, 'chunks': int(arrived.sum()), 'points': len(dealt),
                         'dealt [m]': distance(whole, dealt), 'in a row [m]': distance(whole, rowed)})
    table.write(run.folder / 'sizes.csv', sizes)
    table.write(run.folder / 'losses.csv', rows)


def subset(chunks: int, share: float, random: np.random.RandomState) -> BoolArray:
    """(chunks,) bool: a random subset of this share."""
    chosen = np.zeros(chunks, bool)
    chosen[random.choice(chunks, round(share * chunks), replace=False)] = True
    return chosen


def size_row(name: str, scanned: Array, decimated: Array, frames: Mapping[str, Sequence[Frame]]) -> table.Row:
    """A row of sizes.csv; frames: {encoding: those of the cloud}."""
    row = {'cloud': name, 'scanned points': len(scanned), 'thinned': len(decimated)}
    for encoding, sent in frames.items():
        row['%s: datagrams' % encoding], row['%s: kB' % encoding] = datagram_count(sent), wire_size(sent) / 1e3
    return row


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """Figures of the clouds, of points and of distances over loss, and a table of sizes."""
    sizes, rows = table.read(folder / 'sizes.csv'), table.read(folder / 'losses.csv')
    names = [row['cloud'] for row in sizes]
    items: List[Union[Figure, Table]] = []
    for name in names:
        path = folder / (name.replace(' ', '_') + '.png')
        with np.load(str(folder / (name + '.npz'))) as shown:
            draw([shown[str(share)] for share in SHARES], path)
        items.append(Figure(path.name, 'The %s cloud: all of it, half of its datagrams, and a tenth of them. From '
                            'above (the red arrow is the robot), and from behind it.' % name))
    fit = draw_points(rows, sizes[0], folder / 'points.png')
    draw_distances(rows, names, folder / 'distance.png')
    return [
        *items,
        Figure('points.png', 'The mean number of points of the simulated cloud that arrive (the band: the least and '
               'the most). It falls in a straight line (R² of the means %.4f). As one message over UDP, a cloud '
               'arrives only where all its datagrams do.' % fit),
        Figure('distance.png', 'How close the received points are to the lost ones: with points dealt, and with '
               'points in a row. Where no point arrives in some draw, there is no line.'),
        sizes_table(folder)]


def sizes_table(folder: pathlib.Path) -> Table:
    """Datagrams and bytes of each encoding."""
    sizes = table.read(folder / 'sizes.csv')
    return Table('On the wire, whole IP packets (*packed*: the short offsets of this package, accurate to an eighth of '
                 'a voxel; *sorted*, its default: the same, sorted and entropy-coded):', list(sizes[0]),
                 [list(row.values()) for row in sizes])


def points_table(folder: pathlib.Path) -> Table:
    """How many points of the simulated cloud arrive, and how evenly."""
    rows = [row for row in table.read(folder / 'losses.csv') if row['cloud'] == 'simulated']
    losses = [loss for loss in sorted({row['loss [%]'] for row in rows}) if loss]

    def means(key: str, losses: Sequence[float]) -> List[float]:
        return [float(np.mean([row[key] for row in rows if row['loss [%]'] == loss])) for loss in losses]
    whole = sorted({row['loss [%]'] for row in rows})
    return Table('The simulated cloud, by the packet loss. The number of points is linear in it, R² of the means %.4f. '
                 'The distances are those within which 99 of 100 points have a received one:'
                 % linear_fit(whole, means('points', whole))[2], ['', *('%g %%' % loss for loss in losses)], [
                     ['points', *('%.0f' % value for value in means('points', losses))],
                     ['dealt, this package [m]', *map(_metres, means('dealt [m]', losses))],
                     ['in a row [m]', *map(_metres, means('in a row [m]', losses))]])


def _metres(distance: float) -> str:
    return '%.2f' % distance if np.isfinite(distance) else '–'


def draw(clouds: Sequence[Float32Array], path: pathlib.Path) -> None:
    """Clouds of SHARES from above and in perspective."""
    low, high = (np.percentile(clouds[0], part, axis=0) + side for part, side in ((0.5, -0.3), (99.5, 0.3)))
    figure, grid = drawing.canvas(14, 8, 2, len(SHARES), sharex='row', sharey='row')
    for axes, share, xyz in zip(grid.T, SHARES, clouds):
        count, xyz = len(xyz), xyz[((xyz > low) & (xyz < high)).all(axis=1)]
        for view, (across, up, near) in zip(axes, (xyz.T, turned(xyz).T)):
            order = np.argsort(near)
            heights = view.scatter(across[order], up[order], c=xyz[order, 2], s=4, cmap='viridis', vmin=low[2],
                                   vmax=high[2], linewidths=0)
            view.set_aspect('equal')
        axes[0].plot(0, 0, 'r>', markersize=9)
        axes[0].set(xlabel='x, ahead [m]', title='%g %% of the datagrams: %d points' % (100 * share, count))
        axes[1].set_axis_off()
    grid[0, 0].set_ylabel('y, to the left [m]')
    figure.colorbar(heights, ax=grid, shrink=0.5, label='height above the sensor [m]')
    drawing.save(figure, path)


def turned(xyz: Float32Array) -> Array:
    """Points as seen from VIEWPOINT: (n, 3) to the right, up, towards the eye."""
    side, tilt = np.radians(VIEWPOINT)
    right = np.array([np.sin(side), -np.cos(side), 0])
    eye = np.array([-np.cos(side) * np.cos(tilt), -np.sin(side) * np.cos(tilt), np.sin(tilt)])
    return xyz @ np.stack([right, np.cross(eye, right), eye], axis=1)


def draw_points(rows: Sequence[table.Row], size: table.Row, path: pathlib.Path) -> float:
    """Points over loss; R² of the straight line through their means.

    :param size: a row of sizes.csv, of the cloud that is drawn
    """
    rows = [row for row in rows if row['cloud'] == size['cloud']]
    loss, points = (np.array([row[key] for row in rows]) for key in ('loss [%]', 'points'))
    losses = np.unique(loss)
    each = [points[loss == at] for at in losses]
    means = [float(p.mean()) for p in each]
    fine = np.linspace(0, 100, 401)
    fragments = -(-12 * size['thinned'] // FRAGMENT)
    figure, axes = drawing.canvas()
    axes.fill_between(losses, [p.min() for p in each], [p.max() for p in each], color=drawing.OURS, alpha=0.2,
                      linewidth=0)
    axes.plot(losses, means, '.-', color=drawing.OURS,
              label='in %d independent datagrams (this package)' % size['float32: datagrams'])
    axes.plot(fine, size['thinned'] * (1 - fine / 100) ** fragments, color=drawing.COLOURS['cloud over UDPROS'],
              label='the same cloud as one message over UDP, %d datagrams' % fragments)
    axes.set(xlabel='datagrams lost [%]', ylabel='received points of a cloud', xlim=(0, 100), ylim=(0, None))
    axes.legend(loc='upper right')
    drawing.save(figure, path)
    return linear_fit(losses, means)[2]


def draw_distances(rows: Sequence[table.Row], names: Sequence[str], path: pathlib.Path) -> None:
    """Distances over loss, axes for each cloud."""
    figure, grid = drawing.canvas(6.0 * len(names), 4.2, 1, len(names), squeeze=False, sharey=True)
    for axes, name in zip(grid[0], names):
        for key, colour, words in (('dealt [m]', drawing.OURS, 'dealt like cards (this package)'),
                                   ('in a row [m]', drawing.PAPER, 'in a row')):
            mean = [np.mean([row[key] for row in rows if (row['cloud'], row['loss [%]']) == (name, 100 * loss)])
                    for loss in LOSSES]
            axes.plot([100 * loss for loss in LOSSES], mean, '.-', color=colour, label=words)
        axes.set(xlabel='datagrams lost [%]', title=name, xlim=(0, 100), ylim=(0, None))
        axes.legend(loc='upper left')
    grid[0, 0].set_ylabel('distance to the nearest received point, p99 [m]')
    drawing.save(figure, path)


DOC_TABLES = {'points': points_table, 'sizes': sizes_table}
