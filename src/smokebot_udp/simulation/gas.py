# SPDX-License-Identifier: BSD-3-Clause
"""Carbon monoxide: the plume of each fire thins out around it as if there were no walls."""
from typing import Sequence

import numpy as np

from .pose import Pose
from .world import World

FRESH_AIR = 2.0
"""[ppm]"""

PEAK = 900.0
"""Concentration above a fire [ppm]."""

SPREAD = 1.5
"""Distance from a fire at which the concentration is half of the peak [m]."""


def carbon_monoxide(world: World, point: Sequence[float], time: float) -> float:
    """Concentration [ppm] at a point (x, y) [m] at a time [s]."""
    squared = ((world.fires[:, :2] - np.asarray(point)) ** 2).sum(axis=1)
    draught = 1 + 0.15 * np.sin(0.4 * time + 2.0 * np.arange(len(squared)))
    return FRESH_AIR + float((PEAK * draught / (1 + squared / SPREAD ** 2)).sum())


class GasSensor:
    """:param noise: standard deviation [ppm]; 0: none"""

    def __init__(self, world: World, seed: int, noise: float = 1.0) -> None:
        self.world, self.seed, self.noise = world, seed, noise

    def measure(self, pose: Pose, time: float) -> float:
        """Concentration [ppm], never below 0, at a pose at a time [s]."""
        random = np.random.RandomState([self.seed, int(time * 1e3) & 0x7fffffff])
        return max(0.0, carbon_monoxide(self.world, pose[:2], time) + self.noise * random.standard_normal())
