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
from .loops import borrowing, compiled, float32, inlined, int32, int64, specialised, summed, uint64

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
"""Values that are summed at once."""
APART = 4
"""Distance of compared pixels."""
ONE_AFTER, TWO_AFTER, THREE_AFTER = uint64(1), uint64(2), uint64(3)


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
    """The displacements of the nodes' columns at row y, times WEIGHT: (2, n) int64."""
    cells = nodes.shape[0] - 1
    cell, below = _place(y, height, cells)
    for column in range(cells + 1):
        for k in range(2):
            result[k, column] = (int64(nodes[cell, column, k]) * (WEIGHT - below)
                                 + int64(nodes[cell + 1, column, k]) * below)


@inlined
def _sum(values: Array, at: Any, apart: Any, a: int, b: int, c: int, d: int) -> Any:
    """The weighted sum of four values. Indexes are unsigned: numba counts negative ones from the end, which takes twice
    the time."""
    return int32(int32(int32(a * int32(values[at])) + int32(b * int32(values[at + apart]))) + int32(
        int32(c * int32(values[at + apart + apart])) + int32(d * int32(values[at + apart + apart + apart]))))


@specialised
def _eight(values: Array, at: int, apart: int, filters: Array, phase: int, result: Array, to: int) -> None:
    """LANES weighted sums of four values, `apart` from each other: result[to:to + LANES]; the numbers are uint64.

    All are known before the first one is stored: else the compiler makes no vectors of them, as the arrays might be
    the same one.
    """
    a, b = filters[phase], filters[phase + ONE_AFTER]
    c, d = filters[phase + TWO_AFTER], filters[phase + THREE_AFTER]
    one, two = _sum(values, at, apart, a, b, c, d), _sum(values, at + ONE_AFTER, apart, a, b, c, d)
    three, four = _sum(values, at + TWO_AFTER, apart, a, b, c, d), _sum(values, at + THREE_AFTER, apart, a, b, c, d)
    at += uint64(4)
    five, six = _sum(values, at, apart, a, b, c, d), _sum(values, at + ONE_AFTER, apart, a, b, c, d)
    seven, eight = _sum(values, at + TWO_AFTER, apart, a, b, c, d), _sum(values, at + THREE_AFTER, apart, a, b, c, d)
    result[to], result[to + ONE_AFTER], result[to + TWO_AFTER], result[to + THREE_AFTER] = one, two, three, four
    to += uint64(4)
    result[to], result[to + ONE_AFTER], result[to + TWO_AFTER], result[to + THREE_AFTER] = five, six, seven, eight


@borrowing
def _sums(values: Array, at: int, apart: int, filters: Array, phase: int, count: int, result: Array, to: int) -> None:
    """As _eight, of `count` sums, and some more that make it a multiple of LANES; the numbers are uint64."""
    for i in range(uint64(0), count, uint64(LANES)):
        _eight(values, at + i, apart, filters, phase, result, to + i)


@borrowing
def _across(source: Array, size: Tuple[int, int, int], filters: Array, y: int, x: int, down: int, right: int,
            result: Array) -> None:
    """As the two sums of a run that begins in column x and needs pixels beyond the border."""
    height, width, channels = size
    top, left, vertical, horizontal = y + (down >> 6) - 1, x + (right >> 6) - 1, 4 * (down & 63), 4 * (right & 63)
    for k in range(min(RUN, width - x) * channels):
        total = 0
        for i in range(16):
            row = min(max(top + (i >> 2), 0), height - 1)
            column = min(max(left + (i & 3) + k // channels, 0), width - 1)
            value = int64(source[(row * width + column) * channels + k % channels])
            total += int64(filters[vertical + (i >> 2)]) * int64(filters[horizontal + (i & 3)]) * value
        result[x * channels + k] = total


@compiled
def cells_of(width: int, cells: int) -> Tuple[Array, Array]:
    """How a row is divided into runs of RUN pixels: (cells + 1,) int64: the first run of each cell of the mesh, and the
    number of runs; (runs,) int32: the weight of the nodes behind each run."""
    firsts, weights = np.zeros(cells + 1, np.int64), np.empty((width + RUN - 1) // RUN, np.int32)
    for i in range(len(weights)):
        cell, weights[i] = _place(i * RUN + min(RUN, width - i * RUN) // 2, width, cells)
        firsts[cell + 1] = i + 1
    for cell in range(cells):       # a narrow image has no run in some
        firsts[cell + 1] = max(firsts[cell + 1], firsts[cell])
    return firsts, weights


@borrowing
def _displace(ends: Array, firsts: Array, weights: Array, result: Array) -> None:
    """The displacements of the runs of a row [1/PHASES pixel], from those of the nodes' columns; see _between."""
    for cell in range(len(firsts) - 1):
        base, slope = int32(ends[cell] * WEIGHT + ROUND), int32(ends[cell + 1] - ends[cell])
        for i in range(uint64(firsts[cell]), uint64(firsts[cell + 1])):
            # 31 bits, as an interpolated displacement has 15 at most; what overflows between cancels out
            result[i] = int32(int32(slope * weights[i]) + base) >> SHIFT


@borrowing
def _alike(displacements: Array, first: int, most: int) -> int:
    """How many runs from one on are displaced as that one is, `most` at most."""
    count = 1
    while (count < most and displacements[0, first + count] == displacements[0, first]
           and displacements[1, first + count] == displacements[1, first]):
        count += 1
    return count


@borrowing
def _sum_columns(source: Array, size: Tuple[int, int, int], filters: Array, y: int, displacements: Array, groups: Array,
                 sums: Array) -> None:
    """The sums of columns of each group of runs that are displaced alike. Those of a group that begins with the run i
    are from i * LANES * channels on.

    :param groups: becomes the number of runs of each group; 0: pixels beyond the border are needed
    """
    height, width, channels = size
    row, number = width * channels, 0
    while number < len(groups):
        x, down, right = number * RUN, int64(displacements[0, number]), int64(displacements[1, number])
        top, left = y + (down >> 6) - 1, x + (right >> 6) - 1
        within, runs = min(width - x, width - left - 3) // RUN, 0
        # sums are made of LANES values at least: in the last rows these might be beyond the source
        if top >= 0 and left >= 0 and top + 4 < height and within > 0 and row >= LANES:
            runs = _alike(displacements, number, within)
            _sums(source, uint64((top * width + left) * channels), uint64(row), filters, uint64(4 * (down & 63)),
                  uint64((runs * RUN + 3) * channels), sums, uint64(number * LANES * channels))
        groups[number] = runs
        number += max(runs, 1)


@borrowing
def warp_row(source: Array, size: Tuple[int, int, int], nodes: Array, filters: Array, y: int,
             cells: Tuple[Array, Array], buffers: Tuple[Array, Array, Array, Array], result: Array) -> None:
    """Row y of the displaced image, times ONE * ONE: first sums of columns, of all runs, then of those.

    No sum exceeds 32 bits: the magnitudes of the weights of SHARP add up to 1.25 times ONE at most, both ways.

    :param source: (height * width * channels,) uint8 or uint16
    :param size: height, width and channels
    :param nodes: (n, n, 2) int16, n from 2 on: down and right [1/NODE_UNITS pixel]
    :param filters: (PHASES * 4,) int32: SHARP or SMOOTH, phase by phase
    :param cells, buffers: see cells_of and _buffers
    :param result: (runs * LANES * channels,) int32: is overwritten; those behind the width are of no meaning
    """
    ends, displacements, groups, sums = buffers
    channels, number = size[2], 0
    _between(nodes, y, size[0], ends)
    for k in range(2):
        _displace(ends[k], cells[0], cells[1], displacements[k])
    _sum_columns(source, size, filters, y, displacements, groups, sums)
    while number < len(groups):
        runs, x, right = groups[number], number * RUN, displacements[1, number]
        if runs > 0:
            # writes some values more: before those of the next group
            _sums(sums, uint64(number * LANES * channels), uint64(channels), filters, uint64(4 * (right & 63)),
                  uint64(runs * RUN * channels), result, uint64(x * channels))
        else:
            _across(source, size, filters, y, x, displacements[0, number], right, result)
        number += max(runs, 1)


@compiled
def _buffers(nodes: int, runs: int, channels: int) -> Tuple[Tuple[Array, Array, Array, Array], Array]:
    """What warp_row overwrites: (2, nodes) int64, displacements of the nodes' columns; (2, runs) int32, of the runs;
    (runs,) int64, groups; sums; and the result."""
    values = (runs + 1) * LANES * channels
    return (np.zeros((2, nodes), np.int64), np.zeros((2, runs), np.int32), np.zeros(runs, np.int64),
            np.zeros(values, np.int32)), np.zeros(values, np.int32)


@compiled
def _clip(row: Array, most: int, result: Array, at: int, count: int) -> None:
    """Round the sums, and clip them to what pixels can hold; `most` is int32, the last two are uint64."""
    for x in range(count):
        result[at + x] = min(max(int32(int32(row[x] + int32(ONE * ONE // 2)) >> 14), int32(0)), most)


@compiled
def warp(source: Array, size: Tuple[int, int, int], nodes: Array, filters: Array, most: int, result: Array) -> None:
    """The displaced image; parameters as of warp_row.

    :param most: the largest value
    :param result: as the source: is overwritten
    """
    height, width, channels = size
    cells = cells_of(width, nodes.shape[0] - 1)
    buffers, row = _buffers(len(nodes), len(cells[1]), channels)
    for y in range(height):
        warp_row(source, size, nodes, filters, y, cells, buffers, row)
        _clip(row, int32(most), result, uint64(y * width * channels), uint64(width * channels))


@compiled
def _subtract(row: Array, image: Array, at: int, count: int) -> None:
    """The differences of a row from that of an image; the numbers are uint64."""
    for x in range(count):
        row[x] = int32(int32(image[at + x]) - row[x])


@summed
def _roughness(row: Array, apart: int, count: int) -> float:
    """The sum of the roots of how much values differ from those `apart` on their left; the numbers are uint64."""
    total = float32(0)
    for x in range(count):
        total += math.sqrt(float32(abs(int32(row[x + apart] - row[x]))))
    return float(total)


@compiled
def roughness(source: Array, size: Tuple[int, int, int], nodes: Array, filters: Array, most: int, image: Array,
              step: int) -> float:
    """The roughness of the difference between an image and the displaced source, in each `step`-th row: the sum of the
    square roots of how much pixels differ from those APART pixels on their left. Parameters are as of warp.

    :param nodes: without any the source is as it is
    :param image: as the source
    """
    height, width, channels = size
    cells = cells_of(width, max(nodes.shape[0] - 1, 1))
    buffers, row = _buffers(len(nodes), len(cells[1]), channels)
    values, apart, total = uint64(width * channels), uint64(APART * channels), 0.0
    for y in range(step // 2, height if width > APART else 0, step):
        at = uint64(y * width * channels)
        if len(nodes):
            warp_row(source, size, nodes, filters, y, cells, buffers, row)
            _clip(row, int32(most), row, uint64(0), values)
        else:
            row[:width * channels] = source[y * width * channels:(y + 1) * width * channels]
        _subtract(row, image, at, values)
        total += _roughness(row, apart, values - apart)
    return total
