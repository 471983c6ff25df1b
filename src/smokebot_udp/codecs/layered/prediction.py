# SPDX-License-Identifier: BSD-3-Clause
"""Prediction of an image's coefficients from those of a reference: where, how, and its coding.

Both canvases are of one layout. A band is predicted by the number of a noise, see `shrinking`; a predicted band has a
flag for each of its blocks of SIDE x SIDE coefficients. What is coded of a predicted block is the difference. All of it
is of integers, so that it is added as exactly as it was subtracted.

The choice minimises the bits of a block by its variance s: with a distortion t for each coefficient, the one that the
budget allows to all (reverse water-filling: Cover, Thomas, Elements of Information Theory, 10.3), they are
log2(s / t) / 2 each, and where s is below t, what is lost more than t at the same slope.
"""
import math
from typing import NamedTuple, Tuple

import numpy as np

from ...arrays import Array, UInt8Array
from . import noise_choice, shrinking
from .layout import COLUMNS, ORIGIN, ROWS, SIDE, STEP, STEP_BITS, Layout
from .loops import borrowing, compiled, float32, int32, int64, uint64
from .range_coder import State, code
from .shrinking import FAINTEST, NONE, PLAIN, STRONGEST

LEAST_GAIN = 8.0
"""A flag that differs from most must save this [bit]: it takes about as much."""
MARGIN = 1 / 16
"""Variances say no more than that about bits. A prediction must save this part of what a band takes without it; but a
block is predicted even if that seems to take this part more: then nearly all have the same flag."""
GRAIN = 4
"""The variances of blocks are sorted into steps of 1/GRAIN in log2."""
LN_2 = math.log(2)
UNIT = float32(1)
CURVE, CURVE_1, CURVE_2, CURVE_3 = float32(0.44174), float32(-0.26603), float32(0.146314), float32(-0.044005)
"""log2(1 + x) is about x + x (1 - x) (CURVE + CURVE_1 x + CURVE_2 x^2 + CURVE_3 x^3), for x from 0 to 1."""
BEGINNING = 14
"""The first number of a noise is coded as its difference from this one."""
NOISE_CONTEXT, STEP_CONTEXT, STEP_CONTEXTS, PLAIN_CONTEXT, CONTEXTS = 27, 31, 6, 37, 38
"""Those of flags come first. Of noises: whether there is prediction, noise, another number, a smaller one; then each
step."""


class Prediction(NamedTuple):
    """How an image is predicted."""
    noises: Array
    """(bands,) int64: numbers of noises, see `shrinking`"""
    flags: UInt8Array
    """(blocks,) 1: predicted; those of a band come by rows, from Layout.flag_firsts on"""


class Blocks(NamedTuple):
    """Statistics of all blocks, each of them (blocks,) float32."""
    own: Array
    """Mean squares of the image's coefficients."""
    apart: Array
    """Mean squares of the differences between these and what is predicted."""
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
def _measure(canvas: Array, predicted: Array, bands: Array, firsts: Array, stride: int, own: Array, apart: Array,
             numbers: Array) -> None:
    """Write the arrays of Blocks."""
    for number in range(len(bands)):
        rows, columns, first = bands[number, ROWS], bands[number, COLUMNS], firsts[number]
        wide = (columns + SIDE - 1) // SIDE
        squares, differences = np.zeros(wide * SIDE, np.float32), np.zeros(wide * SIDE, np.float32)
        for y in range(rows):
            at = uint64(bands[number, ORIGIN] + y * stride)
            _add_squares(canvas, at, uint64(columns), squares)
            _add_differences(canvas, predicted, at, uint64(columns), differences)
            if y % SIDE == SIDE - 1 or y == rows - 1:
                for i in range(wide):
                    numbers[first + i] = (y % SIDE + 1) * min(SIDE, columns - i * SIDE)
                its_numbers = numbers[first:first + wide]
                _end_blocks(squares, first, its_numbers, own)
                _end_blocks(differences, first, its_numbers, apart)
                first += wide


@compiled
def _clear(canvas: Array, bands: Array, firsts: Array, stride: int, noises: Array, flags: Array) -> None:
    """Write zeros where nothing is predicted."""
    for number in range(len(bands)):
        columns = bands[number, COLUMNS]
        wide = (columns + SIDE - 1) // SIDE
        for block in range(firsts[number], firsts[number + 1]):
            if flags[block]:
                continue
            y, x = (block - firsts[number]) // wide * SIDE, (block - firsts[number]) % wide * SIDE
            for row in range(y, min(y + SIDE, bands[number, ROWS])):
                at = bands[number, ORIGIN] + row * stride
                canvas[at + x:at + min(x + SIDE, columns)] = 0


def predicted(reference: Array, plan: Layout, prediction: Prediction) -> Array:
    """(cells,) int32: the canvas of what is predicted from that of a reference."""
    canvas = shrinking.shrunk(reference, plan, prediction.noises)
    _clear(canvas, plan.bands, plan.flag_firsts, plan.stride, *prediction)
    return canvas


@borrowing
def _flag_context(flags: Array, number: int, own: Tuple[int, int, int], parent: Tuple[int, int, int]) -> int:
    """From the flags on the left and above, and from the one of the same place in the next coarser band; 2: none.

    :param number: of the flag in its band
    :param own: see _flags_of
    :param parent: likewise, of the next coarser band
    """
    first, _, wide = own
    y, x = number // wide, number % wide
    left = int64(flags[first + number - 1]) if x > 0 else 2
    above = int64(flags[first + number - wide]) if y > 0 else 2
    coarser, (parents, high, parents_wide) = 2, parent
    if parents >= 0:
        coarser = int64(flags[parents + min(y >> 1, high - 1) * parents_wide + min(x >> 1, parents_wide - 1)])
    return 9 * left + 3 * above + coarser


@borrowing
def _code_noise(encoding: bool, noise: int, before: int, data: Array, odds: Array, state: State) -> Tuple[int, State]:
    """The number of a band's noise, or END, and the coder's state.

    :param before: the number of the last band that has noise
    """
    symbols = noise > NONE, noise > PLAIN, noise != before, noise < before
    values = NONE, PLAIN, before
    for question in range(4):
        context = NOISE_CONTEXT + question
        symbol, state = code(encoding, data, odds, context, int64(symbols[question]), state)
        if symbol < 0 or symbol == 0 and question < 3:
            return -1 if symbol < 0 else values[question], state
    step, end = (-1, FAINTEST) if symbol else (1, STRONGEST)
    value = before
    while value != end:
        value += step
        more, state = code(encoding, data, odds, STEP_CONTEXT + min(abs(value - before), STEP_CONTEXTS) - 1,
                           1 if value != noise else 0, state)
        if more <= 0:
            return -1 if more < 0 else value, state
    return -1, state        # there is no such number


@borrowing
def _flags_of(number: int, bands: Array, firsts: Array) -> Tuple[int, int, int]:
    """Where the flags of a band begin, their rows and columns; they begin at -1 where the number is -1: no band."""
    if number < 0:
        return int64(-1), int64(0), int64(0)
    return (firsts[number], (bands[number, ROWS] + SIDE - 1) // SIDE, (bands[number, COLUMNS] + SIDE - 1) // SIDE)


@borrowing
def _code_flags(encoding: bool, own: Tuple[int, int, int], parent: Tuple[int, int, int], flags: Array, data: Array,
                odds: Array, state: State) -> Tuple[int, State]:
    """The flags of a band: whether all are 1, else each; END in place of 0 where the stream or the room ends.

    :param own: see _flags_of
    :param parent: likewise, of the next coarser band
    """
    first, high, wide = own
    end, other = first + high * wide, 0
    if encoding:
        for i in range(first, end):
            other |= 1 - flags[i]
    other, state = code(encoding, data, odds, PLAIN_CONTEXT, other, state)
    if other <= 0:
        flags[first:end] = 1
        return other, state
    for i in range(first, end):
        context = _flag_context(flags, i - first, own, parent)
        flag, state = code(encoding, data, odds, context, int64(flags[i]), state)
        if flag < 0:
            return -1, state
        flags[i] = flag
    return 0, state


@borrowing
def _code(encoding: bool, bands: Array, firsts: Array, in_channel: int, prediction: Prediction, data: Array,
          odds: Array, state: State) -> Tuple[bool, State]:
    """As code_prediction.

    :param in_channel: number of bands of a channel
    """
    noises, flags = prediction
    before = BEGINNING
    for number in range(len(bands)):
        noise, state = _code_noise(encoding, noises[number], before, data, odds, state)
        if noise < 0:
            return False, state
        noises[number] = noise
        if noise == NONE:
            continue
        if noise > PLAIN:
            before = noise
        parent = number - 3 if number % in_channel >= 4 and noises[number - 3] else -1
        end, state = _code_flags(encoding, _flags_of(number, bands, firsts), _flags_of(parent, bands, firsts), flags,
                                 data, odds, state)
        if end < 0:
            return False, state
    return True, state


def code_prediction(encoding: bool, prediction: Prediction, plan: Layout, data: UInt8Array, state: State
                    ) -> Tuple[bool, State]:
    """Code the noises and flags; whether all of them are coded, and the coder's state.

    :param prediction: is written when decoding
    """
    odds = np.full(CONTEXTS, 1 << 31 | 1 << 15, np.uint32)
    return _code(encoding, plan.bands, plan.flag_firsts, 1 + 3 * plan.levels, prediction, data, odds, state)


def nothing(plan: Layout) -> Prediction:
    """No noise, no flag: nothing is predicted."""
    return Prediction(np.zeros(len(plan.bands), np.int64), np.zeros(int(plan.flag_firsts[-1]), np.uint8))


@compiled
def _variances(squares: Array, first: int, unit: float, least: float, result: Array) -> None:
    """Write the variances of a band's blocks; see `choose`. The numbers are float32, but `first` is uint64."""
    for i in range(uint64(len(result))):
        result[i] = squares[first + i] * unit + least


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
def _least_logarithms(own: Array, apart: Array, units: Array, leasts: Array, firsts: Array) -> Array:
    """(blocks,) float32: log2 of their variances, predicted or not, whichever is less."""
    result = np.empty(firsts[-1], np.float32)
    for number in range(len(units)):
        first, last = firsts[number], firsts[number + 1]
        variances = np.minimum(own[first:last], apart[first:last]) * units[number] + leasts[number]
        _logarithms(variances, variances.view(np.int32), result[first:last])
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
def _savings(own: Array, apart: Array, numbers: Array, first: int, unit: float, least: float, costs: Array,
             saved: Array) -> None:
    """Write what the blocks of a band take without prediction, and what it saves of that for certain [bit]."""
    variances, logs = np.empty_like(saved), np.empty_like(saved)
    _variances(own, first, unit, least, variances)
    _costs(numbers, first, variances, logs, costs)
    _variances(apart, first, unit, least, variances)
    _costs(numbers, first, variances, logs, saved)
    for i in range(len(saved)):
        saved[i] = float32(1 - MARGIN) * costs[i] - saved[i]


@compiled
def _flag(costs: Array, saved: Array, flags: Array) -> float:
    """Flag the blocks that are worth it; what that saves, less what the flags take [bit]."""
    usual, total = saved.sum() > 0, 0.0
    for block in range(len(saved)):
        chosen = saved[block] + 2 * MARGIN * costs[block] > (-LEAST_GAIN if usual else LEAST_GAIN)
        flags[block] = chosen
        total += (saved[block] if chosen else 0.0) - (LEAST_GAIN if chosen != usual else 0.0)
    return total


@compiled
def _choose(own: Array, apart: Array, numbers: Array, units: Array, leasts: Array, firsts: Array, noises: Array,
            flags: Array) -> float:
    """Write the flags, and NONE for bands that are not worth it; what they save [bit]. Units and leasts are in terms of
    the distortion."""
    total = 0.0
    for number in range(len(noises)):
        first, last = firsts[number], firsts[number + 1]
        flags[first:last] = 0
        if noises[number] == NONE:
            continue
        costs, saved = np.empty(last - first, np.float32), np.empty(last - first, np.float32)
        _savings(own, apart, numbers, uint64(first), units[number], leasts[number], costs, saved)
        gain = _flag(costs, saved, flags[first:last])
        if gain > LEAST_GAIN:
            total += gain
        else:
            noises[number], flags[first:last] = NONE, 0
    return total


def choose(canvas: Array, reference: Array, plan: Layout, bits: float) -> Tuple[Prediction, Array, float]:
    """Where and how a reference saves bits of an image that takes about so many, what it predicts, and what that saves
    [bit].

    :param canvas: (cells,) int32, of the image; `reference`: likewise
    :returns: the second: (cells,) int32
    """
    firsts, chosen = plan.flag_firsts, nothing(plan)
    # variances are in quantisation steps by their weights, and never below what rounding leaves
    units, leasts = (plan.weights / plan.bands[:, STEP] * 2.0 ** STEP_BITS) ** 2, plan.weights ** 2 / 12
    found = noise_choice.samples(canvas, reference, plan)
    variances, numbers = noise_choice.least_variances(found, plan, units, leasts)
    if len(variances):      # else the reference shows something else everywhere
        distortion = max(2.0 ** _distortion(np.log2(variances), numbers, bits), float(leasts.min()))
        chosen.noises[:] = noise_choice.best_noises(found, units / distortion)
    canvas_of_it = shrinking.shrunk(reference, plan, chosen.noises)
    blocks = Blocks(*(np.empty(firsts[-1], np.float32) for _ in Blocks._fields))
    _measure(canvas, canvas_of_it, plan.bands, firsts, plan.stride, *blocks)
    logs = _least_logarithms(*blocks[:2], units.astype(np.float32), leasts.astype(np.float32), firsts)
    distortion = max(2.0 ** _distortion(logs, blocks.numbers, bits), float(leasts.min()))
    saved = _choose(*blocks, (units / distortion).astype(np.float32), (leasts / distortion).astype(np.float32), firsts,
                    *chosen)
    _clear(canvas_of_it, plan.bands, firsts, plan.stride, *chosen)
    return chosen, canvas_of_it, saved
