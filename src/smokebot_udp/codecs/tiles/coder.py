# SPDX-License-Identifier: BSD-3-Clause
"""A tile's cells to bytes and back, without loss: doc/wire_format.md, "Data of a tile"."""
from typing import Optional

import numpy as np

from ...arrays import Array, UInt8Array
from .cells import decode_cells, encode_cells

MAX_CELLS = 1 << 20
"""Maximum number of cells of a tile. It bounds the memory and time of decoding."""
THREE_VALUED, GRADED = 102, 103
"""The first byte: below these it is the value of all cells plus 1, and nothing follows. THREE_VALUED: all cells are -1,
0 or 100. GRADED: any values."""
FINISHING = 8
"""Bytes that the range coder wants to have ahead."""


def encode(cells: Array, most: int) -> Optional[bytes]:
    """Code a tile.

    :param cells: (h, w) int8, -1..100, from one cell to MAX_CELLS
    :param most: bytes, at least 1
    :returns: None: it takes more than `most` bytes, which is found out early
    """
    low, high = int(cells.min()), int(cells.max())
    if low == high:
        return bytes([low + 1])
    graded = bool(((cells > 0) & (cells < 100)).any())
    data = np.zeros(most + FINISHING, np.uint8)
    data[0] = GRADED if graded else THREE_VALUED
    # a copy, as in decode: those of a message are read-only, and anywhere
    end = encode_cells(np.array(cells, np.int8, order='C'), graded, data)
    return data[:end].tobytes() if 0 < end <= most else None


def decode(data: UInt8Array, height: int, width: int) -> Array:
    """The (height, width) int8 cells of a tile.

    :param data: (n,) uint8
    :raises ValueError: the size is impossible, or the bytes are not a tile's
    """
    if not (height >= 1 and width >= 1 and height * width <= MAX_CELLS):
        raise ValueError('a tile of %d x %d cells' % (height, width))
    if not len(data):
        raise ValueError('a tile without bytes')
    kind = int(data[0])
    if kind < THREE_VALUED:
        if len(data) > 1:
            raise ValueError('%d bytes of a uniform tile' % len(data))
        return np.full((height, width), kind - 1, np.int8)
    if kind > GRADED:
        raise ValueError('a tile of kind %d' % kind)
    cells = np.empty((height, width), np.int8)
    # a copy: the loops are compiled for arrays that can be written to
    if not decode_cells(cells, kind == GRADED, np.array(data, np.uint8)):
        raise ValueError('the bytes of a tile of %d x %d cells are broken' % (height, width))
    return cells
