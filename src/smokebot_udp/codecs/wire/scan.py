# SPDX-License-Identifier: BSD-3-Clause
"""A laser scan in parts, even and odd indexes, in the fewest bytes that keep its values (D6.3, section 6.2)."""
from typing import Optional, Tuple

import numpy as np

from ...arrays import Array, BoolArray, Float32Array, IntArray, UInt8Array
from .parts import ReceivedParts

MILLIMETRE = np.float32(0.001)
"""Most scanners measure in whole millimetres. Such a range takes 2 bytes and stays exact."""

MINUS_INF, PLUS_INF, NAN = 65533, 65534, 65535
"""Codes among the millimetres for REP-117's too close, nothing in range, and erroneous."""

MAX_RANGES = 1 << 18
"""Longer scans are not sent, and refused on arrival."""

FLOAT, SHORT, BYTE, NONE = 4, 2, 1, 0
"""Size of a value: float32; millimetres or uint16; uint8; no values [byte]."""

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
    :param range_size: SHORT or FLOAT
    :param intensity_size: NONE, BYTE, SHORT or FLOAT
    :raises ValueError: the numbers contradict each other or exceed a limit
    """

    def __init__(self, total: int, parts: int, range_size: int, intensity_size: int) -> None:
        if not 1 <= parts <= max(1, total) <= MAX_RANGES:
            raise ValueError('%d ranges in %d parts; there are up to %d' % (total, parts, MAX_RANGES))
        if range_size not in (SHORT, FLOAT) or intensity_size not in (NONE, BYTE, SHORT, FLOAT):
            raise ValueError('no range has %d bytes, no intensity %d' % (range_size, intensity_size))
        super().__init__(parts)
        self._ranges = np.zeros((total, range_size), np.uint8)
        self._intensities = np.zeros((total, intensity_size), np.uint8)

    def add(self, parts: IntArray, ranges: UInt8Array, intensities: UInt8Array) -> BoolArray:
        """Add parts of the same length.

        :param parts: (m,) int, their numbers
        :param ranges: (m, k) uint8
        :param intensities: (m, l) uint8
        :return: (m,) bool: those that fit the scan; the others were dropped
        """
        good = np.zeros(len(parts), bool)
        for i, part in enumerate(parts):
            if part < len(self.have):
                part_ranges = self._ranges[part::len(self.have)]
                part_intensities = self._intensities[part::len(self.have)]
                if ranges.shape[1] == part_ranges.size and intensities.shape[1] == part_intensities.size:
                    part_ranges[:] = ranges[i].reshape(part_ranges.shape)
                    part_intensities[:] = intensities[i].reshape(part_intensities.shape)
                    self.have[part] = good[i] = True
        return good

    def merge(self, gaps: str) -> Tuple[Float32Array, Optional[Float32Array], Tuple[int, int]]:
        """The scan, as far as it was received.

        :param gaps: one of GAPS
        :return: (n,) float32 ranges [m], (n,) float32 intensities or None, and (first, step), their indexes in the
            whole scan
        :raises ValueError: gaps is 'thin', and no part was received
        """
        ranges = read_ranges(self._ranges)
        intensities = read_intensities(self._intensities) if self._intensities.shape[1] else None
        first, step = 0, 1
        if gaps == 'thin':
            first, step = densest_comb(self.have)
        else:
            missing: BoolArray = np.resize(~self.have, len(ranges))
            ranges[missing] = np.nan
            if intensities is not None:
                intensities[missing] = np.nan
        comb = slice(first, None, step)
        return ranges[comb], None if intensities is None else intensities[comb], (first, step)


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
