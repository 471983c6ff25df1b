# SPDX-License-Identifier: BSD-3-Clause
"""Lossless codings of the data of an original. The decoders take bytes from the network: what they make is bounded by
the size that is expected."""
import enum
import zlib
from typing import Optional, Tuple

import numpy as np

from ..arrays import Array, UInt8Array
from ..packed import inflated

LEVEL = 6
"""Compression level of zlib."""


class Coding(enum.IntEnum):
    """How data are coded; the values are those on the wire."""
    PLANES = 0
    """The bytes of all items, first bytes first, in zlib's format."""
    DIFFERENCES = 1
    """PLANES of the differences of each pixel from left + above - left above."""
    LAYERED = 2
    """An exact layered stream (doc/layered_images.md)."""


MAX_ITEM = 0xffff
"""[byte]"""


def to_planes(data: bytes, item: int) -> bytes:
    """Code items of `item` bytes each; where they are longer than MAX_ITEM, or the data no multiple of them, bytes."""
    size = item if 0 < item <= MAX_ITEM and len(data) % item == 0 else 1
    array: UInt8Array = np.frombuffer(data, np.uint8).reshape(-1, size)
    return size.to_bytes(2, 'little') + zlib.compress(array.T.tobytes(), LEVEL)


def from_planes(coded: bytes, expected: int) -> bytes:
    """The inverse of `to_planes`.

    :param expected: length of the data [byte]
    :raises ValueError: it is no such coding of this length
    """
    size = int.from_bytes(coded[:2], 'little')
    plain = inflated(coded[2:], zlib.decompressobj(), expected)
    if len(plain) != expected or not size or expected % size:
        raise ValueError('it has not the length that is announced, %d bytes' % expected)
    return bytes(np.frombuffer(plain, np.uint8).reshape(size, -1).T.tobytes())


def to_differences(pixels: Array) -> bytes:
    """Code an image.

    :param pixels: (height, width) or (height, width, channels) uint8 or uint16
    """
    values = pixels.reshape(pixels.shape[0], pixels.shape[1], -1).copy()
    values[1:] -= values[:-1].copy()
    values[:, 1:] -= values[:, :-1].copy()
    return to_planes(values.tobytes(), values.itemsize * values.shape[2])


def from_differences(coded: bytes, pixels: Array) -> None:
    """The inverse of `to_differences`.

    :param pixels: C-contiguous, uint8 or uint16: it is filled
    :raises ValueError: it is no such coding of an image of this shape
    """
    values = np.frombuffer(from_planes(coded, pixels.nbytes), pixels.dtype)
    values = values.reshape(pixels.shape[0], pixels.shape[1], -1)
    summed = values.cumsum(1, pixels.dtype).cumsum(0, pixels.dtype)
    pixels[...] = summed.reshape(pixels.shape)


def may_be_layered(pixels: Array) -> bool:
    """Whether the layered codec takes such an image."""
    from ..codecs.layered.layout import MAX_CELLS
    kind = pixels.dtype.itemsize, pixels.shape[2] if pixels.ndim == 3 else 1
    return pixels.dtype.kind == 'u' and kind in ((1, 1), (2, 1), (1, 3)) and pixels.size <= MAX_CELLS


def code_image(pixels: Array, layered: bool) -> Tuple[Coding, bytes]:
    """Code an image.

    :param pixels: (height, width) or (height, width, channels) in native byte order
    :param layered: whether the layered codec is there on both sides
    """
    if layered and may_be_layered(pixels):
        from ..codecs.layered import image, layout  # compiled
        return Coding.LAYERED, image.encode(pixels, True, layout.most_bytes(pixels.size, pixels.itemsize)).data
    if pixels.dtype.kind == 'u' and pixels.itemsize <= 2:
        return Coding.DIFFERENCES, to_differences(pixels)
    return Coding.PLANES, to_planes(pixels.tobytes(), pixels.itemsize)


def decode_image(coding: int, coded: bytes, shape: Tuple[int, ...], kind: str) -> Array:
    """The pixels of an image.

    :param kind: numpy's name of a channel's type, in native byte order
    :return: C-contiguous
    :raises ValueError: it is no such coding of such an image
    """
    pixels: Array = np.zeros(shape, kind)
    if coding == Coding.LAYERED:
        decoded = _decode_layered(coded, pixels)
        if decoded is None:
            raise ValueError('it is no layered image of %s %s' % (shape, kind))
        return decoded
    if coding == Coding.DIFFERENCES and pixels.dtype.kind == 'u' and pixels.itemsize <= 2:
        from_differences(coded, pixels)
        return pixels
    if coding == Coding.PLANES:
        return np.frombuffer(from_planes(coded, pixels.nbytes), kind).reshape(shape)
    raise ValueError('its coding %d is unknown' % coding)


def _decode_layered(coded: bytes, pixels: Array) -> Optional[Array]:
    if not may_be_layered(pixels):
        return None
    from ..codecs.layered import image  # compiled
    decoded = image.decode(coded, pixels.shape[0], pixels.shape[1], 3 if pixels.ndim == 3 else 1, pixels.itemsize)
    return None if decoded is None or decoded.pixels.shape != pixels.shape else np.ascontiguousarray(decoded.pixels)
