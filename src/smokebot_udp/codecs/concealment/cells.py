# SPDX-License-Identifier: BSD-3-Clause
"""Which parts of a scene have changed between two images of one camera.

The squared differences of the pixels that are known in both images are summed in square cells. A cell whose sum is more
than the sensor's noise, or the error of coded images, explains (a chi-square test) has changed.
"""
import math
from typing import Tuple

import cv2
import numpy as np

from ...arrays import Array, BoolArray, DType, Float32Array

MIN_CELL = 8
"""The smallest useful side of a cell [pixel]."""

PAIRS_EXPECTED = 8
"""Pairs that a cell should have."""

SIGNIFICANCE = 4.75
"""Standard deviations of a normal variable: noise alone makes one cell in a million look changed."""

NOISE_MARGIN = 2.0
"""Factor by which a cell's noise variance may exceed the image's: noise depends on brightness."""

MAX_NOISE_RISE = 1.02
"""The noise variance rises by at most this factor per image, and falls at once. Movement looks like noise, but no
sensor's noise rises like that."""

MIN_INTEGER_VARIANCE = 2.0
"""Lower limit for the variance of the difference of two integers, as if the noise were one count: less is invisible,
and flat parts of a compressed image seem to have none."""

SMOOTHING_FACTOR = 3.0
"""Factor by which a camera that smooths or compresses may reduce the variance between neighbouring pixels."""

NAN_DIFFERENCE = 1e15
"""Difference between a number and NaN. Sums of its square are finite in float32."""


BY_OPENCV = np.dtype(np.uint8), np.dtype(np.uint16)
"""Types of numbers that OpenCV subtracts as well, in a third of the time."""


class CellComparison:
    """Compares images of one size and pixel type, and estimates the sensor's noise from them."""

    def __init__(self) -> None:
        self._noise = 0.0
        """Variance of the difference of two images of the same scene; 0: unknown."""

    def compare(self, new: Array, old: Array, received: BoolArray, known: BoolArray, cell: int,
                error: float = 0.0) -> Tuple[BoolArray, Float32Array]:
        """Which cells changed, (rows, columns) bool, and the number of pairs of each, float32.

        :param new, old: (height, width, channels) numbers of the images
        :param received, known: (height, width) bool: the pixels of the new and of the old image to compare
        :param cell: side of a cell [pixel]
        :param error: mean squared difference that the coding of the images may cause, where they were coded with loss
        """
        squares, pairs = squared_differences(new, old, received & known, cell)
        self._update_noise(squares, pairs, new, received, error)
        return (squares > self.limit(pairs, new, error)) & (pairs > 0), pairs

    def limit(self, pairs: Float32Array, numbers: Array, error: float = 0.0) -> Float32Array:
        """The largest sum of squared differences that noise and coding explain, for each cell.

        :param numbers: (height, width, channels) of an image
        """
        with np.errstate(divide='ignore', invalid='ignore'):
            # quantile of the chi-square distribution: E. B. Wilson and M. M. Hilferty, 1931
            freedom = pairs * numbers.shape[2]
            spread = 2 / (9 * freedom)
            quantile: Float32Array = freedom * (1 - spread + SIGNIFICANCE * np.sqrt(spread)) ** 3
            return NOISE_MARGIN * max(self._noise, _least_variance(numbers), error) * quantile

    def _update_noise(self, squares: Float32Array, pairs: Float32Array, new: Array, received: BoolArray,
                      error: float) -> None:
        """Measure the noise variance of a difference: by how much the median cell changed.

        If all cells moved, that is too much. But neighbouring pixels of one image differ by the noise and by the scene,
        so the noise is not more than that, except for what SMOOTHING_FACTOR allows. Coding with an error may hide as
        much noise: it is seen again when images become better.
        """
        if not pairs.any():
            return
        some = slice(None, None, 7)   # rows: enough of them, and of all subimages
        beside = squared_differences(new[some, 1:], new[some, :-1], received[some, 1:] & received[some, :-1], MIN_CELL)
        noise = min(_median_square(squares, pairs), SMOOTHING_FACTOR * _median_square(*beside)) / new.shape[2]
        least = _least_variance(new)
        if not self._noise:
            self._noise = max(noise, error, least) if math.isfinite(noise) else 0.0
        elif noise:   # with 0 the camera repeats an image, which is no measurement
            self._noise = max(min(noise, self._noise * MAX_NOISE_RISE), min(self._noise, error), least)


def _least_variance(numbers: Array) -> float:
    return MIN_INTEGER_VARIANCE if numbers.dtype.kind == 'u' else 0.0


def numbers_of(items: Array, channel: DType) -> Array:
    """(height, width, channels) view."""
    return items.view(channel).reshape(items.shape + (-1,))


def squared_differences(first: Array, second: Array, both: BoolArray, side: int) -> Tuple[Float32Array, Float32Array]:
    """Sums of the squared differences of two images in cells, and the number of pixels compared in each.

    :param first, second: (height, width, channels) numbers
    :param both: (height, width) bool: the pixels to compare
    :return: both (rows, columns) float32; NAN_DIFFERENCE stands for the difference of a number and NaN
    """
    difference = _differences(first, second, both)
    return _sum_cells(difference, side), _count_cells(both, side)


def _differences(first: Array, second: Array, both: BoolArray) -> Float32Array:
    """(height, width, channels) float32: the differences of two images, or their negatives; 0 where not `both`."""
    if first.dtype in BY_OPENCV and first.size:
        absolute = cv2.copyTo(cv2.absdiff(first, second), both.view(np.uint8))
        of_numbers: Float32Array = absolute.reshape(first.shape).astype(np.float32)
        return of_numbers
    with np.errstate(invalid='ignore', over='ignore'):
        difference: Float32Array = np.subtract(first, second, dtype=np.float32, casting='unsafe')
        if first.dtype.kind == 'f':
            # NaN, as where a depth camera sees nothing, equals NaN only
            undefined = ~(np.abs(difference) < NAN_DIFFERENCE)
            if undefined.any():
                number = np.isfinite(first[undefined]) | np.isfinite(second[undefined])
                difference[undefined] = np.where(number, NAN_DIFFERENCE, 0)
    difference *= both[..., np.newaxis]
    return difference


def _sum_cells(numbers: Float32Array, side: int) -> Float32Array:
    """Sums of the squares in cells: (height, width, channels) -> (ceil(height / side), ceil(width / side))."""
    strips = _strips(numbers, side)
    columns = np.einsum('ijk,ijk->ik', strips, strips)      # of each strip of cells
    sums: Float32Array = columns.reshape(len(strips), -1, side * numbers.shape[2]).sum(axis=2)
    return sums


def _count_cells(mask: BoolArray, side: int) -> Float32Array:
    """The number of pixels in cells, likewise."""
    strips = _strips(mask.view(np.uint8), side)
    columns = strips.sum(axis=1, dtype=np.uint8)            # up to 255: a side is shorter
    counts: Float32Array = columns.reshape(len(strips), -1, side).sum(axis=2, dtype=np.uint16).astype(np.float32)
    return counts


def _strips(pixels: Array, side: int) -> Array:
    """(height, width, ...) -> (ceil(height / side), side, all numbers of a row), rows and columns padded with 0."""
    below, beside = -pixels.shape[0] % side, -pixels.shape[1] % side
    if below or beside:
        pixels = np.pad(pixels, ((0, below), (0, beside)) + ((0, 0),) * (pixels.ndim - 2))
    return pixels.reshape(len(pixels) // side, side, -1)


def _median_square(squares: Float32Array, pairs: Float32Array) -> float:
    """The mean squared difference of the median cell; infinite if there is none."""
    some = (pairs >= min(PAIRS_EXPECTED, pairs.max(initial=1))) & (squares < NAN_DIFFERENCE)
    return float(np.median(squares[some] / pairs[some])) if some.any() else math.inf
