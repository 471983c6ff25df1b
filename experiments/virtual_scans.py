# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of virtual scans, for a person to judge."""
import pathlib
from operator import itemgetter

import numpy as np

from smokebot_udp.codecs.perception import virtual_scan
from smokebot_udp.codecs.perception.ground import ASSUMED, FRESH, GroundFinder, Plane
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.lidar import Lidar
from smokebot_udp.simulation.world import building

from . import drawing, table
from .runner import Figure, Table, again

TOP = pathlib.Path(__file__).resolve().parent.parent
SCANS = TOP.parent / 'shared' / 'data' / 'lidar'

TITLE = 'Virtual 2D scans (section 6.2)'

EXPLANATION = """
A 3D scan is reduced to two 2D ones of 720 half degrees. The **obstacle scan** has the nearest thing in each that the
robot could run into: above the ground, and not above the robot. The **landmark scan** has the farthest upright wall in
each, which is seen again from elsewhere, for the robot's localisation. The ground is found in the points and taken out
first; where too little of it is seen, it is assumed where the sensor's mounting says. The clouds are of the simulated
building, and recordings where those are at hand.
"""

SHOWN = 'simulated', 'simulated, tilted', 'vlp16_einride_indoor_10hz', 'seq_os1-128'
"""Kinds of clouds of which the report has one each."""

MOUNTS = {'seq_os0-8': 1.15, 'seq_os1-128': 2.0, 'vlp16_einride': 1.05, 'fast_gicp': 1.9, 'vlp32c': 0.33, 'hesai': 0.75}
"""Heights of the sensors above the floor [m], by a part of a folder's or a file's name; looked up in the scans."""

MOUNT = 0.9
"""[m], of the others"""

TOLERANCE, SLOPE, MAX_HEIGHT = 0.1, 0.01, 1.2
"""What is above the ground [m], [m/m], and in a robot's way [m]."""

RANGE_MIN = 0.4
"""[m]"""

FIELD = 20.0
"""Farther points are not drawn [m]."""

SOURCES = {FRESH: 'found in the points', ASSUMED: 'assumed'}

SLICE = 2.0
"""The side view shows points so far to the left and right [m]."""


def recorded(folder):
    """The scans in a folder's folders: (kind, name, mounting height [m], (n, 3) float32 [m]) each."""
    for path in sorted(folder.glob('*/*')):
        if path.suffix in ('.npz', '.pcd'):
            name = '%s_%s' % (path.parent.name, path.stem)
            mount = next((MOUNTS[part] for part in MOUNTS if part in name), MOUNT)
            yield path.parent.name, name, mount, read(path)


def read(path):
    """The points of a file: (n, 3) float32 [m]."""
    if path.suffix == '.npz':
        with np.load(str(path)) as arrays:
            return arrays['xyz'].reshape(-1, 3)
    import pcl
    return np.asarray(pcl.load(str(path)))


def simulated():
    """Scans of the building, on a level floor and tilted by 10 degrees: as recorded."""
    lidar, drive = Lidar(building(1), mount=MOUNT, seed=1), Drive()
    for time in (0, 20, 28, 64, 108):
        points = lidar.scan(drive.pose(time), time)
        xyz = np.stack([points['x'], points['y'], points['z']], axis=1)
        yield 'simulated', 'simulated_%03d' % time, MOUNT, xyz
        c, s = np.cos(np.radians(10)), np.sin(np.radians(10))
        tilt = np.array([(c, 0, s), (0, 1, 0), (-s, 0, c)], np.float32)
        yield 'simulated, tilted', 'simulated_%03d_tilted' % time, MOUNT, xyz @ tilt.T


def draw(name, xyz, plane, obstacles, landmarks, path):
    """Write one picture: the scans from above, the plane from the side."""
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
    side = min(FIELD, 1.1 * np.percentile(np.hypot(x, y), 98))
    above.set(xlim=(-side, side), ylim=(-side, side), aspect='equal', xlabel='x, ahead [m]',
              ylabel='y, to the left [m]', title='%s, from above' % name)
    for level, style, label, va in ((0, 'k-', 'ground', 'top'), (TOLERANCE, 'g:', 'obstacles begin', 'bottom'),
                                    (MAX_HEIGHT, 'r:', 'obstacles end', 'center')):
        beside.plot((-side, side), (level, level), style, linewidth=1)
        beside.annotate(label, (side, level), (3, 0), textcoords='offset points', va=va, fontsize=8)
    tilt = np.degrees(np.arccos(min(1.0, plane.normal[2])))
    beside.set(xlim=(-side, side), ylim=(-1, 4), xlabel='x, ahead [m]', ylabel='height [m]', title=(
        'From the side. Ground %s, %.2f m below the sensor, tilted by %.1f°' % (
            SOURCES[plane.source], plane.offset, tilt)))
    figure.legend(loc='outside upper center', ncols=3, markerscale=4)
    drawing.save(figure, path)


def run(run):
    """Make the scans of simulated and recorded clouds."""
    clouds = [*simulated(), *recorded(SCANS)]
    if run.quick:   # the first of each kind
        clouds = list({cloud[0]: cloud for cloud in reversed(clouds)}.values())
    rows = []
    for kind, name, mount, xyz in run.steps(clouds, say=itemgetter(1)):
        plane = GroundFinder(mount, max_offset=0.3).find(xyz)
        points = virtual_scan.fan(xyz, plane, tolerance=TOLERANCE, slope=SLOPE, range_min=RANGE_MIN)
        obstacles, landmarks = virtual_scan.obstacle_scan(points, MAX_HEIGHT), virtual_scan.landmark_scan(points)
        np.savez_compressed(str(run.folder / (name + '.npz')), xyz=xyz, normal=plane.normal, offset=plane.offset,
                            obstacles=obstacles, landmarks=landmarks)
        rows.append({'kind': kind, 'name': name, 'points': len(xyz), 'ground': plane.source,
                     'obstacle columns': int(np.isfinite(obstacles).sum()),
                     'landmark columns': int(np.isfinite(landmarks).sum())})
    table.write(run.folder / 'scans.csv', rows)


def plot(folder):
    rows = table.read(folder / 'scans.csv')
    for row in rows:
        with np.load(str(folder / (row['name'] + '.npz'))) as found:
            plane = Plane(found['normal'], float(found['offset']), row['ground'])
            draw(row['name'], found['xyz'], plane, found['obstacles'], found['landmarks'],
                 folder / (row['name'] + '.png'))
    shown = {row['kind']: row['name'] for row in reversed(rows)}
    return [Figure(shown[kind] + '.png', 'The legend tells in how many half degrees something is seen; the black arrow '
                   'is the sensor. Below are the points up to %g m to its left and right.' % SLICE)
            for kind in SHOWN if kind in shown] + [
        Table('All of them; their pictures lie in the folder.', list(rows[0])[1:],
              [list(row.values())[1:] for row in rows])]


again(__name__, plot)
