# SPDX-License-Identifier: BSD-3-Clause
"""Two wavelet transforms by lifting, symmetric at the border, of images of any size (JPEG 2000 part 1, annex F).

9/7 (Cohen, Daubechies, Feauveau 1992; lifting: Daubechies and Sweldens 1998) and 5/3 (Le Gall and Tabatabai 1988). Both
are of integers: each lifting step adds a rounded product, so the inverse is exact, and alike on every machine. A level
splits rows and columns in halves: the even samples become the low half, rounded up, the odd ones the high half. Halves
are not scaled: see `gains` in layout.py.
"""
from typing import Any, Tuple

import numpy as np

from ...arrays import Array
from .layout import HH, HL, LH, ORIGIN
from .loops import compiled, inlined, int32, int64, uint64

BITS = 30
"""Factors of lifting steps are in 2^-BITS."""
ONE = uint64(1)
RING = 8
"""Rows that are lifted at a time, and some more."""
LANES = 32
"""Samples that the compiler's vectors take at a time: 4 of 8. Rows are padded to multiples of it, as a remainder takes
as long as all the vectors of a short one."""
LARGEST = int32(1 << 30)
"""Channels of an image are smaller [2^-fraction]."""


def _steps(*steps: Tuple[int, float, int, int]) -> Array:
    """(s, 4) int64: whether odd samples are lifted; the factor, and what is added before rounding down [2^-BITS]; of
    factors of 2^-n, which are computed in 32 bits, n, else 0.

    Odd and even samples take turns.
    """
    return np.array([(odd, round(factor * 2 ** BITS), added, halvings) for odd, factor, added, halvings in steps],
                    np.int64)


_HALF = 1 << (BITS - 1)
STEPS_9_7 = _steps((1, -1.586134342059924, _HALF, 0), (0, -0.052980118572961, _HALF, 0),
                   (1, 0.882911075530934, _HALF, 0), (0, 0.443506852043971, _HALF, 0))
STEPS_5_3 = _steps((1, -0.5, 2 * _HALF - 1, 1), (0, 0.25, _HALF, 2))
_ODD, _FACTOR, _ADDED, _HALVINGS = range(4)


def inverse(steps: Array) -> Array:
    """The steps of `join` that undo those of `split`."""
    return np.array([(odd, -factor, 2 * _HALF - 1 - added, halvings) for odd, factor, added, halvings in steps[::-1]],
                    np.int64)


@inlined
def _product(one: int, other: int, factor: int, added: int) -> Any:
    """What a step adds to a sample between two others."""
    return (int64(int32(one + other)) * factor + added) >> BITS


@inlined
def _part(one: int, other: int, again: int, negative: int) -> Any:
    """As _product, of factors 2^-n in 32 bits: half of a sum, rounded down, or a quarter of it, to the nearest.

    :param again: int32: 1: a quarter; 0: half
    :param negative: int32: -1: the negative of it; 0: it
    """
    part = int32(int32(int32(int32(one + other) >> 1) + again) >> again)
    return int32(int32(part ^ negative) - negative)


@compiled
def _numbers(steps: Array, step: int) -> Tuple[int, int, int, int]:
    """The last arguments of _product and _part; steps that are products have -1 in place of the first one of _part."""
    factor = steps[step, _FACTOR]
    return int32(factor), steps[step, _ADDED], int32(steps[step, _HALVINGS] - 1), int32(-1 if factor < 0 else 0)


@compiled
def lift(ring: Array, at: int, above: int, below: int, steps: Array, step: int) -> None:
    """One step of row `at`."""
    factor, added, again, negative = _numbers(steps, step)
    if again < 0:
        for i in range(ring.shape[1]):
            ring[at, i] += _product(ring[above, i], ring[below, i], factor, added)
    else:
        for i in range(ring.shape[1]):
            ring[at, i] += _part(ring[above, i], ring[below, i], again, negative)


@compiled
def _lift_rows(ring: Array, rows: int, y: int, steps: Array) -> None:
    """Each step s of the row y - s: those that the rows up to y, lifted likewise, allow.

    :param ring: (RING, columns or more) int32: row y is ring[y % RING]
    """
    for step in range(len(steps)):
        at = y - step
        if 0 <= at < rows:
            above, below = at - 1 if at > 0 else at + 1, at + 1 if at + 1 < rows else at - 1
            lift(ring, at % RING, above % RING, below % RING, steps, step)


@compiled
def _lift_odd(even: Array, odd: Array, steps: Array, step: int) -> None:
    """One step of the odd samples of a row, see _lift_row."""
    factor, added, again, negative = _numbers(steps, step)
    if again < 0:
        for i in range(len(odd) - 2):
            odd[i + 1] += _product(even[i], even[i + 1], factor, added)
    else:
        for i in range(len(odd) - 2):
            odd[i + 1] += _part(even[i], even[i + 1], again, negative)


@compiled
def _lift_even(even: Array, odd: Array, steps: Array, step: int) -> None:
    """One step of the even samples of a row, see _lift_row."""
    factor, added, again, negative = _numbers(steps, step)
    if again < 0:
        for i in range(len(even) - 1):
            even[i] += _product(odd[i], odd[i + 1], factor, added)
    else:
        for i in range(len(even) - 1):
            even[i] += _part(odd[i], odd[i + 1], again, negative)


@compiled
def _lift_row(even: Array, odd: Array, columns: int, steps: Array) -> None:
    """All steps of the samples of a row; those at the border are mirrored beside them.

    :param even: (m + 1 or more,) int32: the even samples, then what is overwritten
    :param odd: (n + 2 or more,) int32: one that is overwritten, the odd samples, then what is overwritten
    """
    m, n = (columns + 1) // 2, columns // 2
    for step in range(len(steps) if n else 0):
        if steps[step, _ODD]:
            if m == n:
                even[m] = even[m - 1]
            _lift_odd(even, odd, steps, step)
        else:
            odd[0], odd[n + 1] = odd[1], odd[n]
            _lift_even(even, odd, steps, step)


@compiled
def _separate(ring: Array, at: int, columns: int, even: Array, odd: Array) -> None:
    """The samples of the row that begins at `at`, see _lift_row."""
    last = columns >> ONE
    for i in range(last):
        even[i] = ring[at + i + i]
    for i in range(last):
        odd[i + ONE] = ring[at + i + i + ONE]
    if columns & ONE:
        even[last] = ring[at + last + last]


@compiled
def _interleave(even: Array, odd: Array, ring: Array, at: int, columns: int) -> None:
    """The inverse of _separate."""
    last = columns >> ONE
    for i in range(last):
        ring[at + i + i] = even[i]
        ring[at + i + i + ONE] = odd[i + ONE]
    if columns & ONE:
        ring[at + last + last] = even[last]


@compiled
def _copy(source: Array, start: int, result: Array, at: int, count: int) -> None:
    """Some values to another array."""
    for i in range(count):
        result[at + i] = source[start + i]


@inlined
def scaled(value: int, offset: int, fraction: int) -> Any:
    """(value - offset) * 2^fraction, all int32."""
    return int32(int32(int32(value) - offset) << fraction)


@inlined
def rounded(value: int, shift: int, fraction: int, most: int) -> Any:
    """(value + shift) / 2^fraction, from 0 to `most`, all int32."""
    # values of streams with faults are larger: sums of theirs need more than 32 bits
    within = int32(min(max(value, -LARGEST), LARGEST) + shift)
    return min(max(int32(within >> fraction), int32(0)), most)


@compiled
def _load(source: Array, start: int, count: int, offset: int, fraction: int, ring: Array, at: int) -> None:
    """A row of a flat array."""
    for i in range(count):
        ring[at + i] = scaled(source[start + i], offset, fraction)


@compiled
def _store(ring: Array, at: int, count: int, shift: int, fraction: int, most: int, result: Array, to: int) -> None:
    """A row of a flat array, exactly where `most` is 0."""
    if most == 0:
        _copy(ring, at, result, to, count)
    else:
        for i in range(count):
            result[to + i] = rounded(ring[at + i], shift, fraction, most)


@compiled
def _copy_halves(halves: Tuple[Array, Array], columns: int, y: int, low: Array, canvas: Array, bands: Array,
                 stride: int, store: bool) -> None:
    """Store the halves of row y, even and odd, or load them."""
    even, odd = halves
    lows, highs, at = uint64((columns + 1) // 2), uint64(columns // 2), y // 2 * stride
    low_at = uint64(bands[LH, ORIGIN] + at if y % 2 else y // 2 * ((columns + 1) // 2))
    high_at = uint64(bands[HH if y % 2 else HL, ORIGIN] + at)
    lower = canvas if y % 2 else low
    if store:
        _copy(even, uint64(0), lower, low_at, lows)
        _copy(odd, ONE, canvas, high_at, highs)
    else:
        _copy(lower, low_at, even, uint64(0), lows)
        _copy(canvas, high_at, odd, ONE, highs)


@compiled
def _buffers(columns: int) -> Tuple[Array, Array, Array]:
    """What rows are lifted in, see _lift_rows and _lift_row."""
    whole, half = (columns + LANES - 1) // LANES * LANES, ((columns + 1) // 2 + LANES - 1) // LANES * LANES
    return np.zeros((RING, whole), np.int32), np.zeros(half + 1, np.int32), np.zeros(half + 2, np.int32)


@compiled
def split(source: Array, size: Tuple[int, int], scale: Tuple[int, int], steps: Array, low: Array, canvas: Array,
          bands: Array, stride: int) -> None:
    """One level, in one sweep: each row is lifted while it is in the processor's cache.

    The compiler makes vectors of the loops over the samples of a row, because they are functions of their own, whose
    indexes are known not to be negative: numba counts negative ones from the end.

    :param source: (rows * columns,) int32 or pixels
    :param size: rows and columns
    :param scale: offset and fraction, see `scaled`
    :param low: (ceil(rows / 2) * ceil(columns / 2),) int32, becomes LL
    :param canvas: (cells,) int32: the others are stored there
    :param bands: (3, ...) int64: of HL, LH and HH, see layout.Layout
    """
    (rows, columns), (offset, fraction) = size, scale
    ring, even, odd = _buffers(columns)
    flat, pitch, count, begun, done = ring.reshape(-1), uint64(ring.shape[1]), uint64(columns), 0, 0
    for y in range(1, rows + len(steps) + 1, 2):
        while begun < min(y + 2, rows):
            _load(source, uint64(begun) * count, count, int32(offset), int32(fraction), flat,
                  uint64(begun % RING) * pitch)
            begun += 1
        if rows > 1:
            _lift_rows(ring, rows, y, steps)
        while done < min(y - len(steps) + 1, rows):
            _separate(flat, uint64(done % RING) * pitch, count, even, odd)
            _lift_row(even, odd, columns, steps)
            _copy_halves((even, odd), columns, done, low, canvas, bands, stride, True)
            done += 1


@compiled
def join(low: Array, canvas: Array, bands: Array, stride: int, steps: Array, rounding: Tuple[int, int, int],
         result: Array, size: Tuple[int, int]) -> None:
    """The inverse of split, by the `inverse` of its steps.

    :param rounding: shift, fraction, and the most of pixels, see `rounded`; a most of 0: the result is exact
    :param result: (rows * columns,) int32 or pixels
    :param size: rows and columns
    """
    rows, columns = size
    shift, fraction, most = rounding
    ring, even, odd = _buffers(columns)
    flat, pitch, count, begun, done = ring.reshape(-1), uint64(ring.shape[1]), uint64(columns), 0, 0
    for y in range(0, rows + len(steps), 2):
        while begun < min(y + 2, rows):
            _copy_halves((even, odd), columns, begun, low, canvas, bands, stride, False)
            _lift_row(even, odd, columns, steps)
            _interleave(even, odd, flat, uint64(begun % RING) * pitch, count)
            begun += 1
        if rows > 1:
            _lift_rows(ring, rows, y, steps)
        while done < min(y - len(steps) + 2, rows):
            _store(flat, uint64(done % RING) * pitch, count, int32(shift), int32(fraction), int32(most), result,
                   uint64(done) * count)
            done += 1
