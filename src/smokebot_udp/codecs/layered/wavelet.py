# SPDX-License-Identifier: BSD-3-Clause
"""Two wavelet transforms by lifting, symmetric at the border, of images of any size (JPEG 2000 part 1, annex F).

9/7 (Cohen, Daubechies, Feauveau 1992; lifting: Daubechies and Sweldens 1998) and 5/3 (Le Gall and Tabatabai 1988). Both
are of integers: each lifting step adds a rounded product, so the inverse is exact, and alike on every machine. A level
splits rows and columns in halves: the even samples become the low half, rounded up, the odd ones the high half. Halves
are not scaled: see `gains` in layout.py.
"""
from typing import Tuple

import numpy as np

from ...arrays import Array
from .loops import compiled, int32, int64

BITS = 30
"""Factors of lifting steps are in 2^-BITS."""


def _steps(*steps: Tuple[int, float, int]) -> Array:
    """(s, 3) int64: whether odd samples are lifted, the factor and what is added before rounding down [2^-BITS].

    Odd and even samples take turns.
    """
    return np.array([(odd, round(factor * 2 ** BITS), half) for odd, factor, half in steps], np.int64)


_HALF = 1 << (BITS - 1)
STEPS_9_7 = _steps((1, -1.586134342059924, _HALF), (0, -0.052980118572961, _HALF),
                   (1, 0.882911075530934, _HALF), (0, 0.443506852043971, _HALF))
STEPS_5_3 = _steps((1, -0.5, 2 * _HALF - 1), (0, 0.25, _HALF))


def inverse(steps: Array) -> Array:
    """The steps of `join` that undo those of `split`."""
    return np.array([(odd, -factor, 2 * _HALF - 1 - half) for odd, factor, half in steps[::-1]], np.int64)


@compiled
def _lift(row: Array, above: Array, below: Array, factor: int, half: int) -> None:
    """Add to a row the factor times the two beside it. A function of its own: the compiler makes vectors of it."""
    for i in range(len(row)):
        row[i] += (int64(int32(above[i] + below[i])) * factor + half) >> BITS


@compiled
def _lift_rows(x: Array, y: int, steps: Array) -> None:
    """Each step s of the row y - s: those that the rows up to y, lifted likewise, allow."""
    rows = x.shape[0]
    for step in range(len(steps)):
        at = y - step
        if 0 <= at < rows:
            _lift(x[at], x[at - 1 if at > 0 else at + 1], x[at + 1 if at + 1 < rows else at - 1],
                  int32(steps[step, 1]), steps[step, 2])


@compiled
def _lift_odd(even: Array, odd: Array, factor: int, half: int) -> None:
    """Add to each odd sample the factor times the even ones beside it."""
    n = len(odd)
    for i in range(n - 1):
        odd[i] += (int64(int32(even[i] + even[i + 1])) * factor + half) >> BITS
    last = even[n] if len(even) > n else even[n - 1]
    odd[n - 1] += (int64(int32(even[n - 1] + last)) * factor + half) >> BITS


@compiled
def _lift_even(even: Array, odd: Array, factor: int, half: int) -> None:
    """Add to each even sample the factor times the odd ones beside it."""
    n = len(odd)
    even[0] += (int64(int32(odd[0] + odd[0])) * factor + half) >> BITS
    for i in range(1, n):
        even[i] += (int64(int32(odd[i - 1] + odd[i])) * factor + half) >> BITS
    if len(even) > n:
        even[n] += (int64(int32(odd[n - 1] + odd[n - 1])) * factor + half) >> BITS


@compiled
def _lift_row(even: Array, odd: Array, steps: Array) -> None:
    for step in range(len(steps)):
        if steps[step, 0]:
            _lift_odd(even, odd, int32(steps[step, 1]), steps[step, 2])
        else:
            _lift_even(even, odd, int32(steps[step, 1]), steps[step, 2])


@compiled
def _split_row(row: Array, even: Array, odd: Array, steps: Array) -> None:
    for i in range(len(even)):
        even[i] = row[2 * i]
    for i in range(len(odd)):
        odd[i] = row[2 * i + 1]
    _lift_row(even, odd, steps)
    row[:len(even)] = even
    row[len(even):] = odd


@compiled
def _join_row(row: Array, even: Array, odd: Array, steps: Array) -> None:
    even[:] = row[:len(even)]
    odd[:] = row[len(even):]
    _lift_row(even, odd, steps)
    for i in range(len(even)):
        row[2 * i] = even[i]
    for i in range(len(odd)):
        row[2 * i + 1] = odd[i]


@compiled
def split(x: Array, steps: Array) -> None:
    """One level, in place: (rows, columns) int32 to low and high halves, [[LL, HL], [LH, HH]] by columns.

    The halves of the columns are apart; rows stay interleaved, the even ones low. All is done in one sweep, while the
    rows are in the processor's cache.
    """
    rows, columns = x.shape
    even, odd = np.empty((columns + 1) // 2, x.dtype), np.empty(columns // 2, x.dtype)
    done = 0
    for y in range(steps[0, 0], rows + len(steps) + 1, 2):
        if rows > 1:
            _lift_rows(x, y, steps)
        while done < min(y - len(steps) + 1, rows):
            if columns > 1:
                _split_row(x[done], even, odd, steps)
            done += 1


@compiled
def join(x: Array, steps: Array) -> None:
    """The inverse of split, in place, by the `inverse` of its steps."""
    rows, columns = x.shape
    even, odd = np.empty((columns + 1) // 2, x.dtype), np.empty(columns // 2, x.dtype)
    done = 0
    for y in range(steps[0, 0], rows + len(steps), 2):
        while done < min(y + 2, rows):
            if columns > 1:
                _join_row(x[done], even, odd, steps)
            done += 1
        if rows > 1:
            _lift_rows(x, y, steps)
