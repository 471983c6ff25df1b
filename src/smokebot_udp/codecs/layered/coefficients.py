# SPDX-License-Identifier: BSD-3-Clause
"""From pixels to coefficients on the canvas, their quantisation, and back: all in integers, alike everywhere.

Coefficients on a canvas are integers in the unit of the channels, 2^-fraction counts.
"""
from typing import Optional, Tuple

import numpy as np

from ...arrays import Array, FloatArray, IntArray
from . import colour, wavelet
from .layout import COLUMNS, HL, LH, MAX_PLANES, ORIGIN, RATE, RATE_BITS, ROWS, STEP, STEP_BITS, Layout
from .loops import compiled, int32, int64, uint64
from .passes import FOUND, GUESS_BITS, OLD, PLANE, REFINED

CENTRE = round(0.45 * 2 ** GUESS_BITS)
"""Where in its interval a coefficient is thought to be [2^-GUESS_BITS]: smaller ones are likelier."""
CENTRE_OF_DIFFERENCES = round(0.37 * 2 ** GUESS_BITS)
"""Likewise for predicted coefficients of the 9/7 wavelet: among them small ones are even likelier."""
STEPS = {True: wavelet.STEPS_5_3, False: wavelet.STEPS_9_7}
"""By `lossless`."""
EXACT = 0, 0, 0
"""No rounding, see colour.rounding."""


@compiled
def _store(x: Array, offset: int, fraction: int, band: Array, stride: int, canvas: Array) -> None:
    """Store LL on the canvas: (rows, columns) int32 or pixels, see wavelet.scaled."""
    for y in range(band[ROWS]):
        for column in range(band[COLUMNS]):
            canvas[band[ORIGIN] + y * stride + column] = wavelet.scaled(x[y, column], int32(offset), int32(fraction))


@compiled
def _load(canvas: Array, band: Array, stride: int, x: Array) -> None:
    """Load LL from the canvas: (rows, columns) int32."""
    for y in range(band[ROWS]):
        for column in range(band[COLUMNS]):
            x[y, column] = canvas[band[ORIGIN] + y * stride + column]


@compiled
def _round(x: Array, shift: int, fraction: int, most: int, pixels: Array) -> None:
    """Round an image that is not split, (rows, columns) int32, to pixels; see wavelet.rounded."""
    for y in range(x.shape[0]):
        for column in range(x.shape[1]):
            pixels[y, column] = wavelet.rounded(x[y, column], int32(shift), int32(fraction), int32(most))


def analyse(pixels: Array, plan: Layout, offset: int) -> Array:
    """(cells,) int32: the canvas of an image.

    :param offset: is subtracted from the first channel [count]
    """
    canvas, number = np.empty(plan.cells, np.int32), 0      # nobody reads the margins of its bands
    for x, subtracted, fraction in colour.to_channels(pixels, offset, plan.fraction):
        for level in range(plan.levels - 1, -1, -1):
            low = np.empty(((x.shape[0] + 1) // 2, (x.shape[1] + 1) // 2), np.int32)
            wavelet.split(x.reshape(-1), (x.shape[0], x.shape[1]), (subtracted, fraction), STEPS[plan.lossless],
                          low.reshape(-1), canvas, _bands_of(plan, number, level), plan.stride)
            x, subtracted, fraction = low, 0, 0
        _store(x, subtracted, fraction, plan.bands[number], plan.stride, canvas)
        number += 1 + 3 * plan.levels
    return canvas


def _bands_of(plan: Layout, number: int, level: int) -> Array:
    """(3, ...): the bands HL, LH and HH of a level of the channel that begins with the band `number`."""
    first = number + 1 + 3 * level
    bands: Array = plan.bands[first:first + 3]
    return bands


@compiled
def _quantise_row(values: Array, at: int, count: int, rate: int, half: int) -> Tuple[int, int]:
    """All bits of the magnitudes of a row, and the sum of their squares; at and count are uint64, rate is int32."""
    bits, energy = int32(0), int64(0)
    for i in range(count):
        value = values[at + i]
        negative = int32(value >> 31)
        magnitude = int32((int64(int32(int32(value ^ negative) - negative)) * rate + half) >> RATE_BITS)
        values[at + i] = int32(int32(magnitude << 1) - negative)
        bits = int32(bits | magnitude)
        energy += int64(magnitude) * int64(magnitude)
    return bits, energy


@compiled
def _quantise(values: Array, bands: Array, stride: int, half: int, planes: Array, energies: Array) -> None:
    """Quantise all bands; note their planes and the sums of squares.

    :param half: what is added before magnitudes are rounded down [2^-RATE_BITS]
    """
    for number in range(len(bands)):
        columns, bits, energy = bands[number, COLUMNS], int64(0), int64(0)
        for y in range(bands[number, ROWS]):
            at = uint64(bands[number, ORIGIN] + y * stride)
            its_bits, squares = _quantise_row(values, at, uint64(columns), int32(bands[number, RATE]), half)
            bits |= its_bits
            energy += squares
        planes[number] = 0
        while bits >> planes[number]:
            planes[number] += 1
        energies[number] = energy


def quantise(canvas: Array, plan: Layout, predicted: Optional[Array]) -> Tuple[IntArray, FloatArray]:
    """Quantise all coefficients of a canvas, in place: see passes.Coefficients.values.

    :param predicted: the canvas of what is predicted of them
    :returns: (bands,): the planes of the largest magnitudes, and the sums of squared magnitudes
    """
    planes, energies = np.zeros(len(plan.bands), np.int64), np.zeros(len(plan.bands))
    if predicted is not None:
        np.subtract(canvas, predicted, out=canvas)
    _quantise(canvas, plan.bands, plan.stride, 0 if plan.lossless else 1 << (RATE_BITS - 1), planes, energies)
    return planes, energies


@compiled
def _estimate(bands: Array, counts: Array, firsts: Array, places: Array, values: Array, guesses: Array, canvas: Array
              ) -> None:
    """Add what is thought of significant coefficients to a canvas.

    Of a band the first REFINED of those found before the last plane are known down to it, the other old ones to the one
    above.
    """
    shift = GUESS_BITS + STEP_BITS
    half = int64(1) << (shift - 1)
    for number in range(len(bands)):
        step, own, first = bands[number, STEP], counts[number], firsts[number]
        for i in range(own[FOUND]):
            value = int64(values[first + i])
            low = own[PLANE] + (1 if own[REFINED] <= i < own[OLD] else 0)
            magnitude = (((value >> (low + 1) << (low + GUESS_BITS)) + guesses[low]) * step + half) >> shift
            canvas[places[first + i]] += -magnitude if value & 1 else magnitude


def guesses_of(lossless: bool, predicted: bool) -> IntArray:
    """(planes,) int64: where in its interval of 2^plane a coefficient is thought to be [2^-GUESS_BITS]."""
    centre = CENTRE_OF_DIFFERENCES if predicted and not lossless else CENTRE
    guesses: IntArray = centre << np.arange(MAX_PLANES + 1)
    return guesses >> GUESS_BITS << GUESS_BITS if lossless else guesses - centre


def add_estimates(canvas: Array, plan: Layout, firsts: IntArray, places: Array, values: Array, counts: Array,
                  guesses: IntArray) -> None:
    """Add what is known of significant coefficients to a canvas; see prefixes.Prefixes.

    :param counts: (bands, 9) int64, see passes.Coding: how many are known, and down to which plane
    :param guesses: see guesses_of
    """
    _estimate(plan.bands, counts, firsts, places, values, guesses, canvas)


def synthesise(canvas: Array, plan: Layout, offset: int, itemsize: int) -> Array:
    """The inverse of analyse: the pixels of a canvas."""
    rounding = colour.rounding(offset, plan.fraction, itemsize)
    if plan.channels == 1:
        return _joined(canvas, plan, 0, rounding, np.uint8 if itemsize == 1 else np.uint16)
    parts = [_joined(canvas, plan, number, EXACT, np.int32)
             for number in range(0, len(plan.bands), 1 + 3 * plan.levels)]
    return colour.from_channels(parts, *rounding[:2])


def _joined(canvas: Array, plan: Layout, number: int, rounding: Tuple[int, int, int], kind: type) -> Array:
    """(height, width) of this type: the channel that begins with the band `number`."""
    steps = wavelet.inverse(STEPS[plan.lossless])
    x = np.empty((plan.bands[number, ROWS], plan.bands[number, COLUMNS]), np.int32)
    _load(canvas, plan.bands[number], plan.stride, x)
    for level in range(plan.levels):
        bands, is_last = _bands_of(plan, number, level), level == plan.levels - 1
        low, size = x.reshape(-1), (x.shape[0] + bands[LH, ROWS], x.shape[1] + bands[HL, COLUMNS])
        x = np.empty(size, kind if is_last else np.int32)
        wavelet.join(low, canvas, bands, plan.stride, steps, rounding if is_last else EXACT, x.reshape(-1), size)
    if not plan.levels and rounding != EXACT:
        values, x = x, np.empty(x.shape, kind)
        _round(values, *rounding, x)
    return x
