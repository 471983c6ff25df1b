# SPDX-License-Identifier: BSD-3-Clause
"""The loops of the tile coder; the encoder's and the decoder's are the same.

Cells are coded row by row. Where all known neighbours are alike, one decision says whether the cells go on like them as
far as the rows above do; if not, the first one that differs is found by halving. Elsewhere each cell is compared with
its neighbours.
"""
from typing import Tuple

from ...arrays import Array, UInt8Array
from ..layered.loops import borrowing, compiled, int64
from ..layered.range_coder import State, begin, finish
from .chances import code_ordered, code_single, unused
from .graded import BROKEN, NONE, Learnt, code_error, code_ranked, empty_memory, places_of, remember
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


@borrowing
def _code_run(encoding: bool, data: Array, chances: Array, cells: Array, y: int, x: int, length: int, state: State
              ) -> Tuple[int, State]:
    """Code how many of `length` cells from (y, x) on are like the one before; or BROKEN."""
    value, same = cells[y, x - 1], 0
    if encoding:
        while same < length and cells[y, x + same] == value:
            same += 1
    context = RUN + (class_of(value) << 4 | min(log2(length), 15))
    symbol, state = code_single(encoding, data, chances, context, 1 if same < length else 0, state)
    if symbol <= 0:
        return length if symbol == 0 else BROKEN, state
    first, last = 0, length         # the first one that differs is in first..last - 1
    while last - first > 1:
        middle = (first + last) >> 1
        symbol, state = code_single(encoding, data, chances, HALF + min(log2(last - first), 15),
                                    1 if same >= middle else 0, state)
        if symbol < 0:
            return BROKEN, state
        if symbol:
            first = middle
        else:
            last = middle
    return first, state


@borrowing
def _code_turn(encoding: bool, data: Array, chances: Array, context: int, kind: int, west: int, state: State
               ) -> Tuple[int, State]:
    """Code a cell that is not graded and of another class than `west`, or BROKEN."""
    if west == GRADED:
        symbol, state = code_ordered(encoding, data, chances, CLEARS, context, 1 if kind == FREE else 0, state)
        if symbol:
            return 0 if symbol > 0 else BROKEN, state
        west = FREE
    symbol, state = code_ordered(encoding, data, chances, TURNS, context, 1 if kind == (west + 1) % 3 else 0, state)
    if symbol < 0:
        return BROKEN, state
    return value_of((west + 1) % 3 if symbol else (west + 2) % 3), state


@borrowing
def _code_compared(encoding: bool, data: Array, learnt: Learnt, cells: Array, y: int, x: int, differs: bool,
                   state: State) -> Tuple[int, State]:
    """Code a cell by comparison with its western neighbour, or BROKEN.

    :param differs: whether it is known to differ from it
    """
    chances = learnt.chances
    context, west = context_of(cells, y, x), cells[y, x - 1]
    if not differs:
        symbol, state = code_ordered(encoding, data, chances, DIFFERS, context, 1 if cells[y, x] != west else 0, state)
        if symbol <= 0:
            return int64(west) if symbol == 0 else BROKEN, state
    kind = class_of(cells[y, x]) if encoding else FREE
    if learnt.is_graded:
        symbol, state = code_ordered(encoding, data, chances, GRADES, context, 1 if kind == GRADED else 0, state)
        if symbol < 0:
            return BROKEN, state
        if symbol:
            return code_error(encoding, data, chances, cells, y, x, state)
    return _code_turn(encoding, data, chances, context, kind, class_of(west), state)


@borrowing
def _code_cell(encoding: bool, data: Array, learnt: Learnt, cells: Array, y: int, x: int, differs: bool, state: State
               ) -> Tuple[int, State]:
    """Code a cell's value, or BROKEN."""
    if not learnt.is_graded:
        return _code_compared(encoding, data, learnt, cells, y, x, differs, state)
    places = places_of(cells, y, x)
    value, differs, state = code_ranked(encoding, data, learnt, places, cells, (y, x), differs, state)
    if value == NONE:
        value, state = _code_compared(encoding, data, learnt, cells, y, x, differs, state)
    if value > BROKEN:
        remember(learnt.memory, places, value)
    return value, state


@compiled
def _code_cells(encoding: bool, data: Array, graded: bool, cells: Array) -> Tuple[bool, State]:
    """Code all cells, which have a margin; whether the stream or the encoder's room did not end before, and the coder's
    state."""
    learnt = Learnt(unused(CONTEXTS), empty_memory(graded), graded)
    state = begin(encoding, data, 1)
    for y in range(MARGIN, cells.shape[0]):
        begin_row(cells, y)
        x = MARGIN
        while x < cells.shape[1] - MARGIN:
            length = run_of(cells, y, x)
            if length:
                same, state = _code_run(encoding, data, learnt.chances, cells, y, x, length, state)
                if same < 0:
                    return False, state
                if not encoding:
                    cells[y, x:x + same] = cells[y, x - 1]
                x += same
                if same == length:
                    continue
            value, state = _code_cell(encoding, data, learnt, cells, y, x, length > 0, state)
            if value <= BROKEN:
                return False, state
            cells[y, x] = value
            x += 1
        end_row(cells, y)
    return True, state


@compiled
def encode_cells(tile: Array, graded: bool, data: UInt8Array) -> int:
    """Write the cells of a tile behind the first byte of `data`; the number of bytes. 0: there is no room."""
    cells = with_margin(tile.shape[0], tile.shape[1])
    cells[MARGIN:, MARGIN:-MARGIN] = tile
    good, state = _code_cells(True, data, graded, cells)
    return finish(data, state) if good else 0


@compiled
def decode_cells(tile: Array, graded: bool, data: UInt8Array) -> bool:
    """Read the cells of a tile; False: the bytes are not those of one."""
    cells = with_margin(tile.shape[0], tile.shape[1])
    good, state = _code_cells(False, data, graded, cells)
    tile[:] = cells[MARGIN:, MARGIN:-MARGIN]
    return good and state[2] >= len(data)
