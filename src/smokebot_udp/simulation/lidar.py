# SPDX-License-Identifier: BSD-3-Clause
"""A spinning LiDAR with the dimensions of a Velodyne VLP-16."""
from typing import Tuple

import numpy as np

from ..arrays import Array, DType, Float32Array, Records
from .noise import NoisePool
from .pose import Pose
from .rays import ranges
from .world import World

RINGS = np.radians(np.arange(-15, 16, 2))
"""(16,) elevations of the lasers, from the lowest [rad]."""

COLUMNS = 1440
"""Directions per revolution: one each 0.25 degrees."""

MAX_RANGE = 100.0
"""[m]"""

POINT: DType = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4'), ('ring', '<u2'),
                         ('time', '<f4')])
"""A point as published by velodyne_pointcloud: sensor coordinates [m], intensity 0..255, laser 0..15 from the lowest,
and time after the stamp [s], here always 0: a simulated revolution takes no time."""


class Lidar:
    """:param mount: height above the floor [m]; noise: standard deviation of a range [m], 0: none"""

    def __init__(self, world: World, mount: float, seed: int, noise: float = 0.03) -> None:
        self.world, self.mount = world, mount
        self._noise = NoisePool((COLUMNS, len(RINGS)), seed, noise) if noise else None
        self._azimuths = np.arange(COLUMNS) * (2 * np.pi / COLUMNS)
        self._east, self._north = (f(self._azimuths).astype(np.float32)[:, np.newaxis] for f in (np.cos, np.sin))
        self._level, self._up = (f(RINGS).astype(np.float32) for f in (np.cos, np.sin))
        # bright surfaces reflect more; the last three: NOTHING, ROOF, FLOOR = -3, -2, -1
        self._brightness = np.append(world.colour.mean(axis=1), (0.0, 110.0, 90.0)).astype(np.float32)

    def look(self, pose: Pose) -> Tuple[Float32Array, Array]:
        """Cast the rays from a pose, without noise.

        :return: (COLUMNS, 16) float32 distances [m], inf where nothing is within MAX_RANGE; (COLUMNS, 16) int16
            surface ids
        """
        level, surface = ranges(self.world, pose[:2], self.mount, self._azimuths + pose[2], np.tan(RINGS))
        distance = level / self._level
        distance[distance > MAX_RANGE] = np.inf
        return distance, surface

    def scan(self, pose: Pose, time: float) -> Records:
        """One revolution from a pose at a time [s].

        :return: (23 040,) POINT array, column by column; coordinates are NaN where nothing is in range
        """
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
