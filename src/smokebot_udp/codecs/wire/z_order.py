# SPDX-License-Identifier: BSD-3-Clause
"""Points along a Z-order curve (Morton 1966): three coordinates as one number whose bits take turns."""
import functools
from typing import List, Sequence, Tuple

import numpy as np

from ...arrays import Array, IntArray

AXIS_BITS = 20
"""Maximum size of a coordinate [bit]."""

PIECE = 12
"""Bits are moved by tables for this many at a time."""


def keys_of(offsets: IntArray, bits: Sequence[int]) -> Array:
    """The place of each point on the curve.

    From the lowest bit on: bit 0 of x, y, z, bit 1 of x, y, z, ...; an axis without further bits is left out.

    :param offsets: (n, 3) int, 0 <= offset < 2 ** bits of the axis
    :param bits: of each axis, up to AXIS_BITS
    :return: (n,) uint64, below 2 ** sum(bits)
    """
    values = offsets.astype(np.uint64)
    joined = values[:, 0] | values[:, 1] << np.uint64(AXIS_BITS) | values[:, 2] << np.uint64(2 * AXIS_BITS)
    return _moved(joined, _tables(tuple(bits), False))


def offsets_of(keys: Array, bits: Sequence[int]) -> IntArray:
    """The inverse of keys_of.

    :param keys: (n,) uint64, below 2 ** sum(bits)
    :return: (n, 3) int
    """
    joined = _moved(keys, _tables(tuple(bits), True))
    shifts = np.array([0, AXIS_BITS, 2 * AXIS_BITS], np.uint64)
    offsets: IntArray = (joined[:, np.newaxis] >> shifts & np.uint64((1 << AXIS_BITS) - 1)).astype(int)
    return offsets


def _moved(values: Array, tables: List[Array]) -> Array:
    moved = np.zeros(len(values), np.uint64)
    for number, table in enumerate(tables):
        moved |= table[(values >> np.uint64(PIECE * number) & np.uint64((1 << PIECE) - 1)).astype(np.intp)]
    return moved


@functools.lru_cache(maxsize=8)
def _tables(bits: Tuple[int, ...], back: bool) -> List[Array]:
    """Where the bits of each piece of a number go: (2 ** PIECE,) uint64 for each.

    :param back: from keys to coordinates
    """
    order = [AXIS_BITS * axis + bit for bit in range(AXIS_BITS) for axis in range(3) if bit < bits[axis]]
    moves = list(enumerate(order)) if back else [(source, target) for target, source in enumerate(order)]
    tables = [np.zeros(1 << PIECE, np.uint64) for _ in range(-(-3 * AXIS_BITS // PIECE))]
    numbers = np.arange(1 << PIECE, dtype=np.uint64)
    for source, target in moves:
        piece, bit = divmod(source, PIECE)
        tables[piece] |= (numbers >> np.uint64(bit) & np.uint64(1)) << np.uint64(target)
    return tables
