# SPDX-License-Identifier: BSD-3-Clause
"""Two references blended to one: the noise of the one is not that of the other, so their mean has less.

Each is displaced by a motion of its own. Bytes say which image the second reference is, and its share. Blending is of
integers, so that both sides have the same pixels.
"""
import struct
from typing import NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import Array
from . import motion
from .differences import flat
from .loops import compiled, int32, int64, uint64

_SHIFT = 4
SHARES = 1 << _SHIFT
"""Shares are in parts of this number."""
WORTH = 0.99
"""A second reference is used where it decreases the mean squared difference to less than this part. With 0.96 the clips
euroc and sway of `experiments video` have 0.1 dB less on the mean; 1 % is worth its 25 bytes from 0.3 Mbit/s on."""
STEP = 8
"""Shares are determined from each STEP-th row."""
_KIND = 2
"""Value of the first byte: no motion alone begins with it."""
_HEAD = struct.Struct('<BBBBIB')


class Second(NamedTuple):
    """The second reference of an image."""
    back: int
    """Number of the image minus that of the reference, 1..255."""
    layers: int
    """Number of its layers that are used."""
    checksum: int
    """CRC-32 of its pixels, uint32."""
    share: int
    """1..SHARES - 1"""
    motion: motion.Motion
    """Motion since it."""


class Course(NamedTuple):
    """How an image is made of its references."""
    motion: motion.Motion
    """Motion since the first one."""
    second: Optional[Second]
    """None: there is no other."""


def to_bytes(course: Course) -> bytes:
    """Bytes of a course: those of the motion where there is no second reference; 249 at most."""
    first = motion.to_bytes(course.motion)
    if course.second is None:
        return first
    second = course.second
    return _HEAD.pack(_KIND, second.back, second.layers, second.share, second.checksum, len(first)) + (
        first + motion.to_bytes(second.motion))


def from_bytes(data: bytes) -> Course:
    """The course that `to_bytes` wrote.

    :raises ValueError: these are not the bytes of a course
    """
    if not data or data[0] != _KIND:
        return Course(motion.from_bytes(data), None)
    if len(data) < _HEAD.size:
        raise ValueError('%d bytes of a second reference' % len(data))
    _, back, layers, share, checksum, length = _HEAD.unpack_from(data)
    end = _HEAD.size + length
    if not back or not layers or not 0 < share < SHARES or len(data) < end:
        raise ValueError('a second reference %d images before, of %d layers, with a share of %d' % (
            back, layers, share))
    return Course(motion.from_bytes(data[_HEAD.size:end]),
                  Second(back, layers, checksum, share, motion.from_bytes(data[end:])))


@compiled
def _blend(first: Array, second: Array, share: int, result: Array) -> None:
    """Blend flat images; the share is int32."""
    rest = int32(SHARES - share)
    for i in range(uint64(len(result))):
        result[i] = int32(int32(int32(int32(first[i]) * rest) + int32(int32(second[i]) * share))
                          + int32(SHARES // 2)) >> _SHIFT


def blended(first: Array, second: Array, share: int) -> Array:
    """((SHARES - share) * first + share * second) / SHARES, rounded: bit-identical on every machine.

    :param first: (height, width) uint8 or uint16, or (height, width, 3) uint8
    :param second: of the same shape and type
    :param share: 0..SHARES
    """
    result = np.empty(first.size, first.dtype)
    _blend(flat(first), flat(second), int32(share), result)
    return result.reshape(first.shape)


def predicted(course: Course, first: Array, second: Array) -> Array:
    """What references predict an image to be, bit-identical on every machine.

    :param first: its pixels, see `blended`
    :param second: likewise; is ignored if the course has no second one
    """
    displaced = motion.compensate(first, course.motion)
    if course.second is None:
        return displaced
    return blended(displaced, motion.compensate(second, course.second.motion), course.second.share)


@compiled
def _products(first: Array, second: Array, image: Array, length: int, step: int) -> Tuple[int, int, int]:
    """Over each `step`-th row of `length` values of flat images: sums of the squares of what the first one lacks, of
    its products with what distinguishes the two, and of the squares of that."""
    lacks, both, apart = 0, 0, 0
    for start in range(step // 2 * length, len(image), step * length):
        for i in range(uint64(start), uint64(start + length)):
            missing = int64(image[i]) - int64(first[i])
            other = int64(second[i]) - int64(first[i])
            lacks += missing * missing
            both += missing * other
            apart += other * other
    return lacks, both, apart


def share_of(first: Array, second: Array, image: Array) -> int:
    """The share of the second one with which the blend is most like an image; 0: it is of no use.

    :param first, second, image: see `blended`
    """
    lacks, both, apart = _products(flat(first), flat(second), flat(image), image[0].size,
                                   max(min(STEP, len(image) // 2), 1))
    share = int(min(max(round(SHARES * both / max(apart, 1)), 0), SHARES - 1))
    part = share / SHARES
    return share if lacks - 2 * part * both + part * part * apart < WORTH * lacks else 0
