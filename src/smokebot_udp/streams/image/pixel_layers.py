# SPDX-License-Identifier: BSD-3-Clause
"""The pixels of a sensor_msgs/Image as the codec of layered images takes them."""
from typing import Any, NamedTuple, Optional

import numpy as np

from ...arrays import Array, UInt8Array
from ...codecs.layered.layout import MAX_CELLS
from ...codecs.wire import pixels

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
    """Of a count [m]; 0: it is no depth."""


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
