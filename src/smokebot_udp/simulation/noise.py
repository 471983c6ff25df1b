# SPDX-License-Identifier: BSD-3-Clause
"""Sensor noise that costs nothing: windows of one field of normal numbers, another for each moment."""
import numpy as np

MARGIN = 61


class NoisePool:
    """:param shape: (height, width); sigma: standard deviation"""

    def __init__(self, shape, seed, sigma):
        self.shape, self.seed = shape, seed
        random = np.random.RandomState(seed)
        self._field = (random.standard_normal((shape[0] + MARGIN, shape[1] + MARGIN)) * sigma).astype(np.float32)

    def draw(self, time):
        """(height, width) float32, the same for the same time [s]."""
        row, column = np.random.RandomState([self.seed, int(time * 1e3) & 0x7fffffff]).randint(0, MARGIN, 2)
        return self._field[row:row + self.shape[0], column:column + self.shape[1]]
