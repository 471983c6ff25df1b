# SPDX-License-Identifier: BSD-3-Clause
"""Point clouds of which a part comes: Figures 12 to 14, and how evenly; the points over the loss, as in Figure 11."""
import numpy as np
from scipy.spatial import cKDTree
from sensor_msgs.msg import PointCloud2, PointField

from benchmarks.pictures import RECORDINGS
from smokebot_udp.simulation import mounts
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.lidar import Lidar
from smokebot_udp.simulation.world import building
from smokebot_udp.streams import operator_class
from smokebot_udp.streams.outbox import size_of
from smokebot_udp.udpros.datagram import HEADER

from . import drawing, lossy, table
from .runner import Figure, Table, again
from .virtual_scans import read

TITLE = 'Point clouds of which a part comes (Figures 12 to 14)'

EXPLANATION = """
A scan of some 20 000 points is thinned, one point for each box of 0.1 m, and split into datagrams of at most 80 points,
which stand alone. Here some of them are lost at random, without a network in between.

The points could go *in a row* into a datagram; then a lost one is a hole in the cloud. This package *deals* them like
cards, so that a lost one thins the cloud evenly. How good that is tells the **distance** from each point of the whole
cloud to the nearest one that came: 99 of 100 points have one at least that near.
"""

SHARES = 1.0, 0.5, 0.1
LOSSES = 0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95
FRAGMENT = 1472 - HEADER.size
"""Bytes of a whole cloud in each of its datagrams."""

RECORDED = 'vlp16_einride_indoor_10hz'
SOMEWHERE = 12.0
"""When the simulated robot's cloud is taken [s]: in a room, with its door in sight."""

VIEWED_FROM = 25, 35
"""To which side of straight ahead the perspective looks, and how far down [degree]."""


def clouds():
    """{name: (n, 3) float32 [m]}"""
    points = Lidar(building(1), mounts.LIDAR, 1).scan(Drive().pose(SOMEWHERE), SOMEWHERE)
    found = {'simulated': np.stack([points[axis] for axis in 'xyz'], axis=1)}
    for path in sorted(RECORDINGS.joinpath('lidar', RECORDED).glob('*.pcd'))[:1]:
        found['recorded VLP-16'] = read(path)
    return found


def message_of(xyz):
    fields = [PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate('xyz')]
    message = PointCloud2(height=1, width=len(xyz), fields=fields, point_step=12, row_step=12 * len(xyz),
                          data=xyz.astype('<f4').tobytes())
    message.header.frame_id = 'velodyne'
    return message


def points_of(message):
    """(n, 3) float32 [m] of an operator's cloud; none of None."""
    return np.frombuffer(b'' if message is None else message.data, '<f4').reshape(-1, 3)


def farthest(whole, came):
    """The distance within which 99 of 100 points of the whole cloud have one that came [m]."""
    return float(np.percentile(cKDTree(came).query(whole)[0], 99)) if len(came) else np.inf


def run(run):
    """Lose chunks of each cloud: sizes.csv, losses.csv; SHARES of it in NAME.npz."""
    random, sizes, rows = np.random.RandomState(run.seed), [], []
    senders = {encoding: lossy.robot('cloud', encoding=encoding) for encoding in ('float32', 'packed')}
    receiver = lossy.stream(operator_class, 'cloud')
    found = clouds()
    for name, loss in run.steps([(name, loss) for name in found for loss in LOSSES], say=lambda at: at[0]):
        frames = {encoding: sender.frames(message_of(found[name])) for encoding, sender in senders.items()}
        sent, chunks = frames['float32'], lossy.count(frames['float32'])
        whole = points_of(lossy.came_of(receiver, sent, np.ones(chunks, bool)))
        if loss == LOSSES[0]:
            sizes.append(row_of(name, found[name], whole, frames))
            shown = {str(share): points_of(lossy.came_of(receiver, sent, some(chunks, share, random)))
                     for share in SHARES}
            np.savez_compressed(str(run.folder / (name + '.npz')), **shown)
        in_a_row = np.array_split(whole, chunks)
        for _ in range(3 if run.quick else 20):
            came = random.random_sample(chunks) >= loss
            dealt = points_of(lossy.came_of(receiver, sent, came))
            rowed = np.concatenate([part for part, here in zip(in_a_row, came) if here] or [whole[:0]])
            rows.append({'cloud': name, 'loss [%]': 100 * loss, 'chunks': int(came.sum()), 'points': len(dealt),
                         'dealt [m]': farthest(whole, dealt), 'in a row [m]': farthest(whole, rowed)})
    table.write(run.folder / 'sizes.csv', sizes)
    table.write(run.folder / 'losses.csv', rows)


def some(chunks, share, random):
    """(chunks,) bool: this share of them."""
    came = np.zeros(chunks, bool)
    came[random.choice(chunks, round(share * chunks), replace=False)] = True
    return came


def row_of(name, scanned, whole, frames):
    row = {'cloud': name, 'scanned points': len(scanned), 'thinned': len(whole)}
    for encoding, sent in frames.items():
        row['%s: datagrams' % encoding], row['%s: kB' % encoding] = (
            lossy.count(sent), size_of(sent) / 1e3)
    return row


def plot(folder):
    sizes, rows = table.read(folder / 'sizes.csv'), table.read(folder / 'losses.csv')
    names = [row['cloud'] for row in sizes]
    items = []
    for name in names:
        path = folder / (name.replace(' ', '_') + '.png')
        with np.load(str(folder / (name + '.npz'))) as shown:
            draw([shown[str(share)] for share in SHARES], path)
        items.append(Figure(path.name, 'The %s cloud: all of it, half of its datagrams, and a tenth of them. From '
                            'above (the red arrow is the robot), and from behind it.' % name))
    fit = points_over_loss(rows, sizes[0], folder / 'points.png')
    distances(rows, names, folder / 'distance.png')
    return items + [
        Figure('points.png', 'How many points of the simulated cloud come, on average (the band: the least and the '
               'most). They fall in a straight line (R² of the means %.4f). Sent as one message '
               'over UDP, a cloud comes only where all its datagrams do.' % fit),
        Figure('distance.png', 'How near the points that came are to those that did not: as they are dealt, and as '
               'they would be in a row. Where too few came for any, there is no line.'),
        Table('On the wire, whole IP packets (*packed*: the short offsets of this package, an eighth of a box off at '
              'most):', list(sizes[0]), [list(row.values()) for row in sizes])]


def draw(clouds, path):
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


def turned(xyz):
    """As seen from behind, right and above: (n, 3) to the right, up, towards the eye."""
    side, tilt = np.radians(VIEWED_FROM)
    right = np.array([np.sin(side), -np.cos(side), 0])
    eye = np.array([-np.cos(side) * np.cos(tilt), -np.sin(side) * np.cos(tilt), np.sin(tilt)])
    return xyz @ np.stack([right, np.cross(eye, right), eye], axis=1)


def points_over_loss(rows, size, path):
    """R² of the straight line through the mean points that come at each loss."""
    rows = [row for row in rows if row['cloud'] == size['cloud']]
    loss, points = (np.array([row[key] for row in rows]) for key in ('loss [%]', 'points'))
    fine = np.linspace(0, 100, 401)
    fragments = -(-12 * size['thinned'] // FRAGMENT)
    each = {at: points[loss == at] for at in np.unique(loss)}
    figure, axes = drawing.canvas()
    axes.fill_between(list(each), [p.min() for p in each.values()], [p.max() for p in each.values()],
                      color=drawing.OURS, alpha=0.2, linewidth=0)
    axes.plot(list(each), [p.mean() for p in each.values()], '.-', color=drawing.OURS,
              label='in %d datagrams that stand alone (this package)' % size['float32: datagrams'])
    axes.plot(fine, size['thinned'] * (1 - fine / 100) ** fragments, color=drawing.WAYS['cloud over UDPROS'],
              label='the same cloud as one message over UDP, %d datagrams' % fragments)
    axes.set(xlabel='datagrams lost [%]', ylabel='points of a cloud that come', xlim=(0, 100), ylim=(0, None))
    axes.legend(loc='upper right')
    drawing.save(figure, path)
    return np.corrcoef(list(each), [p.mean() for p in each.values()])[0, 1] ** 2


def distances(rows, names, path):
    figure, grid = drawing.canvas(6.0 * len(names), 4.2, 1, len(names), squeeze=False, sharey=True)
    for axes, name in zip(grid[0], names):
        for key, colour, words in (('dealt [m]', drawing.OURS, 'dealt like cards (this package)'),
                                   ('in a row [m]', drawing.PAPER, 'in a row')):
            mean = [np.mean([row[key] for row in rows if (row['cloud'], row['loss [%]']) == (name, 100 * loss)])
                    for loss in LOSSES]
            axes.plot([100 * loss for loss in LOSSES], mean, '.-', color=colour, label=words)
        axes.set(xlabel='datagrams lost [%]', title=name, xlim=(0, 100), ylim=(0, None))
        axes.legend(loc='upper left')
    grid[0, 0].set_ylabel('99 % of points have one that came within [m]')
    drawing.save(figure, path)


again(__name__, plot)
