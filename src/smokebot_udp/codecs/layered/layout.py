# SPDX-License-Identifier: BSD-3-Clause
"""Where the coefficients of an image are, and in which order their bit planes are coded.

All bands of all channels share one canvas, a flat array with rows of `stride` cells, each band with a margin of one
cell around it. A coefficient at p has its children, the four coefficients of the next finer level at the same place,
from 2 p + `child` on.
"""
import functools
import math
from typing import Dict, List, NamedTuple, Tuple

import numpy as np

from ...arrays import Array, IntArray

MAX_LEVELS = 5
MAX_CELLS = 1 << 22
MAX_PLANES = 27
MAX_EXPANSION, SLACK = 1.75, 4096
"""No stream is longer than the pixels times one, plus the other [byte]. Exact streams of noise of 8 bits take 1.13."""
FINE = 3
"""9/7 coefficients are multiples of 2^-FINE."""
FRACTION = 6
"""Channels and coefficients of the 9/7 are in 2^-FRACTION counts; those of the 5/3 in counts.

None of 16 bits takes more than 30 bits.
"""
STEP_BITS, RATE_BITS = 16, 30
BLOCK = 4
"""Side of the blocks that are coded as one while all their coefficients are zero."""
SIDE = 8
"""Side of a block of a band [coefficient]. Each block is predicted or not. The last ones of rows and columns are
smaller."""
HL, LH, HH, LL = range(4)
"""Orientations: of the columns' and rows' high halves."""
SCALE_9_7 = 0.869864451624781
"""High halves of the 9/7 multiplied by this and low halves divided by it are nearly orthonormal."""
NORMS_9_7 = (0.991, 1.015, 1.026, 1.029, 1.03), (1.02, 0.983, 1.02, 1.037, 1.042)
"""L2 norms of the low and high synthesis functions of each level, in one dimension."""
NORMS_5_3 = (1.225, 1.658, 2.318, 3.269, 4.62), (0.848, 0.96, 1.259, 1.744, 2.454)
CHANNEL_WEIGHTS = {1: (1.0,), 3: (1.732, 0.707, 0.866)}
"""How much errors of Y, Co, Cg count in those of B, G, R: roots of 3, 1/2 and 3/4."""
NEAR, REFINEMENT, FAR = range(3)
DELAYS = {NEAR: 0.0, REFINEMENT: 0.5, FAR: 0.51}
"""A byte of these passes reduces the error as much as one of near passes that number of planes lower."""

# columns of the table of bands
(ORIGIN, ROWS, COLUMNS, CHILD, START, KIND, MAP_STRIDE, MAP_ORIGIN, CHILDREN, STEP, RATE) = range(11)
# columns of the table of blocks: first cell, place in the blocks' map, parent cell or -1, rows * 8 + columns
CELL, PLACE, PARENT, SHAPE = range(4)


class Layout(NamedTuple):
    """How the coefficients of images of one shape are arranged."""
    levels: int
    channels: int
    lossless: bool
    """Whether the wavelet is the 5/3; else it is the 9/7."""
    fraction: int
    """Channels and coefficients are in 2^-fraction counts."""
    stride: int
    """Cells from one row of the canvas to the next."""
    cells: int
    """Number of cells of the canvas."""
    bands: Array
    """(n, 11) int64: flat ORIGIN, ROWS, COLUMNS, CHILD, START in lists of coefficients, KIND; MAP_STRIDE of rows of
    blocks in their map, and MAP_ORIGIN of the first block; CHILDREN: the band of the children or -1; STEP of quantised
    coefficients [2^-STEP_BITS of the unit of channels], and RATE, its reciprocal [2^-RATE_BITS]"""
    weights: Array
    """(n,) float64: a coefficient's squared error counts weight^2 times."""
    steps: Array
    """(s, 3) int64: band, plane, pass; in the order of the stream."""
    blocks: Array
    """(b, 4) int32: the table of blocks. Those of each band begin at `firsts`."""
    firsts: IntArray
    """(n + 1,) where the blocks of each band begin in `blocks`."""
    places: int
    """Number of places of the map of blocks, margins included."""
    flag_firsts: IntArray
    """(n + 1,) where the flags of each band's prediction begin, see prediction.Prediction"""


def levels_of(height: int, width: int) -> int:
    """How often an image is split."""
    return min(MAX_LEVELS, max(min(height, width) // 4, 1).bit_length() - 1)


def most_bytes(cells: int, itemsize: int) -> int:
    """No stream of an image is longer: encode ends there, and decode looks no further.

    :param cells: height * width * channels
    """
    return int(MAX_EXPANSION * cells * itemsize) + SLACK


def _norms(levels: int, lossless: bool) -> Dict[Tuple[int, int], float]:
    """{(level, orientation): L2 norm of a coefficient's synthesis function}; of the 9/7, that of a step."""
    low, high = NORMS_5_3 if lossless else NORMS_9_7
    step = 1.0 if lossless else 2.0 ** -FINE
    if not levels:
        return {(0, LL): step}
    return {(level, o): step * across * along for level in range(levels) for o, across, along in (
        (HL, low[level], high[level]), (LH, low[level], high[level]), (HH, high[level], high[level]),
        (LL, low[level], low[level]))}


def _step(levels: int, level: int, kind: int, lossless: bool) -> Tuple[int, int]:
    """STEP and RATE of a band; the scale of the 9/7 is in them."""
    step = 1.0
    if not lossless:
        step = 2.0 ** (FRACTION - FINE)
        for _ in range(2 * level):
            step *= SCALE_9_7
        if levels and kind in (HH, LL):
            step *= (1 / SCALE_9_7) ** 2 if kind == HH else SCALE_9_7 ** 2
    return round(step * 2 ** STEP_BITS), round(2 ** RATE_BITS / step)


def _axis(size: int, levels: int) -> Tuple[List[int], List[int], int]:
    """Lengths of the low halves, origins of the high ones by level, and the canvas's length."""
    lows = [size]
    for _ in range(levels):
        lows.append((lows[-1] + 1) // 2)
    origins, end = [0] * levels, 1 + lows[-1]
    for level in range(levels - 1, -1, -1):
        origins[level] = end + 1
        end += 1 + lows[level] // 2
    return lows, origins, end + 1


def _steps(bands: Array, weights: List[float], order: List[int]) -> Array:
    # rounded: logarithms differ in the last bit between machines, and the order must not
    steps = sorted((-round(math.log2(weight) + plane - delay, 6), order[band], band, plane, kind)
                   for band, weight in enumerate(weights) for plane in range(MAX_PLANES)
                   for kind, delay in DELAYS.items())
    return np.array([step[2:] for step in steps], np.int64)


def _blocks_of(origin: int, rows: int, columns: int, stride: int, parent: int, place: int) -> Array:
    """(n, 4) int32: the blocks of a band.

    :param parent: the flat origin of the parents' band or -1
    :param place: of the first block in the map
    """
    y, x = np.mgrid[0:rows:BLOCK, 0:columns:BLOCK]
    high, wide = np.minimum(rows - y, BLOCK), np.minimum(columns - x, BLOCK)
    places = place + y // BLOCK * (-(-columns // BLOCK) + 2) + x // BLOCK
    parents = parent + (y // 2) * stride + x // 2 if parent >= 0 else np.full(y.shape, -1)
    table = np.stack([origin + y * stride + x, places, parents, high * 8 + wide], -1)
    return np.asarray(table.reshape(-1, 4), np.int32)


@functools.lru_cache(maxsize=8)
def layout_of(height: int, width: int, channels: int, lossless: bool) -> Layout:
    """The layout of an image."""
    levels = levels_of(height, width)
    norms = _norms(levels, lossless)
    (high, tops, canvas), (wide, lefts, stride) = _axis(height, levels), _axis(width, levels)
    bands: List[List[int]] = []
    weights, order, blocks, firsts, start, places = [], [], [], [0], 0, 0
    last = max(levels - 1, 0)
    for channel, factor in enumerate(CHANNEL_WEIGHTS[channels]):
        top = channel * canvas * stride
        parents: Dict[int, int] = {}
        for level, o in [(last, LL)] + [(level, o) for level in range(levels - 1, -1, -1) for o in (HL, LH, HH)]:
            y, rows = (tops[level], high[level] // 2) if o in (LH, HH) else (1, high[level + 1] if levels else height)
            x, columns = ((lefts[level], wide[level] // 2) if o in (HL, HH) else
                          (1, wide[level + 1] if levels else width))
            origin = top + y * stride + x
            if o in parents:
                bands[parents[o]][CHILD] = origin - 2 * bands[parents[o]][ORIGIN]
                bands[parents[o]][CHILDREN] = len(bands)
            along = -(-columns // BLOCK) + 2
            blocks.append(_blocks_of(origin, rows, columns, stride, bands[parents[o]][ORIGIN] if o in parents else -1,
                                     places + along + 1))
            if o != LL:
                parents[o] = len(bands)
            bands.append([origin, rows, columns, 0, start, o, along, places + along + 1, -1,
                          *_step(levels, level, o, lossless)])
            places += (-(-rows // BLOCK) + 2) * along
            firsts.append(firsts[-1] + len(blocks[-1]))
            weights.append(factor * norms[level, o])
            order.append(-level)
            start += rows * columns
    table = np.array(bands, np.int64)
    flags = -(-table[:, ROWS] // SIDE) * -(-table[:, COLUMNS] // SIDE)
    return Layout(levels, channels, lossless, 0 if lossless else FRACTION, stride, channels * canvas * stride, table,
                  np.array(weights), _steps(table, weights, order), np.concatenate(blocks), np.array(firsts), places,
                  np.concatenate([[0], np.cumsum(flags)]).astype(np.int64))
