# SPDX-License-Identifier: BSD-3-Clause
"""The encoder's choice of the noise of each band: which number, see `shrinking`, leaves least to be coded.

Samples of the coefficients are sorted by the magnitude of their neighbourhood in the reference: all of a class have
about the same gain, so sums of squares say what any noise leaves of it.
"""
import math
from typing import Tuple

import numpy as np

from ...arrays import Array, FloatArray, IntArray
from .layout import COLUMNS, ORIGIN, ROWS, SIDE, Layout
from .loops import compiled, int32, int64
from .shrinking import GAIN_BITS, GAINS, NONE, PLAIN, RATE_BITS, RATES, shift_of, sum_around

CLASSES = 128
"""Number of classes of sums of magnitudes: two for each octave."""
ELSE = 4.0
"""A difference of this many times the image's energy is that of something else; noise alone makes twice as much."""
SAMPLES = 1 << 13
"""Approximate number of coefficients from which the noise of a band is chosen; rows are left out."""


@compiled
def _differs(canvas: Array, reference: Array, first: int, count: int) -> bool:
    """Whether a reference shows something else than the image does: the difference is far larger than the image."""
    own, apart = 0.0, 0.0
    for i in range(first, first + count):
        value, left = float(canvas[i]), float(canvas[i]) - float(reference[i])
        own += value * value
        apart += left * left
    return apart > ELSE * own


@compiled
def _sample(canvas: Array, reference: Array, band: Array, stride: int, shift: int, found: Array) -> None:
    """Write what `samples` says of a band."""
    wide = band[COLUMNS]
    columns, sums, floats = np.empty(wide + 2, np.int32), np.empty(wide, np.int32), np.empty(wide, np.float32)
    bits = floats.view(np.int32)
    step = max(band[ROWS] * wide // SAMPLES, 1)
    for y in range(step // 2, band[ROWS], step):
        sum_around(reference, band, y, stride, shift, columns, sums)
        for i in range(wide):
            floats[i] = sums[i] + 1
        for start in range(0, wide, SIDE):
            at, count = band[ORIGIN] + y * stride + start, min(SIDE, wide - start)
            if _differs(canvas, reference, at, count):
                continue
            for i in range(count):
                own, other = float(canvas[at + i]), float(reference[at + i])
                into = found[(bits[start + i] >> 22) - 254]     # exponent and one more bit; of 1: 254
                into[0] += 1.0
                into[1] += sums[start + i]
                into[2] += own * own
                into[3] += own * other
                into[4] += other * other


def samples(canvas: Array, reference: Array, plan: Layout) -> Array:
    """Sums over the classes of each band, where the reference shows what the image shows.

    :param canvas, reference: (cells,) int32
    :returns: (bands, classes, 5) float64: numbers, sums of nine magnitudes, squares of the image's coefficients, their
        products with the reference's, and squares of the reference's
    """
    found = np.zeros((len(plan.bands), CLASSES, 5))
    _samples(canvas, reference, plan.bands, plan.stride, int32(shift_of(plan)), found)
    return found


@compiled
def _samples(canvas: Array, reference: Array, bands: Array, stride: int, shift: int, found: Array) -> None:
    for number in range(len(bands)):
        _sample(canvas, reference, bands[number], stride, shift, found[number])


def least_variances(found: FloatArray, plan: Layout, units: FloatArray, leasts: FloatArray
                    ) -> Tuple[FloatArray, FloatArray]:
    """Variances of classes of all bands with the gain that suits each of them best, and numbers of coefficients.

    :param found: see `samples`
    :param units, leasts: (bands,) of a unit of squares, and what rounding leaves
    """
    numbers, (own, both, other) = found[:, :, 0], np.moveaxis(found[:, :, 2:], 2, 0)
    gains = np.clip(both / np.maximum(other, 1.0), 0.0, 1.0)
    means = np.maximum(own - gains * (2 * both - gains * other), 0.0) / np.maximum(numbers, 1.0)
    variances = means * units[:, np.newaxis] + leasts[:, np.newaxis]
    sizes = (plan.bands[:, ROWS] * plan.bands[:, COLUMNS]) / np.maximum(numbers.sum(axis=1), 1.0)
    there = numbers > 0
    return variances[there], (numbers * sizes[:, np.newaxis])[there]


@compiled
def _left(sums: Array, noise: int, rates: Array, gains: Array, unit: float) -> float:
    """What is coded of a band's sample once it is predicted, and what is lost at the same slope.

    :param sums: (classes, 5), see `samples`
    :param unit: of squares, in terms of the distortion
    """
    total = 0.0
    for i in range(len(sums)):
        count = sums[i, 0]
        if count == 0:
            continue
        gain = 0.0 if noise == NONE else 1.0
        if noise > PLAIN:
            step = min((int64(sums[i, 1] / count) * rates[noise]) >> RATE_BITS, len(gains) - 1)
            gain = gains[step] / (1 << GAIN_BITS)
        variance = max(sums[i, 2] - gain * (2 * sums[i, 3] - gain * sums[i, 4]), 0.0) / count * unit
        total += count * (math.log(max(variance, 1.0)) + min(variance, 1.0))
    return total


@compiled
def _best(found: Array, rates: Array, gains: Array, units: Array, noises: Array) -> None:
    for number in range(len(found)):
        best, least = NONE, _left(found[number], NONE, rates, gains, units[number])
        for noise in range(PLAIN, len(rates)):
            left = _left(found[number], noise, rates, gains, units[number])
            if left < least:
                best, least = noise, left
        noises[number] = best


def best_noises(found: FloatArray, units: FloatArray) -> IntArray:
    """(bands,) int64: the numbers of the noises that leave least to be coded.

    :param found: see `samples`
    :param units: (bands,) of squares, in terms of the distortion
    """
    noises: IntArray = np.zeros(len(found), np.int64)
    _best(found, RATES, GAINS, units, noises)
    return noises
