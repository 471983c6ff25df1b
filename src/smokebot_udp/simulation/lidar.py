# SPDX-License-Identifier: BSD-3-Clause
"""A spinning LiDAR with the measures of a Velodyne VLP-16, in the same building as the cameras."""
import numpy as np

from .noise import NoisePool
from .rays import ranges

RINGS = np.radians(np.arange(-15, 16, 2))
"""(16,) elevation of each laser, from below [rad]."""

COLUMNS = 1440
"""Directions of a revolution: 0.25 degrees each."""

FARTHEST = 100.0
"""[m]"""

POINT = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4'), ('ring', '<u2'), ('time', '<f4')])
"""A point as velodyne_pointcloud's: in the sensor's own axes [m], its intensity 0..255, its laser 0..15 from below,
its time after the stamp [s], which is 0: this revolution takes none."""


class Lidar:
    """:param mount: its height above the floor [m]; noise: standard deviation of a range [m], 0: none"""

    def __init__(self, world, mount, seed, noise=0.03):
        self.world, self.mount = world, mount
        self._noise = NoisePool((COLUMNS, len(RINGS)), seed, noise) if noise else None
        self._azimuths = np.arange(COLUMNS) * (2 * np.pi / COLUMNS)
        self._east, self._north = (f(self._azimuths).astype(np.float32)[:, np.newaxis] for f in (np.cos, np.sin))
        self._level, self._up = (f(RINGS).astype(np.float32) for f in (np.cos, np.sin))
        # bright walls reflect more; the last three: NOTHING, ROOF, FLOOR = -3, -2, -1
        self._brightness = np.append(world.colour.mean(axis=1), (0.0, 110.0, 90.0)).astype(np.float32)

    def look(self, pose):
        """What each ray meets from a pose (x, y, yaw): (COLUMNS, 16) float32 distance [m], inf where nothing is within
        FARTHEST, and (COLUMNS, 16) int16 surface id."""
        level, surface = ranges(self.world, pose[:2], self.mount, self._azimuths + pose[2], np.tan(RINGS))
        distance = level / self._level
        distance[distance > FARTHEST] = np.inf
        return distance, surface

    def scan(self, pose, time):
        """One revolution from a pose (x, y, yaw): (23 040,) POINT array, column by column; NaN where nothing is."""
        distance, surface = self.look(pose)
        if self._noise is not None:
            distance += self._noise.draw(time)
        distance[np.isinf(distance)] = np.nan
        level = distance * self._level
        points = np.zeros(distance.shape, POINT)
        points['x'], points['y'], points['z'] = level * self._east, level * self._north, distance * self._up
        points['intensity'] = self._brightness[surface] / (1 + distance / 20)
        points['ring'] = np.arange(len(RINGS))
        return points.reshape(-1)
