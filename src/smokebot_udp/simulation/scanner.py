# SPDX-License-Identifier: BSD-3-Clause
"""A planar laser scanner, in the same building as the other sensors."""
import numpy as np

from .noise import NoisePool
from .rays import NOTHING, ranges

ANGLES = np.radians(np.arange(-135.0, 135.1, 0.5))
"""(541,) directions of the rays, to the left [rad]."""

NEAREST, FARTHEST = 0.05, 30.0
"""[m]"""


class Scanner:
    """:param mount: its height above the floor [m]; noise: standard deviation of a range [m], 0: none"""

    def __init__(self, world, mount, seed, noise=0.01):
        self.world, self.mount = world, mount
        self._noise = NoisePool((len(ANGLES), 1), seed, noise) if noise else None
        self._brightness = np.append(world.colour.mean(axis=1), 0.0)   # the last one: NOTHING

    def scan(self, pose, time):
        """From a pose (x, y, yaw) at a time [s]: (541,) float32 ranges [m], inf where nothing is within FARTHEST
        (REP-117), and (541,) float32 intensities, 0..255."""
        distance, surface = (value[:, 0] for value in ranges(
            self.world, pose[:2], self.mount, ANGLES + pose[2], np.array([0.0]), floor=False))
        if self._noise is not None:
            distance = distance + self._noise.draw(time)[:, 0]
        distance[distance > FARTHEST] = np.inf
        brightness = self._brightness[np.where(surface == NOTHING, -1, surface)]
        return np.maximum(distance, NEAREST), (brightness / (1 + distance / 20)).astype(np.float32)
