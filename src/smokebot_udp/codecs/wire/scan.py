# SPDX-License-Identifier: BSD-3-Clause
"""A laser scan in parts, even and odd indexes (D6.3, section 6.2): exactly, or in steps of the sensor's resolution.

Exact values take 1, 2 or 4 bytes each. Steps are coded by what they differ from their neighbours (coded_counts.py),
each part for itself: in 6 to 8 bits a range of 1 mm. A scanner that measures in whole steps stays exact, too.
"""
import math
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import Array, BoolArray, Float32Array, IntArray, UInt8Array
from . import coded_counts
from .coded_counts import MAX_COUNT, VALUE
from .parts import ReceivedParts

FIXED = ('angle_min', 'angle_max', 'angle_increment', 'time_increment', 'scan_time', 'range_min', 'range_max')
"""The fields of a LaserScan that every segment repeats."""


MILLIMETRE = np.float32(0.001)
"""Most scanners measure in whole millimetres. Such a range takes 2 bytes and stays exact."""

MINUS_INF, PLUS_INF, NAN = 65533, 65534, 65535
"""Codes among the millimetres for REP-117's too close, nothing in range, and erroneous."""

MAX_RANGES = 1 << 18
"""Longer scans are not sent, and refused on arrival."""

FLOAT, SHORT, BYTE, NONE = 4, 2, 1, 0
"""Size of a value: float32; millimetres or uint16; uint8; no values [byte]."""

CODED = 255
"""In place of a size: the values of a part are a coded row."""

MARKED = {1: np.inf, 2: -np.inf, 3: np.nan}
"""{mark in a coded row: the range}"""

MICROMETRES = 1e6
"""Steps are whole micrometres [1/m]."""

MAX_STEP = 10 ** 6
"""[um]"""

GAPS = 'nan', 'thin'
"""What replaces missing parts: NaN, or nothing: a scan with fewer ranges and a wider step."""


def _meaning(values: Float32Array) -> Float32Array:
    """(n,) float32: the same values, of NaNs and zeros one each: their signs mean nothing, but would cost bytes."""
    with np.errstate(invalid='ignore'):     # signalling NaNs
        meaning: Float32Array = np.where(np.isnan(values), np.float32('nan'), values + np.float32(0))
    return meaning


def write_ranges(ranges: Float32Array) -> UInt8Array:
    """Encode ranges: in 2 bytes each if that decodes to the same floats, else in 4.

    :param ranges: (n,) float32 [m]
    :return: (n, 2) or (n, 4) uint8
    """
    ranges = _meaning(ranges)
    with np.errstate(invalid='ignore', over='ignore'):
        counts = np.rint(ranges / MILLIMETRE)
    counts = np.select([np.isnan(ranges), ranges == np.inf, ranges == -np.inf], [NAN, PLUS_INF, MINUS_INF], counts)
    inside = (counts >= 0) & (counts <= NAN)
    short = np.where(inside, counts, NAN).astype('<u2').view(np.uint8).reshape(-1, SHORT)
    if inside.all() and read_ranges(short).tobytes() == ranges.tobytes():
        return short
    return ranges.astype('<f4', copy=False).view(np.uint8).reshape(-1, FLOAT)


def read_ranges(data: UInt8Array) -> Float32Array:
    """The inverse of write_ranges: (n, size) uint8 -> (n,) float32 [m]."""
    if data.shape[1] == FLOAT:
        return np.ascontiguousarray(data).view('<f4').reshape(-1)
    counts = np.ascontiguousarray(data).view('<u2').reshape(-1)
    ranges = in_millimetres(counts)
    for count, value in ((MINUS_INF, -np.inf), (PLUS_INF, np.inf), (NAN, np.nan)):
        ranges[counts == count] = value
    return ranges


def in_millimetres(counts: Array) -> Float32Array:
    """Ranges that take only 2 bytes on the wire: (n,) whole millimetres -> (n,) float32 [m]."""
    # as drivers do it: the nearest float32 of the decimal number
    return (counts.astype(np.float64) / 1000).astype(np.float32)


def write_intensities(intensities: Float32Array) -> UInt8Array:
    """(n,) float32 -> (n, size) uint8: in 1 or 2 bytes each if all are such whole numbers, else in 4."""
    intensities = _meaning(intensities)
    for dtype in ('<u1', '<u2'):
        with np.errstate(invalid='ignore', over='ignore'):
            whole = np.clip(np.nan_to_num(intensities), 0, np.iinfo(dtype).max).astype(dtype)
        if whole.astype(np.float32).tobytes() == intensities.tobytes():
            return whole.view(np.uint8).reshape(-1, whole.itemsize)
    return intensities.astype('<f4', copy=False).view(np.uint8).reshape(-1, FLOAT)


def read_intensities(data: UInt8Array) -> Float32Array:
    """The inverse of write_intensities: (n, size) uint8 -> (n,) float32."""
    dtype = {BYTE: '<u1', SHORT: '<u2', FLOAT: '<f4'}[data.shape[1]]
    return np.ascontiguousarray(data).view(dtype).reshape(-1).astype(np.float32)


def quantise(ranges: Float32Array, step: int, limits: Tuple[float, float]) -> Optional[Tuple[IntArray, IntArray]]:
    """Ranges as steps: (n,) int counts and (n,) int marks, as of coded_counts.

    The error is half a step and float32's rounding. A range that would cross a limit of the sensor by that, and so
    become a measurement or none, is rounded to the other side: its error is below a step.

    :param ranges: (n,) float32 [m]
    :param step: 1..MAX_STEP [um]
    :param limits: range_min and range_max [m]
    :return: None: they cannot be told apart from each other or from the limits in such steps, or are too large
    """
    finite = np.isfinite(ranges)
    marks = np.select([finite, ranges == np.inf, ranges == -np.inf], [VALUE, 1, 2], 3)
    counts = np.rint(np.where(finite, ranges, 0).astype(np.float64) * MICROMETRES / step)
    if not (abs(counts) < MAX_COUNT - 1).all():
        return None
    low, high = (np.float32(limit) for limit in limits)

    def place(values: Float32Array) -> IntArray:
        """-1, 0, 1: below, within and above the limits."""
        with np.errstate(invalid='ignore'):     # NaNs
            places: IntArray = (values > high).astype(int) - (values < low)
        return places
    counts = counts.astype(int)
    wanted = place(ranges)
    counts += np.where(finite, wanted - place(in_steps(counts, step)), 0)
    kept = (place(in_steps(counts, step)) == wanted)[finite].all()
    return (counts, marks) if kept else None


def in_steps(counts: IntArray, step: int) -> Float32Array:
    """(n,) counts of steps -> (n,) float32 ranges [m]: the float32 of the decimal number, the same on every machine.

    :param step: [um]
    """
    # the product is exact, and IEEE 754 has one result of the division, and one of the conversion
    ranges: Float32Array = (counts.astype(np.float64) * step / MICROMETRES).astype(np.float32)
    return ranges


class WrittenScan(NamedTuple):
    """A scan in parts."""
    range_size: int
    intensity_size: int
    step: int
    """Step of coded ranges; 0: the ranges are not coded [um]."""
    parts: List[Tuple[bytes, bytes]]
    """Ranges and intensities of each part."""


def write_scan(ranges: Float32Array, intensities: Optional[Float32Array], room: int, step: int,
               limits: Tuple[float, float]) -> WrittenScan:
    """A scan in as few parts as fit: 2, or 4, 8, ... of them, of values that are spread evenly.

    :param ranges: (n,) float32 [m]
    :param intensities: (n,) float32; None: none are sent
    :param room: of a part in a datagram [byte]
    :param step: 1..MAX_STEP; 0: values stay exact [um]. They do, too, where steps would not be shorter
    :param limits: range_min and range_max [m]
    :raises ValueError: there are more than MAX_RANGES, or not even one fits
    """
    if len(ranges) > MAX_RANGES:
        raise ValueError('%d ranges are more than %d' % (len(ranges), MAX_RANGES))
    exact = write_ranges(ranges), np.zeros((len(ranges), 0), np.uint8)
    if intensities is not None:
        exact = exact[0], write_intensities(intensities)
    coded = _coded(ranges, exact[1], room, step, limits) if step and len(ranges) else None
    if coded is not None and sum(map(len, sum(coded.parts, ()))) < exact[0].size + exact[1].size:
        return coded
    sizes = exact[0].shape[1], exact[1].shape[1]
    count = fit(len(ranges), sum(sizes), room)
    return WrittenScan(*sizes, 0, [(exact[0][part::count].tobytes(), exact[1][part::count].tobytes())
                                   for part in range(count)])


def _coded(ranges: Float32Array, intensities: UInt8Array, room: int, step: int,
           limits: Tuple[float, float]) -> Optional[WrittenScan]:
    """A scan in coded parts; None: it cannot be coded, or does not fit.

    :param intensities: (n, size) uint8, from write_intensities
    """
    quantised = quantise(ranges, step, limits)
    if quantised is None:
        return None
    counts, marks = quantised
    size = intensities.shape[1]
    # others are no whole numbers
    whole = read_intensities(intensities).astype(int) if size in (BYTE, SHORT) else None
    values = np.zeros(len(ranges), int)

    def part(some: slice) -> Tuple[bytes, bytes]:
        return (coded_counts.encode(counts[some], marks[some]),
                intensities[some].tobytes() if whole is None else coded_counts.encode(whole[some], values[some]))
    parts = min(2, len(ranges))
    while True:
        written = [part(slice(number, None, parts)) for number in range(parts)]
        filled = max(map(len, map(b''.join, written))) / room
        if filled <= 1:
            return WrittenScan(CODED, size if whole is None else CODED, step, written)
        if parts == len(ranges):
            return None
        parts = min(parts << max(1, int(math.log2(filled))), len(ranges))


def fit(total: int, size: int, room: int) -> int:
    """The number of parts of a scan: 2, or 4, 8, ... if half of it does not fit in a datagram.

    :param total: number of ranges
    :param size: size of a range with its intensity [byte]
    :param room: size of these in a datagram, at most [byte]
    :raises ValueError: there are more than MAX_RANGES, or not even one fits
    """
    if total > MAX_RANGES:
        raise ValueError('%d ranges are more than %d' % (total, MAX_RANGES))
    if room < size:
        raise ValueError('a range of %d bytes does not fit in %d' % (size, room))
    parts = max(1, min(2, total))
    while -(-total // parts) * size > room:
        parts = min(2 * parts, total)
    return parts


class ScanParts(ReceivedParts):
    """The parts of one scan, as far as they were received. A part may be one value shorter than part 0.

    :param total: number of ranges of the whole scan
    :param parts: number of parts
    :param range_size: SHORT, FLOAT or CODED
    :param intensity_size: NONE, BYTE, SHORT, FLOAT or CODED
    :param step: of coded ranges, else 0 [um]
    :raises ValueError: the numbers contradict each other or exceed a limit
    """

    def __init__(self, total: int, parts: int, range_size: int, intensity_size: int, step: int = 0) -> None:
        if not 1 <= parts <= max(1, total) <= MAX_RANGES:
            raise ValueError('%d ranges in %d parts; there are up to %d' % (total, parts, MAX_RANGES))
        if range_size not in (SHORT, FLOAT, CODED) or intensity_size not in (NONE, BYTE, SHORT, FLOAT, CODED):
            raise ValueError('no range has %d bytes, no intensity %d' % (range_size, intensity_size))
        if not (1 <= step <= MAX_STEP if range_size == CODED else step == 0):
            raise ValueError('a step of %d um of ranges of size %d' % (step, range_size))
        super().__init__(parts)
        self.broken = 0
        """How many parts `merge` has found to be broken. They do not count as received any more."""
        self._total, self._sizes, self._step = total, (range_size, intensity_size), step
        self._parts: Dict[int, Tuple[UInt8Array, UInt8Array]] = {}

    def add(self, parts: IntArray, ranges: UInt8Array, intensities: UInt8Array) -> BoolArray:
        """Add parts of the same length.

        :param parts: (m,) int, their numbers
        :param ranges: (m, k) uint8
        :param intensities: (m, l) uint8
        :return: (m,) bool: those that fit the scan; the others were dropped
        """
        good = np.zeros(len(parts), bool)
        for i, part in enumerate(parts.tolist()):
            if part < len(self.have) and all(size == CODED or len(values) == size * self._count(part)
                                             for size, values in zip(self._sizes, (ranges[i], intensities[i]))):
                # not views, which would keep the whole batch
                self._parts[part] = ranges[i].copy(), intensities[i].copy()
                self.have[part] = good[i] = True
        return good

    def _count(self, part: int) -> int:
        """Number of ranges of a part."""
        return len(range(part, self._total, len(self.have)))

    def merge(self, gaps: str) -> Tuple[Float32Array, Optional[Float32Array], Tuple[int, int]]:
        """The scan, as far as it was received.

        :param gaps: one of GAPS
        :return: (n,) float32 ranges [m], (n,) float32 intensities or None, and (first, step), their indexes in the
            whole scan
        :raises ValueError: all parts are broken; or gaps is 'thin', and no part was received
        """
        ranges = np.full(self._total, np.nan, np.float32)
        intensities = np.full(self._total, np.nan, np.float32) if self._sizes[1] else None
        for part, (its_ranges, its_intensities) in self._parts.items():
            comb = slice(part, None, len(self.have))
            try:
                ranges[comb], values = self._read(part, its_ranges, its_intensities)
            except ValueError:
                self.have[part] = False
                self.broken += 1
                continue
            if intensities is not None:
                intensities[comb] = values
        if self.broken and not self.have.any():
            raise ValueError('no part can be read')
        first, step = densest_comb(self.have) if gaps == 'thin' else (0, 1)
        comb = slice(first, None, step)
        return ranges[comb], None if intensities is None else intensities[comb], (first, step)

    def _read(self, part: int, ranges: UInt8Array, intensities: UInt8Array) -> Tuple[Float32Array, Any]:
        """The ranges and intensities of a part; of those nothing where there are none.

        :raises ValueError: it is broken
        """
        count, (range_size, intensity_size) = self._count(part), self._sizes
        values = (read_coded(ranges, count, self._step) if range_size == CODED else
                  read_ranges(ranges.reshape(count, range_size)))
        if intensity_size == CODED:
            return values, coded_counts.decode(intensities, count)[0].astype(np.float32)
        return values, read_intensities(intensities.reshape(count, intensity_size)) if intensity_size else None


def read_coded(data: UInt8Array, count: int, step: int) -> Float32Array:
    """The ranges of a coded part: (count,) float32 [m].

    :param data: (k,) uint8
    :param step: [um]
    :raises ValueError: the part is broken
    """
    counts, marks = coded_counts.decode(data, count)
    ranges = in_steps(counts, step)
    for mark, value in MARKED.items():
        ranges[marks == mark] = value
    return ranges


def densest_comb(have: BoolArray) -> Tuple[int, int]:
    """The smallest step at which every part was received: (first, step).

    :param have: (n,) bool
    :raises ValueError: no part was received
    """
    for step in (step for step in range(1, len(have) + 1) if len(have) % step == 0):
        for first in range(step):
            if have[first::step].all():
                return first, step
    raise ValueError('no part was received')
