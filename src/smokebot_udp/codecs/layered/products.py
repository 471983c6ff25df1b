# SPDX-License-Identifier: BSD-3-Clause
"""Products of matrices over GF(256), eight bytes at a time.

A row times a number is the sum (XOR) of the row's multiples by the powers of two in that number, and doubling a packed
row takes a few operations on 64-bit words.
"""
import numpy as np

from ...arrays import Array
from .field import POLYNOMIAL
from .loops import compiled, int64

_TOP_BITS = np.uint64(0x8080808080808080)
_ONE, _SEVEN, _REDUCTION = np.uint64(1), np.uint64(7), np.uint64(POLYNOMIAL & 0xff)


@compiled
def _double(row: Array, result: Array) -> None:
    for i in range(len(row)):
        overflow = row[i] & _TOP_BITS
        result[i] = ((row[i] ^ overflow) << _ONE) ^ (overflow >> _SEVEN) * _REDUCTION


@compiled
def _add(row: Array, result: Array) -> None:
    for i in range(len(row)):
        result[i] ^= row[i]


@compiled
def add_products(matrix: Array, rows: Array, result: Array) -> None:
    """Add the product of two matrices to a third.

    :param matrix: (r, t) uint8
    :param rows: (t, w) uint64: eight elements in each
    :param result: (r, w) uint64
    """
    multiples = np.empty((8, rows.shape[1]), np.uint64)
    for j in range(len(rows)):
        multiples[0] = rows[j]
        for bit in range(1, 8):
            _double(multiples[bit - 1], multiples[bit])
        for i in range(len(matrix)):
            factor = int64(matrix[i, j])
            for bit in range(8):
                if factor >> bit & 1:
                    _add(multiples[bit], result[i])
