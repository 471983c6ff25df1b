# SPDX-License-Identifier: BSD-3-Clause
"""The cells of a map that were received in tiles, each with the revision that it came with: 5 bytes a cell.

A number is a tile's revision + 1. NEVER and FORMER are below all of them: what is known from a former session of the
sender stays until this session's first tile replaces it.

A tile is held as long as any of its cells is shown. Others of its cells may belong to newer tiles, such as patches.
"""
import zlib
from dataclasses import dataclass
from typing import Dict, Iterable, NamedTuple, Tuple

import numpy as np

from ...arrays import Array, BoolArray
from ...codecs.tiles.rectangle import Rectangle
from ...codecs.wire.grid import UNKNOWN
from .placed import moved

NEVER, FORMER = 0, 1
"""Numbers of cells that were never received, and of those of a former session."""

MAX_REVISION = (1 << 32) - 2

MAX_HELD = 1 << 14
"""Tiles that are remembered as held. Noise that fills the largest map takes fewer tiles of 1.4 kB."""


class Identity(NamedTuple):
    """What distinguishes a tile from others of its session."""
    revision: int
    place: Rectangle
    checksum: int

    @classmethod
    def of(cls, revision: int, place: Rectangle, data: bytes) -> 'Identity':
        """The identity of a tile as received."""
        return cls(revision, place, zlib.crc32(data))


@dataclass
class _Held:
    tile: Identity
    shown: int
    """Number of its cells that no other tile has replaced."""


class Canvas:
    """Receives tiles.

    :param area: the map's rectangle
    """

    def __init__(self, area: Rectangle) -> None:
        self.area = area
        self.cells: Array = np.full((area.height, area.width), UNKNOWN, np.int8)
        self.numbers: Array = np.zeros((area.height, area.width), np.uint32)
        self.known = 0
        """Cells that were received, in this session or a former one."""
        self._held: Dict[int, _Held] = {}

    @property
    def complete(self) -> bool:
        """Whether all cells were received."""
        return bool(self.known == self.cells.size)

    @property
    def held(self) -> Iterable[int]:
        """Revisions of the tiles of this session of which cells are shown."""
        return self._held

    def holds(self, tile: Identity) -> bool:
        """Whether this very tile is held."""
        held = self._held.get(tile.revision)
        return held is not None and held.tile == tile

    def disown(self, revision: int) -> bool:
        """Do not count a tile as held any more; whether it was."""
        return self._held.pop(revision, None) is not None

    def move(self, area: Rectangle) -> None:
        """Change the map's rectangle. What is in both is kept. A tile that is cut is not held any more."""
        self.cells = moved(self.cells, self.area, area, UNKNOWN)
        self.numbers = moved(self.numbers, self.area, area, NEVER)
        self.area = area
        self.known = int(np.count_nonzero(self.numbers))
        self._held = {revision: held for revision, held in self._held.items() if area.holds(held.tile.place)}

    def renumber(self, columns: int, rows: int) -> None:
        """Number the cells by as many more."""
        self.area = self.area.moved(columns, rows)

    def begin_session(self) -> None:
        """Number anew: all that is known is older than any tile that comes."""
        np.minimum(self.numbers, FORMER, out=self.numbers)
        self._held.clear()

    def older(self, tile: Identity) -> BoolArray:
        """(tile's height, width): the cells that the tile renews."""
        older: BoolArray = self.numbers[self.area.slices(tile.place)] <= tile.revision
        return older

    def put(self, tile: Identity, cells: Array, renewed: BoolArray) -> None:
        """Write a tile's cells.

        :param tile: inside `area`, of a revision of 1..MAX_REVISION
        :param cells: (height, width) int8
        :param renewed: (height, width), those to be written
        """
        region = self.area.slices(tile.place)
        numbers = self.numbers[region]
        replaced = numbers[renewed]
        self.known += int(np.count_nonzero(replaced == NEVER))
        for number, count in _counts(replaced):
            self._lose(number - 1, count)
        numbers[renewed] = tile.revision + 1
        np.copyto(self.cells[region], cells, where=renewed)
        if replaced.size:
            self._hold(tile, replaced.size)

    def _hold(self, tile: Identity, shown: int) -> None:
        if len(self._held) >= MAX_HELD:
            del self._held[next(iter(self._held))]      # it is sent once more
        self._held[tile.revision] = _Held(tile, shown)

    def _lose(self, revision: int, count: int) -> None:
        """Note that cells of a tile are shown no more."""
        held = self._held.get(revision)
        if held is not None:
            held.shown -= count
            if held.shown <= 0:
                del self._held[revision]


def _counts(numbers: Array) -> Iterable[Tuple[int, int]]:
    """(number, how often it occurs); mostly it is one number."""
    if not numbers.size:
        return ()
    first = int(numbers[0])
    if (numbers == first).all():
        return ((first, numbers.size),)
    different, counts = np.unique(numbers, return_counts=True)
    return zip(different.tolist(), counts.tolist())
