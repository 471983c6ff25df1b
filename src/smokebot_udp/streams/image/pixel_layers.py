# SPDX-License-Identifier: BSD-3-Clause
"""Which images can be sent in layers, and their pixels as the codec takes them."""
import math
from typing import Any, NamedTuple, Optional

import numpy as np

from ...arrays import Array, UInt8Array
from ...codecs.layered.layout import MAX_CELLS
from ...codecs.wire import pixels
from ...codecs.wire.interleave import MAX_SIDE

DEPTH = '32FC1'
"""The encoding that crosses as counts of `depth_unit`."""

RGB = 'rgb8'
"""The encoding whose channels cross in the other order."""

LAYERED = 'mono8', '8UC1', 'mono16', '16UC1', DEPTH, 'bgr8', RGB, '8UC3'
"""Encodings that can be layered; DEPTH if depth_unit is set."""

WITHOUT_ALPHA = {'bgra8': 'bgr8', 'rgba8': 'rgb8'}
"""These are layered without their alpha."""


class Layerable(NamedTuple):
    """An image for the codec."""
    pixels: Array
    """(height, width) uint8 or uint16, or (height, width, 3) uint8: blue, green, red; native byte order."""
    classes: Optional[UInt8Array]
    """(height, width) uint8, see codecs/layered/depth.py; None: all pixels are finite."""
    encoding: str
    """As the receiver publishes it."""
    depth_unit: float
    """Depth of a count [m]; 0: it is no depth image."""


class CodedShape(NamedTuple):
    """What is coded of an image."""
    height: int
    width: int
    channels: int
    itemsize: int
    """Size of a cell [byte]."""

    @property
    def cells(self) -> int:
        return self.height * self.width * self.channels


def shape_of(array: Array) -> CodedShape:
    """The shape of an image as the codec takes it: (height, width) or (height, width, channels)."""
    height, width = array.shape[:2]
    return CodedShape(height, width, 1 if array.ndim == 2 else array.shape[2], array.itemsize)


def coded_shape(height: int, width: int, encoding: str, depth_unit: float) -> CodedShape:
    """What is coded of an image.

    :param depth_unit: of 32FC1 the depth of a count [m], of others 0
    :raises ValueError: it cannot be sent in layers
    """
    if encoding not in LAYERED:
        raise ValueError('encoding is %r, must be one of %s' % (encoding, ', '.join(LAYERED)))
    if not (0 < depth_unit < math.inf if encoding == DEPTH else depth_unit == 0):
        raise ValueError('depth_unit is %r, the encoding %s' % (depth_unit, encoding))
    for name, side in (('height', height), ('width', width)):
        if not 1 <= side <= MAX_SIDE:
            raise ValueError('%s is %d, must be from 1 to %d' % (name, side, MAX_SIDE))
    item, channels = pixels.pixel_type(encoding)
    return CodedShape(height, width, channels, min(item.itemsize, 2))


def cannot_be_layered(message: Any, scale: int, depth_unit: float) -> Optional[str]:
    """Why an Image cannot be layered; None: it can.

    :param scale: by which it is reduced
    :param depth_unit: as the setting [m]
    """
    encoding = message.encoding
    name = WITHOUT_ALPHA.get(encoding, encoding)
    if name not in LAYERED:
        return 'encoding is %r, which cannot be layered; %s can' % (
            encoding, ', '.join((*LAYERED, *WITHOUT_ALPHA)))
    if name == DEPTH and not depth_unit:
        return "encoding is '32FC1', which can be layered only if depth_unit is set, and depth_unit is 0"
    height, width = -(-message.height // scale), -(-message.width // scale)
    values = height * width * pixels.pixel_type(name)[1]
    if values > MAX_CELLS:
        return '%d x %d pixels %s are %d values, of which %d at most can be layered; scale reduces them' % (
            height, width, name, values, MAX_CELLS)
    return None


def layerable(message: Any, scale: int, depth_unit: float) -> Layerable:
    """The pixels of an Image, reduced by a factor.

    :param depth_unit: of the counts that 32FC1 becomes [m]
    :raises ValueError: names the wrong field and its value
    """
    array = pixels.as_pixels(message.data, message.height, message.width, message.step, message.encoding,
                             message.is_bigendian)
    if scale > 1:
        array = pixels.reduce_by(array, scale)
    encoding = WITHOUT_ALPHA.get(message.encoding, message.encoding)
    array = np.ascontiguousarray(array, array.dtype.newbyteorder('='))
    if encoding == DEPTH:
        from ...codecs.layered import depth  # compiled
        depth_unit = float(np.float32(depth_unit))      # as the message holds it
        counts, classes = depth.to_counts(array, depth_unit)
        return Layerable(counts, classes, encoding, depth_unit)
    if array.ndim == 3:
        array = np.ascontiguousarray(array[..., 2::-1] if encoding == RGB else array[..., :3])
    return Layerable(array, None, encoding, 0.0)


def restored(source: Layerable, is_bigendian: bool) -> Array:
    """The inverse of `layerable`: the pixels of an Image of this encoding and byte order.

    :return: (height, width) or (height, width, channels) array, C-contiguous
    """
    array = source.pixels
    if source.encoding == DEPTH:
        from ...codecs.layered import depth, image  # compiled
        array = depth.from_counts(image.Decoded(array, source.classes), source.depth_unit)
    elif source.encoding == RGB:
        array = array[..., ::-1]
    channel, _ = pixels.pixel_type(source.encoding, is_bigendian)
    return np.ascontiguousarray(array, channel)
