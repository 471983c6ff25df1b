# SPDX-License-Identifier: BSD-3-Clause
"""Two wavelet transforms by lifting, symmetric at the border, of images of any size (JPEG 2000 part 1, annex F).

9/7 of float32 (Cohen, Daubechies, Feauveau 1992; lifting: Daubechies and Sweldens 1998), scaled to be nearly
orthonormal; 5/3 of int32 (Le Gall and Tabatabai 1988), reversible. A level splits rows and columns in halves: the even
samples become the low half, rounded up, the odd ones the high half.
"""
import numpy as np

from ...arrays import Array
from .loops import compiled, float32

PREDICT_1, UPDATE_1 = float32(-1.586134342059924), float32(-0.052980118572961)
PREDICT_2, UPDATE_2 = float32(0.882911075530934), float32(0.443506852043971)
SCALE = float32(0.869864451624781)
UNSCALE = float32(1 / 0.869864451624781)


@compiled
def _lift_rows(x: Array, first: int, factor: float) -> None:
    """Add to each second row from `first` on the factor times the rows beside it."""
    rows, columns = x.shape
    for y in range(first, rows, 2):
        row = x[y]
        above, below = x[y - 1 if y > 0 else y + 1], x[y + 1 if y + 1 < rows else y - 1]
        for i in range(columns):
            row[i] += factor * (above[i] + below[i])


@compiled
def _lift_rows_exactly(x: Array, first: int, sign: int, rounding: int, shift: int) -> None:
    """Likewise of integers: the sum of the rows beside it, divided by 2^shift."""
    rows, columns = x.shape
    for y in range(first, rows, 2):
        row = x[y]
        above, below = x[y - 1 if y > 0 else y + 1], x[y + 1 if y + 1 < rows else y - 1]
        for i in range(columns):
            row[i] += sign * ((above[i] + below[i] + rounding) >> shift)


@compiled
def _lift_odd(even: Array, odd: Array, factor: float) -> None:
    """Add to each odd sample the factor times the even ones beside it."""
    n = len(odd)
    for i in range(n - 1):
        odd[i] += factor * (even[i] + even[i + 1])
    odd[n - 1] += factor * (even[n - 1] + (even[n] if len(even) > n else even[n - 1]))


@compiled
def _lift_even(even: Array, odd: Array, factor: float) -> None:
    """Add to each even sample the factor times the odd ones beside it."""
    n = len(odd)
    even[0] += factor * (odd[0] + odd[0])
    for i in range(1, n):
        even[i] += factor * (odd[i - 1] + odd[i])
    if len(even) > n:
        even[n] += factor * (odd[n - 1] + odd[n - 1])


@compiled
def _lift_odd_exactly(even: Array, odd: Array, sign: int) -> None:
    """The prediction of the 5/3."""
    n = len(odd)
    for i in range(n - 1):
        odd[i] += sign * ((even[i] + even[i + 1]) >> 1)
    odd[n - 1] += sign * ((even[n - 1] + (even[n] if len(even) > n else even[n - 1])) >> 1)


@compiled
def _lift_even_exactly(even: Array, odd: Array, sign: int) -> None:
    """The update of the 5/3."""
    n = len(odd)
    even[0] += sign * ((odd[0] + odd[0] + 2) >> 2)
    for i in range(1, n):
        even[i] += sign * ((odd[i - 1] + odd[i] + 2) >> 2)
    if len(even) > n:
        even[n] += sign * ((odd[n - 1] + odd[n - 1] + 2) >> 2)


@compiled
def _divide(row: Array, even: Array, odd: Array) -> None:
    """Copy the even and the odd samples of a row."""
    for i in range(len(even)):
        even[i] = row[2 * i]
    for i in range(len(odd)):
        odd[i] = row[2 * i + 1]


@compiled
def _interleave(row: Array, even: Array, odd: Array) -> None:
    """The inverse of _divide."""
    for i in range(len(even)):
        row[2 * i] = even[i]
    for i in range(len(odd)):
        row[2 * i + 1] = odd[i]


@compiled
def split(x: Array) -> None:
    """One level by 9/7, in place: (rows, columns) float32 to low and high halves, [[LL, HL], [LH, HH]] by columns.

    The halves of the columns are apart; rows stay interleaved, the even ones low: nothing is moved twice.
    """
    rows, columns = x.shape
    if rows > 1:
        _lift_rows(x, 1, PREDICT_1)
        _lift_rows(x, 0, UPDATE_1)
        _lift_rows(x, 1, PREDICT_2)
        _lift_rows(x, 0, UPDATE_2)
    n = (columns + 1) // 2
    even, odd = np.empty(n, x.dtype), np.empty(columns - n, x.dtype)
    for y in range(rows):
        row = x[y]
        _divide(row, even, odd)
        if columns > 1:
            _lift_odd(even, odd, PREDICT_1)
            _lift_even(even, odd, UPDATE_1)
            _lift_odd(even, odd, PREDICT_2)
            _lift_even(even, odd, UPDATE_2)
        scale = float32(1)
        if rows > 1:
            scale = SCALE if y & 1 else UNSCALE
        low = scale * UNSCALE if columns > 1 else scale
        high = scale * SCALE
        for i in range(n):
            row[i] = even[i] * low
        for i in range(columns - n):
            row[n + i] = odd[i] * high


@compiled
def join(x: Array) -> None:
    """The inverse of split, in place."""
    rows, columns = x.shape
    n = (columns + 1) // 2
    even, odd = np.empty(n, x.dtype), np.empty(columns - n, x.dtype)
    for y in range(rows):
        row = x[y]
        scale = float32(1)
        if rows > 1:
            scale = UNSCALE if y & 1 else SCALE
        low = scale * SCALE if columns > 1 else scale
        high = scale * UNSCALE
        for i in range(n):
            even[i] = row[i] * low
        for i in range(columns - n):
            odd[i] = row[n + i] * high
        if columns > 1:
            _lift_even(even, odd, -UPDATE_2)
            _lift_odd(even, odd, -PREDICT_2)
            _lift_even(even, odd, -UPDATE_1)
            _lift_odd(even, odd, -PREDICT_1)
        _interleave(row, even, odd)
    if rows > 1:
        _lift_rows(x, 0, -UPDATE_2)
        _lift_rows(x, 1, -PREDICT_2)
        _lift_rows(x, 0, -UPDATE_1)
        _lift_rows(x, 1, -PREDICT_1)


@compiled
def split_exactly(x: Array) -> None:
    """One level by 5/3, in place, of (rows, columns) int32; the halves as split has them."""
    rows, columns = x.shape
    if rows > 1:
        _lift_rows_exactly(x, 1, -1, 0, 1)
        _lift_rows_exactly(x, 0, 1, 2, 2)
    n = (columns + 1) // 2
    even, odd = np.empty(n, x.dtype), np.empty(columns - n, x.dtype)
    if columns > 1:
        for y in range(rows):
            row = x[y]
            _divide(row, even, odd)
            _lift_odd_exactly(even, odd, -1)
            _lift_even_exactly(even, odd, 1)
            row[:n] = even
            row[n:] = odd


@compiled
def join_exactly(x: Array) -> None:
    """The inverse of split_exactly, in place."""
    rows, columns = x.shape
    n = (columns + 1) // 2
    even, odd = np.empty(n, x.dtype), np.empty(columns - n, x.dtype)
    if columns > 1:
        for y in range(rows):
            row = x[y]
            even[:] = row[:n]
            odd[:] = row[n:]
            _lift_even_exactly(even, odd, -1)
            _lift_odd_exactly(even, odd, 1)
            _interleave(row, even, odd)
    if rows > 1:
        _lift_rows_exactly(x, 0, -1, 2, 2)
        _lift_rows_exactly(x, 1, 1, 0, 1)
