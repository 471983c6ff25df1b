# SPDX-License-Identifier: BSD-3-Clause
"""A planar laser scanner."""
from typing import Tuple

import numpy as np

from ..arrays import Float32Array
from .noise import NoisePool
from .pose import Pose
from .rays import NOTHING, ranges
from .world import World

ANGLES = np.radians(np.arange(-135.0, 135.1, 0.5))
"""(541,) directions of the rays, counter-clockwise from forward [rad]."""

MIN_RANGE, MAX_RANGE = 0.05, 30.0
"""[m]"""


class Scanner:
    """:param mount: height above the floor [m]; noise: standard deviation of a range [m], 0: none"""

    def __init__(self, world: World, mount: float, seed: int, noise: float = 0.01) -> None:
        self.world, self.mount = world, mount
        self._noise = NoisePool((len(ANGLES), 1), seed, noise) if noise else None
        self._brightness = np.append(world.colour.mean(axis=1), 0.0)   # the last one: NOTHING

    def scan(self, pose: Pose, time: float) -> Tuple[Float32Array, Float32Array]:
        """Scan from a pose at a time [s].

        :return: (541,) float32 ranges [m], +inf where nothing is within MAX_RANGE (REP-117); (541,) float32
            intensities, 0..255
        """
        distance, surface = (value[:, 0] for value in ranges(
            self.world, pose[:2], self.mount, ANGLES + pose[2], np.array([0.0]), floor=False))
        if self._noise is not None:
            distance = distance + self._noise.draw(time)[:, 0]
        distance[distance > MAX_RANGE] = np.inf
        brightness = self._brightness[np.where(surface == NOTHING, -1, surface)]
        return np.maximum(distance, MIN_RANGE), (brightness / (1 + distance / 20)).astype(np.float32)
