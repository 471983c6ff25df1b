# SPDX-License-Identifier: BSD-3-Clause
"""Bit planes in passes, with contexts from what is known: the encoder's and the decoder's loops are the same.

Each coefficient that is not yet significant has an activity: each neighbour that becomes significant adds to it, again
when it is first refined, and so does its parent. So a context is one look-up. Coefficients of a band are in lists:
of blocks without a significant coefficient or one beside it, of the other insignificant ones, of the significant ones.

Near pass: insignificant coefficients with activity. Refinement: those that were significant before this plane. Far
pass: the other insignificant ones, then the blocks.
"""
from typing import NamedTuple, Tuple

from ...arrays import Array, UInt8Array
from .contexts import (
    BAND_CONTEXT,
    BLOCK_CONTEXT,
    CONTEXTS,
    FAR_CONTEXT,
    NEAR_CONTEXT,
    REFINEMENT_CONTEXT,
    SIGN_CONTEXT,
)
from .layout import (
    CELL,
    CHILD,
    CHILDREN,
    FAR,
    HL,
    KIND,
    LH,
    MAP_ORIGIN,
    MAP_STRIDE,
    NEAR,
    ORIGIN,
    PARENT,
    PLACE,
    REFINEMENT,
    SHAPE,
    START,
    Layout,
)
from .loops import borrowing, int64, specialised, uint64
from .range_coder import AHEAD, END, LEAST, State, after_one, after_zero, bound_of, code, decide, refill, unknown_of

Interval = Tuple[int, int, int]
"""The range coder's low and width, and `unknown`, see range_coder.refill."""

BLOCKS_PASS = 3
GUESS_BITS = 10
GUESS_UNIT = 2.0 ** -GUESS_BITS
ONE = uint64(1)
ROW_BITS = 40
"""Rows of the canvas are found by a product with 2^ROW_BITS / stride, not by a division: exactly, as places have 23
bits, and strides 13."""
# columns of the counts of a band
TOP, ALIVE, LIVE, QUIET, FOUND, OLD, REFINED, BLOCKS, PLANE = range(9)
# columns of the log: bytes that a decoder has read before the pass, band, plane, kind, coefficients found until its end
LOG_AT, LOG_BAND, LOG_PLANE, LOG_KIND, LOG_FOUND = range(5)


class Coefficients(NamedTuple):
    """The coefficients of an image."""
    values: Array
    """(cells,) int32: twice the magnitude, and 1 of negative ones; the decoder has none"""
    activity: UInt8Array
    """(cells,), at most twice the sum of all neighbours and a parent: 34"""
    signs: Array
    """(cells,) int8: 0 insignificant, 1, -1"""
    live: Array
    """(coefficients,) int32: insignificant ones outside `blocks`; each band's from START on"""
    quiet: Array
    """(coefficients,) int32: those of them that the far pass will code"""
    found: Array
    """(coefficients,) int32: significant ones, in the order in which they became so"""
    known: Array
    """(coefficients,) int32: their values; the decoder's as far as known"""


class BlockLists(NamedTuple):
    """The blocks of an image."""
    closed: Array
    """(b,) int32: which blocks are without activity"""
    table: Array
    """(4 b,) int32: the one of layout.Layout, row by row"""
    firsts: Array
    """(bands + 1,) where the blocks of each band begin"""
    alive: UInt8Array
    """(places,) 1: a block that is no more in `closed`"""
    touched: UInt8Array
    """(places,) 1: a block any of whose coefficients has activity, or one that is alive"""


class Coding(NamedTuple):
    """What codes an image, and what is noted of it."""
    counts: Array
    """(bands, 9) int64: TOP: planes that are not empty (encoder); ALIVE; lengths of lists; OLD: found before this
    plane; REFINED: of them, in this plane; PLANE: the one that was begun last"""
    odds: Array
    """(bands * CONTEXTS,) uint32"""
    error: Array
    """(1,) float64: the encoder's squared error, summed"""
    guesses: Array
    """(planes,) int64: where in its interval of 2^plane a coefficient is thought to be [2^-GUESS_BITS]"""
    data: UInt8Array
    """The stream"""
    log: Array
    """(passes, 5) int32: LOG_AT, ...: of each pass that codes coefficients"""
    marks: Array
    """(m,) int32: where the bytes up to 2 i are read by a pass, how many coefficients it has found or refined until
    then; -1: no pass of the log reads them"""


class Work(NamedTuple):
    """The arrays of an image."""
    coefficients: Coefficients
    blocks: BlockLists
    coding: Coding


class Points(NamedTuple):
    """Truncation points, each with (n,) int64: where it is [byte]; and float64: the squared error until there."""
    ends: Array
    errors: Array


class Band(NamedTuple):
    """What the loops need to know of a band and plane."""
    number: int
    plane: int
    stride: int
    beside: int
    above: int
    origin: int
    map_origin: int
    map_stride: int
    child: int
    child_map_origin: int
    """-1: it has no children."""
    child_map_stride: int
    odds: int
    start: int
    weight: float
    """Squared weight of the band's coefficients in the error of the image."""


@specialised
def _spread(work: Work, band: Band, place: int) -> None:
    """A coefficient became significant or was refined for the first time: it adds to its neighbours and children."""
    activity, touched = work.coefficients.activity, work.blocks.touched
    here = uint64(place)
    up, down = here - uint64(band.stride), here + uint64(band.stride)
    activity[up - ONE] += 1
    activity[up] += band.above
    activity[up + ONE] += 1
    activity[here - ONE] += band.beside
    activity[here + ONE] += band.beside
    activity[down - ONE] += 1
    activity[down] += band.above
    activity[down + ONE] += 1
    y = ((place - band.origin) * ((1 << ROW_BITS) // band.stride + 1)) >> ROW_BITS
    x = place - band.origin - y * band.stride
    upper = band.map_origin + ((y - 1) >> 2) * band.map_stride
    lower = band.map_origin + ((y + 1) >> 2) * band.map_stride
    left, right = (x - 1) >> 2, (x + 1) >> 2
    touched[uint64(upper + left)] = 1
    touched[uint64(upper + right)] = 1
    touched[uint64(lower + left)] = 1
    touched[uint64(lower + right)] = 1
    if band.child_map_origin >= 0:
        first = uint64(2 * place + band.child)
        second = first + uint64(band.stride)
        activity[first] += 3
        activity[first + ONE] += 3
        activity[second] += 3
        activity[second + ONE] += 3
        touched[uint64(band.child_map_origin + (y >> 1) * band.child_map_stride + (x >> 1))] = 1


@borrowing
def _sign_context(signs: Array, place: int, stride: int) -> int:
    """-4..4, from the signs beside and above; that of the opposite signs is the negative."""
    here = uint64(place)
    beside = signs[here - ONE] + signs[here + ONE]
    above = signs[here - uint64(stride)] + signs[here + uint64(stride)]
    return int(3 * ((beside > 0) - (beside < 0)) + (above > 0) - (above < 0))


@borrowing
def _mark(marks: Array, at: int, progress: int) -> None:
    """The next two bytes are needed, when a decoder has read `at` of them."""
    marks[min((at >> 1) + 1, len(marks) - 1)] = progress


@specialised
def _zeros(encoding: bool, near: bool, work: Work, band: Band, first: int, last: int, ends: Tuple[int, int],
           interval: Interval) -> Tuple[int, int, int, int, int]:
    """Code the members from `first` on that stay insignificant, until one does not, or bytes are needed.

    Nine of ten symbols are coded here: in a loop with few variables, which all are in registers.

    :param ends: of the live and of the quiet list
    :returns: how far it came, the new ends of the lists, and width; and 1: the next one becomes significant, END: the
        stream ends, or 0
    """
    coefficients, activity, odds = work.coefficients, work.coefficients.activity, work.coding.odds
    members, (kept, waiting), (low, width, unknown) = coefficients.live if near else coefficients.quiet, ends, interval
    context, plane = band.odds + (NEAR_CONTEXT if near else FAR_CONTEXT), band.plane
    for i in range(first, last):
        place = members[i]
        active = int64(activity[uint64(place)])
        if near and active == 0:
            coefficients.quiet[uint64(waiting)] = place
            waiting += 1
            continue
        at_odds = uint64(context + active)
        odd = int64(odds[at_odds])
        bound = bound_of(odd, width)
        if (int64(coefficients.values[uint64(place)]) >> (plane + 1)) & 1 if encoding else low >= bound:
            return i, kept, waiting, width, 1
        if not encoding and low + unknown > bound:
            return i, kept, waiting, bound, END
        odds[at_odds] = after_zero(odd)
        coefficients.live[uint64(kept)] = place
        kept += 1
        width = bound
        if width < LEAST:
            return i + 1, kept, waiting, width, 0
    return last, kept, waiting, width, 0


@specialised
def _sign(encoding: bool, sign: int, work: Work, band: Band, place: int, interval: Interval) -> Tuple[int, int, int]:
    """Code a sign: 1 of negative ones; the sign or END, and the new low and width."""
    odds, (low, width, unknown) = work.coding.odds, interval
    around = _sign_context(work.coefficients.signs, place, band.stride)
    flip, at_odds = 1 if around < 0 else 0, band.odds + SIGN_CONTEXT + abs(around)
    odd = int64(odds[at_odds])
    symbol, low, width = decide(encoding, sign ^ flip, bound_of(odd, width), low, width, unknown)
    odds[at_odds] = after_one(odd) if symbol > 0 else after_zero(odd)
    return symbol if symbol < 0 else symbol ^ flip, low, width


@specialised
def _significance(encoding: bool, near: bool, work: Work, band: Band, first: int, last: int, state: State
                  ) -> Tuple[int, State]:
    """The near pass over a part of the live list, or the far pass over a part of the quiet ones."""
    values, coding, (low, width, at) = work.coefficients.values, work.coding, state
    odds, data, marks, counts = coding.odds, coding.data, coding.marks, coding.counts[band.number]
    ahead, plane = AHEAD if encoding else 0, band.plane
    context = band.odds + (NEAR_CONTEXT if near else FAR_CONTEXT)
    kept, waiting, end = band.start + counts[LIVE], band.start + counts[QUIET], band.start + counts[FOUND]
    guess, gain, one = coding.guesses[plane] * GUESS_UNIT, 0.0, 1 << plane
    members = work.coefficients.live if near else work.coefficients.quiet
    symbol, unknown, i = 0, unknown_of(data, at), first
    while i < last:
        i, kept, waiting, width, symbol = _zeros(encoding, near, work, band, i, last, (kept, waiting),
                                                 (low, width, unknown))
        place = members[min(i, last - 1)]
        if symbol > 0:
            at_odds = context + int64(work.coefficients.activity[place])
            odd = int64(odds[at_odds])
            _, low, width = decide(encoding, 1, bound_of(odd, width), low, width, unknown)
            odds[at_odds] = after_one(odd)
        if width < LEAST:
            _mark(marks, at + ahead, end - band.start)
            low, width, at, unknown = refill(encoding, data, low, width, at)
        if symbol < 0 or unknown == 0:
            symbol = END
            break
        if symbol == 0:
            continue
        sign, low, width = _sign(encoding, values[place] & 1 if encoding else 0, work, band, place,
                                 (low, width, unknown))
        if width < LEAST:
            _mark(marks, at + ahead, end - band.start)
            low, width, at, unknown = refill(encoding, data, low, width, at)
        if sign < 0 or unknown == 0:
            symbol = END
            break
        if encoding:
            magnitude = float(values[place] >> 1)
            rest = magnitude - one - guess
            gain += magnitude * magnitude - rest * rest
        work.coefficients.signs[place] = 1 - 2 * sign
        work.coefficients.found[end] = place
        work.coefficients.known[end] = values[place] if encoding else 2 * one + sign
        end += 1
        _spread(work, band, place)
        i += 1
    counts[LIVE], counts[QUIET], counts[FOUND] = kept - band.start, waiting - band.start, end - band.start
    coding.error[0] -= band.weight * gain
    return symbol, (low, width, at)


@specialised
def _refine(encoding: bool, work: Work, band: Band, first: int, last: int, state: State) -> Tuple[int, State]:
    """One more bit of a part of the significant coefficients."""
    activity, found, values = work.coefficients.activity, work.coefficients.found, work.coefficients.known
    odds, data, marks, guesses = work.coding.odds, work.coding.data, work.coding.marks, work.coding.guesses
    ahead, (low, width, at) = AHEAD if encoding else 0, state
    plane, context = band.plane, band.odds + REFINEMENT_CONTEXT
    before, after = guesses[plane + 1] * GUESS_UNIT, guesses[plane] * GUESS_UNIT
    gain = 0.0
    symbol, unknown = 0, unknown_of(data, at)
    for i in range(first, last):
        value = int64(values[i])
        known = value >> (plane + 2)
        bit = (value >> (plane + 1)) & 1
        if known < 4:
            at_odds = context + 3
            if known == 1:
                place = found[i]
                at_odds = context + min(int64(activity[place]) >> 3, 2)
                _spread(work, band, place)
            odd = int64(odds[at_odds])
            symbol, low, width = decide(encoding, bit, bound_of(odd, width), low, width, unknown)
            odds[at_odds] = after_one(odd) if symbol > 0 else after_zero(odd)
        else:
            symbol, low, width = decide(encoding, bit, width >> 1, low, width, unknown)
        if width < LEAST:
            _mark(marks, at + ahead, i - band.start)
            low, width, at, unknown = refill(encoding, data, low, width, at)
        if symbol < 0 or unknown == 0:
            symbol, last = END, i
            break
        if encoding:
            old = float((value >> 1) & ((2 << plane) - 1))
            new = old - (symbol << plane) - after
            old -= before
            gain += old * old - new * new
        else:
            values[i] = value | symbol << (plane + 1)
    work.coding.error[0] -= band.weight * gain
    work.coding.counts[band.number, REFINED] = last - band.start
    return symbol, (low, width, at)


@borrowing
def _united(values: Array, cell: int, shape: int, stride: int) -> int:
    """All bits that are in any value of a block."""
    bits = int64(0)
    for y in range(shape >> 3):
        at = uint64(cell + y * stride)
        for x in range(uint64(shape & 7)):
            bits |= int64(values[at + x])
    return int(bits)


@specialised
def _block_context(work: Work, place: int, along: int, parent: int, stride: int) -> int:
    """From the four blocks beside it, and from its parents."""
    alive, activity, here = work.blocks.alive, work.coefficients.activity, uint64(place)
    context = (int64(alive[here - ONE]) + int64(alive[here + ONE]) + int64(alive[here - uint64(along)])
               + int64(alive[here + uint64(along)]))
    if parent >= 0:
        first, second = uint64(parent), uint64(parent + stride)
        if activity[first] | activity[first + ONE] | activity[second] | activity[second + ONE]:
            context += 5
    return int(context)


@specialised
def _closed(encoding: bool, work: Work, band: Band, first: int, last: int, kept: int, interval: Interval
            ) -> Tuple[int, int, int, int, int]:
    """Code the blocks from `first` on that stay closed, until one does not, or bytes are needed.

    :param kept: where the list of closed blocks ends
    :returns: how far it came, the new end of the list, and width; 1: a symbol opens the next one, 2: its activity does,
        END: the stream ends, or 0; and the context of the symbol
    """
    closed, table, odds, (low, width, unknown) = work.blocks.closed, work.blocks.table, work.coding.odds, interval
    plane, stride = band.plane, band.stride
    for i in range(first, last):
        block = 4 * int64(closed[uint64(i)])
        place = int64(table[uint64(block + PLACE)])
        if work.blocks.touched[uint64(place)]:
            return i, kept, width, 2, 0
        at_odds = band.odds + BLOCK_CONTEXT + _block_context(work, place, band.map_stride,
                                                             int64(table[uint64(block + PARENT)]), stride)
        odd = int64(odds[uint64(at_odds)])
        bound = bound_of(odd, width)
        if (_united(work.coefficients.values, int64(table[uint64(block + CELL)]),
                    int64(table[uint64(block + SHAPE)]), stride) >> (plane + 1) if encoding else low >= bound):
            return i, kept, width, 1, at_odds
        if not encoding and low + unknown > bound:
            return i, kept, bound, END, 0
        odds[uint64(at_odds)] = after_zero(odd)
        closed[uint64(kept)] = block >> 2
        kept += 1
        width = bound
        if width < LEAST:
            return i + 1, kept, width, 0, 0
    return last, kept, width, 0, 0


@borrowing
def _open(work: Work, block: int, waiting: int, stride: int) -> int:
    """Put the coefficients of a block into the quiet list, whose new end is returned."""
    table = work.blocks.table
    work.blocks.alive[uint64(table[uint64(block + PLACE)])] = 1
    shape = int64(table[uint64(block + SHAPE)])
    for y in range(shape >> 3):
        first = table[uint64(block + CELL)] + y * stride
        for x in range(first, first + (shape & 7)):
            work.coefficients.quiet[uint64(waiting)] = x
            waiting += 1
    return waiting


@specialised
def _blocks(encoding: bool, work: Work, band: Band, first: int, last: int, state: State) -> Tuple[int, State]:
    """The far pass over a part of the blocks; those that are opened go to the quiet list, to be coded next."""
    odds, data, counts = work.coding.odds, work.coding.data, work.coding.counts[band.number]
    low, width, at = state
    kept, waiting = work.blocks.firsts[band.number] + counts[BLOCKS], band.start + counts[QUIET]
    symbol, unknown, i = 0, unknown_of(data, at), first
    while i < last:
        i, kept, width, symbol, at_odds = _closed(encoding, work, band, i, last, kept, (low, width, unknown))
        if symbol == 1:
            odd = int64(odds[at_odds])
            _, low, width = decide(encoding, 1, bound_of(odd, width), low, width, unknown)
            odds[at_odds] = after_one(odd)
        if width < LEAST:
            low, width, at, unknown = refill(encoding, data, low, width, at)
        if symbol < 0 or unknown == 0:
            symbol = END
            break
        if symbol > 0:
            waiting = _open(work, 4 * int64(work.blocks.closed[i]), waiting, band.stride)
            i += 1
    counts[BLOCKS], counts[QUIET] = kept - work.blocks.firsts[band.number], waiting - band.start
    return symbol, (low, width, at)


@specialised
def _part(encoding: bool, kind: int, work: Work, band: Band, first: int, last: int, state: State) -> Tuple[int, State]:
    if kind == REFINEMENT:
        return _refine(encoding, work, band, first, last, state)
    if kind == BLOCKS_PASS:
        return _blocks(encoding, work, band, first, last, state)
    if kind == NEAR:
        return _significance(encoding, True, work, band, first, last, state)
    return _significance(encoding, False, work, band, first, last, state)


@borrowing
def _encode_part(kind: int, work: Work, band: Band, first: int, last: int, state: State) -> Tuple[int, State]:
    return _part(True, kind, work, band, first, last, state)


@borrowing
def _decode_part(kind: int, work: Work, band: Band, first: int, last: int, state: State) -> Tuple[int, State]:
    return _part(False, kind, work, band, first, last, state)


@borrowing
def _band(bands: Array, weights: Array, number: int, plane: int, stride: int) -> Band:
    row = bands[number]
    kind = row[KIND]
    beside, above = 2, 2
    if kind == HL:
        above = 3
    elif kind == LH:
        beside = 3
    children = row[CHILDREN]
    return Band(number, plane, stride, beside, above, row[ORIGIN], row[MAP_ORIGIN], row[MAP_STRIDE], row[CHILD],
                bands[children, MAP_ORIGIN] if children >= 0 else -1, bands[children, MAP_STRIDE], number * CONTEXTS,
                row[START], weights[number] * weights[number])


@borrowing
def _begin_pass(entry: Array, at: int, band: Band, kind: int) -> None:
    entry[LOG_AT], entry[LOG_BAND], entry[LOG_PLANE], entry[LOG_KIND] = at, band.number, band.plane, kind


@borrowing
def _record(work: Work, points: Points, count: int, at: int) -> int:
    """Note a truncation point, unless the last one is near; how many there are."""
    ends, end = points.ends, at + AHEAD
    if end >= ends[count - 1] + 16 and count < len(ends) - 1:
        ends[count] = end
        points.errors[count] = max(work.coding.error[0], 0.0)
        count += 1
    return count


@borrowing
def _pass(encoding: bool, work: Work, band: Band, kind: int, part: int, points: Points, count: int, state: State
          ) -> Tuple[int, int, State]:
    """One pass of a plane of a band, in parts, each with a truncation point at its end.

    :param count: number of truncation points until now
    :returns: 0 or END, their new number, and the coder's state
    """
    counts = work.coding.counts[band.number]
    symbol, start = 0, band.start
    if kind == BLOCKS_PASS:
        start = work.blocks.firsts[band.number]
        last = start + counts[BLOCKS]
        counts[BLOCKS], counts[QUIET] = 0, 0
    elif kind == NEAR:
        last = start + counts[LIVE]
        counts[LIVE], counts[QUIET], counts[OLD], counts[REFINED], counts[PLANE] = 0, 0, counts[FOUND], 0, band.plane
    elif kind == FAR:
        last = start + counts[QUIET]
    else:
        last = start + counts[OLD]
    for first in range(start, last, part):
        end = min(first + part, last)
        if encoding:
            symbol, state = _encode_part(kind, work, band, first, end, state)
        else:
            symbol, state = _decode_part(kind, work, band, first, end, state)
        if symbol < 0:
            break
        if encoding:
            count = _record(work, points, count, state[2])
    return symbol, count, state


def code_planes(encoding: bool, work: Work, layout: Layout, planes: int, part: int, points: Points, state: State
                ) -> Tuple[int, bool, int, State]:
    """All passes of an image, until the stream or the encoder's room ends.

    :param planes: that are not empty
    :param part: coefficients from a truncation point to the next one, at most
    :param points: are written by the encoder, but for the first one, where the passes begin
    :returns: the number of truncation points, whether all passes are complete, the length of the log, and the coder's
        state
    """
    return _code_planes(encoding, (layout.stride, planes, part), points, state, layout.bands, layout.weights,
                        layout.steps, *work.coefficients, *work.blocks, *work.coding)


@borrowing
def _code_planes(   # noqa: PLR0913  (see below)
        encoding: bool, sizes: Tuple[int, int, int], points: Points, state: State, bands: Array, weights: Array,
        steps: Array, values: Array, activity: Array, signs: Array, live: Array, quiet: Array, found: Array,
        known: Array, closed: Array, table: Array, firsts: Array, alive: Array, touched: Array, counts: Array,
        odds: Array, error: Array, guesses: Array, data: Array, log: Array, marks: Array
        ) -> Tuple[int, bool, int, State]:
    """As code_planes, with the arrays of Work one by one.

    numba 0.56 caches the types of arguments by a fingerprint, and that of a tuple is wrong where it is longer than 40
    bytes, as that of five arrays: each call would add an entry to the cache.

    :param sizes: the canvas' stride, and its `planes` and `part`
    """
    coefficients = Coefficients(values, activity, signs, live, quiet, found, known)
    work = Work(coefficients, BlockLists(closed, table, firsts, alive, touched),
                Coding(counts, odds, error, guesses, data, log, marks))
    stride, planes, part = sizes
    count, symbol, logged = 1, 0, 0
    for step in range(len(steps)):
        number, plane, kind = steps[step, 0], steps[step, 1], steps[step, 2]
        own = counts[number]
        if plane >= planes or (kind != NEAR and not own[ALIVE]):
            continue
        if not own[ALIVE]:
            symbol, state = code(encoding, data, odds, number * CONTEXTS + BAND_CONTEXT, 1 if own[TOP] > plane else 0,
                                 state)
            if symbol < 0:
                break
            if symbol == 0:
                continue
            own[ALIVE] = 1
        band = _band(bands, weights, number, plane, stride)
        for turn in range(3 if kind == FAR else 1):     # the blocks between two far passes
            one = BLOCKS_PASS if turn == 1 else kind
            _begin_pass(log[logged], state[2] + (AHEAD if encoding else 0), band, one)
            symbol, count, state = _pass(encoding, work, band, one, part, points, count, state)
            log[logged, LOG_FOUND] = own[FOUND]
            logged += 1
            if symbol < 0:
                break
        if symbol < 0:
            break
    return count, symbol >= 0, logged, state
