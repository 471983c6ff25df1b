# SPDX-License-Identifier: BSD-3-Clause
"""What crosses: an original as bytes, or why there is none.

The first byte is Kind. An ORIGINAL goes on with the SHA-256 of the serialised message, the coding of its data, the
lengths of its two heads, the heads, and the coded data. The heads are the message without data and, where the robot
knows it, the geometry_msgs/TransformStamped of its frame. A REFUSAL goes on with a sentence in UTF-8.
"""
import copy
import enum
import hashlib
import struct
from typing import Any, NamedTuple, Tuple

import numpy as np
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import Image, PointCloud2

from ..arrays import Array
from ..codecs.wire.bayer import BAYER
from ..codecs.wire.pixels import image_pixels, pixel_type
from ..serialised import deserialised, serialised
from .coding import Coding, code_image, decode_image, from_planes, to_planes

MAX_DATA = 1 << 26
"""Maximum size of the data of an original [byte]."""

MAX_HEAD = 0xffff
"""Maximum size of a message without its data, and of a pose [byte]."""

MAX_REASON = 1000
"""Maximum size of the sentence that gives the reason of a refusal [byte]."""

WHOLE = (0, 0, 0, 0)
"""The region that is all of an image."""

_HEAD = struct.Struct('<B32sBHH')


class Kind(enum.IntEnum):
    """Kinds of contents."""
    REFUSAL = 0
    ORIGINAL = 1


class Captured(NamedTuple):
    """An original as it came."""
    message: Any
    """An Image or a PointCloud2."""
    pose: Any
    """geometry_msgs/TransformStamped of its frame; None: unknown."""


class Refused(Exception):
    """The robot sends no original: it says why."""


def refusal(reason: str) -> bytes:
    """The content that says why there is no original."""
    return bytes([Kind.REFUSAL]) + reason.encode()[:MAX_REASON]


def cropped(message: Any, region: Tuple[int, int, int, int]) -> Any:
    """A region of an Image, its rows without padding. Of a PointCloud2 there is only WHOLE.

    :param region: x, y, width, height [pixel]; width, height 0: all from x, y on
    :return: a copy, unless nothing changes
    :raises ValueError: saying what is wrong with the region or the message
    """
    if message._type != Image._type:
        if region != WHOLE:
            raise ValueError('a region is of an image, not of a %s' % message._type)
        return message
    pixels = image_pixels(message)
    x, y, width, height = region
    width, height = width or max(0, message.width - x), height or max(0, message.height - y)
    if not (width and height and x + width <= message.width and y + height <= message.height):
        raise ValueError('the region of %d x %d pixels at (%d, %d) is not in the image of %d x %d' % (
            width, height, x, y, message.width, message.height))
    if message.encoding in BAYER and (x % 2 or y % 2):
        raise ValueError('the region of a Bayer mosaic begins at (%d, %d), must begin at even places' % (x, y))
    part = np.ascontiguousarray(pixels[y:y + height, x:x + width])
    found = copy.copy(message)
    found.height, found.width, found.step, found.data = height, width, part.nbytes // height, part.tobytes()
    return found


def pack(message: Any, pose: Any, layered: bool) -> bytes:
    """An original as bytes.

    :param message: an Image as of `cropped`, or a PointCloud2
    :param pose: geometry_msgs/TransformStamped of its frame; None: unknown
    :param layered: whether the layered codec is there on both sides
    :raises ValueError: it is too large, or not what it says it is
    """
    if len(message.data) > MAX_DATA:
        raise ValueError('it has %d bytes, at most %d can cross: ask for a region' % (len(message.data), MAX_DATA))
    if message._type == PointCloud2._type:
        _check_rows(message)
        if len(message.data) != message.height * message.row_step:
            raise ValueError('its data have %d bytes, height x row_step is %d x %d' % (
                len(message.data), message.height, message.row_step))
    whole = serialised(message)
    head = copy.copy(message)
    head.data = b''
    heads = serialised(head), b'' if pose is None else serialised(pose)
    if max(map(len, heads)) > MAX_HEAD:
        raise ValueError('what it says of its data has %d bytes, at most %d can cross' % (
            max(map(len, heads)), MAX_HEAD))
    if message._type == Image._type:
        coding, coded = code_image(_pixels(message), layered)
    else:
        coding, coded = Coding.PLANES, to_planes(bytes(message.data), message.point_step)
    return _HEAD.pack(Kind.ORIGINAL, hashlib.sha256(whole).digest(), coding, *map(len, heads)) + b''.join(
        heads) + coded


def unpack(content: bytes, message_class: Any) -> Captured:
    """An original that came from the network.

    :param message_class: Image or PointCloud2
    :raises Refused: there is none
    :raises ValueError: it is none of this type, or not what the robot sent
    """
    if content[:1] == bytes([Kind.REFUSAL]):
        raise Refused(content[1:1 + MAX_REASON].decode('utf-8', 'replace'))
    if len(content) < _HEAD.size or content[0] != Kind.ORIGINAL:
        raise ValueError('what came is no original')
    _, digest, coding, first, second = _HEAD.unpack_from(content)
    ends = _HEAD.size + first, _HEAD.size + first + second
    message = deserialised(message_class, content[_HEAD.size:ends[0]])
    pose = deserialised(TransformStamped, content[ends[0]:ends[1]]) if second else None
    message.data = _decoded(message, coding, content[ends[1]:])
    if hashlib.sha256(serialised(message)).digest() != digest:
        raise ValueError('what came is not what the robot sent: its checksum differs')
    return Captured(message, pose)


def _decoded(message: Any, coding: int, coded: bytes) -> bytes:
    """:raises ValueError: it is no such coding of such a message"""
    size = message.height * (message.step if message._type == Image._type else message.row_step)
    if size > MAX_DATA:
        raise ValueError('what came has %d bytes, at most %d are taken' % (size, MAX_DATA))
    if message._type == PointCloud2._type:
        if coding != Coding.PLANES:
            raise ValueError('its coding %d is unknown' % coding)
        _check_rows(message)
        return from_planes(coded, size)
    kind, channels = pixel_type(message.encoding)
    if not message.height or not message.width or message.step != message.width * channels * kind.itemsize:
        raise ValueError('its rows have %d bytes, %d pixels %s take another number' % (
            message.step, message.width, message.encoding))
    shape = (message.height, message.width) + (channels,) * (channels > 1)
    pixels = decode_image(coding, coded, shape, kind.str[1:])
    return np.ascontiguousarray(pixels, pixel_type(message.encoding, message.is_bigendian)[0]).tobytes()


def _check_rows(message: Any) -> None:
    """:raises ValueError: who reads this PointCloud2 would read beyond its data"""
    if message.row_step < message.width * message.point_step:
        raise ValueError('its rows have %d bytes, %d points of %d bytes do not fit' % (
            message.row_step, message.width, message.point_step))


def _pixels(message: Any) -> Array:
    pixels = image_pixels(message)
    return np.ascontiguousarray(pixels, pixels.dtype.newbyteorder('='))

