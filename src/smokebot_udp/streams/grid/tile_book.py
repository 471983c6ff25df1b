# SPDX-License-Identifier: BSD-3-Clause
"""The datagrams that make a map: its tiles, and patches over tiles that changed a little.

A change of a few cells is coded in a hundred bytes, the tile around it in a thousand. So a tile that was sent stays as
it was, and one patch over it has the cells that changed since: its revision is higher, so it is what is shown. A patch
that becomes too large ends both; the tile is sent as it is then.
"""
from dataclasses import dataclass
from typing import Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import Array
from ...codecs.tiles import coder
from ...codecs.tiles.rectangle import Rectangle
from ...codecs.tiles.tiling import Area, Tile, Tiling
from ...codecs.wire.grid import UNKNOWN
from .tile_queue import Item

PATCH_PART = 0.5
"""A patch takes this part of its tile's bytes, at most."""


class Change(NamedTuple):
    """From one map to the next."""
    made: List[Item]
    gone: List[int]
    """Revisions that are not in use any more."""


@dataclass
class _Block:
    """The datagrams of one tile's place."""
    tile: Item
    patch: Optional[Item] = None

    @property
    def revisions(self) -> List[int]:
        return [item.revision for item in (self.tile, self.patch) if item is not None]


class TileBook:
    """Makes the datagrams of each map of a session, and numbers them.

    :param room: of data in a datagram [byte]
    """

    def __init__(self, room: int) -> None:
        self._tiling = Tiling(room)
        self._blocks: Dict[Rectangle, _Block] = {}
        self._before: Optional[Area] = None
        self.revision = 0
        """The newest one."""

    def update(self, cells: Array, corner: Tuple[int, int], room: int) -> Change:
        """Take the next map.

        :param cells: (height, width) int8, not changed any more
        :param corner: column and row of its first cell on the lattice
        :param room: of data in a datagram from now on [byte]
        """
        self._tiling.room = room
        remade = {tile.place for tile in self._tiling.update(cells, corner)}
        now = Area(Rectangle(corner[0], corner[1], cells.shape[1], cells.shape[0]), cells)
        before, self._blocks = self._blocks, {}
        change = Change([], [])
        for tile in self._tiling.tiles.values():
            block = before.pop(tile.place, None)
            if block is None:
                self._blocks[tile.place] = self._new(tile, change, self._shows_news(tile.place, now))
            else:
                self._blocks[tile.place] = self._renewed(block, tile, tile.place in remade, now, room, change)
        change.gone.extend(revision for block in before.values() for revision in block.revisions)
        self._before = now
        return change

    def _renewed(self, block: _Block, tile: Tile, remade: bool, now: Area, room: int, change: Change) -> _Block:
        """The block of a tile whose place is as before."""
        fits = max(len(item.data) for item in (block.tile, block.patch or block.tile)) <= room
        changed = self._changed(tile.place, now) if remade else None
        if changed is None and fits:
            return block
        if changed is not None and fits:
            patch = self._patch(block, changed, now, change)
            if patch is not None:
                change.gone.extend(block.revisions[1:])
                return _Block(block.tile, patch)
        change.gone.extend(block.revisions)
        return self._new(tile, change, changed is not None)

    def _patch(self, block: _Block, changed: Rectangle, now: Area, change: Change) -> Optional[Item]:
        """All that changed since the tile was made, also what changed back: an operator may have seen it."""
        place = changed if block.patch is None else _around(changed, block.patch.place)
        if place == block.tile.place:
            return None
        data = coder.encode(now.at(place), max(1, int(PATCH_PART * len(block.tile.data))))
        return None if data is None else self._item(place, data, change, True)

    def _changed(self, place: Rectangle, now: Area) -> Optional[Rectangle]:
        """The smallest rectangle around the cells that differ from the map before; None: none do."""
        assert self._before is not None     # there was a tile
        found = Rectangle.around(self._before.at(place) != now.at(place))
        return found and found.moved(place.column, place.row)

    def _shows_news(self, place: Rectangle, now: Area) -> bool:
        """Whether a new place has cells that changed, or new known ones; else operators lack nothing they would see."""
        if self._before is None:
            return False
        common = place.within(self._before.place)
        if common.empty:
            return bool((now.at(place) != UNKNOWN).any())
        if not np.array_equal(self._before.at(common), now.at(common)):
            return True
        return np.count_nonzero(now.at(place) != UNKNOWN) > np.count_nonzero(now.at(common) != UNKNOWN)

    def _new(self, tile: Tile, change: Change, urgent: bool) -> _Block:
        return _Block(self._item(tile.place, tile.data, change, urgent))

    def _item(self, place: Rectangle, data: bytes, change: Change, urgent: bool) -> Item:
        self.revision += 1
        item = Item(self.revision, place, data, urgent)
        change.made.append(item)
        return item


def _around(one: Rectangle, other: Rectangle) -> Rectangle:
    """The smallest rectangle around both."""
    column, row = min(one.column, other.column), min(one.row, other.row)
    return Rectangle(column, row, max(one.column + one.width, other.column + other.width) - column,
                     max(one.row + one.height, other.row + other.height) - row)
