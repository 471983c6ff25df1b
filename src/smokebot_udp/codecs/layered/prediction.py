# SPDX-License-Identifier: BSD-3-Clause
"""Prediction of an image's coefficients from those of a reference: where, by how much, and its coding.

Both canvases are of one layout. A band is predicted by its weight, quarters of the reference's coefficients, 0 not at
all; a predicted band has a flag for each of its blocks of SIDE x SIDE coefficients. What is coded of a predicted block
is the difference. All of it is of integers, so that it is added as exactly as it was subtracted.

The choice minimises the bits of a block by its variance s: with a distortion t for each coefficient, the one that the
budget allows to all (reverse water-filling: Cover, Thomas, Elements of Information Theory, 10.3), they are
log2(s / t) / 2 each, and where s is below t, what is lost more than t at the same slope.
"""
import math
from typing import NamedTuple, Tuple

import numpy as np

from ...arrays import Array, FloatArray, IntArray, UInt8Array
from .layout import COLUMNS, ORIGIN, ROWS, STEP, STEP_BITS, Layout
from .loops import compiled, int32, int64, uint64
from .range_coder import code

SIDE = 8
"""Of the blocks of a band [coefficient]; those at the ends of its rows and columns are smaller."""
WHOLE = 4
"""The weight by which the difference is the plain one."""
LEAST_GAIN = 3.0
"""A flag that differs from most must save this [bit]: it takes about as much."""
MARGIN = 1 / 16
"""A prediction must save this part of what a block takes without it: variances say no more than that about bits."""
GRAIN = 4
"""The variances of blocks are sorted into steps of 1/GRAIN in log2."""
WEIGHT_CONTEXT, PLAIN_CONTEXT, CONTEXTS = 27, 31, 32
"""Those of flags come first."""


class Prediction(NamedTuple):
    """How an image is predicted."""
    weights: Array
    """(bands,) int64: 0..WHOLE"""
    flags: UInt8Array
    """(blocks,) 1: predicted; those of a band come by rows, from `firsts_of(plan)` on"""


def firsts_of(plan: Layout) -> IntArray:
    """(bands + 1,) where the flags of each band begin."""
    blocks = -(-plan.bands[:, ROWS] // SIDE) * -(-plan.bands[:, COLUMNS] // SIDE)
    return np.concatenate([[0], np.cumsum(blocks)]).astype(np.int64)


@compiled
def _sums(canvas: Array, reference: Array, bands: Array, firsts: Array, stride: int, sums: Array) -> None:
    """Add to the sums of all blocks, (4, blocks) float64: squares of coefficients, products, squares of the reference,
    number."""
    for number in range(len(bands)):
        band = bands[number]
        wide = (band[COLUMNS] + SIDE - 1) // SIDE
        for y in range(band[ROWS]):
            first = firsts[number] + y // SIDE * wide
            for i in range(wide):
                at = band[ORIGIN] + y * stride + i * SIDE
                length = min(SIDE, band[COLUMNS] - i * SIDE)
                own, both, other = int64(0), int64(0), int64(0)     # of 30 bits at most: see layout.FRACTION
                for x in range(at, at + length):
                    a, b = int64(canvas[x]), int64(reference[x])
                    own += a * a
                    both += a * b
                    other += b * b
                sums[0, first + i] += own
                sums[1, first + i] += both
                sums[2, first + i] += other
                sums[3, first + i] += length


@compiled
def _add(sign: int, canvas: Array, reference: Array, bands: Array, firsts: Array, stride: int, weights: Array,
         flags: Array) -> None:
    """Add the prediction, or subtract it."""
    for number in range(len(bands)):
        band, weight = bands[number], weights[number]
        if weight == 0:
            continue
        wide = (band[COLUMNS] + SIDE - 1) // SIDE
        for y in range(band[ROWS]):
            first = firsts[number] + y // SIDE * wide
            for i in range(wide):
                if flags[first + i]:
                    at = band[ORIGIN] + y * stride + i * SIDE
                    for x in range(at, at + min(SIDE, band[COLUMNS] - i * SIDE)):
                        canvas[x] += sign * int32((weight * reference[x] + 2) >> 2)


def add(sign: int, canvas: Array, reference: Array, plan: Layout, prediction: Prediction) -> None:
    """Add the prediction to a canvas, in place.

    :param sign: -1: subtract it
    """
    _add(sign, canvas, reference, plan.bands, firsts_of(plan), plan.stride, prediction.weights, prediction.flags)


@compiled
def tally(pixels: Array, predicted: Array, counts: Array) -> None:
    """Count how often pixels differ from predicted ones by each number.

    :param pixels: (n,) uint8 or uint16; `predicted`: likewise
    :param counts: (2 m + 1,) int64, is added to: of differences from -m to m, the largest possible ones
    """
    middle = len(counts) // 2
    for i in range(len(pixels)):
        counts[uint64(middle + int64(pixels[i]) - int64(predicted[i]))] += 1


@compiled
def _flag_context(flags: Array, first: int, y: int, x: int, wide: int, parents: int, high: int, parents_wide: int
                  ) -> int:
    """From the flags on the left and above, and from the one of the same place in the next coarser band; 2: none."""
    left = int64(flags[first + y * wide + x - 1]) if x > 0 else 2
    above = int64(flags[first + (y - 1) * wide + x]) if y > 0 else 2
    parent = 2
    if parents >= 0:
        parent = int64(flags[parents + min(y >> 1, high - 1) * parents_wide + min(x >> 1, parents_wide - 1)])
    return 9 * left + 3 * above + parent


@compiled
def _code_weight(encoding: bool, weight: int, data: Array, odds: Array, low: int, width: int, at: int
                 ) -> Tuple[int, int, int, int]:
    """Whether it is WHOLE, else whether WHOLE - 1, ...: the weight or END, and the coder's state."""
    for value in range(WHOLE, 0, -1):
        less, low, width, at = code(encoding, data, odds, WEIGHT_CONTEXT + value - 1, 1 if weight < value else 0, low,
                                    width, at)
        if less < 0:
            return -1, low, width, at
        if less == 0:
            return value, low, width, at
    return 0, low, width, at


@compiled
def _code_flags(encoding: bool, number: int, parent: int, bands: Array, firsts: Array, flags: Array, data: Array,
                odds: Array, low: int, width: int, at: int) -> Tuple[int, int, int, int]:
    """The flags of a band: whether all are 1, else each; END in place of 0 where the stream or the room ends."""
    first, end = firsts[number], firsts[number + 1]
    other = 0
    if encoding:
        for i in range(first, end):
            other |= 1 - flags[i]
    other, low, width, at = code(encoding, data, odds, PLAIN_CONTEXT, other, low, width, at)
    if other <= 0:
        flags[first:end] = 1
        return other, low, width, at
    wide, parents, high, parents_wide = (bands[number, COLUMNS] + SIDE - 1) // SIDE, int64(-1), int64(1), int64(1)
    if parent >= 0:
        parents, parents_wide = firsts[parent], (bands[parent, COLUMNS] + SIDE - 1) // SIDE
        high = (firsts[parent + 1] - parents) // parents_wide
    for i in range(first, end):
        y, x = (i - first) // wide, (i - first) % wide
        context = _flag_context(flags, first, y, x, wide, parents, high, parents_wide)
        flag, low, width, at = code(encoding, data, odds, context, int64(flags[i]), low, width, at)
        if flag < 0:
            return -1, low, width, at
        flags[i] = flag
    return 0, low, width, at


@compiled
def _code(encoding: bool, bands: Array, firsts: Array, in_channel: int, weights: Array, flags: Array, data: Array,
          odds: Array, low: int, width: int, at: int) -> Tuple[bool, int, int, int]:
    for number in range(len(bands)):
        weight, low, width, at = _code_weight(encoding, weights[number], data, odds, low, width, at)
        if weight < 0:
            return False, low, width, at
        weights[number] = weight
        if weight == 0:
            continue
        parent = number - 3 if number % in_channel >= 4 and weights[number - 3] else -1
        end, low, width, at = _code_flags(encoding, number, parent, bands, firsts, flags, data, odds, low, width, at)
        if end < 0:
            return False, low, width, at
    return True, low, width, at


def code_prediction(encoding: bool, prediction: Prediction, plan: Layout, data: UInt8Array, low: int, width: int,
                    at: int) -> Tuple[bool, int, int, int]:
    """Code the weights and flags; whether all of them are coded, and the coder's state.

    :param prediction: is written when decoding
    """
    odds = np.full(CONTEXTS, 1 << 31 | 1 << 15, np.uint32)
    return _code(encoding, plan.bands, firsts_of(plan), 1 + 3 * plan.levels, prediction.weights, prediction.flags,
                 data, odds, low, width, at)


def nothing(plan: Layout) -> Prediction:
    """All weights and flags 0."""
    return Prediction(np.zeros(len(plan.bands), np.int64), np.zeros(int(firsts_of(plan)[-1]), np.uint8))


def _distortion(logs: FloatArray, numbers: FloatArray, bits: float) -> float:
    """log2 of the distortion of each coefficient when so many bits are divided among blocks.

    :param logs: (blocks,) log2 of their variances; `numbers`: of their coefficients
    """
    lowest = math.floor(float(logs.min()))
    steps = (GRAIN * (logs - lowest)).astype(np.int64)
    # from the largest variances on: coefficients, and their logarithms, of all that are larger than a level
    totals = np.cumsum(np.bincount(steps, numbers)[::-1])
    sums = np.cumsum(np.bincount(steps, numbers * logs)[::-1])
    levels = lowest + np.arange(len(totals))[::-1] / GRAIN
    last = int(np.searchsorted(0.5 * (sums - totals * levels), bits, side='right'))
    last = min(max(last, int(np.searchsorted(totals, 1))), len(totals) - 1)
    return float((sums[last] - 2 * bits) / totals[last])


def choose(canvas: Array, reference: Array, plan: Layout, bits: float) -> Tuple[Prediction, float]:
    """Where a reference saves bits of an image that takes about so many, and how many [bit].

    :param canvas: (cells,) int32, of the image; `reference`: likewise
    """
    firsts = firsts_of(plan)
    bands, sums = np.repeat(np.arange(len(plan.bands)), np.diff(firsts)), np.zeros((4, firsts[-1]))
    _sums(canvas, reference, plan.bands, firsts, plan.stride, sums)
    own, both, other, numbers = sums
    # in quantisation steps by their weights, and never below what rounding leaves
    units = ((plan.weights / plan.bands[:, STEP] * 2.0 ** STEP_BITS) ** 2)[bands] / numbers
    least = (plan.weights ** 2 / 12)[bands]
    quarters = np.arange(WHOLE + 1)[:, np.newaxis] / WHOLE
    variances = np.maximum((own - 2 * quarters * both + quarters ** 2 * other) * units, 0) + least
    logs = np.log2(variances)
    distortion = max(_distortion(np.minimum(logs[0], logs[WHOLE]), numbers, bits), math.log2(float(least.min())))
    # of each block and weight: its bits, and what it loses, at the same slope
    taken = numbers / 2 * (np.maximum(logs - distortion, 0)
                           + np.minimum(variances * 2.0 ** -distortion, 1) / math.log(2))
    return _chosen((1 - MARGIN) * taken[0] - taken[1:], firsts)


def _chosen(saved: FloatArray, firsts: IntArray) -> Tuple[Prediction, float]:
    """The weights and flags that save most, and how much.

    :param saved: (WHOLE, blocks) bits by the weights 1, ..., WHOLE
    """
    weights, total = np.zeros(len(firsts) - 1, np.int64), 0.0
    flags = np.zeros(saved.shape[1], np.uint8)
    best = np.argmax(np.add.reduceat(np.maximum(saved, 0), firsts[:-1], axis=1), axis=0)
    for number, row in enumerate(best):
        gains = saved[row, firsts[number]:firsts[number + 1]]
        usual = float(gains.sum()) > 0
        chosen = gains > (-LEAST_GAIN if usual else LEAST_GAIN)
        gain = float(gains[chosen].sum()) - LEAST_GAIN * int((chosen != usual).sum())
        if gain > LEAST_GAIN:
            weights[number], total = row + 1, total + gain
            flags[firsts[number]:firsts[number + 1]] = chosen
    return Prediction(weights, flags), total
