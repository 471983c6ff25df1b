# SPDX-License-Identifier: BSD-3-Clause
"""Unsigned integers of any widths in one array of bytes, written and read all at once. The highest bit comes first."""
import numpy as np

from ...arrays import Array, IntArray, UInt8Array

WORD = 32
"""Fields are added up in words of this size [bit]: sums of their parts are exact in float64."""

ONES = np.uint64((1 << WORD) - 1)

MAX_WIDTH = 57
"""Maximum width of a field that is read: with the 7 bits before it in its first byte it fits in 64 [bit]."""

PADDING = 8
"""`read` needs this many bytes behind the start of the last field."""


class FieldWriter:
    """Writes fields to bytes that are 0 elsewhere.

    :param size: number of bytes
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._words = np.zeros(size * 8 // WORD + 3)

    def write(self, positions: IntArray, widths: IntArray, values: Array) -> None:
        """Write fields where nothing was written yet.

        :param positions: (...) int, of each field's first bit; fields neither overlap nor reach beyond the end
        :param widths: (...) int, 0..64
        :param values: (...) int, 0 <= value < 2 ** width
        """
        values = values.astype(np.uint64)
        if widths.max() > WORD:
            low = np.minimum(widths, WORD)
            self.write(positions, widths - low, values >> low.astype(np.uint64))
            positions, widths = positions + widths - low, low
            values = values & ((np.uint64(1) << low.astype(np.uint64)) - np.uint64(1))
        # where the field is in two words; a shift by 64 is one of 0
        in_words = values << (2 * WORD - widths - (positions & (WORD - 1))).astype(np.uint64)
        first = (positions // WORD).reshape(-1)
        for number, part in enumerate((in_words >> np.uint64(WORD), in_words & ONES)):
            self._words[number:] += np.bincount(first, part.view(np.int64).reshape(-1), len(self._words) - number)

    def data(self) -> UInt8Array:
        """(size,) uint8: what was written."""
        data: UInt8Array = self._words.astype('>u4').view(np.uint8)[:self._size]
        return data


def read(data: UInt8Array, positions: IntArray, widths: IntArray) -> Array:
    """The fields that a FieldWriter wrote.

    :param data: (m,) uint8, contiguous, with PADDING bytes behind the start of the last field
    :param positions: (n,) int, of each field's first bit
    :param widths: (n,) int, 0..MAX_WIDTH
    :return: (n,) uint64
    """
    windows: Array = np.ndarray((len(data) - PADDING + 1,), '>u8', data, 0, (1,))
    left = windows[positions >> 3].astype(np.uint64) << (positions & 7).astype(np.uint64)
    values: Array = left >> np.uint64(1) >> (63 - widths).astype(np.uint64)
    return values


def bit_lengths(values: Array) -> IntArray:
    """(...) int: the bits that each number needs; 0 of 0.

    :param values: (...) uint64, below 2 ** 53
    """
    lengths: IntArray = np.frexp(values.astype(np.float64))[1].astype(int)
    return lengths


def zigzag(differences: IntArray) -> Array:
    """0, -1, 1, -2, ... as 0, 1, 2, 3, ...: (...) uint64."""
    numbers: Array = np.where(differences < 0, -2 * differences - 1, 2 * differences).astype(np.uint64)
    return numbers


def unzigzag(numbers: Array) -> IntArray:
    """The inverse of zigzag.

    :param numbers: (...) uint64, below 2 ** 62
    """
    half = (numbers >> np.uint64(1)).astype(int)
    differences: IntArray = np.where(numbers & np.uint64(1), -half - 1, half)
    return differences

