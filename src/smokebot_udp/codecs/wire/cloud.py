# SPDX-License-Identifier: BSD-3-Clause
"""A point cloud in chunks that each thin it evenly, and its points as few bytes (D6.3, section 6.1).

Points are dealt like cards: of n chunks, chunk i takes the points i, i + n, i + 2n, ... Clouds come in an order
in which neighbours follow each other (a scanner's, or the voxel filter's), so no chunk holds a place alone.
"""
import functools
from dataclasses import dataclass

import numpy as np

MAX_POINTS = 1 << 21
"""A cloud of more points is refused on arrival: it would take some 50 MB."""

MAX_BITS = 20
"""Of an axis' offsets; clouds that span more at the bound asked for are sent as float32."""

MAX_CHUNKS = 0xffff
WORD = 64
"""A point's offsets and intensity together have no more bits."""

INTENSITY_BITS = 8
ENDING = 4
"""So many chunks at a cloud's end tell that it is ending: with one alone, its loss would hide it."""


@dataclass(frozen=True)
class PointFormat:
    """How a cloud's points are written."""
    has_intensity: bool
    step: float = 0.0             # of the offsets [m]; 0: float32 coordinates
    origin: tuple = (0, 0, 0)     # in steps
    bits: tuple = (0, 0, 0)       # of each axis' offsets
    intensity_min: float = 0.0
    intensity_step: float = 0.0

    def __post_init__(self):
        if not np.isfinite(self.step) or self.step < 0:
            raise ValueError('step is %r, must be 0 or above' % self.step)
        if any(bits > MAX_BITS for bits in self.bits) or self._width > WORD:
            raise ValueError('bits are %r, must be from 0 to %d; with any intensity up to %d in all' % (
                self.bits, MAX_BITS, WORD))

    @property
    def _width(self):
        """Bits of a point's offsets and intensity."""
        return sum(self.bits) + INTENSITY_BITS * self.has_intensity

    @property
    def size(self):
        """Bytes of a point."""
        if not self.step:
            return 16 if self.has_intensity else 12
        return max(1, -(-self._width // 8))

    def write(self, points, intensity=None):
        """(n, size) uint8 of (n, 3) float32 points and, where it has them, (n,) float32 intensities.

        As an offset, an intensity that is NaN is the least.
        """
        if not self.step:
            values = points if not self.has_intensity else np.column_stack([points, intensity])
            return np.ascontiguousarray(values, '<f4').view(np.uint8).reshape(len(points), self.size)
        whole, shift = np.zeros(len(points), np.uint64), 0
        offsets = np.rint(points.astype(np.float64) / self.step).astype(np.int64) - np.array(self.origin)
        for axis in range(3):
            whole |= offsets[:, axis].astype(np.uint64) << np.uint64(shift)
            shift += self.bits[axis]
        if self.has_intensity:
            levels = np.rint((intensity.astype(np.float64) - self.intensity_min) / (self.intensity_step or 1.0))
            whole |= np.fmin(np.fmax(levels, 0), 255).astype(np.uint64) << np.uint64(shift)
        return whole.astype('<u8').view(np.uint8).reshape(len(points), 8)[:, :self.size]

    def read(self, data):
        """The inverse of write: (n, 3) float32 points, and (n,) float32 intensities or None."""
        if not self.step:
            values = np.ascontiguousarray(data).view('<f4')
            return values[:, :3], values[:, 3] if self.has_intensity else None
        padded = np.zeros((len(data), 8), np.uint8)
        padded[:, :self.size] = data
        whole = padded.view('<u8').reshape(-1)
        points, shift = np.empty((len(data), 3), np.float32), 0
        with np.errstate(over='ignore', invalid='ignore'):     # a forger's steps
            for axis in range(3):
                offsets = (whole >> np.uint64(shift)) & np.uint64((1 << self.bits[axis]) - 1)
                points[:, axis] = (offsets.astype(np.int64) + self.origin[axis]) * self.step
                shift += self.bits[axis]
            if not self.has_intensity:
                return points, None
            levels = (whole >> np.uint64(shift)) & np.uint64(255)
            return points, (levels * self.intensity_step + self.intensity_min).astype(np.float32)


def plain(has_intensity):
    """float32 coordinates: exact."""
    return PointFormat(has_intensity)


def packed(points, bound, intensity=None):
    """Offsets on a grid so fine that no coordinate is off by more than `bound`, in as few bytes as they need.

    Where the cloud spans too much for that, its coordinates are float32.

    :param points: (n, 3) float32 [m], n >= 1
    :param bound: [m], > 0; float32's own rounding comes on top
    :param intensity: (n,) float32 or None; written in 8 bits from its least to its greatest finite value
    """
    step = float(np.float32(2 * bound))
    if not step:
        return plain(intensity is not None)
    ends = np.rint(np.stack([points.min(axis=0), points.max(axis=0)]).astype(np.float64) / step)
    bits = tuple(int(side).bit_length() for side in ends[1] - ends[0])
    too_long = sum(bits) + INTENSITY_BITS * (intensity is not None) > WORD
    if max(bits) > MAX_BITS or too_long or np.abs(ends).max() >= 2 ** 31:
        return plain(intensity is not None)
    origin = tuple(int(end) for end in ends[0])
    if intensity is None:
        return PointFormat(False, step, origin, bits)
    finite = intensity[np.isfinite(intensity)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    return PointFormat(True, step, origin, bits, float(np.float32(low)), float(np.float32((high - low) / 255)))


def deal(points, chunks):
    """Deal points to chunks.

    :param points: (n, ...) array; at least `chunks` of them, or none in one chunk
    :return: (chunks, ceil(n / chunks), ...) array; where a chunk would have one less, it repeats the last point
    :raises ValueError: where there are more than a receiver takes
    """
    if len(points) > MAX_POINTS or chunks > MAX_CHUNKS:
        raise ValueError('%d points in %d chunks; there are up to %d in %d' % (
            len(points), chunks, MAX_POINTS, MAX_CHUNKS))
    size = -(-len(points) // chunks)
    missing = size * chunks - len(points)
    if missing:
        points = np.concatenate([points, np.repeat(points[-1:], missing, axis=0)])
    return np.swapaxes(points.reshape((size, chunks) + points.shape[1:]), 0, 1)


@functools.lru_cache(maxsize=64)
def sending_order(chunks):
    """(chunks,) int: which chunk is sent when, so that chunks sent together hold no neighbours.

    Van der Corput's order: the first k are spread evenly, for any k. Read-only.
    """
    bits = max(1, (chunks - 1).bit_length())
    numbers = np.arange(1 << bits)
    mirrored = sum((numbers >> bit & 1) << (bits - 1 - bit) for bit in range(bits))
    order = mirrored[mirrored < chunks]
    order.setflags(write=False)
    return order


class CloudParts:
    """What has come of one cloud.

    :param point_format: PointFormat
    :raises ValueError: where the numbers contradict each other or a limit
    """

    def __init__(self, points, chunks, point_format):
        if not (1 <= chunks <= max(1, points) and points <= MAX_POINTS):
            raise ValueError('%d points in %d chunks; there are up to %d' % (points, chunks, MAX_POINTS))
        self.points, self.format = points, point_format
        self.have = np.zeros(chunks, bool)
        """(chunks,) bool: those received."""
        self.ending = False
        """Whether one of the last chunks has come: not much can follow."""
        self._last = sending_order(chunks)[-ENDING:]
        self._dealt = np.zeros((chunks, -(-points // chunks) * point_format.size), np.uint8)

    @property
    def complete(self):
        return bool(self.have.all())

    @property
    def completeness(self):
        """The share of its chunks that were received, 0..1."""
        return float(np.count_nonzero(self.have)) / len(self.have)

    def add(self, indexes, payloads):
        """Take chunks.

        :param indexes: (m,) int
        :param payloads: (m, k) uint8
        :return: (m,) bool: those that fit the cloud; the others were dropped
        """
        good = indexes < len(self.have)
        if payloads.shape[1] != self._dealt.shape[1]:
            good[:] = False
        if good.any():
            self._dealt[indexes[good]] = payloads[good]
            self.have[indexes[good]] = True
            self.ending = self.ending or bool(self.have[self._last].any())
        return good

    def merge(self):
        """What has come, in the cloud's order: (n, 3) float32 points, (n,) float32 intensities or None.

        Points that are not finite are left out: only a forger sends them.
        """
        chunks = np.flatnonzero(self.have)
        dealt = self._dealt[chunks].reshape(len(chunks), self._dealt.shape[1] // self.format.size, self.format.size)
        in_cloud = chunks + np.arange(dealt.shape[1])[:, np.newaxis] * len(self.have) < self.points
        points, intensity = self.format.read(np.swapaxes(dealt, 0, 1)[in_cloud])
        finite = np.isfinite(points).all(axis=1)
        if not finite.all():
            points, intensity = points[finite], None if intensity is None else intensity[finite]
        return points, intensity
