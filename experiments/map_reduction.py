# SPDX-License-Identifier: BSD-3-Clause
"""Maps at full and at reduced resolution, and with half of their segments lost: Figures 4 to 6."""
import cv2
import numpy as np
from nav_msgs.msg import OccupancyGrid
from scipy import ndimage

from benchmarks.pictures import RECORDINGS
from smokebot_udp.codecs.wire.grid import UNKNOWN
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.mapping import RESOLUTION, Mapper
from smokebot_udp.simulation.world import building
from smokebot_udp.streams.grid import FILLS, GridReceiver, begin
from smokebot_udp.streams.segments import head_of

from . import drawing, lossy, table
from .runner import Figure, Table, again

TITLE = 'Maps, reduced and half lost (Figures 4 to 6)'

EXPLANATION = """
A map of 500 × 300 cells is sent in 64 datagrams at most, and so has to be reduced. Each block of cells becomes its
**highest**: walls get thicker, but no obstacle is lost. A mean, as pictures are reduced by, blurs and wipes out what
is thin. Then half of the datagrams are lost, and each missing cell is taken from the nearest that came (Figure 6).

The deliverable stops there. This package sends the map in rounds, which complete each other: after the second three
quarters, after the third seven eighths of all datagrams have come.

Cells count as occupied from 65 % on. *Kept* are those of the full map at whose place the shown map is occupied, too. A
*gap* is where an obstacle that is in one piece on the full map has fallen into pieces. *Grown* are free cells that are
shown occupied, as a share of all free ones.
"""

MAX_SEGMENTS = {'simulated building': 64}
"""For the others, the stream's own limit."""

RECORDED = {'willow-full-0.05': 0.05, 'gdc_floor2': 0.05}
"""{map: resolution [m]}, of real SLAMs, where those are at hand"""

OCCUPIED = 65
"""From here on a cell counts as occupied, as in map_server and costmap_2d."""

LOSS = 0.5
ROUNDS = 1, 2, 3
UNKNOWN_GREY = 0.8
ALIKE = np.ones((3, 3))
"""Cells that touch, corners included, are of one piece."""


def simulated():
    """The building's map, after one round of the robot: (300, 500) int8."""
    drive, mapper = Drive(), Mapper(building(1))
    for time in np.arange(0.0, drive.period, 1.0):
        mapper.update(drive.pose(time))
    return mapper.cells


def recorded(name):
    """A map_server's picture as cells: int8, the south first."""
    grey = np.flipud(cv2.imread(str(RECORDINGS / 'maps' / (name + '.pgm')), cv2.IMREAD_UNCHANGED))
    chance = 1 - grey / 255.0
    return np.select([chance > 0.65, chance < 0.196], [100, 0], UNKNOWN).astype(np.int8)


def mean_reduced(cells, factor):
    """What one gets from a map as from a picture; unknown counts as free."""
    rows, columns = (-(-side // factor) for side in cells.shape)
    padded = np.pad(np.maximum(cells, 0), ((0, rows * factor - cells.shape[0]), (0, columns * factor - cells.shape[1])))
    return padded.reshape(rows, factor, columns, factor).mean(axis=(1, 3))


class Crossing:
    """A map's rounds over a lossy link."""

    def __init__(self, cells, resolution, **settings):
        message = OccupancyGrid(data=cells.ravel())
        message.info.height, message.info.width = cells.shape
        message.info.resolution = resolution
        self.frames = lossy.robot('grid', **settings).frames(message)
        self.segments = lossy.count(self.frames)
        self._head = head_of(self.frames[0].records[0], GridReceiver.SEGMENT, GridReceiver.HEAD)
        self.factor = round(self._head.info[1] / resolution)

    def rounds(self, loss, random):
        """The map as it has come after each round, endlessly: a codecs.image.Picture, always the same one."""
        picture = begin(self._head)
        while True:
            for records in lossy.records_of(self.frames, random.random_sample(self.segments) >= loss):
                picture.add(records['index'].astype(int), records['count'], records['data'].view(np.uint8))
            yield picture

    @staticmethod
    def cells(picture, fill='nearest'):
        return picture.items(FILLS[fill]).view(np.int8)


def judged(full, shown, factor):
    """{what the table tells: value} of a map that is shown, whose cells are `factor` of the full one's."""
    obstacles, count = ndimage.label(full >= OCCUPIED, ALIKE)
    seen = np.repeat(np.repeat(shown >= OCCUPIED, factor, axis=0), factor, axis=1)[:full.shape[0], :full.shape[1]]
    pieces = np.array([ndimage.label(_touched(obstacles[box] == i + 1, box, factor)
                                     & (shown[_reduced(box, factor)] >= OCCUPIED), ALIKE)[1]
                       for i, box in enumerate(ndimage.find_objects(obstacles))])
    free = (full >= 0) & (full < OCCUPIED)
    return {'occupied kept [%]': 100 * float(seen[full >= OCCUPIED].mean()), 'obstacles': count,
            'of them gone': int((pieces == 0).sum()), 'gaps': int(np.maximum(pieces - 1, 0).sum()),
            'grown [%]': 100 * float(seen[free].mean())}


def _reduced(box, factor):
    return tuple(slice(side.start // factor, (side.stop - 1) // factor + 1) for side in box)


def _touched(obstacle, box, factor):
    """Which cells of the reduced box an obstacle touches."""
    reduced = _reduced(box, factor)
    touched = np.zeros([side.stop - side.start for side in reduced], bool)
    rows, columns = ((cells + side.start) // factor - few.start
                     for cells, side, few in zip(np.nonzero(obstacle), box, reduced))
    touched[rows, columns] = True
    return touched


def run(run):
    """Judge each map: maps.csv; the first draw of each is kept in NAME.npz."""
    maps = {'simulated building': (simulated(), RESOLUTION)}
    if not run.quick:
        maps.update({name: (recorded(name), resolution) for name, resolution in RECORDED.items()
                     if (RECORDINGS / 'maps' / (name + '.pgm')).exists()})
    rows, random = [], np.random.RandomState(run.seed)
    for name in run.steps(maps, say=str):
        cells, resolution = maps[name]
        crossing = Crossing(cells, resolution, **({'max_segments': MAX_SEGMENTS[name]} if name in MAX_SEGMENTS else {}))
        factor = crossing.factor
        kept = {'full resolution': (cells, 1), 'reduced by the mean': (mean_reduced(cells, factor), factor),
                'reduced by the highest': (crossing.cells(next(crossing.rounds(0.0, random))), factor)}
        for rounds, picture in zip(ROUNDS, crossing.rounds(LOSS, random)):
            words = '%d %% lost, %d round%s' % (100 * LOSS, rounds, 's' * (rounds > 1))
            if rounds == 1:
                kept[words + ', missing left unknown'] = crossing.cells(picture, 'unknown'), factor
            kept[words] = crossing.cells(picture), factor
        rows += [{'map': name, 'segments': crossing.segments, 'shown': words, 'cell [m]': resolution * by,
                  **judged(cells, shown, by)} for words, (shown, by) in kept.items()]
        np.savez_compressed(str(run.folder / (name + '.npz')), **{words: shown for words, (shown, _) in kept.items()})
    table.write(run.folder / 'maps.csv', rows)


def plot(folder):
    rows = table.read(folder / 'maps.csv')
    items = []
    for name in dict.fromkeys(row['map'] for row in rows):
        of_map = [row for row in rows if row['map'] == name]
        path = folder / (name.replace(' ', '_') + '.png')
        with np.load(str(folder / (name + '.npz'))) as shown:
            draw(shown, of_map, path)
        items += [Figure(path.name, '%s: black is occupied, white free, light grey unknown. Above: the full map; '
                         'reduced by the mean; reduced by the highest, in %d datagrams. Below: half of them lost, '
                         'after one, two and three rounds.' % (name.capitalize(), of_map[0]['segments'])),
                  Table('%s, one draw of losses:' % name.capitalize(), list(rows[0])[2:],
                        [list(row.values())[2:] for row in of_map])]
    return items


def draw(shown, rows, path):
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


again(__name__, plot)
