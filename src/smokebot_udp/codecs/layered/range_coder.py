# SPDX-License-Identifier: BSD-3-Clause
"""An adaptive binary range coder with carry (Martin 1979; Schindler 1998), in 48-bit integers and bytes by pairs.

The state is (low, width, at). Of the encoder: the interval [low, low + width) in units of the last byte written, and
the number of bytes in `data`. Of the decoder: `low` is what the stream says above the interval's lower end, and `at`
the number of bytes read. Each context has two estimates of the probability of 0, a fast and a slow one, of which the
mean is used. A stream may end anywhere: the decoder stops at the first symbol that its bytes do not determine.
"""
from typing import Tuple

from ...arrays import Array
from .loops import borrowing, inlined, int64

State = Tuple[int, int, int]

FULL = 1 << 48
"""The first interval."""
LEAST = 1 << 32
"""A narrower interval is shifted by two bytes."""
AHEAD = 6
"""The decoder has read this number of bytes more than the encoder has written [byte]."""
FAST, SLOW = 4, 7
"""Each symbol moves the estimates by 2^-FAST and 2^-SLOW of what is left to certainty."""
END = -1
"""In place of a symbol: the stream ends here, or the encoder's room."""


@borrowing
def begin(encoding: bool, data: Array, at: int) -> State:
    """The state at the byte `at`."""
    if encoding:
        return 0, FULL, at
    low = 0
    for i in range(at, at + AHEAD):
        low = low << 8 | (int64(data[i]) if i < len(data) else 0)
    return low, FULL, at + AHEAD


@borrowing
def _carry(data: Array, at: int) -> None:
    """Add 1 to the number that ends before byte `at`. The sum of all intervals is below 1: it ends within `data`."""
    i = at - 1
    while i > 0 and data[i] == 255:
        data[i] = 0
        i -= 1
    data[i] += 1


@inlined
def bound_of(odds: int, width: int) -> int:
    """The part of the width that 0 has, above 0 and below the width.

    :param odds: the two estimates of the probability of 0 [2^-16], fast << 16 | slow
    """
    return (width >> 16) * (((odds >> 16) + (odds & 65535)) >> 1)


@inlined
def after_zero(odds: int) -> int:
    """The estimates after a 0."""
    fast, slow = odds >> 16, odds & 65535
    return (fast + ((65536 - fast) >> FAST)) << 16 | (slow + ((65536 - slow) >> SLOW))


@inlined
def after_one(odds: int) -> int:
    """The estimates after a 1."""
    fast, slow = odds >> 16, odds & 65535
    return (fast - (fast >> FAST)) << 16 | (slow - (slow >> SLOW))


@inlined
def decide(encoding: bool, symbol: int, bound: int, low: int, width: int, unknown: int) -> Tuple[int, int, int]:
    """Code a symbol, 0 or 1; the decoder ignores the given one. Its context is adapted and `refill` comes next.

    It takes no arrays, as numba would count references to them at each symbol.

    :param bound: the part of the width that 0 has, above 0 and below the width
    :returns: the symbol or END, and the new low and width
    """
    if not encoding:
        symbol = 1 if low >= bound else 0
        if symbol == 0 and low + unknown > bound:
            symbol = END
    if symbol > 0:
        low += bound if encoding else -bound
        width -= bound
    else:
        width = bound
    return symbol, low, width


@borrowing
def refill(encoding: bool, data: Array, low: int, width: int, at: int) -> Tuple[int, int, int, int]:
    """Where the width is below LEAST: write or read two bytes.

    :returns: the new low, width and at, and `unknown`: the decoder's low may be so much larger, less 1; 0: the encoder
        has no room
    """
    if not encoding:
        for i in range(at, at + 2):
            low = low << 8 | (int64(data[i]) if i < len(data) else 0)
        return low, width << 16, at + 2, unknown_of(data, at + 2)
    if at + 8 > len(data):
        return low, width, at, 0
    if low >= FULL:
        _carry(data, at)
        low -= FULL
    data[at] = low >> 40
    data[at + 1] = (low >> 32) & 255
    return (low & (LEAST - 1)) << 16, width << 16, at + 2, 1


@borrowing
def unknown_of(data: Array, at: int) -> int:
    """1 where all bytes before `at` are known, 256 where one is not, ..."""
    return 1 << 8 * min(max(at - len(data), 0), 6)


@borrowing
def refilled(encoding: bool, data: Array, symbol: int, state: State) -> Tuple[int, State]:
    """After a symbol: the symbol, END where the encoder has no room, and the state."""
    low, width, at = state
    if width < LEAST:
        low, width, at, unknown = refill(encoding, data, low, width, at)
        if unknown == 0:
            symbol = END
    return symbol, (low, width, at)


@borrowing
def code(encoding: bool, data: Array, odds: Array, context: int, symbol: int, state: State) -> Tuple[int, State]:
    """Code one symbol, all in one; END also where the encoder has no room.

    :param odds: (contexts,) uint32
    """
    low, width, at = state
    odd = int64(odds[context])
    symbol, low, width = decide(encoding, symbol, bound_of(odd, width), low, width, unknown_of(data, at))
    odds[context] = after_one(odd) if symbol > 0 else after_zero(odd)
    return refilled(encoding, data, symbol, (low, width, at))


@borrowing
def finish(data: Array, state: State) -> int:
    """Write the fewest bytes that determine all symbols; the end of the stream."""
    low, width, at = state
    for missing in range(7):
        granule = FULL >> 8 * missing
        value = (low + granule - 1) // granule * granule
        if value + granule <= low + width:
            break
    if value >= FULL:
        _carry(data, at)
        value -= FULL
    for i in range(missing):
        data[at + i] = (value >> (40 - 8 * i)) & 255
    return at + missing
