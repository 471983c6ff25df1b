# SPDX-License-Identifier: BSD-3-Clause
"""From channels to quantised coefficients on the canvas, and back."""
from typing import List

import numpy as np

from ...arrays import Array
from . import wavelet
from .layout import COLUMNS, FINE, HL, LH, LL, ORIGIN, ROWS, START, Layout
from .loops import compiled, float32, int32, int64
from .passes import ALIVE, FOUND, OLD, PLANE, REFINED, TOP, Work

STEPS = float32(1 << FINE)
"""Quantisation steps of the 9/7 in one grey level."""


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
def _store(x: Array, kind: int, steps: float, half: float, values: Array, band: Array, stride: int, counts: Array
           ) -> float:
    """Quantise a band of a split image; note its planes and return the sum of squares.

    :param steps: in one grey level; `half`: added before magnitudes are truncated
    """
    first, bits, energy = _source_column(kind, x.shape[1]), 0, int64(0)
    for y in range(band[ROWS]):
        row, at = x[_source_row(kind, y)], band[ORIGIN] + y * stride
        for i in range(band[COLUMNS]):
            value = row[first + i]
            magnitude = int32(abs(value) * steps + half)
            values[at + i] = magnitude * 2 + (1 if value < 0 else 0)
            bits |= magnitude
        for i in range(at, at + band[COLUMNS]):
            energy += int64(values[i] >> 1) * int64(values[i] >> 1)
    planes = 0
    while bits >> planes:
        planes += 1
    counts[TOP] = planes
    return float(energy)


@compiled
def _low_half(x: Array) -> Array:
    """LL of a split image."""
    rows, columns = (x.shape[0] + 1) // 2, (x.shape[1] + 1) // 2
    low = np.empty((rows, columns), x.dtype)
    for y in range(rows):
        low[y] = x[2 * y, :columns]
    return low


def analyse(channels: List[Array], plan: Layout, lossless: bool, work: Work) -> int:
    """Transform and quantise all channels, which are overwritten; the number of planes of the largest magnitude."""
    split, number = wavelet.split_exactly if lossless else wavelet.split, 0
    steps, half = (float32(1), float32(0)) if lossless else (STEPS, float32(0.5))

    def store(x: Array, kind: int, number: int) -> None:
        energy = _store(x, kind, steps, half, work.values, plan.bands[number], plan.stride, work.counts[number])
        work.error[0] += float(plan.weights[number]) ** 2 * energy

    for x in channels:
        for level in range(plan.levels):
            split(x)
            for kind in (HL, LH, 2):
                store(x, kind, number + 1 + 3 * (plan.levels - 1 - level) + kind)
            x = _low_half(x)
        store(x, LL, number)
        number += 1 + 3 * plan.levels
    return int(work.counts[:, TOP].max())


@compiled
def _estimate(work: Work, number: int, start: int, step: float, canvas: Array) -> None:
    """Write what is thought of a band's significant coefficients into a canvas of zeros.

    The first REFINED of those found before the last plane are known down to it, the other old ones to the one above.
    """
    counts = work.counts[number]
    plane = counts[PLANE]
    if not counts[ALIVE]:
        return
    for i in range(counts[FOUND]):
        place = work.found[start + i]
        value = work.values[place]
        low = plane + 1 if counts[REFINED] <= i < counts[OLD] else plane
        magnitude = ((value >> 1) + work.guesses[low]) * step
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


def synthesise(plan: Layout, lossless: bool, work: Work, channels: int) -> List[Array]:
    """The channels, (height, width) int32 or float32, of what is known of the coefficients."""
    canvas = np.zeros(plan.cells, np.int32 if lossless else np.float32)
    for number, band in enumerate(plan.bands):
        _estimate(work, number, int(band[START]), 1.0 if lossless else 1 / float(STEPS), canvas)
    join, result, number = wavelet.join_exactly if lossless else wavelet.join, [], 0
    for _ in range(channels):
        x = np.empty((plan.bands[number, ROWS], plan.bands[number, COLUMNS]), canvas.dtype)
        _load(x, canvas, LL, plan.bands[number], plan.stride)
        for level in range(plan.levels):
            first = number + 1 + 3 * level
            x = _enlarged(x, canvas, plan.bands[first:first + 3], plan.stride)
            join(x)
        result.append(x)
        number += 1 + 3 * plan.levels
    return result
