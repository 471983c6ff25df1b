# SPDX-License-Identifier: BSD-3-Clause
"""Pixels as H.264 has them: luma as it is, or luma and chroma of BT.601 as OpenCV computes them (I420, 16..235).

Sides are padded to even ones by repeating the border; who decodes is told the true size.
"""
from typing import Mapping, NamedTuple

import cv2
import numpy as np

from ...arrays import UInt8Array


class _Conversion(NamedTuple):
    there: int
    back: int


_COLOUR: Mapping[str, _Conversion] = {
    'bgr8': _Conversion(cv2.COLOR_BGR2YUV_I420, cv2.COLOR_YUV2BGR_I420),
    'rgb8': _Conversion(cv2.COLOR_RGB2YUV_I420, cv2.COLOR_YUV2RGB_I420),
}
GREY = 'mono8'
ENCODINGS = (GREY, *_COLOUR)
"""Encodings of images that have such planes."""


def even(side: int) -> int:
    """A side of an image once it is padded [pixel]."""
    return side + (side & 1)


def has_colour(encoding: str) -> bool:
    """Whether there are planes of chroma.

    :raises ValueError: the encoding is none of ENCODINGS
    """
    if encoding not in ENCODINGS:
        raise ValueError('encoding %r has no planes, must be one of %s' % (encoding, ', '.join(ENCODINGS)))
    return encoding != GREY


def to_planes(pixels: UInt8Array, encoding: str) -> UInt8Array:
    """The planes of an image, one below the other.

    :param pixels: (height, width) uint8 of mono8, (height, width, 3) uint8 of the others
    :param encoding: one of ENCODINGS
    :return: (rows, even(width)) uint8: even(height) rows of luma, and half as many of both chromas where there are any
    """
    height, width = pixels.shape[:2]
    if height & 1 or width & 1:
        pixels = cv2.copyMakeBorder(pixels, 0, height & 1, 0, width & 1, cv2.BORDER_REPLICATE)
    planes: UInt8Array = cv2.cvtColor(pixels, _COLOUR[encoding].there) if has_colour(encoding) else pixels
    return np.ascontiguousarray(planes)


def from_planes(planes: UInt8Array, height: int, width: int, encoding: str) -> UInt8Array:
    """The image that has such planes.

    :param planes: (rows, even(width)) uint8 of an image of this size; mono8 takes those of colour images, too
    :return: (height, width[, 3]) uint8
    :raises ValueError: the planes are not of that size
    """
    luma = even(height)
    rows = luma * 3 // 2 if has_colour(encoding) else luma
    if planes.shape[1] != even(width) or len(planes) < rows:
        raise ValueError('planes of %d x %d bytes are not those of an image of %d x %d' % (
            *planes.shape, height, width))
    pixels: UInt8Array = planes[:rows]
    if has_colour(encoding):
        pixels = cv2.cvtColor(np.ascontiguousarray(pixels), _COLOUR[encoding].back)
    return pixels[:height, :width]
