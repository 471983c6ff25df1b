# SPDX-License-Identifier: BSD-3-Clause
"""An image displaced by a mesh, in integers only: the same pixels on every machine.

A mesh has (2^level + 1)^2 nodes, evenly spaced over the image from corner to corner. Each has a displacement; between
nodes it is interpolated bilinearly. RUN pixels of a row have the same one, as the blocks of affine motion in H.266 do.
A pixel of the result is interpolated from 4 x 4 pixels of the source around where the displacement leads; those beyond
the border are the border's.
"""
import math
from typing import Tuple

import numpy as np

from ...arrays import Array, IntArray
from .loops import compiled, int64, uint64

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
APART = 4
"""Distance of compared pixels."""


def _weights(b: float, c: float) -> IntArray:
    """(PHASES, 4) int64: the piecewise cubic filter with these parameters (Mitchell and Netravali 1988).

    Rounded such that the sum is ONE; the largest weight takes what is left.
    """
    distances = np.abs(np.arange(-1, 3) - np.arange(PHASES)[:, np.newaxis] / PHASES)
    near = (12 - 9 * b - 6 * c) * distances ** 3 + (-18 + 12 * b + 6 * c) * distances ** 2 + 6 - 2 * b
    far = (-b - 6 * c) * distances ** 3 + (6 * b + 30 * c) * distances ** 2 - (12 * b + 48 * c) * distances + (
        8 * b + 24 * c)
    weights = np.rint(np.where(distances < 1, near, np.where(distances < 2, far, 0)) * ONE / 6)
    rows = np.arange(PHASES)
    weights[rows, weights.argmax(axis=1)] += ONE - weights.sum(axis=1)
    return np.asarray(weights, np.int64)


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
def _inside(source: Array, at: int, row: int, pixel: int, weights: Array, result: Array, first: int) -> None:
    """The weighted sums of RUN values around 4 x 4 pixels, all of which are there."""
    # unsigned: numba counts negative indexes from the end, which takes twice the time
    start, down, right, end = uint64(at), uint64(row), uint64(pixel), uint64(first)
    for k in range(RUN):
        total = 0
        for i in range(4):
            for j in range(4):
                total += weights[4 * i + j] * int64(source[start + uint64(i) * down + uint64(j) * right + uint64(k)])
        result[end + uint64(k)] = total


@compiled
def _across(source: Array, top: int, left: int, size: Tuple[int, int, int], weights: Array, result: Array, first: int,
            count: int) -> None:
    """Likewise, where some pixels may be beyond the border."""
    height, width, channels = size
    for k in range(count):
        total = 0
        for i in range(16):
            y = min(max(top + (i >> 2), 0), height - 1)
            x = min(max(left + (i & 3) + k // channels, 0), width - 1)
            total += weights[i] * int64(source[(y * width + x) * channels + k % channels])
        result[first + k] = total


@compiled
def warp_row(source: Array, size: Tuple[int, int, int], nodes: Array, filters: Array, y: int, work: Array,
             result: Array) -> None:
    """Row y of the displaced image, times ONE * ONE.

    :param source: (height * width * channels,) uint8 or uint16
    :param size: height, width and channels
    :param nodes: (n, n, 2) int16, n from 2 on: down and right [1/NODE_UNITS pixel]
    :param filters: (PHASES, 4) int64: SHARP or SMOOTH
    :param work: (2, n) int64: is overwritten
    :param result: (width * channels,) int64: is overwritten
    """
    height, width, channels = size
    _between(nodes, y, height, work)
    weights = np.empty(16, np.int64)
    for x in range(0, width, RUN):
        pixels = min(RUN, width - x)
        cell, behind = _place(x + pixels // 2, width, nodes.shape[0] - 1)
        down = (work[0, cell] * (WEIGHT - behind) + work[0, cell + 1] * behind + ROUND) >> SHIFT
        right = (work[1, cell] * (WEIGHT - behind) + work[1, cell + 1] * behind + ROUND) >> SHIFT
        for i in range(16):
            weights[i] = filters[down & 63, i >> 2] * filters[right & 63, i & 3]
        top, left = y + (down >> 6) - 1, x + (right >> 6) - 1
        if pixels == RUN and top >= 0 and left >= 0 and top + 4 <= height and left + RUN + 3 <= width:
            for part in range(0, RUN * channels, RUN):
                _inside(source, (top * width + left) * channels + part, width * channels, channels, weights, result,
                        x * channels + part)
        else:
            _across(source, top, left, size, weights, result, x * channels, pixels * channels)


@compiled
def _rounded(value: int, most: int) -> int:
    return min(max((value + ONE * ONE // 2) >> 14, 0), most)


@compiled
def warp(source: Array, size: Tuple[int, int, int], nodes: Array, filters: Array, most: int, result: Array) -> None:
    """The displaced image; parameters as of warp_row.

    :param most: the largest value
    :param result: as the source: is overwritten
    """
    height, width, channels = size
    work, row = np.zeros((2, len(nodes)), np.int64), np.zeros(width * channels, np.int64)
    for y in range(height):
        warp_row(source, size, nodes, filters, y, work, row)
        for x in range(width * channels):
            result[y * width * channels + x] = _rounded(row[x], most)


@compiled
def roughness(source: Array, size: Tuple[int, int, int], nodes: Array, filters: Array, most: int, image: Array,
              step: int) -> float:
    """Of the difference of an image and of the displaced source, in each `step`-th row: the sum of the roots of how
    much pixels differ from those APART pixels on their left. Parameters as of warp.

    :param image: as the source
    """
    height, width, channels = size
    work, row = np.zeros((2, len(nodes)), np.int64), np.zeros(width * channels, np.int64)
    total = 0.0
    for y in range(step // 2, height, step):
        warp_row(source, size, nodes, filters, y, work, row)
        for x in range(width * channels):
            row[x] = int64(image[y * width * channels + x]) - _rounded(row[x], most)
        for x in range(APART * channels, width * channels):
            total += math.sqrt(abs(row[x] - row[x - APART * channels]))
    return total
