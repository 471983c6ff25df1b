# SPDX-License-Identifier: BSD-3-Clause
"""What a reference's coefficients predict: each of them, shrunk by how much its neighbourhood stands out of noise.

The noise of a sensor and of quantisation is in all coefficients alike, what is seen is in few of them, side by side.
With e the mean magnitude of a coefficient and its eight neighbours and n that of the noise, a coefficient is multiplied
by e^2 / (e^2 + n^2), as by a Wiener filter. The noise is a property of a band. All is of integers.
"""
import numpy as np

from ...arrays import Array
from .layout import COLUMNS, FRACTION, ORIGIN, ROWS, Layout
from .loops import compiled, int32, int64, uint64

NONE, PLAIN, FAINTEST, STRONGEST = 0, 1, 2, 40
"""Numbers of noises. NONE: the band is not predicted. PLAIN: there is no noise. From FAINTEST to STRONGEST each is
stronger than the one before by 3 dB."""
FAINT = 4.0
"""Mean magnitude of the coefficients of noise of the number FAINTEST [2^-FRACTION counts]."""
RATE_BITS = 30
GAIN_BITS = 8
FINENESS = 16
"""Steps of e / n."""
LARGEST = 1 << 26
"""Larger magnitudes count as this one."""
CELLS = 9
"""A coefficient and its neighbours."""
_SQUARES = (2 * np.arange(32 * FINENESS, dtype=np.int64) + 1) ** 2
_UNIT = (2 * FINENESS) ** 2
GAINS = ((_SQUARES << GAIN_BITS) + (_SQUARES + _UNIT) // 2) // (_SQUARES + _UNIT)
"""(steps,) int64: the gain at each step of e / n [2^-GAIN_BITS]; beyond, it is the last one, 1"""
RATES = np.array([0, 0] + [round(2.0 ** (RATE_BITS - number / 2) * FINENESS / (CELLS * FAINT))
                           for number in range(STRONGEST - FAINTEST + 1)], np.int64)
"""(numbers,) int64: steps of e / n for each unit of the sum of the nine magnitudes [2^-RATE_BITS]"""


@compiled
def _add_row(canvas: Array, at: int, shift: int, sums: Array) -> None:
    """Add the magnitudes of a row, times 2^shift, to sums[1:-1]; at is uint64, shift is int32."""
    most = int32(LARGEST >> shift)
    for i in range(uint64(len(sums) - 2)):
        value = canvas[at + i]
        negative = int32(value >> 31)
        sums[i + uint64(1)] += int32(min(int32(int32(value ^ negative) - negative), most) << shift)


@compiled
def sum_around(canvas: Array, band: Array, y: int, stride: int, shift: int, columns: Array, sums: Array) -> None:
    """Write the sum of the magnitudes of each coefficient of a row and its neighbours; those at borders are repeated.

    :param shift: the magnitudes are times 2^shift, int32
    :param columns: (n + 2,) int32, scratch
    :param sums: (n,) int32
    """
    columns[:] = 0
    for row in (max(y - 1, 0), y, min(y + 1, band[ROWS] - 1)):
        _add_row(canvas, uint64(band[ORIGIN] + row * stride), shift, columns)
    columns[0], columns[-1] = columns[1], columns[-2]
    for i in range(uint64(len(sums))):
        sums[i] = int32(int32(columns[i] + columns[i + uint64(1)]) + columns[i + uint64(2)])


@compiled
def _shrink(canvas: Array, at: int, sums: Array, rate: int, gains: Array, result: Array) -> None:
    """Write a row; at is uint64, the rate is int64."""
    last = int64(len(gains) - 1)
    for i in range(uint64(len(sums))):
        gain = gains[uint64(min((int64(sums[i]) * rate) >> RATE_BITS, last))]
        result[at + i] = int32((int64(canvas[at + i]) * gain + (1 << (GAIN_BITS - 1))) >> GAIN_BITS)


@compiled
def _write(canvas: Array, bands: Array, stride: int, shift: int, noises: Array, rates: Array, gains: Array,
           result: Array) -> None:
    for number in range(len(bands)):
        band, wide = bands[number], bands[number, COLUMNS]
        columns, sums = np.empty(wide + 2, np.int32), np.empty(wide, np.int32)
        for y in range(band[ROWS]):
            at = band[ORIGIN] + y * stride
            if noises[number] == NONE:
                result[at:at + wide] = 0
            elif noises[number] == PLAIN:
                result[at:at + wide] = canvas[at:at + wide]
            else:
                sum_around(canvas, band, y, stride, shift, columns, sums)
                _shrink(canvas, uint64(at), sums, rates[noises[number]], gains, result)


def shift_of(plan: Layout) -> int:
    """Coefficients times 2^shift are in 2^-FRACTION counts."""
    return FRACTION - plan.fraction


def shrunk(canvas: Array, plan: Layout, noises: Array) -> Array:
    """(cells,) int32: what is predicted from the canvas of a reference.

    :param noises: (bands,) int64: numbers of the noises
    """
    result = np.empty(plan.cells, np.int32)     # nobody reads the margins of its bands
    _write(canvas, plan.bands, plan.stride, int32(shift_of(plan)), noises, RATES, GAINS, result)
    return result
