# SPDX-License-Identifier: BSD-3-Clause
"""The whole map in a few datagrams: reduced by max-pooling, so that no obstacle is lost."""
from typing import List, NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import Array
from ..wire.grid import UNKNOWN
from . import coder
from .rectangle import Rectangle
from .tiling import Area


class Piece(NamedTuple):
    """A coded part of the reduced map."""
    column: int
    row: int
    width: int
    height: int
    """On the lattice of the blocks: its columns and rows are those of cells divided by 2^shift, rounded down."""
    data: bytes
    """See coder.encode."""


def overview(cells: Array, corner: Tuple[int, int], room: int, most_datagrams: int = 4) -> Tuple[int, List[Piece]]:
    """The smallest reduction of a map that fits.

    :param cells: (height, width) int8, -1..100
    :param corner: column and row of its first cell on the lattice
    :param room: bytes of data in a datagram, at most
    :returns: (shift, pieces), at most `most_datagrams` of them, which cover the map: each value is the maximum of
        2^shift by 2^shift cells; 0: the map fits as it is, and needs no overview
    """
    area = Area(Rectangle(corner[0], corner[1], cells.shape[1], cells.shape[0]), cells)
    shift = 0
    while True:
        pieces = _pieces(area, room, most_datagrams)
        if pieces is not None:
            return shift, pieces
        area, shift = halved(area), shift + 1


def _pieces(area: Area, room: int, most: int) -> Optional[List[Piece]]:
    """Halve what does not fit; None: it takes more than `most` datagrams."""
    done: List[Piece] = []
    waiting = [area.place]
    while waiting:
        place = waiting.pop()
        data = coder.encode(area.at(place), room) if place.width * place.height <= coder.MAX_CELLS else None
        if data is not None:
            done.append(Piece(*place, data))
            continue
        waiting.extend(place.halves())
        if len(done) + len(waiting) > most:
            return None
    return done


def halved(area: Area) -> Area:
    """Reduced by 2; blocks are those of the lattice, so the first and last ones may be incomplete."""
    blocks = area.place.blocks(1)
    whole = Rectangle(2 * blocks.column, 2 * blocks.row, 2 * blocks.width, 2 * blocks.height)
    cells = np.full((whole.height, whole.width), UNKNOWN, np.int8)
    cells[whole.slices(area.place)] = area.cells
    pairs = np.maximum(cells[::2], cells[1::2])
    return Area(blocks, np.maximum(pairs[:, ::2], pairs[:, 1::2]))
