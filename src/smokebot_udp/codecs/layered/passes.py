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
    ACTIVITIES,
    BAND_CONTEXT,
    BLOCK_CONTEXT,
    CONTEXTS,
    FAR_CONTEXT,
    NEAR_CONTEXT,
    REFINEMENT_CONTEXT,
    SIGN_CONTEXT,
)
from .layout import (
    ALIVE_STRIDE,
    BLOCK,
    CELL,
    CHILD,
    FAR,
    HAS_CHILDREN,
    HL,
    KIND,
    LH,
    NEAR,
    PARENT,
    PLACE,
    REFINEMENT,
    SHAPE,
    START,
)
from .loops import compiled, int64, specialised, uint64
from .range_coder import AHEAD, END, LEAST, code, decide, decide_at, refill, unknown_of

BLOCKS_PASS = 3
GUESS_BITS = 10
GUESS_UNIT = 2.0 ** -GUESS_BITS
ONE, TWO, THREE = uint64(1), uint64(2), uint64(3)
# columns of the counts of a band
TOP, ALIVE, LIVE, QUIET, FOUND, OLD, REFINED, BLOCKS, PLANE = range(9)
# columns of the log: bytes that a decoder has read before the pass, band, plane, kind, coefficients found until its end
LOG_AT, LOG_BAND, LOG_PLANE, LOG_KIND, LOG_FOUND = range(5)


class Work(NamedTuple):
    """The arrays of an image."""
    values: Array
    """(cells,) int32: twice the magnitude, and 1 of negative ones; the decoder's as far as known"""
    activity: UInt8Array
    """(cells,)"""
    signs: Array
    """(cells,) int8: 0 insignificant, 1, -1"""
    live: Array
    """(coefficients,) int32: insignificant ones outside `blocks`; each band's from START on"""
    quiet: Array
    """(coefficients,) int32: those of them that the far pass will code"""
    found: Array
    """(coefficients,) int32: significant ones, in the order in which they became so"""
    blocks: Array
    """(b, 4) int32: those without activity"""
    firsts: Array
    """(bands + 1,) where the blocks of each band begin"""
    alive: UInt8Array
    """(places,) 1: a block that is no more in `blocks`"""
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


class Band(NamedTuple):
    """What the loops need to know of a band and plane."""
    number: int
    plane: int
    stride: int
    child: int
    """0: it has no children."""
    beside: int
    above: int
    odds: int
    start: int
    weight: float
    """squared"""


@compiled
def _spread(activity: UInt8Array, place: int, stride: int, child: int, beside: int, above: int) -> None:
    """A coefficient became significant or was refined for the first time: it adds to its neighbours and children."""
    here = uint64(place)
    up, down = here - uint64(stride), here + uint64(stride)
    activity[up - ONE] += 1
    activity[up] += above
    activity[up + ONE] += 1
    activity[here - ONE] += beside
    activity[here + ONE] += beside
    activity[down - ONE] += 1
    activity[down] += above
    activity[down + ONE] += 1
    if child:
        first = uint64(2 * place + child)
        second = first + uint64(stride)
        activity[first] += 3
        activity[first + ONE] += 3
        activity[second] += 3
        activity[second + ONE] += 3


@compiled
def _sign_context(signs: Array, place: int, stride: int) -> int:
    """-4..4, from the signs beside and above; that of the opposite signs is the negative."""
    here = uint64(place)
    beside = signs[here - ONE] + signs[here + ONE]
    above = signs[here - uint64(stride)] + signs[here + uint64(stride)]
    return int(3 * ((beside > 0) - (beside < 0)) + (above > 0) - (above < 0))


@compiled
def _mark(marks: Array, at: int, progress: int) -> None:
    """The next two bytes are needed, when a decoder has read `at` of them."""
    marks[min((at >> 1) + 1, len(marks) - 1)] = progress


@specialised
def _significance(encoding: bool, near: bool, work: Work, band: Band, first: int, last: int, low: int, width: int,
                  at: int) -> Tuple[int, int, int, int]:
    """The near pass over a part of the live list, or the far pass over a part of the quiet ones."""
    values, activity, signs, odds, data = work.values, work.activity, work.signs, work.odds, work.data
    live, quiet, found, counts, marks = work.live, work.quiet, work.found, work.counts[band.number], work.marks
    ahead = AHEAD if encoding else 0
    plane, stride, child, beside, above = band.plane, band.stride, band.child, band.beside, band.above
    context = band.odds + (NEAR_CONTEXT if near else FAR_CONTEXT)
    sign_context = band.odds + SIGN_CONTEXT
    kept, waiting, end = band.start + counts[LIVE], band.start + counts[QUIET], band.start + counts[FOUND]
    guess, gain, one = work.guesses[plane] * GUESS_UNIT, 0.0, 1 << plane
    members = live if near else quiet
    symbol, unknown = 0, unknown_of(data, at)
    for i in range(first, last):
        place = members[i]
        here = uint64(place)
        active = int64(activity[here])
        if near and active == 0:
            quiet[uint64(waiting)] = place
            waiting += 1
            continue
        value = int64(values[here]) if encoding else int64(0)
        at_odds = uint64(context + min(active, ACTIVITIES - 1))
        symbol, odd, low, width = decide(encoding, (value >> (plane + 1)) & 1, int64(odds[at_odds]), low, width,
                                         unknown)
        odds[at_odds] = odd
        if width < LEAST:
            _mark(marks, at + ahead, end - band.start)
            low, width, at, unknown = refill(encoding, data, low, width, at)
        if symbol == 0:
            live[uint64(kept)] = place
            kept += 1
            if unknown:
                continue
        if symbol < 0 or unknown == 0:
            symbol = END
            break
        around = _sign_context(signs, place, stride)
        flip = 1 if around < 0 else 0
        at_odds = sign_context + abs(around)
        sign, odd, low, width = decide(encoding, (value & 1) ^ flip, int64(odds[at_odds]), low, width, unknown)
        odds[at_odds] = odd
        if width < LEAST:
            _mark(marks, at + ahead, end - band.start)
            low, width, at, unknown = refill(encoding, data, low, width, at)
        if sign < 0 or unknown == 0:
            symbol = END
            break
        sign ^= flip
        signs[place] = 1 - 2 * sign
        if encoding:
            magnitude = float(value >> 1)
            rest = magnitude - one - guess
            gain += magnitude * magnitude - rest * rest
        else:
            values[place] = 2 * one + sign
        _spread(activity, place, stride, child, beside, above)
        found[end] = place
        end += 1
    counts[LIVE], counts[QUIET], counts[FOUND] = kept - band.start, waiting - band.start, end - band.start
    work.error[0] -= band.weight * gain
    return symbol, low, width, at


@specialised
def _refine(encoding: bool, work: Work, band: Band, first: int, last: int, low: int, width: int, at: int
            ) -> Tuple[int, int, int, int]:
    """One more bit of a part of the significant coefficients."""
    values, activity, odds, data, found = work.values, work.activity, work.odds, work.data, work.found
    marks, ahead = work.marks, AHEAD if encoding else 0
    plane, stride, child, beside, above = band.plane, band.stride, band.child, band.beside, band.above
    context = band.odds + REFINEMENT_CONTEXT
    before, after = work.guesses[plane + 1] * GUESS_UNIT, work.guesses[plane] * GUESS_UNIT
    gain = 0.0
    symbol, unknown = 0, unknown_of(data, at)
    for i in range(first, last):
        place = found[i]
        value = int64(values[place])
        known = value >> (plane + 2)
        bit = (value >> (plane + 1)) & 1
        if known < 4:
            at_odds = context + 3
            if known == 1:
                at_odds = context + min(int64(activity[place]) >> 3, 2)
                _spread(activity, place, stride, child, beside, above)
            symbol, odd, low, width = decide(encoding, bit, int64(odds[at_odds]), low, width, unknown)
            odds[at_odds] = odd
        else:
            symbol, low, width = decide_at(encoding, bit, width >> 1, low, width, unknown)
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
            values[place] = value | symbol << (plane + 1)
    work.error[0] -= band.weight * gain
    work.counts[band.number, REFINED] = last - band.start
    return symbol, low, width, at


@compiled
def _block_context(alive: UInt8Array, activity: UInt8Array, place: int, along: int, parent: int, stride: int) -> int:
    """From the four blocks beside it, and from its parents."""
    context = (int64(alive[place - 1]) + int64(alive[place + 1]) + int64(alive[place - along])
               + int64(alive[place + along]))
    if parent >= 0 and (activity[parent] | activity[parent + 1] | activity[parent + stride]
                        | activity[parent + stride + 1]):
        context += 5
    return int(context)


@compiled
def _united(cells: Array, first: int, rows: int, columns: int, stride: int) -> int:
    """All bits that are in any cell of a block."""
    bits = int64(0)
    if rows == BLOCK and columns == BLOCK:
        at = uint64(first)
        for _ in range(BLOCK):
            bits |= int64(cells[at] | cells[at + ONE] | cells[at + TWO] | cells[at + THREE])
            at += uint64(stride)
        return int(bits)
    for y in range(rows):
        for i in range(first + y * stride, first + y * stride + columns):
            bits |= int64(cells[i])
    return int(bits)


@specialised
def _blocks(encoding: bool, work: Work, band: Band, along: int, first: int, last: int, low: int, width: int, at: int
            ) -> Tuple[int, int, int, int]:
    """The far pass over a part of the blocks; those that are opened go to the quiet list, to be coded next."""
    values, activity, odds, data = work.values, work.activity, work.odds, work.data
    blocks, alive, quiet, counts = work.blocks, work.alive, work.quiet, work.counts[band.number]
    stride, plane, context = band.stride, band.plane, band.odds + BLOCK_CONTEXT
    kept, waiting = work.firsts[band.number] + counts[BLOCKS], band.start + counts[QUIET]
    symbol, unknown = 0, unknown_of(data, at)
    for block in range(first, last):
        cell, place = int64(blocks[block, CELL]), int64(blocks[block, PLACE])
        rows, columns = int64(blocks[block, SHAPE]) >> 3, int64(blocks[block, SHAPE]) & 7
        if _united(activity, cell, rows, columns, stride) == 0:
            bits = _united(values, cell, rows, columns, stride) if encoding else 0
            at_odds = context + _block_context(alive, activity, place, along, int64(blocks[block, PARENT]), stride)
            symbol, odd, low, width = decide(encoding, 1 if bits >> (plane + 1) else 0, int64(odds[at_odds]), low,
                                             width, unknown)
            odds[at_odds] = odd
            if width < LEAST:
                low, width, at, unknown = refill(encoding, data, low, width, at)
            if symbol < 0 or unknown == 0:
                symbol = END
                break
            if symbol == 0:
                for i in range(4):
                    blocks[kept, i] = blocks[block, i]
                kept += 1
                continue
        alive[place] = 1
        for y in range(rows):
            for x in range(cell + y * stride, cell + y * stride + columns):
                quiet[waiting] = x
                waiting += 1
    counts[BLOCKS], counts[QUIET] = kept - work.firsts[band.number], waiting - band.start
    return symbol, low, width, at


@specialised
def _part(encoding: bool, kind: int, work: Work, band: Band, along: int, first: int, last: int, low: int, width: int,
          at: int) -> Tuple[int, int, int, int]:
    if kind == REFINEMENT:
        return _refine(encoding, work, band, first, last, low, width, at)
    if kind == BLOCKS_PASS:
        return _blocks(encoding, work, band, along, first, last, low, width, at)
    if kind == NEAR:
        return _significance(encoding, True, work, band, first, last, low, width, at)
    return _significance(encoding, False, work, band, first, last, low, width, at)


@compiled
def _encode_part(kind: int, work: Work, band: Band, along: int, first: int, last: int, low: int, width: int, at: int
                 ) -> Tuple[int, int, int, int]:
    return _part(True, kind, work, band, along, first, last, low, width, at)


@compiled
def _decode_part(kind: int, work: Work, band: Band, along: int, first: int, last: int, low: int, width: int, at: int
                 ) -> Tuple[int, int, int, int]:
    return _part(False, kind, work, band, along, first, last, low, width, at)


@compiled
def _band(bands: Array, weights: Array, number: int, plane: int, stride: int) -> Band:
    row = bands[number]
    kind = row[KIND]
    beside, above = 2, 2
    if kind == HL:
        above = 3
    elif kind == LH:
        beside = 3
    return Band(number, plane, stride, row[CHILD] if row[HAS_CHILDREN] else 0, beside, above, number * CONTEXTS,
                row[START], weights[number] * weights[number])


@compiled
def _begin_pass(entry: Array, at: int, band: Band, kind: int) -> None:
    entry[LOG_AT], entry[LOG_BAND], entry[LOG_PLANE], entry[LOG_KIND] = at, band.number, band.plane, kind


@compiled
def _record(work: Work, ends: Array, errors: Array, count: int, at: int) -> int:
    """Note a truncation point, unless the last one is near; how many there are."""
    end = at + AHEAD
    if end >= ends[count - 1] + 16 and count < len(ends) - 1:
        ends[count] = end
        errors[count] = max(work.error[0], 0.0)
        count += 1
    return count


@compiled
def _pass(encoding: bool, work: Work, band: Band, kind: int, along: int, part: int, ends: Array, errors: Array,
          points: int, low: int, width: int, at: int) -> Tuple[int, int, int, int, int]:
    """One pass of a plane of a band, in parts, each with a truncation point at its end."""
    counts = work.counts[band.number]
    symbol, start = 0, band.start
    if kind == BLOCKS_PASS:
        start = work.firsts[band.number]
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
            symbol, low, width, at = _encode_part(kind, work, band, along, first, end, low, width, at)
        else:
            symbol, low, width, at = _decode_part(kind, work, band, along, first, end, low, width, at)
        if symbol < 0:
            break
        if encoding:
            points = _record(work, ends, errors, points, at)
    return symbol, points, low, width, at


def code_planes(encoding: bool, work: Work, bands: Array, weights: Array, steps: Array, stride: int, planes: int,
                part: int, ends: Array, errors: Array, low: int, width: int, at: int
                ) -> Tuple[int, int, int, int, int, int]:
    """All passes of an image, until the stream or the encoder's room ends.

    :returns: the number of truncation points, whether all passes are complete, the length of the log, and the coder's
        state
    """
    return _code_planes(encoding, bands, weights, steps, stride, planes, part, ends, errors, low, width, at, *work)


@compiled
def _code_planes(encoding: bool, bands: Array, weights: Array, steps: Array, stride: int, planes: int, part: int,
                 ends: Array, errors: Array, low: int, width: int, at: int, values: Array, activity: Array,
                 signs: Array, live: Array, quiet: Array, found: Array, blocks: Array, firsts: Array, alive: Array,
                 counts: Array, odds: Array, error: Array, guesses: Array, data: Array, log: Array, marks: Array
                 ) -> Tuple[int, int, int, int, int, int]:
    """As code_planes, with the arrays of Work one by one.

    numba 0.56 caches the types of arguments by a fingerprint, and that of a tuple is wrong where it is longer than 40
    bytes: each call would add an entry to the cache.
    """
    work = Work(values, activity, signs, live, quiet, found, blocks, firsts, alive, counts, odds, error, guesses, data,
                log, marks)
    points, symbol, logged = 1, 0, 0
    for step in range(len(steps)):
        number, plane, kind = steps[step, 0], steps[step, 1], steps[step, 2]
        own = counts[number]
        if plane >= planes or (kind != NEAR and not own[ALIVE]):
            continue
        if not own[ALIVE]:
            symbol, low, width, at = code(encoding, data, odds, number * CONTEXTS + BAND_CONTEXT,
                                          1 if own[TOP] > plane else 0, low, width, at)
            if symbol < 0:
                break
            if symbol == 0:
                continue
            own[ALIVE] = 1
        band = _band(bands, weights, number, plane, stride)
        for turn in range(3 if kind == FAR else 1):     # the blocks between two far passes
            one = BLOCKS_PASS if turn == 1 else kind
            _begin_pass(log[logged], at + (AHEAD if encoding else 0), band, one)
            symbol, points, low, width, at = _pass(encoding, work, band, one, bands[number, ALIVE_STRIDE], part, ends,
                                                   errors, points, low, width, at)
            log[logged, LOG_FOUND] = own[FOUND]
            logged += 1
            if symbol < 0:
                break
        if symbol < 0:
            break
    return points, 0 if symbol < 0 else 1, logged, low, width, at
