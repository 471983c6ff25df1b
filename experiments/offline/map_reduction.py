# SPDX-License-Identifier: BSD-3-Clause
"""Figures 4 to 6: maps at full and at reduced resolution, and with half of their segments lost."""
import pathlib
from typing import Any, Dict, Iterator, List, Mapping, Sequence, Tuple, Union

import numpy as np
from scipy import ndimage

from evaluation.maps import map_message, recorded, recorded_names, simulated
from evaluation.offline_link import Receiver, Sender, datagram_count, records_of
from smokebot_udp.arrays import Array, BoolArray
from smokebot_udp.simulation.mapping import RESOLUTION

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'Maps, reduced and half lost (Figures 4 to 6)'

EXPLANATION = """
A map of 500 × 300 cells may take 64 datagrams at most, so it has to be reduced. Each block of cells becomes its
**maximum**: walls get thicker, but no obstacle is lost. A mean, as used for images, blurs and erases what is thin.
Then half of the datagrams are lost, and each missing cell is taken from the nearest received one (Figure 6).

The deliverable stops there. This package repeats the map in refresh cycles, which complete each other: after the second
three quarters of all datagrams have arrived, after the third seven eighths.

Cells count as occupied from 65 % on. *Kept* are the occupied cells of the full map where the shown map is occupied,
too. A *gap* is where an obstacle that is in one piece on the full map has fallen apart. *Grown* are free cells that are
shown as occupied, as a share of all free ones.
"""

MAX_SEGMENTS = {'simulated building': 64}
"""For the other maps, the stream's default."""

RECORDED = {'willow-full-0.05': 0.05, 'gdc_floor2': 0.05}
"""{map: resolution [m]} of real SLAMs, where those are at hand"""

OCCUPIED = 65
"""A cell counts as occupied from this value on, as in map_server and costmap_2d [%]."""

LOSS = 0.5
CYCLES = 1, 2, 3
UNKNOWN_GREY = 0.8
TOUCHING = np.ones((3, 3))
"""Cells that touch, corners included, belong to one piece."""


def mean_reduced(cells: Array, factor: int) -> Array:
    """The means of blocks of cells, as images are reduced; unknown counts as free."""
    rows, columns = (-(-side // factor) for side in cells.shape)
    padded = np.pad(np.maximum(cells, 0), ((0, rows * factor - cells.shape[0]), (0, columns * factor - cells.shape[1])))
    means: Array = padded.reshape(rows, factor, columns, factor).mean(axis=(1, 3))
    return means


class MapLink:
    """The refresh cycles of a map over a lossy link.

    :param cells: (height, width) int8
    :param resolution: [m]
    :param settings: of the stream
    """

    def __init__(self, cells: Array, resolution: float, **settings: Any) -> None:
        self._frames = Sender('grid', coding='interleaved', **settings).frames(map_message(cells, resolution))
        self.segments = datagram_count(self._frames)
        self.factor = round(float(self._frames[0].records['info']['resolution'][0]) / resolution)

    def cycles(self, loss: float, random: np.random.RandomState) -> Iterator[Tuple[Array, Array]]:
        """The map after each cycle, endlessly: missing cells filled from the nearest, and left unknown; int8."""
        receivers = [Receiver('grid', fill=fill) for fill in ('nearest', 'unknown')]
        while True:
            batches = records_of(self._frames, random.random_sample(self.segments) >= loss)
            filled, unfilled = (cells_of(receiver.update(batches)) for receiver in receivers)
            yield filled, unfilled


def cells_of(message: Any) -> Array:
    """The cells of an OccupancyGrid: (height, width) int8."""
    return np.asarray(message.data, np.int8).reshape(message.info.height, message.info.width)


def judged(full: Array, shown: Array, factor: int) -> Dict[str, float]:
    """Columns of the table for a map that is shown, whose cells are `factor` times as long as the full one's."""
    obstacles, count = ndimage.label(full >= OCCUPIED, TOUCHING)
    seen = np.repeat(np.repeat(shown >= OCCUPIED, factor, axis=0), factor, axis=1)[:full.shape[0], :full.shape[1]]
    pieces = np.array([ndimage.label(_touched(obstacles[box] == i + 1, box, factor)
                                     & (shown[_reduced(box, factor)] >= OCCUPIED), TOUCHING)[1]
                       for i, box in enumerate(ndimage.find_objects(obstacles))])
    free = (full >= 0) & (full < OCCUPIED)
    return {'occupied kept [%]': 100 * float(seen[full >= OCCUPIED].mean()), 'obstacles': count,
            'of them gone': int((pieces == 0).sum()), 'gaps': int(np.maximum(pieces - 1, 0).sum()),
            'grown [%]': 100 * float(seen[free].mean())}


def _reduced(box: Tuple[slice, ...], factor: int) -> Tuple[slice, ...]:
    return tuple(slice(side.start // factor, (side.stop - 1) // factor + 1) for side in box)


def _touched(obstacle: BoolArray, box: Tuple[slice, ...], factor: int) -> BoolArray:
    """Which cells of the reduced box an obstacle touches."""
    reduced = _reduced(box, factor)
    touched = np.zeros([side.stop - side.start for side in reduced], bool)
    rows, columns = ((cells + side.start) // factor - reduced_side.start
                     for cells, side, reduced_side in zip(np.nonzero(obstacle), box, reduced))
    touched[rows, columns] = True
    return touched


def run(run: Run) -> None:
    """Judge each map with one draw of losses: maps.csv, and the maps themselves in NAME.npz."""
    maps = {'simulated building': (simulated(), RESOLUTION)}
    if not run.quick:
        maps.update({name: (recorded(name), resolution) for name, resolution in RECORDED.items()
                     if name in recorded_names()})
    rows, random = [], np.random.RandomState(run.seed)
    for name in run.steps(maps, str):
        cells, resolution = maps[name]
        limit = {'max_segments': MAX_SEGMENTS[name]} if name in MAX_SEGMENTS else {}
        link = MapLink(cells, resolution, **limit)
        whole, _ = next(link.cycles(0.0, random))
        shown = {'full resolution': (cells, 1), 'reduced by the mean': (mean_reduced(cells, link.factor), link.factor),
                 'reduced by the highest': (whole, link.factor)}
        for cycle, (filled, unfilled) in zip(CYCLES, link.cycles(LOSS, random)):
            words = '%d %% lost, %d round%s' % (100 * LOSS, cycle, 's' * (cycle > 1))
            if cycle == 1:
                shown[words + ', missing left unknown'] = unfilled, link.factor
            shown[words] = filled, link.factor
        rows += [{'map': name, 'segments': link.segments, 'shown': words, 'cell [m]': resolution * factor,
                  **judged(cells, array, factor)} for words, (array, factor) in shown.items()]
        np.savez_compressed(str(run.folder / (name + '.npz')), **{words: array for words, (array, _) in shown.items()})
    table.write(run.folder / 'maps.csv', rows)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """A figure and a table of each map."""
    rows = table.read(folder / 'maps.csv')
    items: List[Union[Figure, Table]] = []
    for name in dict.fromkeys(row['map'] for row in rows):
        of_map = [row for row in rows if row['map'] == name]
        path = folder / (name.replace(' ', '_') + '.png')
        with np.load(str(folder / (name + '.npz'))) as shown:
            draw(shown, of_map, path)
        items += [Figure(path.name, '%s: black is occupied, white free, light grey unknown. Above: the full map; '
                         'reduced by the mean; reduced by the maximum, in %d datagrams. Below: half of them lost, '
                         'after one, two and three cycles.' % (name.capitalize(), of_map[0]['segments'])),
                  judged_table(name, of_map)]
    return items


def judged_table(name: str, rows: Sequence[table.Row]) -> Table:
    """What each way of showing a map keeps of it."""
    return Table('%s, in %d datagrams, one draw of losses:' % (name.capitalize(), rows[0]['segments']),
                 list(rows[0])[2:], [list(row.values())[2:] for row in rows])


def simulated_table(folder: pathlib.Path) -> Table:
    """judged_table of the simulated building."""
    rows = table.read(folder / 'maps.csv')
    return judged_table(rows[0]['map'], [row for row in rows if row['map'] == rows[0]['map']])


def draw(shown: Mapping[str, Array], rows: Sequence[table.Row], path: pathlib.Path) -> None:
    """The maps of some rows, without those with unknown cells."""
    drawn = [row for row in rows if 'unknown' not in row['shown']]
    height, width = shown['full resolution'].shape
    figure, grid = drawing.canvas(15, 1.0 + 9.0 * height / width, 2, 3, sharex=True, sharey=True)
    for axes, row in zip(grid.flat, drawn):
        cells, side = shown[row['shown']], row['cell [m]']
        colours = np.where(cells < 0, UNKNOWN_GREY, 1 - cells / 100.0)
        axes.imshow(colours, cmap='gray', vmin=0, vmax=1, origin='lower', interpolation='nearest',
                    extent=(0, cells.shape[1] * side, 0, cells.shape[0] * side))
        axes.grid(False)
        axes.set_title('%s, %g m: %.1f %% kept, %d gaps' % (
            row['shown'], round(side, 3), row['occupied kept [%]'], row['gaps']), fontsize=9)
    for axes in grid[1]:
        axes.set_xlabel('x [m]')
    for axes in grid[:, 0]:
        axes.set_ylabel('y [m]')
    drawing.save(figure, path)


DOC_TABLES = {'simulated': simulated_table}
