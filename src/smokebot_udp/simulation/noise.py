# SPDX-License-Identifier: BSD-3-Clause
"""Sensor noise at almost no cost: a window of one field of normal random numbers, at another place each time."""
from typing import Tuple

import numpy as np

from ..arrays import Float32Array

MARGIN = 61
"""Number of places of the window along each axis."""


class NoisePool:
    """:param shape: (height, width); sigma: standard deviation"""

    def __init__(self, shape: Tuple[int, int], seed: int, sigma: float) -> None:
        self.shape, self.seed = shape, seed
        random = np.random.RandomState(seed)
        self._field = (random.standard_normal((shape[0] + MARGIN, shape[1] + MARGIN)) * sigma).astype(np.float32)

    def draw(self, time: float) -> Float32Array:
        """(height, width) float32, the same for the same time [s]."""
        row, column = np.random.RandomState([self.seed, int(time * 1e3) & 0x7fffffff]).randint(0, MARGIN, 2)
        return self._field[row:row + self.shape[0], column:column + self.shape[1]]
