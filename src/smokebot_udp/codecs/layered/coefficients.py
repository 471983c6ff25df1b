# SPDX-License-Identifier: BSD-3-Clause
"""From pixels to coefficients on the canvas, their quantisation, and back: all in integers, alike everywhere.

Coefficients on a canvas are integers in the unit of the channels, 2^-fraction counts.
"""
from typing import Tuple

import numpy as np

from ...arrays import Array, IntArray
from . import colour, wavelet
from .layout import COLUMNS, HH, HL, LH, LL, MAX_PLANES, ORIGIN, RATE, RATE_BITS, ROWS, STEP, STEP_BITS, Layout
from .loops import compiled, int32, int64
from .passes import FOUND, GUESS_BITS, OLD, PLANE, REFINED, TOP, Work

CENTRE = round(0.45 * 2 ** GUESS_BITS)
"""Where in its interval a coefficient is thought to be [2^-GUESS_BITS]: smaller ones are likelier."""
STEPS = {True: wavelet.STEPS_5_3, False: wavelet.STEPS_9_7}
"""By `lossless`."""


@compiled
def _source_row(kind: int, row: int) -> int:
    """Of a band's row in a split image: its rows are interleaved; LL comes alone."""
    if kind == LL:
        return row
    return 2 * row if kind == HL else 2 * row + 1


@compiled
def _source_column(kind: int, columns: int) -> int:
    """Of a band's first coefficient in a split image."""
    return 0 if kind in (LH, LL) else (columns + 1) // 2


@compiled
def _store(x: Array, kind: int, band: Array, stride: int, canvas: Array) -> None:
    """Copy a band of a split image to the canvas."""
    first = _source_column(kind, x.shape[1])
    for y in range(band[ROWS]):
        at = band[ORIGIN] + y * stride
        canvas[at:at + band[COLUMNS]] = x[_source_row(kind, y), first:first + band[COLUMNS]]


@compiled
def _low_half(x: Array) -> Array:
    """LL of a split image."""
    rows, columns = (x.shape[0] + 1) // 2, (x.shape[1] + 1) // 2
    low = np.empty((rows, columns), x.dtype)
    for y in range(rows):
        low[y] = x[2 * y, :columns]
    return low


def analyse(pixels: Array, plan: Layout, offset: int) -> Array:
    """(cells,) int32: the canvas of an image.

    :param offset: is subtracted from the first channel [count]
    """
    canvas, number = np.zeros(plan.cells, np.int32), 0
    for x in colour.to_channels(pixels, offset, plan.fraction):
        for level in range(plan.levels):
            wavelet.split(x, STEPS[plan.lossless])
            for kind in (HL, LH, HH):
                _store(x, kind, plan.bands[number + 1 + 3 * (plan.levels - 1 - level) + kind], plan.stride, canvas)
            x = _low_half(x)
        _store(x, LL, plan.bands[number], plan.stride, canvas)
        number += 1 + 3 * plan.levels
    return canvas


@compiled
def _quantise_row(canvas: Array, rate: int, half: int, values: Array) -> Tuple[int, int]:
    """All bits of the magnitudes of a row, and the sum of their squares."""
    bits, energy = int64(0), int64(0)
    for i in range(len(canvas)):
        value = canvas[i]
        magnitude = (int64(abs(value)) * rate + half) >> RATE_BITS
        values[i] = magnitude * 2 + (1 if value < 0 else 0)
        bits |= magnitude
        energy += magnitude * magnitude
    return bits, energy


@compiled
def _quantise(canvas: Array, band: Array, stride: int, half: int, values: Array, counts: Array) -> float:
    """Quantise a band; note its planes and return the sum of squares.

    :param half: what is added before magnitudes are rounded down [2^-RATE_BITS]
    """
    bits, energy = int64(0), int64(0)
    for y in range(band[ROWS]):
        first = band[ORIGIN] + y * stride
        last = first + band[COLUMNS]
        some, squares = _quantise_row(canvas[first:last], int32(band[RATE]), half, values[first:last])
        bits |= some
        energy += squares
    planes = 0
    while bits >> planes:
        planes += 1
    counts[TOP] = planes
    return float(energy)


def quantise(canvas: Array, plan: Layout, work: Work) -> int:
    """Quantise all coefficients; the number of planes of the largest magnitude."""
    half = 0 if plan.lossless else 1 << (RATE_BITS - 1)
    for number, band in enumerate(plan.bands):
        energy = _quantise(canvas, band, plan.stride, half, work.values, work.counts[number])
        work.error[0] += float(plan.weights[number]) ** 2 * energy
    return int(work.counts[:, TOP].max())


@compiled
def _estimate(bands: Array, counts: Array, firsts: Array, places: Array, values: Array, guesses: Array, canvas: Array
              ) -> None:
    """Write what is thought of significant coefficients into a canvas of zeros.

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
            canvas[places[first + i]] = -magnitude if value & 1 else magnitude


@compiled
def _load(x: Array, canvas: Array, kind: int, band: Array, stride: int) -> None:
    """Copy a band from the canvas to its place in a split image."""
    first = _source_column(kind, x.shape[1])
    for y in range(band[ROWS]):
        at = band[ORIGIN] + y * stride
        x[_source_row(kind, y), first:first + band[COLUMNS]] = canvas[at:at + band[COLUMNS]]


@compiled
def _enlarged(low: Array, canvas: Array, bands: Array, stride: int) -> Array:
    """A split image of a level: LL and its three bands."""
    rows, columns = low.shape[0] + bands[LH, ROWS], low.shape[1] + bands[HL, COLUMNS]
    x = np.empty((rows, columns), low.dtype)
    for y in range(low.shape[0]):
        x[2 * y, :low.shape[1]] = low[y]
    for kind in range(3):
        _load(x, canvas, kind, bands[kind], stride)
    return x


def guesses_of(lossless: bool) -> IntArray:
    """(planes,) int64: where in its interval of 2^plane a coefficient is thought to be [2^-GUESS_BITS]."""
    guesses: IntArray = CENTRE << np.arange(MAX_PLANES + 1)
    return guesses >> GUESS_BITS << GUESS_BITS if lossless else guesses - CENTRE


def estimated(plan: Layout, firsts: IntArray, places: Array, values: Array, counts: Array) -> Array:
    """(cells,) int32: the canvas of what is known of significant coefficients; see prefixes.Prefixes.

    :param counts: (bands, 9) int64, see passes.Work: how many are known, and down to which plane
    """
    canvas = np.zeros(plan.cells, np.int32)
    _estimate(plan.bands, counts, firsts, places, values, guesses_of(plan.lossless), canvas)
    return canvas


def synthesise(canvas: Array, plan: Layout, offset: int, itemsize: int) -> Array:
    """The inverse of analyse: the pixels of a canvas."""
    steps, parts, number = wavelet.inverse(STEPS[plan.lossless]), [], 0
    for _ in range(plan.channels):
        x = np.empty((plan.bands[number, ROWS], plan.bands[number, COLUMNS]), canvas.dtype)
        _load(x, canvas, LL, plan.bands[number], plan.stride)
        for level in range(plan.levels):
            first = number + 1 + 3 * level
            x = _enlarged(x, canvas, plan.bands[first:first + 3], plan.stride)
            wavelet.join(x, steps)
        parts.append(x)
        number += 1 + 3 * plan.levels
    return colour.from_channels(parts, offset, plan.fraction, itemsize)
