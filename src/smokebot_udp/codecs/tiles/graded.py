# SPDX-License-Identifier: BSD-3-Clause
"""Cells of maps with values between free and occupied: costs, whose gradients repeat, and noisy probabilities.

Two memories say which value was found last among the same neighbours: W, N, NW, NE, and W, N. A cell that is neither is
compared with its classes as in other maps, and a graded one is coded as the error of a prediction.
"""
from typing import NamedTuple, Tuple

import numpy as np

from ...arrays import Array
from ..layered.loops import borrowing, compiled, int64
from ..layered.range_coder import State
from .chances import code_single
from .neighbours import ERROR, RANK, log2

FAR, NEAR = 1 << 15, 1 << 14
"""Entries of the memories: the first is hashed."""
NONE, BROKEN = -3, -2
"""In place of a value: it is none that is remembered; the stream ends or is broken."""
MOST_TRUSTED = 4
_MULTIPLIER = 2654435761
"""2^32 divided by the golden ratio (Knuth, The Art of Computer Programming, 6.4)."""


class Learnt(NamedTuple):
    """What was learnt of the cells so far."""
    chances: Array
    """(contexts,) uint32, see chances.py"""
    memory: Array
    """See empty_memory."""
    is_graded: bool
    """Whether there are values between free and occupied."""


@compiled
def empty_memory(graded: bool) -> Array:
    """(FAR + NEAR,) uint16: value + 1, or 0: none; and how far it is trusted << 8."""
    return np.zeros(FAR + NEAR if graded else 1, np.uint16)


@borrowing
def places_of(cells: Array, y: int, x: int) -> Tuple[int, int]:
    """Where the memories have what followed a cell's neighbours."""
    near = (int64(cells[y, x - 1]) + 1) << 7 | (int64(cells[y - 1, x]) + 1)
    all_four = (near << 7 | (int64(cells[y - 1, x - 1]) + 1)) << 7 | (int64(cells[y - 1, x + 1]) + 1)
    return all_four * _MULTIPLIER >> 11 & (FAR - 1), FAR + near


@borrowing
def remember(memory: Array, places: Tuple[int, int], value: int) -> None:
    """What is trusted is kept until it was wrong several times."""
    for place in places:
        known, trust = int64(memory[place]) & 255, int64(memory[place]) >> 8
        if known == value + 1:
            trust = min(trust + 1, MOST_TRUSTED)
        elif trust > 1:
            trust -= 2
        else:
            known, trust = value + 1, 0
        memory[place] = trust << 8 | known


@borrowing
def code_ranked(encoding: bool, data: Array, learnt: Learnt, places: Tuple[int, int], cells: Array,
                cell: Tuple[int, int], differs: bool, state: State) -> Tuple[int, bool, State]:
    """Code whether a cell is what one of the memories says.

    :param places: of it in the memories
    :param cell: its row and column
    :param differs: whether it is known to differ from its western neighbour
    :returns: its value, NONE or BROKEN; whether it is known now to differ; the coder's state
    """
    (far, near), (y, x) = places, cell
    entries = int64(learnt.memory[far]), int64(learnt.memory[near])
    west, north = int64(cells[y, x - 1]), int64(cells[y - 1, x])
    agreed = 0 if entries[1] == 0 else 1 if (entries[0] ^ entries[1]) & 255 == 0 else 2
    for rank in range(2):
        entry = entries[rank]
        guess = (entry & 255) - 1
        if entry == 0 or (differs and guess == west) or (rank and agreed == 1):
            continue
        like = (1 if guess == west else 0) + (2 if guess == north else 0)
        context = RANK + (((rank << 2 | min(entry >> 8, 3)) << 2 | like) << 2) + (0 if rank else agreed)
        symbol, state = code_single(encoding, data, learnt.chances, context, 1 if cells[y, x] != guess else 0, state)
        if symbol <= 0:
            return guess if symbol == 0 else BROKEN, differs, state
        differs = differs or guess == west
    return NONE, differs, state


@borrowing
def _predicted(west: int, north: int, corner: int) -> int:
    """What a graded cell is expected to be: the median of W, N, W + N - NW (Weinberger, LOCO-I, 2000); unknown
    neighbours are as others."""
    west = north if west < 0 else west
    north = west if north < 0 else north
    corner = north if corner < 0 else corner
    if west < 0:
        return 50
    guess = max(min(west, north), min(max(west, north), west + north - corner))
    return min(max(guess, 1), 99)


@borrowing
def code_error(encoding: bool, data: Array, chances: Array, cells: Array, y: int, x: int, state: State
               ) -> Tuple[int, State]:
    """Code a value of 1..99, or BROKEN, as the error of the prediction: whether there is one, its sign, the number of
    its bits, the bits below the first."""
    west, north, corner = int64(cells[y, x - 1]), int64(cells[y - 1, x]), int64(cells[y - 1, x - 1])
    guess = _predicted(west, north, corner)
    error = int64(cells[y, x]) - guess if encoding else 0
    context = ERROR + (min(log2(abs(west - corner) + abs(north - corner) + 1), 7) << 5)
    symbol, state = code_single(encoding, data, chances, context, 1 if error else 0, state)
    if symbol <= 0:
        return guess if symbol == 0 else BROKEN, state
    sign, state = code_single(encoding, data, chances, context + 1, 1 if error < 0 else 0, state)
    bits, symbol = 0, sign
    while symbol >= 0 and bits < 6:
        symbol, state = code_single(encoding, data, chances, context + 2 + bits, 1 if abs(error) >> (bits + 1) else 0,
                                    state)
        if symbol <= 0:
            break
        bits += 1
    magnitude = int64(1)
    for i in range(bits):
        if symbol < 0:
            break
        symbol, state = code_single(encoding, data, chances, context + 9 + bits + (8 if i else 0),
                                    abs(error) >> (bits - 1 - i) & 1, state)
        magnitude = magnitude << 1 | symbol
    value = guess - magnitude if sign else guess + magnitude
    return value if symbol >= 0 and 0 < value < 100 else BROKEN, state
