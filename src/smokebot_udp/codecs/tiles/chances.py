# SPDX-License-Identifier: BSD-3-Clause
"""Probabilities that learn fast: each counts its symbols, and moves by 1 / (count + 1.5) of its error at each.

A tile has only a few thousand decisions, so most contexts are rarely used. Decisions about a cell have contexts of
three orders, of its two, four and eight nearest neighbours: one that is used first takes over what the order below has
learnt.
"""
from typing import Tuple

import numpy as np

from ...arrays import Array
from ..layered.loops import borrowing, compiled, int64
from ..layered.range_coder import State, decide, refilled, unknown_of

CLASS_BITS = 2
"""Size of the class of each neighbour in a context [bit]. The nearest neighbour comes first."""
NEIGHBOURS = 8
SECOND, FOURTH, EIGHTH = 0, 1 << 2 * CLASS_BITS, (1 << 2 * CLASS_BITS) + (1 << 4 * CLASS_BITS)
"""Where the contexts of each order begin."""
ORDERS = EIGHTH + (1 << NEIGHBOURS * CLASS_BITS)
"""Number of contexts of a decision about a cell."""

COUNT_BITS = 10
EVEN = 1 << 31
"""The chance at which 0 and 1 are equally likely. A chance is the probability of a 0 [2^-22] and, in the lower
COUNT_BITS bits, its count. A chance of 0 was never used."""
LARGEST = (1 << 22) - 1
MOST_COUNTED = 255
LEAST_CHANCE = 24
"""Minimum probability of the rarer symbol [2^-16]."""
INHERITED = 1
"""Count of a chance that was taken over from the order below."""
_RATES = np.array([65536 / (count + 1.5) for count in range(MOST_COUNTED + 1)], np.int64)


@compiled
def unused(contexts: int) -> Array:
    """(contexts,) uint32 chances."""
    return np.zeros(contexts, np.uint32)


@borrowing
def _adapted(chance: int, symbol: int) -> int:
    probability, count = chance >> COUNT_BITS, chance & ((1 << COUNT_BITS) - 1)
    probability += ((0 if symbol else LARGEST) - probability) * _RATES[count] >> 16
    return probability << COUNT_BITS | min(count + 1, MOST_COUNTED)


@borrowing
def _code(encoding: bool, data: Array, chance: int, symbol: int, state: State) -> Tuple[int, State]:
    low, width, at = state
    probability = min(max(chance >> 16, LEAST_CHANCE), 65536 - LEAST_CHANCE)
    bound = (width >> 16) * probability
    symbol, low, width = decide(encoding, symbol, bound, low, width, unknown_of(data, at))
    return refilled(encoding, data, symbol, (low, width, at))


@borrowing
def code_single(encoding: bool, data: Array, chances: Array, context: int, symbol: int, state: State
                ) -> Tuple[int, State]:
    """Code a symbol, 0 or 1, in a context of one order; the decoder ignores the given one.

    :returns: the symbol or END, and the coder's state
    """
    chance = int64(chances[context])
    if chance == 0:
        chance = int64(EVEN)
    symbol, state = _code(encoding, data, chance, symbol, state)
    if symbol >= 0:
        chances[context] = _adapted(chance, symbol)
    return symbol, state


@borrowing
def code_ordered(encoding: bool, data: Array, chances: Array, decision: int, context: int, symbol: int, state: State
                 ) -> Tuple[int, State]:
    """Code a symbol in contexts of all orders.

    :param decision: where its contexts begin
    :param context: the classes of NEIGHBOURS
    """
    second = decision + SECOND + (context >> (NEIGHBOURS - 2) * CLASS_BITS)
    fourth = decision + FOURTH + (context >> (NEIGHBOURS - 4) * CLASS_BITS)
    eighth = decision + EIGHTH + context
    least, middle, most = int64(chances[second]), int64(chances[fourth]), int64(chances[eighth])
    if least == 0:
        least = int64(EVEN)
    if middle == 0:
        middle = least >> COUNT_BITS << COUNT_BITS | INHERITED
    if most == 0:
        most = middle >> COUNT_BITS << COUNT_BITS | INHERITED
    symbol, state = _code(encoding, data, most, symbol, state)
    if symbol >= 0:
        chances[second] = _adapted(least, symbol)
        chances[fourth] = _adapted(middle, symbol)
        chances[eighth] = _adapted(most, symbol)
    return symbol, state
