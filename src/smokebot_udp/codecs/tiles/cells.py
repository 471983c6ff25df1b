# SPDX-License-Identifier: BSD-3-Clause
"""The loops of the tile coder; the encoder's and the decoder's are the same.

Cells are coded row by row. Where all known neighbours are alike, one decision says whether the cells go on like them as
far as the rows above do; if not, the first one that differs is found by halving. Elsewhere each cell is compared with
its neighbours.
"""
from typing import Tuple

from ...arrays import Array, UInt8Array
from ..layered.loops import compiled, int64
from ..layered.range_coder import begin, finish
from .chances import code_ordered, code_single, unused
from .graded import BROKEN, NONE, code_error, code_ranked, empty_memory, places_of, remember
from .neighbours import (
    CLEARS,
    CONTEXTS,
    DIFFERS,
    FREE,
    GRADED,
    GRADES,
    HALF,
    MARGIN,
    RUN,
    TURNS,
    begin_row,
    class_of,
    context_of,
    end_row,
    log2,
    run_of,
    value_of,
    with_margin,
)


@compiled
def _code_run(encoding: bool, data: Array, chances: Array, cells: Array, y: int, x: int, length: int, low: int,
              width: int, at: int) -> Tuple[int, int, int, int]:
    """Code how many of `length` cells from (y, x) on are like the one before; or BROKEN."""
    value, same = cells[y, x - 1], 0
    if encoding:
        while same < length and cells[y, x + same] == value:
            same += 1
    context = RUN + (class_of(value) << 4 | min(log2(length), 15))
    symbol, low, width, at = code_single(encoding, data, chances, context, 1 if same < length else 0, low, width, at)
    if symbol <= 0:
        return length if symbol == 0 else BROKEN, low, width, at
    first, last = 0, length         # the first one that differs is in first..last - 1
    while last - first > 1:
        middle = (first + last) >> 1
        symbol, low, width, at = code_single(encoding, data, chances, HALF + min(log2(last - first), 15),
                                             1 if same >= middle else 0, low, width, at)
        if symbol < 0:
            return BROKEN, low, width, at
        if symbol:
            first = middle
        else:
            last = middle
    return first, low, width, at


@compiled
def _code_turn(encoding: bool, data: Array, chances: Array, cells: Array, y: int, x: int, context: int, kind: int,
               west: int, low: int, width: int, at: int) -> Tuple[int, int, int, int]:
    """Code a cell that is not graded and of another class than `west`, or BROKEN."""
    if west == GRADED:
        symbol, low, width, at = code_ordered(encoding, data, chances, CLEARS, context, 1 if kind == FREE else 0, low,
                                              width, at)
        if symbol:
            return 0 if symbol > 0 else BROKEN, low, width, at
        west = FREE
    symbol, low, width, at = code_ordered(encoding, data, chances, TURNS, context, 1 if kind == (west + 1) % 3 else 0,
                                          low, width, at)
    if symbol < 0:
        return BROKEN, low, width, at
    return value_of((west + 1) % 3 if symbol else (west + 2) % 3), low, width, at


@compiled
def _code_compared(encoding: bool, data: Array, chances: Array, graded: bool, cells: Array, y: int, x: int,
                   differs: bool, low: int, width: int, at: int) -> Tuple[int, int, int, int]:
    """Code a cell by comparison with its western neighbour, or BROKEN.

    :param differs: whether it is known to differ from it
    """
    context, west = context_of(cells, y, x), cells[y, x - 1]
    if not differs:
        symbol, low, width, at = code_ordered(encoding, data, chances, DIFFERS, context,
                                              1 if cells[y, x] != west else 0, low, width, at)
        if symbol <= 0:
            return int64(west) if symbol == 0 else BROKEN, low, width, at
    kind = class_of(cells[y, x]) if encoding else FREE
    if graded:
        symbol, low, width, at = code_ordered(encoding, data, chances, GRADES, context, 1 if kind == GRADED else 0, low,
                                              width, at)
        if symbol < 0:
            return BROKEN, low, width, at
        if symbol:
            return code_error(encoding, data, chances, cells, y, x, low, width, at)
    return _code_turn(encoding, data, chances, cells, y, x, context, kind, class_of(west), low, width, at)


@compiled
def _code_cell(encoding: bool, data: Array, chances: Array, memory: Array, graded: bool, cells: Array, y: int, x: int,
               differs: bool, low: int, width: int, at: int) -> Tuple[int, int, int, int]:
    """Code a cell's value, or BROKEN."""
    if not graded:
        return _code_compared(encoding, data, chances, graded, cells, y, x, differs, low, width, at)
    far, near = places_of(cells, y, x)
    value, differs, low, width, at = code_ranked(encoding, data, chances, memory, far, near, cells, y, x, differs, low,
                                                 width, at)
    if value == NONE:
        value, low, width, at = _code_compared(encoding, data, chances, graded, cells, y, x, differs, low, width, at)
    if value > BROKEN:
        remember(memory, far, value)
        remember(memory, near, value)
    return value, low, width, at


@compiled
def _code_cells(encoding: bool, data: Array, graded: bool, cells: Array) -> Tuple[bool, int, int, int]:
    """Code all cells, which have a margin; whether the stream or the encoder's room did not end before, and the coder's
    state."""
    chances, memory = unused(CONTEXTS), empty_memory(graded)
    low, width, at = begin(encoding, data, 1)
    for y in range(MARGIN, cells.shape[0]):
        begin_row(cells, y)
        x = MARGIN
        while x < cells.shape[1] - MARGIN:
            length = run_of(cells, y, x)
            if length:
                same, low, width, at = _code_run(encoding, data, chances, cells, y, x, length, low, width, at)
                if same < 0:
                    return False, low, width, at
                if not encoding:
                    cells[y, x:x + same] = cells[y, x - 1]
                x += same
                if same == length:
                    continue
            value, low, width, at = _code_cell(encoding, data, chances, memory, graded, cells, y, x, length > 0, low,
                                               width, at)
            if value <= BROKEN:
                return False, low, width, at
            cells[y, x] = value
            x += 1
        end_row(cells, y)
    return True, low, width, at


@compiled
def encode_cells(tile: Array, graded: bool, data: UInt8Array) -> int:
    """Write the cells of a tile behind the first byte of `data`; the number of bytes. 0: there is no room."""
    cells = with_margin(tile.shape[0], tile.shape[1])
    cells[MARGIN:, MARGIN:-MARGIN] = tile
    good, low, width, at = _code_cells(True, data, graded, cells)
    return finish(data, low, width, at) if good else 0


@compiled
def decode_cells(tile: Array, graded: bool, data: UInt8Array) -> bool:
    """Read the cells of a tile; False: the bytes are not those of one."""
    cells = with_margin(tile.shape[0], tile.shape[1])
    good, low, width, at = _code_cells(False, data, graded, cells)
    tile[:] = cells[MARGIN:, MARGIN:-MARGIN]
    return good and at >= len(data)
