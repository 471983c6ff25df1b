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
from typing import Any, NamedTuple, Tuple

import numpy as np

from ...arrays import Array, UInt8Array
from .layout import COLUMNS, ORIGIN, ROWS, SIDE, STEP, STEP_BITS, Layout
from .loops import compiled, float32, inlined, int32, int64, uint64
from .range_coder import code

WHOLE = 4
"""The weight by which the difference is the plain one."""
LEAST_GAIN = 3.0
"""A flag that differs from most must save this [bit]: it takes about as much."""
MARGIN = 1 / 16
"""A prediction must save this part of what a block takes without it: variances say no more than that about bits."""
GRAIN = 4
"""The variances of blocks are sorted into steps of 1/GRAIN in log2."""
LN_2 = math.log(2)
UNIT, QUARTER = float32(1), float32(1 / WHOLE)
CURVE, CURVE_1, CURVE_2, CURVE_3 = float32(0.44174), float32(-0.26603), float32(0.146314), float32(-0.044005)
"""log2(1 + x) is about x + x (1 - x) (CURVE + CURVE_1 x + CURVE_2 x^2 + CURVE_3 x^3), for x from 0 to 1."""
WEIGHT_CONTEXT, PLAIN_CONTEXT, CONTEXTS = 27, 31, 32
"""Those of flags come first."""


class Prediction(NamedTuple):
    """How an image is predicted."""
    weights: Array
    """(bands,) int64: 0..WHOLE"""
    flags: UInt8Array
    """(blocks,) 1: predicted; those of a band come by rows, from Layout.flag_firsts on"""


class Blocks(NamedTuple):
    """Statistics of all blocks, each of them (blocks,) float32."""
    own: Array
    """Mean squares of the image's coefficients."""
    other: Array
    """Mean squares of the reference's coefficients."""
    apart: Array
    """Mean squares of the differences between the coefficients of image and reference."""
    numbers: Array
    """Numbers of coefficients."""


@compiled
def _add_squares(values: Array, at: int, count: int, sums: Array) -> None:
    """Add the squares of some values; the numbers are uint64."""
    for i in range(count):
        value = float32(values[at + i])
        sums[i] += value * value


@compiled
def _add_differences(values: Array, others: Array, at: int, count: int, sums: Array) -> None:
    """Add the squares of how much some values differ from others; the numbers are uint64."""
    for i in range(count):
        value = float32(int32(values[at + i] - others[at + i]))
        sums[i] += value * value


@compiled
def _end_blocks(sums: Array, first: int, numbers: Array, means: Array) -> None:
    """The means of the columns' sums in each block of a row of blocks, which are reset.

    :param numbers: (wide,) of coefficients
    """
    for i in range(len(numbers)):
        total = float32(0)
        for x in range(i * SIDE, i * SIDE + SIDE):
            total += sums[x]
        means[first + i] = total / numbers[i]
    sums[:] = 0


@compiled
def _measure(canvas: Array, reference: Array, bands: Array, firsts: Array, stride: int, own: Array, other: Array,
             apart: Array, numbers: Array) -> None:
    """Write the arrays of Blocks."""
    for number in range(len(bands)):
        rows, columns, first = bands[number, ROWS], bands[number, COLUMNS], firsts[number]
        wide = (columns + SIDE - 1) // SIDE
        squares, others, differences = (np.zeros(wide * SIDE, np.float32), np.zeros(wide * SIDE, np.float32),
                                        np.zeros(wide * SIDE, np.float32))
        for y in range(rows):
            at = uint64(bands[number, ORIGIN] + y * stride)
            _add_squares(canvas, at, uint64(columns), squares)
            _add_squares(reference, at, uint64(columns), others)
            _add_differences(canvas, reference, at, uint64(columns), differences)
            if y % SIDE == SIDE - 1 or y == rows - 1:
                for i in range(wide):
                    numbers[first + i] = (y % SIDE + 1) * min(SIDE, columns - i * SIDE)
                its_numbers = numbers[first:first + wide]
                _end_blocks(squares, first, its_numbers, own)
                _end_blocks(others, first, its_numbers, other)
                _end_blocks(differences, first, its_numbers, apart)
                first += wide


@inlined
def _share(weight: int, value: int) -> Any:
    """(weight * value + 2) >> 2, in 32 bits."""
    return int32(int32(weight * int32(value >> 2)) + int32(int32(int32(weight * int32(value & 3)) + 2) >> 2))


@compiled
def subtract_row(canvas: Array, reference: Array, at: int, weight: int, mask: Array) -> None:
    """Subtract the prediction of a row; at is uint64, weight is int32.

    :param mask: see fill_mask
    """
    for i in range(uint64(len(mask))):
        canvas[at + i] -= int32(mask[i] & _share(weight, reference[at + i]))


@compiled
def _write_row(canvas: Array, reference: Array, at: int, weight: int, mask: Array) -> None:
    """Write the prediction of a row, and zeros where there is none; as subtract_row."""
    for i in range(uint64(len(mask))):
        canvas[at + i] = int32(mask[i] & _share(weight, reference[at + i]))


@compiled
def fill_mask(flags: Array, first: int, columns: int, mask: Array) -> bool:
    """Whether a row of blocks has any flag; of each column -1 or 0.

    :param first: flag of the row
    """
    some = False
    for i in range((columns + SIDE - 1) // SIDE):
        flag = int32(flags[first + i])
        some |= flag != 0
        for x in range(i * SIDE, min(i * SIDE + SIDE, columns)):
            mask[x] = -flag
    return some


@compiled
def _write(canvas: Array, reference: Array, bands: Array, firsts: Array, stride: int, weights: Array, flags: Array
           ) -> None:
    for number in range(len(bands)):
        first, columns = firsts[number], bands[number, COLUMNS]
        mask = np.zeros(columns, np.int32)
        for block in range(0, bands[number, ROWS], SIDE):
            some = weights[number] != 0 and fill_mask(flags, first, columns, mask)
            for y in range(block, min(block + SIDE, bands[number, ROWS])):
                at = bands[number, ORIGIN] + y * stride
                if some:
                    _write_row(canvas, reference, uint64(at), int32(weights[number]), mask)
                else:
                    canvas[at:at + columns] = 0
            first += (columns + SIDE - 1) // SIDE


def predicted(reference: Array, plan: Layout, prediction: Prediction) -> Array:
    """(cells,) int32: the canvas of what is predicted from that of a reference."""
    canvas = np.empty(plan.cells, np.int32)     # nobody reads the margins of its bands
    _write(canvas, reference, plan.bands, plan.flag_firsts, plan.stride, prediction.weights, prediction.flags)
    return canvas


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
    return _code(encoding, plan.bands, plan.flag_firsts, 1 + 3 * plan.levels, prediction.weights, prediction.flags,
                 data, odds, low, width, at)


def nothing(plan: Layout) -> Prediction:
    """All weights and flags 0."""
    return Prediction(np.zeros(len(plan.bands), np.int64), np.zeros(int(plan.flag_firsts[-1]), np.uint8))


@compiled
def _variances(own: Array, other: Array, apart: Array, first: int, weight: float, unit: float, least: float,
               result: Array) -> None:
    """Write the variances of what is coded of blocks with a weight; see `choose`. The numbers are float32, but `first`
    is uint64."""
    part = weight * QUARTER
    for i in range(uint64(len(result))):
        block = first + i
        left = (UNIT - part) * (own[block] - part * other[block]) + part * apart[block]
        result[i] = max(left * unit, float32(0)) + least


@compiled
def _logarithms(values: Array, bits: Array, result: Array) -> None:
    """About log2 of float32 above 0, within 0.00003: numpy's takes ten times as long.

    :param bits: values.view(np.int32)
    """
    for i in range(len(result)):
        x = float32(int32(bits[i] & 0x7fffff)) * float32(2.0 ** -23)
        curve = CURVE + x * (CURVE_1 + x * (CURVE_2 + x * CURVE_3))
        result[i] = float32(int32(int32(bits[i] >> 23) - 127)) + (x + x * (UNIT - x) * curve)


@compiled
def _least_logarithms(own: Array, other: Array, apart: Array, units: Array, leasts: Array, firsts: Array) -> Array:
    """(blocks,) float32: log2 of their variances, without the reference or with the whole of it, whichever is less."""
    result = np.empty(firsts[-1], np.float32)
    for number in range(len(units)):
        first, last = firsts[number], firsts[number + 1]
        plain, whole = np.empty(last - first, np.float32), np.empty(last - first, np.float32)
        _variances(own, other, apart, uint64(first), float32(0), units[number], leasts[number], plain)
        _variances(own, other, apart, uint64(first), float32(WHOLE), units[number], leasts[number], whole)
        plain = np.minimum(plain, whole)
        _logarithms(plain, plain.view(np.int32), result[first:last])
    return result


@compiled
def _distortion(logs: Array, numbers: Array, bits: float) -> float:
    """log2 of the distortion of each coefficient when so many bits are divided among blocks.

    :param logs: (blocks,) log2 of their variances; `numbers`: of their coefficients
    """
    lowest = math.floor(logs.min())
    sums = np.zeros((int(GRAIN * (logs.max() - lowest)) + 1, 2))
    for block in range(len(logs)):
        step = int(GRAIN * (logs[block] - lowest))
        sums[step, 0] += numbers[block]
        sums[step, 1] += numbers[block] * logs[block]
    # from the largest variances on: coefficients, and their logarithms, of all that are larger than a level
    total, above = 0.0, 0.0
    for step in range(len(sums) - 1, -1, -1):
        total += sums[step, 0]
        above += sums[step, 1]
        if total >= 1 and 0.5 * (above - total * (lowest + step / GRAIN)) > bits:
            break
    return (above - 2 * bits) / total


@compiled
def _costs(numbers: Array, first: int, variances: Array, logs: Array, result: Array) -> None:
    """The bits that blocks take, and what they lose, at the same slope; variances are in terms of the distortion."""
    _logarithms(variances, variances.view(np.int32), logs)
    for i in range(uint64(len(result))):
        bits = max(logs[i], float32(0)) + min(variances[i], UNIT) * float32(1 / LN_2)
        result[i] = numbers[first + i] * bits * float32(0.5)


@compiled
def _savings(own: Array, other: Array, apart: Array, numbers: Array, first: int, unit: float, least: float,
             best: Array) -> int:
    """The weight that saves most, and what it saves of each block [bit]."""
    variances, logs, costs, saved = (np.empty_like(best), np.empty_like(best), np.empty_like(best),
                                     np.empty_like(best))
    chosen, most = 0, -1.0
    for weight in range(WHOLE + 1):
        _variances(own, other, apart, first, float32(weight), unit, least, variances)
        _costs(numbers, first, variances, logs, saved if weight else costs)
        if weight:
            total = 0.0
            for i in range(len(best)):
                saved[i] = float32(1 - MARGIN) * costs[i] - saved[i]
                total += max(saved[i], float32(0))
            if total > most:
                chosen, most = weight, total
                best[:] = saved
    return chosen


@compiled
def _flag(gains: Array, flags: Array) -> float:
    """Flag the blocks that are worth it; what that saves, less what the flags take [bit]."""
    usual, total = gains.sum() > 0, 0.0
    for block in range(len(gains)):
        chosen = gains[block] > (-LEAST_GAIN if usual else LEAST_GAIN)
        flags[block] = chosen
        total += (gains[block] if chosen else 0.0) - (LEAST_GAIN if chosen != usual else 0.0)
    return total


@compiled
def _choose(own: Array, other: Array, apart: Array, numbers: Array, units: Array, leasts: Array, firsts: Array,
            weights: Array, flags: Array) -> float:
    """Write the weights and flags; what they save [bit]. Units and leasts are in terms of the distortion."""
    total = 0.0
    for number in range(len(weights)):
        first, last = firsts[number], firsts[number + 1]
        saved = np.empty(last - first, np.float32)
        weight = _savings(own, other, apart, numbers, uint64(first), units[number], leasts[number], saved)
        gain = _flag(saved, flags[first:last])
        if gain > LEAST_GAIN:
            weights[number], total = weight, total + gain
        else:
            flags[first:last] = 0
    return total


def choose(canvas: Array, reference: Array, plan: Layout, bits: float) -> Tuple[Prediction, float]:
    """Where a reference saves bits of an image that takes about so many, and how many [bit].

    :param canvas: (cells,) int32, of the image; `reference`: likewise
    """
    firsts, chosen = plan.flag_firsts, nothing(plan)
    blocks = Blocks(*(np.empty(firsts[-1], np.float32) for _ in Blocks._fields))
    _measure(canvas, reference, plan.bands, firsts, plan.stride, *blocks)
    # variances are in quantisation steps by their weights, and never below what rounding leaves
    units, leasts = (plan.weights / plan.bands[:, STEP] * 2.0 ** STEP_BITS) ** 2, plan.weights ** 2 / 12
    logs = _least_logarithms(*blocks[:3], units.astype(np.float32), leasts.astype(np.float32), firsts)
    distortion = max(2.0 ** _distortion(logs, blocks.numbers, bits), float(leasts.min()))
    saved = _choose(*blocks, (units / distortion).astype(np.float32), (leasts / distortion).astype(np.float32), firsts,
                    *chosen)
    return chosen, saved
