# SPDX-License-Identifier: BSD-3-Clause
"""The thermal camera: a radiometric picture in 16-bit counts of 0.04 K, as FLIR's high-temperature range."""
import numpy as np

from .noise import NoisePool

KELVIN_PER_COUNT = 0.04
"""counts = temperature [K] / 0.04: 0 degC is 6829, 300 degC 14329; the top of the range is 2348 degC."""

CELSIUS = 273.15


def to_counts(celsius):
    """Counts, as float, of a temperature [degC]."""
    return (celsius + CELSIUS) / KELVIN_PER_COUNT


class ThermalCamera:
    """:param noise: standard deviation of a pixel [K]: a microbolometer's NETD"""

    def __init__(self, world, pinhole, seed, noise=0.05):
        self.world, self.pinhole = world, pinhole
        shape = pinhole.height, pinhole.width
        self._noise = NoisePool(shape, seed, noise) if noise else None
        columns = np.random.RandomState(seed).standard_normal((1, shape[1])) * 0.4 * noise
        self._pattern = columns.astype(np.float32)   # what the sensor's read-out adds, always the same

    def look(self, pose, time):
        """(height, width) uint16 counts from a pose (x, y, yaw) at a time [s]."""
        view = self.pinhole.look(self.world, pose)
        base = np.append(self.world.temperatures(time), (self.world.ambient + 14.0, self.world.ambient - 1.0))
        celsius = base.astype(np.float32)[view.surface]    # ROOF and FLOOR, -2 and -1, are the last two
        # walls are warmer towards the ceiling, where the smoke lies, and uneven
        celsius += 3.5 * view.z ** 2 / 2.7 * (view.surface >= 0)
        celsius += 0.35 * np.sin(7.0 * view.x + 3.0 * view.z) * np.sin(7.0 * view.y - 2.0 * view.z)
        celsius += 0.5 * (np.floor(2.5 * view.x) + np.floor(2.5 * view.y)) % 2 * (view.surface == -1)
        for fire, heat in zip(self.world.fires, self._heat(time)):
            celsius += self._warmed(view, fire, heat)
        if self._noise is not None:
            celsius += self._noise.draw(time) + self._pattern
        return np.clip(to_counts(celsius) + 0.5, 0, 65535).astype(np.uint16)

    def _heat(self, time):
        return self.world.temperatures(time)[self.world.flicker > 0]

    def _warmed(self, view, fire, heat):
        """What a fire has warmed around it [K]."""
        squared = (view.x - np.float32(fire[0])) ** 2 + (view.y - np.float32(fire[1])) ** 2
        return np.float32(0.05 * heat) / (1 + 1.5 * squared)
