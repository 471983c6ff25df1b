# SPDX-License-Identifier: BSD-3-Clause
"""From pixels to coefficients on the canvas, their quantisation, and back: all in integers, alike everywhere.

Coefficients on a canvas are integers in the unit of the channels, 2^-fraction counts.
"""
import numpy as np

from ...arrays import Array
from . import colour, wavelet
from .layout import COLUMNS, HH, HL, LH, LL, ORIGIN, RATE, RATE_BITS, ROWS, START, STEP, STEP_BITS, Layout
from .loops import compiled, int32, int64
from .passes import ALIVE, FOUND, GUESS_BITS, OLD, PLANE, REFINED, TOP, Work

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
def _quantise(canvas: Array, band: Array, stride: int, half: int, values: Array, counts: Array) -> float:
    """Quantise a band; note its planes and return the sum of squares.

    :param half: what is added before magnitudes are rounded down [2^-RATE_BITS]
    """
    bits, energy, rate = int64(0), int64(0), int32(band[RATE])
    for y in range(band[ROWS]):
        first = band[ORIGIN] + y * stride
        for i in range(first, first + band[COLUMNS]):
            value = canvas[i]
            magnitude = (int64(abs(value)) * rate + half) >> RATE_BITS
            values[i] = magnitude * 2 + (1 if value < 0 else 0)
            bits |= magnitude
            energy += magnitude * magnitude
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
def _estimate(values: Array, found: Array, guesses: Array, counts: Array, band: Array, canvas: Array) -> None:
    """Write what is thought of a band's significant coefficients into a canvas of zeros.

    The first REFINED of those found before the last plane are known down to it, the other old ones to the one above.
    """
    start, step = band[START], band[STEP]
    plane, shift = counts[PLANE], GUESS_BITS + STEP_BITS
    half = int64(1) << (shift - 1)
    if not counts[ALIVE]:
        return
    for i in range(counts[FOUND]):
        place = found[start + i]
        value = int64(values[place])
        low = plane + 1 if counts[REFINED] <= i < counts[OLD] else plane
        magnitude = (((value >> 1 << GUESS_BITS) + guesses[low]) * step + half) >> shift
        canvas[place] = -magnitude if value & 1 else magnitude


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


def estimated(plan: Layout, work: Work) -> Array:
    """(cells,) int32: the canvas of what is known of the coefficients."""
    canvas = np.zeros(plan.cells, np.int32)
    for number, band in enumerate(plan.bands):
        _estimate(work.values, work.found, work.guesses, work.counts[number], band, canvas)
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
