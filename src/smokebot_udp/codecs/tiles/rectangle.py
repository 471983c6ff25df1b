# SPDX-License-Identifier: BSD-3-Clause
"""Rectangles of a lattice's cells."""
from typing import NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import BoolArray


class Rectangle(NamedTuple):
    """Cells of the lattice."""
    column: int
    row: int
    width: int
    height: int

    @classmethod
    def around(cls, cells: BoolArray) -> Optional['Rectangle']:
        """The smallest one around the cells that are True, in (height, width) bool; None: none is."""
        rows, columns = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
        if not len(rows):
            return None
        return cls(int(columns[0]), int(rows[0]), int(columns[-1] - columns[0]) + 1, int(rows[-1] - rows[0]) + 1)

    def moved(self, columns: int, rows: int) -> 'Rectangle':
        """One of the same size beside it."""
        return Rectangle(self.column + columns, self.row + rows, self.width, self.height)

    def within(self, other: 'Rectangle') -> 'Rectangle':
        """What both have in common; its sides are 0 or less where that is nothing."""
        column, row = max(self.column, other.column), max(self.row, other.row)
        return Rectangle(column, row, min(self.column + self.width, other.column + other.width) - column,
                         min(self.row + self.height, other.row + other.height) - row)

    @property
    def empty(self) -> bool:
        """Whether it has no cells."""
        return self.width <= 0 or self.height <= 0

    def holds(self, other: 'Rectangle') -> bool:
        """Whether another one, not empty, is inside."""
        return not other.empty and other.within(self) == other

    def slices(self, part: 'Rectangle') -> Tuple[slice, slice]:
        """Where a part of it is in an array (height, width, ...) of its cells.

        :param part: inside, or empty
        """
        column, row = part.column - self.column, part.row - self.row
        return slice(row, row + max(part.height, 0)), slice(column, column + max(part.width, 0))

    def blocks(self, shift: int) -> 'Rectangle':
        """The blocks of 2^shift by 2^shift cells that it touches; block (0, 0) begins at cell (0, 0)."""
        column, row = self.column >> shift, self.row >> shift
        return Rectangle(column, row, ((self.column + self.width - 1) >> shift) + 1 - column,
                         ((self.row + self.height - 1) >> shift) + 1 - row)

    def halves(self) -> Tuple['Rectangle', 'Rectangle']:
        """Cut along the longer side; of one cell, the second half is empty."""
        column, row, width, height = self
        if width >= height:
            first = (width + 1) // 2
            return Rectangle(column, row, first, height), Rectangle(column + first, row, width - first, height)
        first = (height + 1) // 2
        return Rectangle(column, row, width, first), Rectangle(column, row + first, width, height - first)
