# SPDX-License-Identifier: BSD-3-Clause
"""Laser scans in simulated rooms: 1081 ranges over 270 degrees, as of a Hokuyo UTM-30LX."""
import math
from typing import Any, List, Sequence, Tuple

import numpy as np
from sensor_msgs.msg import LaserScan

from smokebot_udp.arrays import Float32Array

ROOM = ((-4.0, -3.0), (6.0, -3.0), (6.0, 5.0), (-4.0, 5.0))
"""Corners [m]."""


def scan_message(ranges: Float32Array) -> Any:
    """A LaserScan of (1081,) ranges [m]."""
    return LaserScan(ranges=ranges, angle_min=-0.75 * math.pi, angle_max=0.75 * math.pi,
                     angle_increment=math.radians(0.25), range_min=0.02, range_max=30.0)


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
