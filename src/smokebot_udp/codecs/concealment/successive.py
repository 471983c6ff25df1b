# SPDX-License-Identifier: BSD-3-Clause
"""How much of a scene has changed from one whole image to the next, where images are coded with a known error.

Coding smooths a scene. Cells where a shift by a pixel would be less than what the errors explain say nothing; those in
which it would be seen, and all that differ, are the cells that count.
"""
import math
from typing import Optional

import numpy as np

from ...arrays import Array
from .cells import MIN_CELL, CellComparison, squared_differences

MAX_PIXELS = 640 * 480
"""Larger images are subsampled: the comparison takes some ms."""

LEAST_CELLS = 0.02
"""Where a smaller share of the cells counts, nothing is known."""


class SuccessiveImages:
    """Compares each image of a stream with the one before."""

    def __init__(self) -> None:
        self._cells = CellComparison()
        self._last: Optional[Array] = None
        self._rms = 0.0

    def changed(self, pixels: Array, rms: float) -> Optional[float]:
        """Compare an image with the one before.

        :param pixels: (height, width) or (height, width, channels); it is kept: the caller must not change it
        :param rms: its estimated error, in the values of the pixels
        :return: share of the cells that count that differ, 0..1; None: nothing is known, as of the first image of a
            shape and type
        """
        numbers = _subsampled(pixels)
        last, before, self._last, self._rms = self._last, self._rms, numbers, rms
        if last is None or (last.shape, last.dtype) != (numbers.shape, numbers.dtype):
            self._cells = CellComparison()
            return None
        everywhere, error = np.ones(numbers.shape[:2], bool), (before + rms) ** 2
        different, pairs = self._cells.compare(numbers, last, everywhere, everywhere, MIN_CELL, error)
        left = np.maximum(np.arange(numbers.shape[1]) - 1, 0)
        shifted, _ = squared_differences(numbers, numbers[:, left], everywhere, MIN_CELL)
        counting = np.count_nonzero(different | (shifted > self._cells.limit(pairs, numbers, error)))
        if counting < max(1.0, LEAST_CELLS * different.size):
            return None
        return float(np.count_nonzero(different)) / counting


def _subsampled(pixels: Array) -> Array:
    """(height, width, channels) of at most MAX_PIXELS, a view where all pixels are taken."""
    height, width = pixels.shape[:2]
    step = math.ceil(math.sqrt(height * width / MAX_PIXELS))
    numbers: Array = pixels.reshape(height, width, -1)
    return numbers if step == 1 else numbers[::step, ::step].copy()
