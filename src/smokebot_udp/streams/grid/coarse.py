# SPDX-License-Identifier: BSD-3-Clause
"""The overview of a map on the operator's side: the maximum of each block of cells, as newest known.

It stands for cells that were never received. Where it contradicts older cells, which something has replaced whose tile
has not come yet, it is shown instead of them: a coarse obstacle is better than a lost one.
"""
from typing import Tuple

import numpy as np

from ...arrays import Array
from ...codecs.tiles.overview import halved
from ...codecs.tiles.rectangle import Rectangle
from ...codecs.tiles.tiling import Area
from ...codecs.wire.grid import UNKNOWN
from .canvas import FORMER, NEVER, Canvas
from .placed import moved, renumbered

NO_CELL = UNKNOWN - 1
"""Below any value."""


class Coarse:
    """Receives pieces of overviews.

    :param area: the map's rectangle [cell]
    """

    def __init__(self, area: Rectangle) -> None:
        self.area, self.shift = area, 1
        self.blocks = area.blocks(self.shift)
        self._values: Array = np.full((self.blocks.height, self.blocks.width), UNKNOWN, np.int8)
        self._numbers: Array = np.zeros(self._values.shape, np.uint32)    # as a canvas's, of the newest tile in them

    @property
    def newest(self) -> int:
        """The highest revision of this session; 0: there is none."""
        return max(int(self._numbers.max()) - 1, 0)

    @property
    def empty(self) -> bool:
        """Whether nothing was received."""
        return not self._numbers.any()

    def move(self, area: Rectangle) -> None:
        """Change the map's rectangle."""
        self._place(area, self.shift, self._values, self._numbers, self.blocks)

    def renumber(self, columns: int, rows: int) -> None:
        """Number the cells by as many more."""
        self._values, self._numbers = (renumbered(values, self.area, columns, rows, self.shift)
                                       for values in (self._values, self._numbers))
        self.area = self.area.moved(columns, rows)
        self.blocks = self.area.blocks(self.shift)

    def begin_session(self) -> None:
        """Number anew."""
        np.minimum(self._numbers, FORMER, out=self._numbers)

    def put(self, shift: int, place: Rectangle, revision: int, values: Array) -> None:
        """Write a piece of an overview.

        :param shift: blocks have 2^shift cells a side, > 0
        :param place: the blocks, inside the map's
        :param revision: of the newest tile when it was made
        :param values: (height, width) int8
        """
        if shift != self.shift:
            self._rescale(shift)
        region = self.blocks.slices(place)
        self._values[region], self._numbers[region] = values, revision + 1

    def settle(self, pending: Array) -> bool:
        """Trust the cells received more than the overview, except where tiles are missing.

        :param pending: (n, 4) int: column, row, width, height of rectangles of missing tiles [cell]
        :return: whether this may change what is shown
        """
        settled = np.minimum(self._numbers, FORMER)
        for rectangle in pending.tolist():
            missing = Rectangle(*rectangle).within(self.area)
            if not missing.empty:
                region = self.blocks.slices(missing.blocks(self.shift))
                settled[region] = self._numbers[region]
        changed = bool((self._numbers != settled).any())
        self._numbers = settled
        return changed

    def shown(self, canvas: Canvas) -> Array:
        """(height, width) int8: the map, of the cells received and of the overview.

        :param canvas: of the same rectangle
        """
        cells = canvas.cells.copy()
        columns = (np.arange(self.area.width) + self.area.column >> self.shift) - self.blocks.column
        for row, highest in enumerate(self._numbers.max(axis=1).tolist()):
            if highest > FORMER or (highest == FORMER and not canvas.complete):
                first = max((self.blocks.row + row << self.shift) - self.area.row, 0)
                last = (self.blocks.row + row + 1 << self.shift) - self.area.row
                taken = self._taken(row, columns, canvas.cells[first:last], canvas.numbers[first:last])
                np.copyto(cells[first:last], self._values[row][columns], where=taken)
        return cells

    def _taken(self, row: int, columns: Array, cells: Array, numbers: Array) -> Array:
        """(h, width) bool: the cells of a row of blocks for which the overview stands.

        :param columns: (width,) block of each column of cells
        :param cells: (h, width) int8
        :param numbers: (h, width) uint32, theirs
        """
        own = self._numbers[row][columns]
        never = numbers == NEVER
        older = ~never & (numbers <= own) & (own > FORMER)
        starts = np.searchsorted(columns, np.arange(self.blocks.width))
        maximum = np.maximum.reduceat(np.where(older, cells, NO_CELL).max(axis=0), starts)
        gaps = np.logical_or.reduceat(never.any(axis=0), starts)
        value = self._values[row]
        # a gap may hide the maximum
        doubtful = (maximum > value) | ((maximum > NO_CELL) & (maximum < value) & ~gaps)
        taken: Array = (never & (own > NEVER)) | (older & doubtful[columns])
        return taken

    def _rescale(self, shift: int) -> None:
        """Change the size of the blocks. What is known for others is good enough for cells that were never received."""
        values, blocks = self._values, self.blocks
        for _ in range(self.shift, shift):
            blocks, values = halved(Area(blocks, values))
        for _ in range(shift, self.shift):
            values, blocks = _doubled(values, blocks)
        self._place(self.area, shift, values, np.where(values > UNKNOWN, FORMER, NEVER).astype(np.uint32), blocks)

    def _place(self, area: Rectangle, shift: int, values: Array, numbers: Array, blocks: Rectangle) -> None:
        self.area, self.shift, self.blocks = area, shift, area.blocks(shift)
        self._values = moved(values, blocks, self.blocks, UNKNOWN)
        self._numbers = moved(numbers, blocks, self.blocks, NEVER)


def _doubled(values: Array, blocks: Rectangle) -> Tuple[Array, Rectangle]:
    """The same values of blocks half as large."""
    return values.repeat(2, axis=0).repeat(2, axis=1), Rectangle(*(2 * number for number in blocks))
