# SPDX-License-Identifier: BSD-3-Clause
"""A map in tiles that fit a datagram each: cut where it is rich, merged where it is empty, renewed where it changed.

Root blocks of the lattice are halved along their longer side until the cells of each block fit. Blocks do not depend on
the map's rectangle: when it grows or moves, only tiles change whose cells do. A tile is a block's cells inside the map.
"""
from typing import Dict, List, Mapping, NamedTuple, Optional, Set, Tuple

import numpy as np

from ...arrays import Array
from . import coder
from .rectangle import Rectangle

ROOT = 512
"""Side of a root block [cell]."""
MERGED = 0.75
"""Two halves are tried as one tile again when they take less than this share of its room together. What was merged
must grow by a third before it is halved again."""


class Area(NamedTuple):
    """A part of the lattice with the cells in it."""
    place: Rectangle
    cells: Array
    """(height, width) int8"""

    def at(self, place: Rectangle) -> Array:
        """The cells of a rectangle inside."""
        return self.cells[self.place.slices(place)]


class Tile(NamedTuple):
    """A coded part of the map."""
    revision: int
    """Rises with each tile made, from 1."""
    column: int
    row: int
    width: int
    height: int
    """On the lattice."""
    data: bytes
    """See coder.encode."""

    @property
    def place(self) -> Rectangle:
        """Its cells."""
        return Rectangle(*self[1:5])


class Tiling:
    """The tiles of a map that changes.

    :param room: bytes of data in a datagram, at most; at least 1. Setting it renews the tiles that no longer fit, at
        the next update
    """

    def __init__(self, room: int) -> None:
        self.room = room
        self._tiles: Dict[int, Tile] = {}
        self._revision = 0
        self._map: Optional[Area] = None
        self._leaves: Dict[Rectangle, Tile] = {}    # by block; revision 0: made in this update
        self._halved: Set[Rectangle] = set()

    @property
    def room(self) -> int:
        """Bytes of data in a datagram, at most."""
        return self._room

    @room.setter
    def room(self, room: int) -> None:
        if room < 1:
            raise ValueError('%d bytes for a tile' % room)
        self._room = room

    @property
    def tiles(self) -> Mapping[int, Tile]:
        """The tiles of the last map, by revision. They are disjoint and cover it."""
        return self._tiles

    def update(self, cells: Array, corner: Tuple[int, int]) -> List[Tile]:
        """Take the next map; its tiles that are new. Those that they replace are no more in `tiles`.

        :param cells: (height, width) int8, -1..100
        :param corner: column and row of its first cell on the lattice
        """
        new = Area(Rectangle(corner[0], corner[1], cells.shape[1], cells.shape[0]), np.array(cells, np.int8))
        renewal = _Renewal(self._room, self._map, new, self._leaves, self._halved)
        for row in range(new.place.row // ROOT * ROOT, new.place.row + new.place.height, ROOT):
            for column in range(new.place.column // ROOT * ROOT, new.place.column + new.place.width, ROOT):
                renewal.visit(Rectangle(column, row, ROOT, ROOT))
        self._map, self._leaves, self._halved = new, renewal.leaves, renewal.halved
        return self._number()

    def _number(self) -> List[Tile]:
        """Give the tiles made in this update their revisions."""
        made = []
        for block, tile in self._leaves.items():
            if tile.revision == 0:
                self._revision += 1
                tile = self._leaves[block] = tile._replace(revision=self._revision)
                made.append(tile)
        self._tiles = {tile.revision: tile for tile in self._leaves.values()}
        return made


class _Renewal:
    """One update: the blocks of the new map, from those of the old one."""

    def __init__(self, room: int, old: Optional[Area], new: Area, leaves: Mapping[Rectangle, Tile],
                 halved: Set[Rectangle]) -> None:
        self._room, self._old, self._new = room, old, new
        self._old_leaves, self._old_halved = leaves, halved
        self.leaves: Dict[Rectangle, Tile] = {}
        self.halved: Set[Rectangle] = set()

    def visit(self, block: Rectangle) -> bool:
        """Make the tiles of a block; whether any of them is new or gone."""
        place = block.within(self._new.place)
        if place.empty:
            return block in self._old_leaves or block in self._old_halved
        if block in self._old_halved:
            first, second = block.halves()
            self.halved.add(block)
            changed = [self.visit(half) for half in (first, second)]
            if any(changed):
                self._merge(block, place, first, second)
            return any(changed)
        tile = self._old_leaves.get(block)
        if tile is not None and len(tile.data) <= self._room and tile.place == place and self._unchanged(place):
            self.leaves[block] = tile
            return False
        self._code(block, place)
        return True

    def _unchanged(self, place: Rectangle) -> bool:
        return self._old is not None and self._old.place.holds(place) and np.array_equal(
            self._old.at(place), self._new.at(place))

    def _code(self, block: Rectangle, place: Rectangle) -> None:
        """Halve a block until its tiles fit."""
        if place.empty:
            return
        data = coder.encode(self._new.at(place), self._room)
        if data is not None:
            self.leaves[block] = Tile(0, *place, data)
            return
        self.halved.add(block)
        for half in block.halves():
            self._code(half, half.within(self._new.place))

    def _merge(self, block: Rectangle, place: Rectangle, first: Rectangle, second: Rectangle) -> None:
        """Make one tile of two where they became small."""
        if first in self.halved or second in self.halved:
            return
        halves = [half for half in (first, second) if half in self.leaves]
        if sum(len(self.leaves[half].data) for half in halves) > MERGED * self._room:
            return
        data = coder.encode(self._new.at(place), self._room)
        if data is not None:
            self.halved.remove(block)
            for half in halves:
                del self.leaves[half]
            self.leaves[block] = Tile(0, *place, data)
