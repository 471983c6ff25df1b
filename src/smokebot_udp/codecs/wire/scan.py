# SPDX-License-Identifier: BSD-3-Clause
"""A laser scan in parts, even and odd indexes, as few bytes as carry it exactly (D6.3, section 6.2)."""
import numpy as np

MILLIMETRE = np.float32(0.001)
"""Scanners count in whole millimetres; so written, a range takes 2 bytes and is still exact."""

MINUS_INF, PLUS_INF, NAN = 65533, 65534, 65535
"""REP-117's too close, nothing there, and erroneous, among the millimetres."""

MAX_RANGES = 1 << 18
"""A longer scan is not sent, and refused on arrival."""

FLOAT, SHORT, BYTE, NONE = 4, 2, 1, 0
"""Bytes of a value: float32; millimetres or uint16; uint8; no values."""

GAPS = 'nan', 'thin'
"""What is made of parts that did not come: NaN, or a scan with fewer and wider steps."""


def write_ranges(ranges):
    """(n,) float32 [m] -> (n, 2) or (n, 4) uint8: the shorter where it gives the same floats again."""
    ranges = np.ascontiguousarray(ranges, np.float32)
    with np.errstate(invalid='ignore', over='ignore'):
        counts = np.rint(ranges / MILLIMETRE)
    counts = np.select([np.isnan(ranges), ranges == np.inf, ranges == -np.inf], [NAN, PLUS_INF, MINUS_INF], counts)
    inside = (counts >= 0) & (counts <= NAN)
    counts = np.where(inside, counts, NAN).astype('<u2')
    short = counts.view(np.uint8).reshape(-1, SHORT)
    if inside.all() and read_ranges(short).tobytes() == ranges.tobytes():
        return short
    return ranges.astype('<f4', copy=False).view(np.uint8).reshape(-1, FLOAT)


def read_ranges(data):
    """The inverse of write_ranges: (n, size) uint8 -> (n,) float32."""
    if data.shape[1] == FLOAT:
        return np.ascontiguousarray(data).view('<f4').reshape(-1)
    counts = np.ascontiguousarray(data).view('<u2').reshape(-1)
    ranges = in_millimetres(counts)
    for count, value in ((MINUS_INF, -np.inf), (PLUS_INF, np.inf), (NAN, np.nan)):
        ranges[counts == count] = value
    return ranges


def in_millimetres(counts):
    """(n,) float32 [m] of whole millimetres: the ranges that need but 2 bytes."""
    # as drivers do it: the nearest float32 of the decimal number
    return (counts.astype(np.float64) / 1000).astype(np.float32)


def write_intensities(intensities):
    """(n,) float32 -> (n, size) uint8: whole numbers in 1 or 2 bytes."""
    intensities = np.ascontiguousarray(intensities, np.float32)
    for dtype in ('<u1', '<u2'):
        with np.errstate(invalid='ignore', over='ignore'):
            whole = np.clip(np.nan_to_num(intensities), 0, np.iinfo(dtype).max).astype(dtype)
        if whole.astype(np.float32).tobytes() == intensities.tobytes():
            return whole.view(np.uint8).reshape(-1, whole.itemsize)
    return intensities.astype('<f4', copy=False).view(np.uint8).reshape(-1, FLOAT)


def read_intensities(data):
    """The inverse of write_intensities: (n, size) uint8 -> (n,) float32."""
    dtype = {BYTE: '<u1', SHORT: '<u2', FLOAT: '<f4'}[data.shape[1]]
    return np.ascontiguousarray(data).view(dtype).reshape(-1).astype(np.float32)


def fit(total, size, room):
    """How many parts a scan needs: 2, or 4, 8, ... where half of it does not fit.

    :param size: bytes of a range with its intensity; room: bytes of them in a datagram
    """
    if total > MAX_RANGES:
        raise ValueError('%d ranges are more than %d' % (total, MAX_RANGES))
    if room < size:
        raise ValueError('a range of %d bytes does not fit in %d' % (size, room))
    parts = min(2, total)
    while -(-total // parts) * size > room:
        parts = min(2 * parts, total)
    return parts


class ScanParts:
    """What has come of one scan. A part may be one value shorter than part 0.

    :raises ValueError: where the numbers contradict each other or a limit
    """

    def __init__(self, total, parts, range_size, intensity_size):
        if not 1 <= parts <= total <= MAX_RANGES:
            raise ValueError('%d ranges in %d parts; there are from 1 to %d' % (total, parts, MAX_RANGES))
        if range_size not in (SHORT, FLOAT) or intensity_size not in (NONE, BYTE, SHORT, FLOAT):
            raise ValueError('no range has %d bytes, no intensity %d' % (range_size, intensity_size))
        self.have = np.zeros(parts, bool)
        """(parts,) bool: those received."""
        self._ranges = np.zeros((total, range_size), np.uint8)
        self._intensities = np.zeros((total, intensity_size), np.uint8)

    @property
    def ending(self):
        """Whether the last part has come: nothing of the scan can follow but what was overtaken."""
        return bool(self.have[-1])

    @property
    def complete(self):
        return bool(self.have.all())

    @property
    def completeness(self):
        """The share of its parts that were received, 0..1."""
        return float(np.count_nonzero(self.have)) / len(self.have)

    def add(self, parts, ranges, intensities):
        """Take parts.

        :param parts: (m,) int
        :param ranges: (m, k) uint8; intensities: (m, l) uint8
        :return: (m,) bool: those that fit the scan; the others were dropped
        """
        good = np.zeros(len(parts), bool)
        for i, part in enumerate(parts):
            if part < len(self.have):
                mine, brightness = self._ranges[part::len(self.have)], self._intensities[part::len(self.have)]
                if ranges.shape[1] == mine.size and intensities.shape[1] == brightness.size:
                    mine[:] = ranges[i].reshape(mine.shape)
                    brightness[:] = intensities[i].reshape(brightness.shape)
                    self.have[part] = good[i] = True
        return good

    def merge(self, gaps):
        """The scan of what has come.

        :param gaps: one of GAPS
        :return: (n,) float32 ranges, (n,) float32 intensities or None, and which indexes of the whole scan they are:
            (first, step)
        """
        ranges = read_ranges(self._ranges)
        intensities = read_intensities(self._intensities) if self._intensities.shape[1] else None
        first, step = 0, 1
        if gaps == 'thin':
            first, step = densest_comb(self.have)
        else:
            missing = np.resize(~self.have, len(ranges))
            ranges[missing] = np.nan
            if intensities is not None:
                intensities[missing] = np.nan
        comb = slice(first, None, step)
        return ranges[comb], None if intensities is None else intensities[comb], (first, step)


def densest_comb(have):
    """(first, step): of the regular combs of parts that all came, one of those with the most teeth.

    :param have: (n,) bool, any of them true
    """
    for step in (step for step in range(1, len(have) + 1) if len(have) % step == 0):
        for first in range(step):
            if have[first::step].all():
                return first, step
    raise ValueError('no part came')
