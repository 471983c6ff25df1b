# SPDX-License-Identifier: BSD-3-Clause
"""A spinning LiDAR with the measures of a Velodyne VLP-16, in the same building as the cameras."""
import numpy as np

from .noise import NoisePool
from .rays import NOTHING, ranges

RINGS = np.radians(np.arange(-15, 16, 2))
"""(16,) elevation of each laser, from below [rad]."""

COLUMNS = 1440
"""Directions of a revolution: 0.25 degrees each."""

FARTHEST = 100.0
"""[m]"""

POINT = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4'), ('ring', '<u2')])
"""A point in the sensor's own axes [m], its intensity 0..255, its laser 0..15 from below."""


class Lidar:
    """:param mount: its height above the floor [m]; noise: standard deviation of a range [m], 0: none"""

    def __init__(self, world, mount, seed, noise=0.03):
        self.world, self.mount = world, mount
        self._noise = NoisePool((COLUMNS, len(RINGS)), seed, noise) if noise else None
        self._azimuths = np.arange(COLUMNS) * (2 * np.pi / COLUMNS)

    def scan(self, pose, time):
        """One revolution from a pose (x, y, yaw): (23 040,) POINT array, column by column; NaN where nothing is."""
        level, surface = ranges(self.world, pose[:2], self.mount, self._azimuths + pose[2], np.tan(RINGS))
        distance = level / np.cos(RINGS)
        if self._noise is not None:
            distance = distance + self._noise.draw(time)
        distance[(surface == NOTHING) | (distance > FARTHEST)] = np.nan
        level = (distance * np.cos(RINGS)).astype(np.float32)
        points = np.zeros(distance.shape, POINT)
        points['x'] = level * np.cos(self._azimuths)[:, np.newaxis]
        points['y'] = level * np.sin(self._azimuths)[:, np.newaxis]
        points['z'] = distance * np.sin(RINGS)
        # bright walls reflect more; the last three: NOTHING, ROOF, FLOOR = -3, -2, -1
        brightness = np.append(self.world.colour.mean(axis=1), (0.0, 110.0, 90.0))
        points['intensity'] = brightness[surface] / (1 + distance / 20)
        points['ring'] = np.arange(len(RINGS))
        return points.reshape(-1)
