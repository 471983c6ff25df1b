# SPDX-License-Identifier: BSD-3-Clause
"""An image displaced by a mesh, in integers only: the same pixels on every machine.

A mesh has (2^level + 1)^2 nodes, evenly spaced over the image from corner to corner. Each has a displacement; between
nodes it is interpolated bilinearly. RUN pixels of a row have the same one, as the blocks of affine motion in H.266 do.
A pixel of the result is interpolated from 4 x 4 pixels of the source around where the displacement leads; those beyond
the border are the border's.
"""
import math
from typing import Any, Tuple

import numpy as np

from ...arrays import Array, IntArray
from .loops import compiled, int32, int64, uint64

NODE_UNITS = 32
"""Displacements of nodes are in parts of a pixel of this number."""
PHASES = 64
"""Displacements of pixels are."""
ROUND, SHIFT = 1 << 14, 15
"""From displacements of nodes, times two weights, to those of pixels."""
ONE = 128
"""The sum of the four weights of a phase."""
WEIGHT = 256
"""The sum of the weights of the nodes on two sides."""
RUN = 4
"""Pixels with the same displacement."""
LANES = 8
"""Columns that are summed at once: those that a run needs, RUN + 3, and one more; of colours, of all channels."""
APART = 4
"""Distance of compared pixels."""


def _weights(b: float, c: float) -> IntArray:
    """(PHASES, 4) int32: the piecewise cubic filter with these parameters (Mitchell and Netravali 1988).

    Rounded such that the sum is ONE; the largest weight takes what is left.
    """
    distances = np.abs(np.arange(-1, 3) - np.arange(PHASES)[:, np.newaxis] / PHASES)
    near = (12 - 9 * b - 6 * c) * distances ** 3 + (-18 + 12 * b + 6 * c) * distances ** 2 + 6 - 2 * b
    far = (-b - 6 * c) * distances ** 3 + (6 * b + 30 * c) * distances ** 2 - (12 * b + 48 * c) * distances + (
        8 * b + 24 * c)
    weights = np.rint(np.where(distances < 1, near, np.where(distances < 2, far, 0)) * ONE / 6)
    rows = np.arange(PHASES)
    weights[rows, weights.argmax(axis=1)] += ONE - weights.sum(axis=1)
    return np.asarray(weights, np.int32)


SHARP = _weights(0, 0.5)
"""Catmull-Rom: keeps detail."""
SMOOTH = _weights(1, 0)
"""Cubic B-spline: removes noise."""


@compiled
def _place(i: int, size: int, cells: int) -> Tuple[int, int]:
    """The cell of a row or column, and the weight of the nodes behind it, up to WEIGHT."""
    at = i * cells * WEIGHT // max(size - 1, 1)
    cell = min(at // WEIGHT, cells - 1)
    return cell, at - cell * WEIGHT


@compiled
def _between(nodes: Array, y: int, height: int, result: Array) -> None:
    """The displacements of the nodes' columns at row y, times WEIGHT: result[:, :n] of (2, ...) int64."""
    cells = nodes.shape[0] - 1
    cell, below = _place(y, height, cells)
    for column in range(cells + 1):
        for k in range(2):
            result[k, column] = (int64(nodes[cell, column, k]) * (WEIGHT - below)
                                 + int64(nodes[cell + 1, column, k]) * below)


@compiled
def _sum(values: Array, at: Any, apart: Any, a: int, b: int, c: int, d: int) -> Any:
    """The weighted sum of four values. Indexes are unsigned: numba counts negative ones from the end, which takes twice
    the time."""
    return int32(int32(int32(a * int32(values[at])) + int32(b * int32(values[at + apart]))) + int32(
        int32(c * int32(values[at + apart + apart])) + int32(d * int32(values[at + apart + apart + apart]))))


@compiled
def _sums(values: Array, start: int, distance: int, filters: Array, phase: int, result: Array, first: int) -> None:
    """LANES weighted sums of four values, `distance` apart: result[first:first + LANES].

    All are known before the first one is stored: else the compiler makes no vectors of them, as the arrays might be
    the same one. And a phase is passed, as numba counts the references to a row of the filters.
    """
    at, to, apart = uint64(start), uint64(first), uint64(distance)
    a, b, c, d = filters[phase, 0], filters[phase, 1], filters[phase, 2], filters[phase, 3]
    one = _sum(values, at, apart, a, b, c, d)
    two = _sum(values, at + uint64(1), apart, a, b, c, d)
    three = _sum(values, at + uint64(2), apart, a, b, c, d)
    four = _sum(values, at + uint64(3), apart, a, b, c, d)
    five = _sum(values, at + uint64(4), apart, a, b, c, d)
    six = _sum(values, at + uint64(5), apart, a, b, c, d)
    seven = _sum(values, at + uint64(6), apart, a, b, c, d)
    eight = _sum(values, at + uint64(7), apart, a, b, c, d)
    result[to], result[to + uint64(1)], result[to + uint64(2)], result[to + uint64(3)] = one, two, three, four
    result[to + uint64(4)], result[to + uint64(5)] = five, six
    result[to + uint64(6)], result[to + uint64(7)] = seven, eight


@compiled
def _across(source: Array, top: int, left: int, size: Tuple[int, int, int], down: Array, right: Array, result: Array,
            first: int, count: int) -> None:
    """The weighted sums of `count` values around 4 x 4 pixels; some pixels may be beyond the border."""
    height, width, channels = size
    for k in range(count):
        total = 0
        for i in range(16):
            y = min(max(top + (i >> 2), 0), height - 1)
            x = min(max(left + (i & 3) + k // channels, 0), width - 1)
            value = int64(source[(y * width + x) * channels + k % channels])
            total += int64(down[i >> 2]) * int64(right[i & 3]) * value
        result[first + k] = total


@compiled
def runs_of(width: int, cells: int) -> Array:
    """(runs, 2) int64: of each run of pixels of a row, its cell and the weight of the nodes behind it."""
    result = np.empty(((width + RUN - 1) // RUN, 2), np.int64)
    for i in range(len(result)):
        x = i * RUN
        result[i, 0], result[i, 1] = _place(x + min(RUN, width - x) // 2, width, cells)
    return result


@compiled
def warp_row(source: Array, size: Tuple[int, int, int], nodes: Array, filters: Array, y: int, runs: Array, work: Array,
             sums: Array, result: Array) -> None:
    """Row y of the displaced image, times ONE * ONE.

    No sum exceeds 32 bits: the magnitudes of the weights of SHARP add up to 1.25 times ONE at most, both ways.

    :param source: (height * width * channels,) uint8 or uint16
    :param size: height, width and channels
    :param nodes: (n, n, 2) int16, n from 2 on: down and right [1/NODE_UNITS pixel]
    :param filters: (PHASES, 4) int32: SHARP or SMOOTH
    :param runs: see runs_of
    :param work: (2, n) int64, and sums: (4 * LANES,) int32: are overwritten
    :param result: (width * channels + LANES,) int32: is overwritten; the last LANES are of no meaning
    """
    height, width, channels = size
    _between(nodes, y, height, work)
    for number in range(len(runs)):
        x = number * RUN
        cell, behind = runs[number, 0], runs[number, 1]
        down = (work[0, cell] * (WEIGHT - behind) + work[0, cell + 1] * behind + ROUND) >> SHIFT
        right = (work[1, cell] * (WEIGHT - behind) + work[1, cell + 1] * behind + ROUND) >> SHIFT
        vertical, horizontal = uint64(down & 63), uint64(right & 63)
        top, left = y + (down >> 6) - 1, x + (right >> 6) - 1
        at, row = (top * width + left) * channels, width * channels
        if (top >= 0 and left >= 0 and top + 4 <= height and x + RUN <= width and left + RUN + 3 <= width
                and at + 3 * row + LANES * channels <= len(source)):
            for part in range(channels):
                _sums(source, at + part * LANES, row, filters, vertical, sums, part * LANES)
            for part in range(channels):    # LANES instead of RUN: the next ones overwrite the others
                _sums(sums, part * RUN, channels, filters, horizontal, result, x * channels + part * RUN)
        else:
            _across(source, top, left, size, filters[vertical], filters[horizontal], result, x * channels,
                    min(RUN, width - x) * channels)


@compiled
def _buffers(nodes: int, values: int) -> Tuple[Array, Array, Array]:
    """What warp_row overwrites: work, result and sums."""
    return np.zeros((2, nodes), np.int64), np.zeros(values + LANES, np.int32), np.zeros(4 * LANES, np.int32)


@compiled
def _clip(row: Array, most: int, result: Array) -> None:
    """Round the sums, as many as there are results, and clip them to what pixels can hold."""
    for x in range(len(result)):
        result[x] = min(max((row[x] + int32(ONE * ONE // 2)) >> 14, int32(0)), int32(most))


@compiled
def warp(source: Array, size: Tuple[int, int, int], nodes: Array, filters: Array, most: int, result: Array) -> None:
    """The displaced image; parameters as of warp_row.

    :param most: the largest value
    :param result: as the source: is overwritten
    """
    height, width, channels = size
    work, row, sums = _buffers(len(nodes), width * channels)
    runs = runs_of(width, nodes.shape[0] - 1)
    for y in range(height):
        warp_row(source, size, nodes, filters, y, runs, work, sums, row)
        _clip(row, most, result[y * width * channels:(y + 1) * width * channels])


@compiled
def roughness(source: Array, size: Tuple[int, int, int], nodes: Array, filters: Array, most: int, image: Array,
              step: int) -> float:
    """Of the difference of an image and of the displaced source, in each `step`-th row: the sum of the roots of how
    much pixels differ from those APART pixels on their left. Parameters as of warp.

    :param image: as the source
    """
    height, width, channels = size
    work, row, sums = _buffers(len(nodes), width * channels)
    runs = runs_of(width, nodes.shape[0] - 1)
    total = 0.0
    for y in range(step // 2, height, step):
        warp_row(source, size, nodes, filters, y, runs, work, sums, row)
        _clip(row, most, row)
        for x in range(width * channels):
            row[x] = int32(image[y * width * channels + x]) - row[x]
        for x in range(APART * channels, width * channels):
            total += math.sqrt(abs(row[x] - row[x - APART * channels]))
    return total
