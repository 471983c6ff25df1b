# SPDX-License-Identifier: BSD-3-Clause
"""How much images differ, and what that takes."""
import math

import numpy as np

from ...arrays import Array
from .loops import compiled, int32, int64, uint64


@compiled
def _squares(pixels: Array, others: Array, at: int, count: int) -> int:
    """The sum of squared differences of some values; the numbers are uint64."""
    total = int64(0)
    for i in range(count):
        apart = int64(int32(int32(pixels[at + i]) - int32(others[at + i])))
        total += apart * apart
    return int(total)


@compiled
def _sum_of_squares(pixels: Array, others: Array, length: int, step: int) -> int:
    """The sum of the squared differences of flat images in each `step`-th row of `length` values."""
    total = 0
    for first in range(0, len(pixels), step * length):
        total += _squares(pixels, others, uint64(first), uint64(length))
    return total


@compiled
def _tally(pixels: Array, others: Array, length: int, step: int, counts: Array) -> int:
    """Count the differences of each `step`-th row of flat images, 0 in the middle; how many there are."""
    middle, total = len(counts) // 2, 0
    for first in range(0, len(pixels), step * length):
        for i in range(uint64(first), uint64(first + length)):
            counts[uint64(middle + int64(pixels[i]) - int64(others[i]))] += 1
        total += length
    return total


@compiled
def _bits(counts: Array, total: int) -> float:
    """The entropy of as many values."""
    bits = 0.0
    for i in range(len(counts)):
        if counts[i]:
            bits -= counts[i] * math.log(counts[i] / total)
    return bits / math.log(2)


def flat(pixels: Array) -> Array:
    """All values; writable, as numba would compile all again for others."""
    return np.require(pixels, requirements=['C', 'A', 'W']).reshape(-1)


def mean_square(pixels: Array, others: Array, step: int = 1) -> float:
    """The mean squared difference of each `step`-th row of two images [count^2].

    :param pixels: (height, width) uint8 or uint16, or (height, width, 3) uint8
    :param others: of the same shape and type
    """
    length = pixels[0].size
    total: int = _sum_of_squares(flat(pixels), flat(others), length, step)
    return float(total / (length * -(-len(pixels) // step)))


def entropy(pixels: Array, others: Array, step: int = 1) -> float:
    """What the difference of two images takes, each value by itself, by that of each `step`-th row [byte]."""
    counts = np.zeros(2 * 256 ** pixels.itemsize - 1, np.int64)
    total = _tally(flat(pixels), flat(others), pixels[0].size, step, counts)
    bits: float = _bits(counts, total)
    return float(bits / 8 * pixels.size / total)
