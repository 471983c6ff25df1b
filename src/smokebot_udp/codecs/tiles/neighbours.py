# SPDX-License-Identifier: BSD-3-Clause
"""What is known around a cell: the cells before it, and the classes of the nearest. And where contexts begin."""
import numpy as np

from ...arrays import Array
from ..layered.loops import compiled
from .chances import CLASS_BITS, ORDERS

FREE, OCCUPIED, UNKNOWN, GRADED = range(4)
"""Classes of cells: 0, 100, -1, others."""
MARGIN = 2
"""Cells on each side but the lower one, for neighbours outside the tile."""

DIFFERS, GRADES, CLEARS, TURNS = 0, ORDERS, 2 * ORDERS, 3 * ORDERS
"""Decisions about a cell: whether it differs from its western neighbour; whether it is graded; whether it is free,
after a graded one; which of two it is."""
RUN = 4 * ORDERS
"""Whether a run breaks: by class and length."""
HALF = RUN + (4 << 4)
"""In which half it breaks: by length."""
RANK = HALF + (1 << 4)
"""Whether a cell is as the memory says: see graded."""
ERROR = RANK + (1 << 7)
"""The error of the prediction: by activity."""
CONTEXTS = ERROR + (8 << 5)


@compiled
def class_of(value: int) -> int:
    """The class of a cell."""
    if value == 0:
        return FREE
    if value == 100:
        return OCCUPIED
    return UNKNOWN if value < 0 else GRADED


@compiled
def value_of(kind: int) -> int:
    """The value of a cell that is not graded."""
    if kind == FREE:
        return 0
    return 100 if kind == OCCUPIED else -1


@compiled
def with_margin(height: int, width: int) -> Array:
    """Space for a tile, unknown around it: (MARGIN + height, width + 2 MARGIN) int8."""
    return np.full((MARGIN + height, width + 2 * MARGIN), np.int8(-1))


@compiled
def begin_row(cells: Array, y: int) -> None:
    """The cells before a row are as the one above its first."""
    for x in range(MARGIN):
        cells[y, x] = cells[y - 1, MARGIN]


@compiled
def end_row(cells: Array, y: int) -> None:
    """The cells behind a row are as its last."""
    for x in range(cells.shape[1] - MARGIN, cells.shape[1]):
        cells[y, x] = cells[y, x - 1]


@compiled
def context_of(cells: Array, y: int, x: int) -> int:
    """The classes of eight neighbours: W, N, NW, NE, WW, NN, NEE, NNE."""
    context = class_of(cells[y, x - 1])
    context = context << CLASS_BITS | class_of(cells[y - 1, x])
    context = context << CLASS_BITS | class_of(cells[y - 1, x - 1])
    context = context << CLASS_BITS | class_of(cells[y - 1, x + 1])
    context = context << CLASS_BITS | class_of(cells[y, x - 2])
    context = context << CLASS_BITS | class_of(cells[y - 2, x])
    context = context << CLASS_BITS | class_of(cells[y - 1, x + 2])
    return context << CLASS_BITS | class_of(cells[y - 2, x + 1])


@compiled
def run_of(cells: Array, y: int, x: int) -> int:
    """How many cells from (y, x) on have neighbours all alike, as long as they are like these."""
    value = cells[y, x - 1]
    if not (cells[y, x - 2] == value and cells[y - 1, x - 1] == value):
        return 0
    end, i = cells.shape[1] - MARGIN, x
    while i < end and cells[y - 1, i + 1] == value and cells[y - 2, i] == value and cells[y - 1, i] == value:
        i += 1
    return i - x


@compiled
def log2(number: int) -> int:
    """Rounded down; 0 of 0."""
    bits = 0
    while number > 1:
        number >>= 1
        bits += 1
    return bits
