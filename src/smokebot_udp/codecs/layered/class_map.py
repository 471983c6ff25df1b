# SPDX-License-Identifier: BSD-3-Clause
"""Coding of a map of four classes, mostly in areas: which cells are NaN, +Inf or -Inf (REP-117).

The map is exact, or one of blocks of cells, each of the class that most of its cells have.
"""
from typing import Iterator, Tuple

import numpy as np

from ...arrays import Array, UInt8Array
from .loops import borrowing, int64
from .range_coder import State, code

CLASSES = 4
MAX_EXPONENT = 7
"""Blocks have sides of 2^MAX_EXPONENT cells at most."""


@borrowing
def _guess(classes: Array, y: int, x: int) -> Tuple[int, int]:
    """The class of the cell on the left or above, and a context 0..63 from three neighbours."""
    left = int64(classes[y, x - 1]) if x > 0 else 0
    above = int64(classes[y - 1, x]) if y > 0 else left
    beyond = int64(classes[y - 1, x + 1]) if y > 0 and x + 1 < classes.shape[1] else above
    return left, (left & 3) << 4 | (above & 3) << 2 | (beyond & 3)


@borrowing
def _code(encoding: bool, classes: Array, odds: Array, data: Array, state: State) -> Tuple[bool, State]:
    for y in range(classes.shape[0]):
        for x in range(classes.shape[1]):
            left, context = _guess(classes, y, x)
            value = int64(classes[y, x])
            other, state = code(encoding, data, odds, context, 1 if value != left else 0, state)
            if other < 0:
                return False, state
            if other:
                high, state = code(encoding, data, odds, 64 + 2 * context, value >> 1, state)
                if high < 0:
                    return False, state
                bit, state = code(encoding, data, odds, 192 + 2 * context + high, value & 1, state)
                if bit < 0:
                    return False, state
                value = 2 * high + bit
            elif not encoding:
                value = left
            if not encoding:
                classes[y, x] = value
    return True, state


def reductions(classes: UInt8Array) -> Iterator[UInt8Array]:
    """Maps of blocks of 2, 4, ... cells: (ceil(height / 2), ceil(width / 2)) uint8, ..."""
    counts = np.stack([classes == kind for kind in range(CLASSES)]).astype(np.int32)
    for _ in range(MAX_EXPONENT):
        counts = np.pad(counts, ((0, 0), (0, counts.shape[1] % 2), (0, counts.shape[2] % 2)))
        counts = counts[:, ::2] + counts[:, 1::2]
        counts = counts[:, :, ::2] + counts[:, :, 1::2]
        yield counts.argmax(axis=0).astype(np.uint8)


def reduced_size(height: int, width: int, exponent: int) -> Tuple[int, int]:
    """(rows, columns) of a map of blocks of 2^exponent cells a side."""
    return -(-height >> exponent), -(-width >> exponent)


def enlarged(blocks: UInt8Array, exponent: int, height: int, width: int) -> UInt8Array:
    """(height, width): the classes of the cells of blocks of 2^exponent."""
    cells: UInt8Array = blocks[np.arange(height)[:, np.newaxis] >> exponent, np.arange(width) >> exponent]
    return cells


def code_classes(encoding: bool, classes: UInt8Array, data: UInt8Array, state: State) -> Tuple[bool, State]:
    """Code the map, (height, width) uint8 0..3; whether it is complete, and the coder's state."""
    return _code(encoding, classes, np.full(320, 1 << 31 | 1 << 15, np.uint32), data, state)
