# SPDX-License-Identifier: BSD-3-Clause
"""The thermal camera: a radiometric image in 16-bit counts of 0.04 K, like FLIR's high-temperature range.

Long-wave infrared passes through the smoke, which therefore is not seen.
"""
import numpy as np

from ..arrays import Array
from .noise import NoisePool
from .pinhole import Pinhole, remainder, warmth
from .pose import Pose
from .world import FLOOR, World

KELVIN_PER_COUNT = 0.04
"""Temperature difference of a count [K]: 0 degC is 6829 counts, 300 degC is 14329; the range ends at 2348 degC."""

CELSIUS = 273.15
"""Temperature of 0 degC [K]."""


def to_counts(celsius: Array) -> Array:
    """Temperatures [degC] in counts, as float; any shape."""
    return np.asarray((celsius + CELSIUS) / KELVIN_PER_COUNT)


class ThermalCamera:
    """:param noise: standard deviation of a pixel [K]: the NETD of a microbolometer"""

    def __init__(self, world: World, pinhole: Pinhole, seed: int, noise: float = 0.05) -> None:
        self.world, self.pinhole = world, pinhole
        shape = pinhole.height, pinhole.width
        self._noise = NoisePool(shape, seed, noise) if noise else None
        columns = np.random.RandomState(seed).standard_normal((1, shape[1])) * 0.4 * noise
        self._pattern = columns.astype(np.float32)   # fixed-pattern noise of the sensor's columns

    def look(self, pose: Pose, time: float) -> Array:
        """Take an image from a pose at a time [s]: (height, width) uint16 counts."""
        view = self.pinhole.look(self.world, pose)
        temperatures = self.world.temperatures(time)
        base = np.append(temperatures, (self.world.ambient + 14.0, self.world.ambient - 1.0))
        # ROOF and FLOOR are the last two
        celsius: Array = np.take(base.astype(np.float32), view.surface, mode='wrap')
        # walls are uneven, and warmer towards the ceiling, where the smoke is
        np.add(celsius, np.float32(3.5 / 2.7) * np.square(view.z), out=celsius, where=view.surface >= 0)
        uneven = np.sin(7.0 * view.x + 3.0 * view.z)
        uneven *= np.sin(7.0 * view.y - 2.0 * view.z)
        uneven *= np.float32(0.35)
        celsius += uneven
        tiles = remainder(0.5 * (np.floor(2.5 * view.x) + np.floor(2.5 * view.y)), 2)
        np.add(celsius, tiles, out=celsius, where=view.surface == FLOOR)
        for fire, temperature in zip(self.world.fires, temperatures[self.world.flicker > 0]):
            celsius += np.float32(0.05 * temperature) * warmth(view, fire, 1.5)
        if self._noise is not None:
            celsius += self._noise.draw(time)
            celsius += self._pattern
        return np.clip(to_counts(celsius) + 0.5, 0, 65535).astype(np.uint16)
