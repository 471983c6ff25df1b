# SPDX-License-Identifier: BSD-3-Clause
"""A point cloud in chunks that each cover all of it, and its points in few bytes (D6.3, section 6.1).

Points are dealt round-robin: of n chunks, chunk i has the points i, i + n, i + 2n, ... Neighbouring points follow each
other in a cloud, in a scanner's order as in the voxel filter's, so they are in different chunks.
"""
import functools
from dataclasses import dataclass
from typing import NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import Array, BoolArray, Float32Array, IntArray, UInt8Array
from .parts import ReceivedParts
from .points import bounding_box

MAX_POINTS = 1 << 21
"""Clouds of more points are refused on arrival: they would take some 50 MB."""

MAX_BYTES = 32 * MAX_POINTS
"""Clouds whose points take more together are refused: points with further fields are larger."""

MAX_BITS = 20
"""Maximum size of an axis' offsets. Clouds that need more at the requested bound are sent as float32 [bit]."""

MAX_CHUNKS = 0xffff
WORD = 64
"""Maximum size of a point's offsets and intensity together [bit]."""

INTENSITY_BITS = 8


@dataclass(frozen=True)
class PointFormat:
    """The encoding of a cloud's points: float32 coordinates, or offsets in steps from an origin.

    :raises ValueError: step or bits are out of limits
    """
    has_intensity: bool
    step: float = 0.0
    """Step of the offsets [m]; 0: the coordinates are float32."""
    origin: Tuple[int, int, int] = (0, 0, 0)
    """Origin of the offsets [step]; of float32 coordinates [m]."""
    bits: Tuple[int, int, int] = (0, 0, 0)
    """Size of each axis' offsets [bit]."""
    intensity_min: float = 0.0
    intensity_step: float = 0.0
    is_double: bool = False
    """Whether points are float64. Without offsets they are written as float32, relative to the origin."""

    def __post_init__(self) -> None:
        if not np.isfinite(self.step) or self.step < 0:
            raise ValueError('step is %r, must be 0 or above' % self.step)
        if any(bits > MAX_BITS for bits in self.bits) or self._width > WORD:
            raise ValueError('bits are %r, must be from 0 to %d; with any intensity up to %d in all' % (
                self.bits, MAX_BITS, WORD))

    @property
    def _width(self) -> int:
        """Size of a point's offsets and intensity [bit]."""
        return sum(self.bits) + INTENSITY_BITS * self.has_intensity

    @property
    def size(self) -> int:
        """Size of a point [byte]."""
        if not self.step:
            return 16 if self.has_intensity else 12
        return max(1, -(-self._width // 8))

    def write(self, points: Array, intensity: Optional[Float32Array] = None) -> UInt8Array:
        """Encode points.

        :param points: (n, 3) float32, or float64 with is_double [m]
        :param intensity: (n,) float32, ignored without has_intensity; in 8 bits, NaN becomes the minimum
        :return: (n, size) uint8
        """
        if not self.has_intensity:
            intensity = None
        if not self.step:
            points = points - np.array(self.origin) if self.is_double else points
            values = points if intensity is None else np.column_stack([points, intensity])
            return np.ascontiguousarray(values, '<f4').view(np.uint8).reshape(len(points), self.size)
        words, shift = np.zeros(len(points), np.uint64), 0
        offsets = self.offsets(points)
        for axis in range(3):
            words |= offsets[:, axis].astype(np.uint64) << np.uint64(shift)
            shift += self.bits[axis]
        if intensity is not None:
            words |= self.levels(intensity).astype(np.uint64) << np.uint64(shift)
        return words.astype('<u8').view(np.uint8).reshape(len(points), 8)[:, :self.size]

    def read(self, data: UInt8Array) -> Tuple[Array, Optional[Float32Array]]:
        """The inverse of write.

        :param data: (n, size) uint8
        :return: (n, 3) points [m], and (n,) float32 intensities or None
        """
        if not self.step:
            values = np.ascontiguousarray(data).view('<f4')
            points = values[:, :3] + np.array(self.origin, np.float64) if self.is_double else values[:, :3]
            return points, values[:, 3] if self.has_intensity else None
        padded = np.zeros((len(data), 8), np.uint8)
        padded[:, :self.size] = data
        words = padded.view('<u8').reshape(-1)
        offsets, shift = np.empty((len(data), 3), int), 0
        for axis in range(3):
            offsets[:, axis] = (words >> np.uint64(shift)) & np.uint64((1 << self.bits[axis]) - 1)
            shift += self.bits[axis]
        points = self.points(offsets)
        return points, self.intensities((words >> np.uint64(shift)) & np.uint64(255)) if self.has_intensity else None

    def offsets(self, points: Array) -> IntArray:
        """(n, 3) int: the offsets of (n, 3) points [m]."""
        steps: IntArray = np.rint(points.astype(np.float64) / self.step).astype(np.int64) - np.array(self.origin)
        return steps

    def points(self, offsets: IntArray) -> Array:
        """(n, 3) float32, or float64 with is_double: the points of (n, 3) int offsets [m]."""
        with np.errstate(over='ignore', invalid='ignore'):     # a forged step
            points: Array = ((offsets + np.array(self.origin)) * self.step).astype(
                np.float64 if self.is_double else np.float32)
        return points

    def levels(self, intensity: Float32Array) -> IntArray:
        """(n,) int: intensities in 8 bits; NaN becomes the minimum."""
        steps = np.rint((intensity.astype(np.float64) - self.intensity_min) / (self.intensity_step or 1.0))
        levels: IntArray = np.fmin(np.fmax(steps, 0), 255).astype(int)
        return levels

    def intensities(self, levels: Array) -> Float32Array:
        """(n,) float32: the inverse of levels."""
        with np.errstate(over='ignore', invalid='ignore'):     # a forged step
            intensities: Float32Array = (levels * self.intensity_step + self.intensity_min).astype(np.float32)
        return intensities


class Chunks(NamedTuple):
    """A cloud's chunks."""
    codes: bytes
    """What is needed to read any of them; empty: their points are not sorted."""
    data: UInt8Array
    """(chunks, size) uint8"""

    @property
    def size(self) -> int:
        """Size of all of them [byte]."""
        return len(self.data) * (len(self.codes) + int(self.data.shape[1]))


def plain(has_intensity: bool, datum: Optional[IntArray] = None) -> PointFormat:
    """The exact format: float32 coordinates.

    :param datum: (3,) int, of float64 points, see points.Cloud
    """
    if datum is None:
        return PointFormat(has_intensity)
    x, y, z = datum.tolist()
    return PointFormat(has_intensity, origin=(x, y, z), is_double=True)


def packed(points: Array, bound: float, intensity: Optional[Float32Array] = None, datum: Optional[IntArray] = None
           ) -> PointFormat:
    """The smallest format in which no coordinate is off by more than `bound`.

    If the cloud spans too much for offsets, that is float32.

    :param points: (n, 3) float32, or float64 with a datum [m], n >= 1
    :param bound: [m], > 0; float32's own rounding is added to it
    :param datum: as of `plain`
    :param intensity: (n,) float32 or None; encoded in 8 bits from its least to its greatest finite value
    """
    step = float(np.float32(2 * bound))
    if not step:
        return plain(intensity is not None, datum)
    ends = np.rint(bounding_box(points).astype(np.float64) / step)
    x, y, z = (int(side).bit_length() for side in ends[1] - ends[0])
    too_long = x + y + z + INTENSITY_BITS * (intensity is not None) > WORD
    if max(x, y, z) > MAX_BITS or too_long or np.abs(ends).max() >= 2 ** 31:
        return plain(intensity is not None, datum)
    origin = int(ends[0, 0]), int(ends[0, 1]), int(ends[0, 2])
    if intensity is None:
        return PointFormat(False, step, origin, (x, y, z), is_double=datum is not None)
    finite = intensity[np.isfinite(intensity)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    return PointFormat(True, step, origin, (x, y, z), float(np.float32(low)), float(np.float32((high - low) / 255)),
                       datum is not None)


def deal(points: Array, chunks: int) -> Array:
    """Distribute points to chunks, round-robin.

    :param points: (n, ...) array; at least `chunks` of them, or none in one chunk
    :return: (chunks, ceil(n / chunks), ...) array; a chunk that would be shorter repeats the last point
    :raises ValueError: there are more points or chunks than a receiver accepts
    """
    if len(points) > MAX_POINTS or chunks > MAX_CHUNKS:
        raise ValueError('%d points in %d chunks; there are up to %d in %d' % (
            len(points), chunks, MAX_POINTS, MAX_CHUNKS))
    if points.nbytes > MAX_BYTES:
        raise ValueError('%d points take %d bytes; there are up to %d' % (len(points), points.nbytes, MAX_BYTES))
    size = -(-len(points) // chunks)
    missing = size * chunks - len(points)
    if missing:
        points = np.concatenate([points, np.repeat(points[-1:], missing, axis=0)])
    return np.swapaxes(points.reshape((size, chunks) + points.shape[1:]), 0, 1)


@functools.lru_cache(maxsize=64)
def sending_order(chunks: int) -> IntArray:
    """The order in which chunks are sent, so that chunks lost in a row contain no neighbouring points.

    This is the van der Corput sequence: its first k numbers are spread evenly, for any k.

    :return: (chunks,) int, read-only
    """
    bits = max(1, (chunks - 1).bit_length())
    numbers = np.arange(1 << bits)
    mirrored = np.zeros_like(numbers)
    for bit in range(bits):
        mirrored += (numbers >> bit & 1) << (bits - 1 - bit)
    order = mirrored[mirrored < chunks]
    order.setflags(write=False)
    return order


class CloudParts(ReceivedParts):
    """The chunks of one cloud, as far as they were received.

    :param points: number of points of the whole cloud
    :param chunks: number of chunks
    :param extra: size of a point's further fields [byte]
    :raises ValueError: the numbers contradict each other or exceed a limit
    """

    def __init__(self, points: int, chunks: int, point_format: PointFormat, extra: int = 0) -> None:
        if not (1 <= chunks <= max(1, points) and points <= MAX_POINTS):
            raise ValueError('%d points in %d chunks; there are up to %d' % (points, chunks, MAX_POINTS))
        self._size = point_format.size + extra
        if points * self._size > MAX_BYTES:
            raise ValueError('%d points of %d bytes; there are up to %d bytes' % (points, self._size, MAX_BYTES))
        self.points, self.format = points, point_format
        super().__init__(chunks, sending_order(chunks))
        self._dealt = np.zeros((chunks, -(-points // chunks) * self._size), np.uint8)

    def add(self, indexes: IntArray, payloads: UInt8Array) -> BoolArray:
        """Add chunks of the same length.

        :param indexes: (m,) int, their numbers
        :param payloads: (m, k) uint8
        :return: (m,) bool: those that fit the cloud; the others were dropped
        """
        good: BoolArray = indexes < len(self.have)
        if payloads.shape[1] != self._dealt.shape[1]:
            good[:] = False
        if good.any():
            self._dealt[indexes[good]] = payloads[good]
            self.have[indexes[good]] = True
        return good

    def merge(self) -> Tuple[Array, Optional[Float32Array]]:
        """The points received, in the cloud's order, without forged ones that are not finite.

        :return: (n, 3) points [m], and (n,) float32 intensities or None
        """
        return self.merge_with_fields()[:2]

    def merge_with_fields(self) -> Tuple[Array, Optional[Float32Array], UInt8Array]:
        """As merge, with (n, extra) uint8, the points' further fields."""
        chunks = np.flatnonzero(self.have)
        dealt = self._dealt[chunks].reshape(len(chunks), self._dealt.shape[1] // self._size, self._size)
        in_cloud = chunks + np.arange(dealt.shape[1])[:, np.newaxis] * len(self.have) < self.points
        merged = np.swapaxes(dealt, 0, 1)[in_cloud]
        points, intensity = self.format.read(merged[:, :self.format.size])
        extra = merged[:, self.format.size:]
        finite = np.isfinite(points).all(axis=1)
        if not finite.all():
            points, intensity = points[finite], None if intensity is None else intensity[finite]
            extra = extra[finite]
        return points, intensity, extra
