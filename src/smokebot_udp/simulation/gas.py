# SPDX-License-Identifier: BSD-3-Clause
"""Carbon monoxide: each fire's plume, thinning out around it as if there were no walls."""
import numpy as np

FRESH_AIR = 2.0
"""[ppm]"""

PEAK = 900.0
"""Over a fire [ppm]."""

SPREAD = 1.5
"""At this distance from a fire half of its peak is left [m]."""


def carbon_monoxide(world, point, time):
    """Concentration [ppm] at a point (x, y) at a time [s]."""
    squared = ((world.fires[:, :2] - np.asarray(point)) ** 2).sum(axis=1)
    draught = 1 + 0.15 * np.sin(0.4 * time + 2.0 * np.arange(len(squared)))
    return FRESH_AIR + float((PEAK * draught / (1 + squared / SPREAD ** 2)).sum())


class GasSensor:
    """:param noise: standard deviation [ppm], 0: none"""

    def __init__(self, world, seed, noise=1.0):
        self.world, self.seed, self.noise = world, seed, noise

    def measure(self, pose, time):
        """Concentration [ppm] at a pose (x, y, yaw) at a time [s], never below 0."""
        random = np.random.RandomState([self.seed, int(time * 1e3) & 0x7fffffff])
        return max(0.0, carbon_monoxide(self.world, pose[:2], time) + self.noise * random.standard_normal())
