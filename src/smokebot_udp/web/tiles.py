# SPDX-License-Identifier: BSD-3-Clause
"""A map as square tiles in several resolutions, of which a browser gets what it shows and what changed.

Tiles are on a lattice that begins at the origin of the first map and stays while the map grows. Cells are 0 where they
are unknown, else their occupancy plus 1; a coarser level has the greatest of the cells.
"""
import math
from typing import Dict, Iterator, List, NamedTuple, Optional, Set, Tuple

import numpy as np

from ..arrays import Array, UInt8Array
from ..newest import Newest
from .png import encoded

TILE = 128
"""Side of a tile [pixel]."""

LEVELS = 7
"""At level n a pixel is 2^n cells."""

MAX_CELLS = 1 << 26
"""Larger maps are not shown."""

MAX_PNGS = 2048
"""That are kept."""

LATTICE = 1e-2
"""A map whose origin is off the lattice by more begins anew [cell]."""


class Key(NamedTuple):
    """A tile."""
    level: int
    column: int
    row: int


class Place(NamedTuple):
    """Where a map is."""
    x: float
    y: float
    yaw: float
    """Pose of its first cell's corner [m, rad]."""
    resolution: float
    """[m]"""
    frame: str = ''


class Area(NamedTuple):
    """A rectangle of cells of the lattice; the ends are not in it."""
    x0: int
    y0: int
    x1: int
    y1: int


class TiledMap:
    """One map."""

    def __init__(self) -> None:
        self.id = 0
        """The lattice's number: it changes where no tile of before is valid any more."""
        self.anchor: Optional[Place] = None
        """Where cell (0, 0) of the lattice is; None: there was no map yet."""
        self.area = Area(0, 0, 0, 0)
        """The map's cells."""
        self._canvas: UInt8Array = np.zeros((0, 0), np.uint8)
        self._corner = (0, 0)       # column and row of the canvas's first tile
        self.changes = 0
        """How often anything changed."""
        self._versions: List[Dict[Tuple[int, int], int]] = [{} for _ in range(LEVELS)]
        self._pngs: Newest[Key, Tuple[int, bytes]] = Newest(MAX_PNGS)

    def set(self, place: Place, cells: Array) -> None:
        """A whole map.

        :param cells: (height, width) int8, -1 unknown, 0..100
        :raises ValueError: it cannot be shown
        """
        height, width = cells.shape
        if not (place.resolution > 0 and all(map(math.isfinite, place[:4]))):
            raise ValueError('a map at (%g, %g) with a resolution of %g m' % (place.x, place.y, place.resolution))
        if not 0 < cells.size <= MAX_CELLS:
            raise ValueError('a map of %d x %d cells' % (width, height))
        column, row = self._cell_of(place)
        area = Area(column, row, column + width, row + height)
        corner = area.x0 // TILE, area.y0 // TILE
        canvas: UInt8Array = np.zeros(((-(-area.y1 // TILE) - corner[1]) * TILE,
                                       (-(-area.x1 // TILE) - corner[0]) * TILE), np.uint8)
        top, left = area.y0 - corner[1] * TILE, area.x0 - corner[0] * TILE
        canvas[top:top + height, left:left + width] = shades(cells)
        changed = set(_differing(self._canvas, self._corner, canvas, corner))
        self._canvas, self._corner, self.area = canvas, corner, area
        self._touch(changed)

    def update(self, x: int, y: int, cells: Array) -> None:
        """A part of the map.

        :param x, y: column and row of its first cell in the map
        :param cells: (height, width) int8
        :raises ValueError: it is not in the map
        """
        height, width = cells.shape
        if not (0 <= x <= x + width <= self.area.x1 - self.area.x0 and
                0 <= y <= y + height <= self.area.y1 - self.area.y0):
            raise ValueError('an update of %d x %d cells at (%d, %d) is not in the map' % (width, height, x, y))
        if not cells.size:
            return
        left = self.area.x0 + x - self._corner[0] * TILE
        top = self.area.y0 + y - self._corner[1] * TILE
        first, last = (left // TILE, top // TILE), ((left + width - 1) // TILE, (top + height - 1) // TILE)
        part = slice(first[1] * TILE, (last[1] + 1) * TILE), slice(first[0] * TILE, (last[0] + 1) * TILE)
        corner = self._corner[0] + first[0], self._corner[1] + first[1]
        before = self._canvas[part].copy()
        self._canvas[top:top + height, left:left + width] = shades(cells)
        self._touch(set(_differing(before, corner, self._canvas[part], corner)))

    def versions(self, level: int, area: Area) -> Iterator[Tuple[Key, int]]:
        """The tiles that intersect an area of the lattice, and a number for each that grows when it changes."""
        side, known = TILE << level, self._versions[level]
        x0, y0, x1, y1 = area.x0 // side, area.y0 // side, -(-area.x1 // side), -(-area.y1 // side)
        if (x1 - x0) * (y1 - y0) > len(known):
            for (column, row), version in known.items():
                if x0 <= column < x1 and y0 <= row < y1:
                    yield Key(level, column, row), version
            return
        for row in range(y0, y1):
            for column in range(x0, x1):
                if (column, row) in known:
                    yield Key(level, column, row), known[column, row]

    def png(self, key: Key) -> bytes:
        """A tile as PNG, 8 bits grey, the first line at the top."""
        version = self._versions[key.level].get((key.column, key.row), 0)
        kept = self._pngs.get(key)
        if kept is not None and kept[0] == version:
            return kept[1]
        data = encoded(self._pixels(key)[::-1])
        self._pngs[key] = version, data
        return data

    def cells_in(self, x0: float, y0: float, x1: float, y1: float, anchor: Place) -> Area:
        """The area of the lattice around a rectangle, within the map.

        :param x0, y0, x1, y1: in the frame of `anchor` [m]
        :param anchor: where cell (0, 0) is
        """
        cos, sin = math.cos(anchor.yaw), math.sin(anchor.yaw)
        corners = [(x - anchor.x, y - anchor.y) for x in (x0, x1) for y in (y0, y1)]
        columns = [(cos * x + sin * y) / anchor.resolution for x, y in corners]
        rows = [(cos * y - sin * x) / anchor.resolution for x, y in corners]
        return Area(*(int(min(max(value, low), high)) for value, low, high in (
            (math.floor(min(columns)), self.area.x0, self.area.x1), (math.floor(min(rows)), self.area.y0, self.area.y1),
            (math.ceil(max(columns)), self.area.x0, self.area.x1),
            (math.ceil(max(rows)), self.area.y0, self.area.y1))))

    def _cell_of(self, place: Place) -> Tuple[int, int]:
        """The cell of the lattice at a map's origin; the lattice begins anew where the map does not fit to it."""
        anchor = self.anchor
        if anchor is not None and (anchor.yaw, anchor.frame) == (place.yaw, place.frame) and math.isclose(
                anchor.resolution, place.resolution, rel_tol=1e-6):
            cos, sin = math.cos(place.yaw), math.sin(place.yaw)
            x, y = (place.x - anchor.x) / place.resolution, (place.y - anchor.y) / place.resolution
            column, row = cos * x + sin * y, cos * y - sin * x
            if max(abs(column), abs(row)) < 1 << 24 and max(
                    abs(column - round(column)), abs(row - round(row))) < LATTICE:
                return round(column), round(row)
        self.anchor, self.id = place, self.id + 1
        self._canvas, self._corner = np.zeros((0, 0), np.uint8), (0, 0)
        self._versions = [{} for _ in range(LEVELS)]
        self._pngs.clear()
        return 0, 0

    def _touch(self, changed: Set[Tuple[int, int]]) -> None:
        self.changes += 1
        for level, versions in enumerate(self._versions):
            for column, row in changed:
                versions[column >> level, row >> level] = self.changes

    def _pixels(self, key: Key) -> UInt8Array:
        """(TILE, TILE): a tile, the first line at the bottom."""
        side = TILE << key.level
        left, top = key.column * side - self._corner[0] * TILE, key.row * side - self._corner[1] * TILE
        cells: UInt8Array = np.zeros((side, side), np.uint8)
        part = self._canvas[max(top, 0):max(top + side, 0), max(left, 0):max(left + side, 0)]
        cells[max(-top, 0):max(-top, 0) + part.shape[0], max(-left, 0):max(-left, 0) + part.shape[1]] = part
        scale = 1 << key.level
        pooled: UInt8Array = cells.reshape(TILE, scale, TILE, scale).max(axis=(1, 3)) if key.level else cells
        return pooled


def shades(cells: Array) -> UInt8Array:
    """Cells of an OccupancyGrid as in tiles; illegal ones are unknown."""
    legal = np.where((cells < 0) | (cells > 100), -1, cells)
    found: UInt8Array = (legal + 1).astype(np.uint8)
    return found


def _differing(before: UInt8Array, corner: Tuple[int, int], after: UInt8Array, new_corner: Tuple[int, int]
               ) -> Iterator[Tuple[int, int]]:
    """Columns and rows of the tiles in which two canvases differ; where one is not, it is unknown.

    :param corner, new_corner: column and row of the first tile of each
    """
    rows, columns = (range(min(one, other), max(one + size // TILE, other + new // TILE))
                     for one, other, size, new in ((corner[1], new_corner[1], before.shape[0], after.shape[0]),
                                                   (corner[0], new_corner[0], before.shape[1], after.shape[1])))
    for row in rows:
        for column in columns:
            one, other = _tile(before, corner, column, row), _tile(after, new_corner, column, row)
            if one is None or other is None:
                present = other if one is None else one
                if present is not None and present.any():
                    yield column, row
            elif not np.array_equal(one, other):
                yield column, row


def _tile(canvas: UInt8Array, corner: Tuple[int, int], column: int, row: int) -> Optional[UInt8Array]:
    top, left = (row - corner[1]) * TILE, (column - corner[0]) * TILE
    if not (0 <= top < canvas.shape[0] and 0 <= left < canvas.shape[1]):
        return None
    return canvas[top:top + TILE, left:left + TILE]
