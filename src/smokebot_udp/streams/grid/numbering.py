# SPDX-License-Identifier: BSD-3-Clause
"""The numbers of a map's cells. They stay although the map grows or moves, so that only changes are sent.

Where a map moves by whole cells, so do its numbers. Where it moves by a part of a cell or turns, its cells are not
those of the map before. But either the map was moved as it is, as by a correction of its pose, or a window was moved
over a world that has stayed: the numbers are those by which most cells are what operators hold.
"""
import math
from typing import List, Optional, Tuple

import numpy as np

from ...arrays import Array
from ...codecs.tiles.lattice import MAX_NUMBER, SAME_PLACE, Lattice
from ...codecs.tiles.rectangle import Rectangle
from ...codecs.wire.grid import UNKNOWN

COMPARED = 1 << 18
"""Number of cells in which two maps are compared, about. Rows of larger maps are left out."""

MOST_WRONG = 0.5
"""A map is the one before, moved as it is, where no more cells differ from it, per cell that is not as most are."""


class Numbering:
    """Numbers the cells of one session's maps."""

    def __init__(self) -> None:
        self._lattice: Optional[Lattice] = None     # of the map before
        self._area = Rectangle(0, 0, 0, 0)          # its numbers
        self._cells: Array = np.empty((0, 0), np.int8)

    def corner(self, lattice: Lattice, cells: Array) -> Optional[Tuple[int, int]]:
        """Column and row of the first cell of the next map; None: nothing of the one before can be kept.

        :param cells: (height, width) int8, not changed any more
        """
        corner = lattice.corner if self._lattice is None else self._next(self._lattice, lattice, cells)
        if corner is not None:
            self._lattice, self._cells = lattice, cells
            self._area = Rectangle(*corner, cells.shape[1], cells.shape[0])
        return corner

    def _next(self, before: Lattice, lattice: Lattice, cells: Array) -> Optional[Tuple[int, int]]:
        way = before.to(lattice)
        if way is None:
            return None
        step = self._step(way, before.turned(lattice), cells)
        if step is None:
            return None
        column, row = self._area.column + step[0], self._area.row + step[1]
        return (column, row) if max(abs(column), abs(row)) <= MAX_NUMBER else None

    def _step(self, way: Tuple[float, float], turned: bool, cells: Array) -> Optional[Tuple[int, int]]:
        """By how many columns and rows the numbers move.

        :param way: of the map's first cell in its frame [cell]
        """
        steps = _whole(way)
        if len(steps) == 1 and not turned:
            return steps[0]
        # the nearest one first: it is taken where others are no better
        steps.sort(key=lambda step: math.hypot(step[0] - way[0], step[1] - way[1]))
        wrong, step = min((self._wrong(cells, step), number) for number, step in enumerate(steps))
        as_it_is = self._wrong(cells, (0, 0))
        if as_it_is < min(wrong, MOST_WRONG):
            return 0, 0
        return None if turned and wrong > MOST_WRONG else steps[step]

    def _wrong(self, cells: Array, step: Tuple[int, int]) -> float:
        """The cells that would differ from those that are held, per cell that is not as most are."""
        every = max(1, cells.size // COMPARED)
        compared = cells[::every]
        rows = np.arange(0, cells.shape[0], every) + step[1]
        first = max(0, step[0])
        last = max(first, min(self._cells.shape[1], cells.shape[1] + step[0]))
        inside = (rows >= 0) & (rows < self._cells.shape[0])
        held = np.full(compared.shape, UNKNOWN, np.int8)
        held[inside, first - step[0]:last - step[0]] = self._cells[rows[inside], first:last]
        commonest = int(np.bincount(compared.ravel().view(np.uint8)).max())
        return float(np.count_nonzero(held != compared) / max(1, compared.size - commonest))


def _whole(way: Tuple[float, float]) -> List[Tuple[int, int]]:
    """The steps of whole cells beside a way; one, where it is whole."""
    columns, rows = ([round(part)] if abs(math.remainder(part, 1.0)) <= SAME_PLACE else [math.floor(part), math.ceil(
        part)] for part in way)
    return [(column, row) for column in columns for row in rows]
