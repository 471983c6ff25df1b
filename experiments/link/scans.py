# SPDX-License-Identifier: BSD-3-Clause
"""Bytes of laser scans, as they are and in steps of 1 mm."""
import math
import pathlib
from typing import Dict, List, Sequence, Tuple, Union

import numpy as np
from sensor_msgs.msg import LaserScan

from evaluation.offline_link import Receiver, Sender, received, wire_size
from evaluation.recordings import RECORDINGS
from smokebot_udp.arrays import Float32Array

from .. import table
from ..runner import Figure, Run, Table

TITLE = 'Laser scans on the wire'

EXPLANATION = """
1081 ranges over 270 degrees, as of a Hokuyo UTM-30LX, in rooms with boxes, with noise of the datasheet's 10 mm and of
3 and 20 mm; and the scans of a Hokuyo URG with 681 ranges, where the recording is at hand. Ranges are floats; those of
the URG are whole millimetres.
"""

NOISES = 0.003, 0.01, 0.02
"""[m]"""

SCANS, QUICK_SCANS = 20, 3
RECORDED = 'hokuyo_demo.bag'
ROOM = ((-4.0, -3.0), (6.0, -3.0), (6.0, 5.0), (-4.0, 5.0))
"""Corners [m]."""


def rooms(noise: float, count: int, seed: int) -> Float32Array:
    """(count, 1081) ranges in rooms of one size, with other boxes each [m]."""
    random = np.random.RandomState(seed)
    found = []
    for _ in range(count):
        walls = _sides(ROOM)
        for _ in range(14):
            (x, y), (w, h) = random.uniform(-3, 5, 2), random.uniform(0.05, 0.5, 2)
            if math.hypot(x, y) >= 1:
                walls += _sides(((x - w, y - h), (x + w, y - h), (x + w, y + h), (x - w, y + h)))
        found.append(_nearest(np.array(walls)) + random.normal(0, noise, 1081))
    return np.array(found, np.float32)


def _sides(corners: Sequence[Tuple[float, float]]) -> List[Tuple[float, ...]]:
    """The walls between corners."""
    return [(*a, *b) for a, b in zip(corners, [*corners[1:], corners[0]])]


def _nearest(walls: Float32Array) -> Float32Array:
    """(1081,) ranges from the origin to (n, 4) walls, x and y of both ends [m]."""
    angles = np.radians(np.linspace(-135, 135, 1081))[:, np.newaxis]
    cosine, sine = np.cos(angles), np.sin(angles)
    x, y, dx, dy = walls[:, 0], walls[:, 1], walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    with np.errstate(all='ignore'):
        across = cosine * dy - sine * dx
        along, place = (x * dy - y * dx) / across, (x * sine - y * cosine) / across
    hits = np.where((along > 0) & (place >= 0) & (place <= 1), along, np.inf)
    nearest: Float32Array = hits.min(axis=1)
    return nearest


def recorded(count: int) -> Float32Array:
    """(n, 681) ranges of the recording; n is 0 where it is not at hand."""
    path = RECORDINGS / 'bags' / RECORDED
    if not path.exists():
        return np.zeros((0, 681), np.float32)
    import rosbag
    with rosbag.Bag(str(path)) as bag:
        ranges = [message.ranges for _, message, _ in bag.read_messages('/scan')]
    return np.array(ranges[::max(1, len(ranges) // count)], np.float32)


def run(run: Run) -> None:
    """Write scans.csv."""
    count = QUICK_SCANS if run.quick else SCANS
    sources: Dict[str, Float32Array] = {'%g mm of noise' % (1e3 * noise): rooms(noise, count, run.seed)
                                        for noise in NOISES}
    sources['recorded URG'] = recorded(count)
    rows = []
    for name, scans in sources.items():
        if not len(scans):
            continue
        sizes: Dict[str, List[int]] = {}
        errors = []
        for ranges in scans:
            message = LaserScan(ranges=ranges, angle_increment=math.radians(0.25), range_min=0.02, range_max=30.0)
            for words, exact in ('exact', True), ('1 mm', False):
                frames = Sender('scan', exact=exact).frames(message)
                sizes.setdefault(words, []).append(wire_size(frames))
            shown = received(Receiver('scan'), frames, np.ones(sum(map(len, frames)), bool))
            assert shown is not None
            errors.append(abs(np.asarray(shown.ranges, float) - ranges.astype(float)).max())
        rows.append({'scans': name, 'ranges': scans.shape[1], 'exact [byte]': float(np.mean(sizes['exact'])),
                     '1 mm [byte]': float(np.mean(sizes['1 mm'])), 'most [byte]': max(sizes['1 mm']),
                     'error [mm]': 1e3 * max(errors)})
    table.write(run.folder / 'scans.csv', rows)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """The table."""
    return [bytes_table(folder)]


def bytes_table(folder: pathlib.Path) -> Table:
    """Bytes and errors."""
    rows = table.read(folder / 'scans.csv')
    return Table('A scan on the wire, whole IP packets: mean, the longest one, and the largest error of a range:',
                 ['scans', 'ranges', 'exact [byte]', '1 mm [byte]', 'most [byte]', 'error [mm]'],
                 [[row['scans'], '%d' % row['ranges'], *('%.0f' % row[key] for key in (
                     'exact [byte]', '1 mm [byte]', 'most [byte]')), '%.2f' % row['error [mm]']] for row in rows])


DOC_TABLES = {'bytes': bytes_table}
