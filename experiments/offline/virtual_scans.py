# SPDX-License-Identifier: BSD-3-Clause
"""Images of virtual scans, for a person to judge."""
import pathlib
from operator import itemgetter
from typing import Iterator, List, Tuple, Union

import numpy as np

from evaluation.recordings import RECORDINGS, cloud_points
from smokebot_udp.arrays import Array, Float32Array
from smokebot_udp.codecs.perception import virtual_scan
from smokebot_udp.codecs.perception.ground import GroundFinder, Plane
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.lidar import Lidar
from smokebot_udp.simulation.world import building

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'Virtual 2D scans (section 6.2)'

EXPLANATION = """
A 3D scan is reduced to two 2D ones of 720 columns of half a degree. The **obstacle scan** has the nearest thing in each
column that the robot could hit: above the ground, and not above the robot. The **landmark scan** has the farthest
upright wall in each, which is visible again from elsewhere, for the robot's localisation. The ground is found in the
points and removed first; where too little of it is visible, it is assumed from the sensor's mounting height. The clouds
are of the simulated building, and recordings where those are at hand.
"""

SHOWN = 'simulated', 'simulated, tilted', 'vlp16_einride_indoor_10hz', 'seq_os1-128'
"""Kinds of clouds; the report shows one of each."""

MOUNTS = {'seq_os0-8': 1.15, 'seq_os1-128': 2.0, 'vlp16_einride': 1.05, 'fast_gicp': 1.9, 'vlp32c': 0.33, 'hesai': 0.75}
"""{part of a folder's or a file's name: height of the sensor above the floor, as measured in the scans [m]}"""

MOUNT = 0.9
"""Height of the sensor above the floor where MOUNTS does not have it [m]."""

TOLERANCE, SLOPE, MAX_HEIGHT = 0.1, 0.01, 1.2
"""Height above which points are not ground [m], its growth with distance, and the robot's height [m]."""

RANGE_MIN = 0.4
"""Minimum range of a scan [m]."""

FIELD = 20.0
"""Farther points are not drawn [m]."""

SOURCES = {'fresh': 'found in the points', 'assumed': 'assumed'}

SLICE = 2.0
"""The side view shows points up to this distance to the left and right [m]."""

TIMES = 0, 20, 28, 64, 108
"""Times of the simulated scans [s]."""

Cloud = Tuple[str, str, float, Float32Array]
"""A cloud: kind, name, mounting height [m], (n, 3) points [m]."""


def recorded(folder: pathlib.Path) -> Iterator[Cloud]:
    """The scans in a folder's folders."""
    for path in sorted(folder.glob('*/*')):
        if path.suffix in ('.npz', '.pcd'):
            name = '%s_%s' % (path.parent.name, path.stem)
            mount = next((MOUNTS[part] for part in MOUNTS if part in name), MOUNT)
            yield path.parent.name, name, mount, cloud_points(path)


def simulated() -> Iterator[Cloud]:
    """Scans of the building, on a level floor and tilted by 10 degrees."""
    lidar, drive = Lidar(building(1), mount=MOUNT, seed=1), Drive()
    for time in TIMES:
        points = lidar.scan(drive.pose(time), time)
        xyz = np.stack([points['x'], points['y'], points['z']], axis=1)
        yield 'simulated', 'simulated_%03d' % time, MOUNT, xyz
        c, s = np.cos(np.radians(10)), np.sin(np.radians(10))
        tilt = np.array([(c, 0, s), (0, 1, 0), (-s, 0, c)], np.float32)
        yield 'simulated, tilted', 'simulated_%03d_tilted' % time, MOUNT, xyz @ tilt.T


def draw(name: str, xyz: Float32Array, plane: Plane, ground: str, obstacles: Array, landmarks: Array,
         path: pathlib.Path) -> None:
    """Write a figure: the scans from above, the plane from the side."""
    x, y, height = plane.level(xyz[np.isfinite(xyz).all(axis=1) & xyz.any(axis=1)])
    limit = TOLERANCE + SLOPE * np.hypot(x, y)
    kinds = ((height > limit, '0.6', 'above the ground'), (np.abs(height) <= limit, '#e6d090', 'ground'),
             (height < -limit, '#90d0a0', 'below the ground'))
    figure, (above, beside) = drawing.canvas(8, 10.5, 2, gridspec_kw={'height_ratios': (4, 1)})
    near = np.abs(y) < SLICE
    for kind, colour, label in kinds:
        above.plot(x[kind], y[kind], '.', color=colour, markersize=1, label=label)
        beside.plot(x[kind & near], height[kind & near], '.', color=colour, markersize=1)
    bearing = virtual_scan.ANGLE_MIN + np.arange(virtual_scan.COLUMNS) * virtual_scan.INCREMENT
    for ranges, colour, label in ((landmarks, 'blue', 'landmark scan'), (obstacles, 'red', 'obstacle scan')):
        ranges = np.where(ranges == np.inf, np.nan, ranges)
        at = np.maximum(ranges, RANGE_MIN)      # where something is too close, too
        above.plot(at * np.cos(bearing), at * np.sin(bearing), '.', color=colour, markersize=3,
                   label='%s: %d of %d' % (label, np.isfinite(at).sum(), virtual_scan.COLUMNS))
    above.plot(0, 0, 'k>', markersize=8)
    side = min(FIELD, 1.1 * float(np.percentile(np.hypot(x, y), 98)))
    above.set(xlim=(-side, side), ylim=(-side, side), aspect='equal', xlabel='x, ahead [m]',
              ylabel='y, to the left [m]', title='%s, from above' % name)
    for level, style, label, va in ((0, 'k-', 'ground', 'top'), (TOLERANCE, 'g:', 'obstacles begin', 'bottom'),
                                    (MAX_HEIGHT, 'r:', 'obstacles end', 'center')):
        beside.plot((-side, side), (level, level), style, linewidth=1)
        beside.annotate(label, (side, level), (3, 0), textcoords='offset points', va=va, fontsize=8)
    tilt = np.degrees(np.arccos(min(1.0, plane.normal[2])))
    beside.set(xlim=(-side, side), ylim=(-1, 4), xlabel='x, ahead [m]', ylabel='height [m]', title=(
        'From the side. Ground %s, %.2f m below the sensor, tilted by %.1f°' % (
            SOURCES[ground], plane.offset, tilt)))
    figure.legend(loc='outside upper center', ncols=3, markerscale=4)
    drawing.save(figure, path)


def run(run: Run) -> None:
    """Make the scans of simulated and recorded clouds: scans.csv, NAME.npz."""
    clouds = [*simulated(), *recorded(RECORDINGS / 'lidar')]
    if run.quick:   # the first of each kind
        clouds = list({cloud[0]: cloud for cloud in reversed(clouds)}.values())
    rows = []
    for kind, name, mount, xyz in run.steps(clouds, itemgetter(1)):
        finder = GroundFinder(mount, max_offset=0.3)
        plane = finder.find(xyz)
        points = virtual_scan.fan(xyz, plane, tolerance=TOLERANCE, slope=SLOPE, range_min=RANGE_MIN)
        obstacles, landmarks = virtual_scan.obstacle_scan(points, MAX_HEIGHT), virtual_scan.landmark_scan(points)
        np.savez_compressed(str(run.folder / (name + '.npz')), xyz=xyz, normal=plane.normal, offset=plane.offset,
                            obstacles=obstacles, landmarks=landmarks)
        rows.append({'kind': kind, 'name': name, 'points': len(xyz), 'ground': 'fresh' if finder.found else 'assumed',
                     'obstacle columns': int(np.isfinite(obstacles).sum()),
                     'landmark columns': int(np.isfinite(landmarks).sum())})
    table.write(run.folder / 'scans.csv', rows)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """Draw a figure of each cloud; the report gets one of each kind, and a table of all."""
    rows = table.read(folder / 'scans.csv')
    for row in rows:
        with np.load(str(folder / (row['name'] + '.npz'))) as found:
            plane = Plane(found['normal'], float(found['offset']))
            draw(row['name'], found['xyz'], plane, row['ground'], found['obstacles'], found['landmarks'],
                 folder / (row['name'] + '.png'))
    shown = {row['kind']: row['name'] for row in reversed(rows)}
    figures = [Figure(shown[kind] + '.png', 'The legend counts the columns in which something is visible; the black '
                      'arrow is the sensor. Below are the points up to %g m to its left and right.' % SLICE)
               for kind in SHOWN if kind in shown]
    return [*figures, Table('All of them; their figures are in the folder.', list(rows[0])[1:],
                            [list(row.values())[1:] for row in rows])]


def kinds_table(folder: pathlib.Path) -> Table:
    """What was found in the clouds of each kind."""
    rows = table.read(folder / 'scans.csv')
    lines = []
    for kind in dict.fromkeys(row['kind'] for row in rows):
        mine = [row for row in rows if row['kind'] == kind]
        medians = (np.median([row[key] for row in mine]) for key in ('obstacle columns', 'landmark columns'))
        lines.append([kind, len(mine), sum(row['ground'] == 'fresh' for row in mine), *map('{:.0f}'.format, medians)])
    return Table('Columns of %d in which something was found, medians, by the kind of cloud:' % virtual_scan.COLUMNS,
                 ['kind', 'clouds', 'with the ground found', 'obstacle scan', 'landmark scan'], lines)


DOC_TABLES = {'kinds': kinds_table}
