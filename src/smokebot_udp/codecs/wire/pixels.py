# SPDX-License-Identifier: BSD-3-Clause
"""The pixels of a sensor_msgs/Image as arrays, without a copy: encodings, step, byte order (REP-118, sensor_msgs)."""
from typing import Any, Tuple

import cv2
import numpy as np

from ...arrays import Array, Buffer, DType
from .bayer import BAYER, CELLS, DEEP, PATTERNS, YUV422
from .interleave import MAX_SIDE

ENCODINGS = {'mono8': ('u1', 1), '8UC1': ('u1', 1), 'mono16': ('u2', 1), '16UC1': ('u2', 1), '32FC1': ('f4', 1),
             'bgr8': ('u1', 3), 'rgb8': ('u1', 3), '8UC3': ('u1', 3), 'bgra8': ('u1', 4), 'rgba8': ('u1', 4),
             '8UC4': ('u1', 4)}
"""{sensor_msgs/image_encodings: (numpy type of a channel, channels)}"""

RAW = {**{name: ('u1', 1) for name in PATTERNS}, **{name: ('u2', 1) for name in DEEP},
       **{name: ('u1', 2) for name in YUV422}}
"""Likewise, of a camera's raw colours, see bayer: never coded as they are."""

OF_CELLS = {name + CELLS: (RAW[name][0], 4) for name in BAYER}
"""Likewise, of the cells of mosaics: only on the wire."""


def pixel_type(encoding: str, is_bigendian: bool = False) -> Tuple[DType, int]:
    """The dtype of a channel, and the number of channels.

    :raises ValueError: the encoding is none of ENCODINGS, RAW and OF_CELLS
    """
    try:
        kind, channels = ENCODINGS.get(encoding) or RAW.get(encoding) or OF_CELLS[encoding]
    except KeyError:
        raise ValueError('encoding is %r, must be one of %s' % (encoding, ', '.join((*ENCODINGS, *RAW)))) from None
    return np.dtype(kind).newbyteorder('>' if is_bigendian else '<'), channels


def as_pixels(data: Buffer, height: int, width: int, step: int, encoding: str, is_bigendian: bool) -> Array:
    """The fields of a sensor_msgs/Image as numbers.

    :return: (height, width) or (height, width, channels) array, a view of data, in the image's byte order
    :raises ValueError: names the wrong field and its value
    """
    dtype, channels = pixel_type(encoding, is_bigendian)
    step = row_length(data, height, width, step, encoding)
    shape = (height, width) + (channels,) * (channels > 1)
    return np.ndarray(shape, dtype, data, 0, (step, channels * dtype.itemsize, dtype.itemsize)[:len(shape)])


def image_pixels(message: Any) -> Array:
    """The pixels of a sensor_msgs/Image, see `as_pixels`."""
    return as_pixels(message.data, message.height, message.width, message.step, message.encoding, message.is_bigendian)


def as_items(data: Buffer, height: int, width: int, step: int, encoding: str) -> Array:
    """The fields of a sensor_msgs/Image as whole pixels, to be moved but not calculated with.

    :return: (height, width) array of `item_type`, a view of data
    :raises ValueError: names the wrong field and its value
    """
    dtype, step = item_type(encoding), row_length(data, height, width, step, encoding)
    return np.ndarray((height, width), dtype, data, 0, (step, dtype.itemsize))


def item_type(encoding: str) -> DType:
    """A dtype of a whole pixel's bytes.

    :raises ValueError: as pixel_type
    """
    dtype, channels = pixel_type(encoding)
    return _item(channels * dtype.itemsize)


def _item(size: int) -> DType:
    return np.dtype({1: 'u1', 2: 'u2', 4: 'u4'}.get(size, 'V%d' % size))


def reduce_by(pixels: Array, factor: int) -> Array:
    """Average each block of factor by factor pixels. Blocks at the right and the lower border may be incomplete.

    :param pixels: (height, width) or (height, width, channels) array from as_pixels, in any byte order
    :return: (ceil(height / factor), ceil(width / factor)) or (..., channels) array, in the same byte order
    """
    below, beside = (-side % factor for side in pixels.shape[:2])
    native = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder('='))
    if below or beside:
        native = cv2.copyMakeBorder(native, 0, below, 0, beside, cv2.BORDER_REPLICATE)
    height, width = (side // factor for side in native.shape[:2])
    means: Array = cv2.resize(native, (width, height), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(means.reshape((height, width) + pixels.shape[2:]), pixels.dtype)


def whole(pixels: Array) -> Array:
    """Pixels as items, to be moved but not calculated with.

    :param pixels: (height, width) or (height, width, channels) array, C-contiguous
    :return: (height, width) array of whole pixels, a view
    """
    size = pixels.itemsize * (pixels.shape[2] if pixels.ndim == 3 else 1)
    return pixels.view(_item(size)).reshape(pixels.shape[:2])


def row_length(data: Buffer, height: int, width: int, step: int, encoding: str) -> int:
    """Distance between the rows of a sensor_msgs/Image [byte]: its step; where the data contradict that, and have rows
    without padding, the length of a row.

    :raises ValueError: names the wrong field and its value
    """
    for name, side in (('height', height), ('width', width)):
        if not 1 <= side <= MAX_SIDE:
            raise ValueError('%s is %d, must be from 1 to %d' % (name, side, MAX_SIDE))
    row = width * item_type(encoding).itemsize
    if step >= row and len(data) >= (height - 1) * step + row:      # the last row need not be padded
        return step
    if len(data) == height * row:
        return row
    raise ValueError('data has %d bytes, height x step is %d x %d; a row of %d pixels %s has %d bytes' % (
        len(data), height, step, width, encoding, row))
