# SPDX-License-Identifier: BSD-3-Clause
"""The pixels of a sensor_msgs/Image, without copying them: encodings, step and byte order (REP-118, sensor_msgs)."""
import cv2
import numpy as np

from .interleave import MAX_SIDE

ENCODINGS = {'mono8': ('u1', 1), '8UC1': ('u1', 1), 'mono16': ('u2', 1), '16UC1': ('u2', 1), '32FC1': ('f4', 1),
             'bgr8': ('u1', 3), 'rgb8': ('u1', 3), '8UC3': ('u1', 3), 'bgra8': ('u1', 4), 'rgba8': ('u1', 4),
             '8UC4': ('u1', 4)}
"""{sensor_msgs/image_encodings: (numpy type of a channel, channels)}"""


def pixel_type(encoding, is_bigendian=False):
    """(dtype of a channel, channels); ValueError where the encoding is not among ENCODINGS."""
    try:
        kind, channels = ENCODINGS[encoding]
    except KeyError:
        raise ValueError('encoding is %r, must be one of %s' % (encoding, ', '.join(ENCODINGS))) from None
    return np.dtype(kind).newbyteorder('>' if is_bigendian else '<'), channels


def as_pixels(data, height, width, step, encoding, is_bigendian):
    """The fields of a sensor_msgs/Image as numbers.

    :return: (height, width) or (height, width, channels) array, a view of data, in the image's byte order
    :raises ValueError: naming the field that is wrong and its value
    """
    dtype, channels = pixel_type(encoding, is_bigendian)
    _check(data, height, width, step, encoding, channels * dtype.itemsize)
    shape = (height, width) + (channels,) * (channels > 1)
    return np.ndarray(shape, dtype, data, 0, (step, channels * dtype.itemsize, dtype.itemsize)[:len(shape)])


def as_items(data, height, width, step, encoding):
    """The same as whole pixels, to be moved but not reckoned with: (height, width) array of `item_type`."""
    dtype = item_type(encoding)
    _check(data, height, width, step, encoding, dtype.itemsize)
    return np.ndarray((height, width), dtype, data, 0, (step, dtype.itemsize))


def item_type(encoding):
    """A dtype of a whole pixel's bytes."""
    dtype, channels = pixel_type(encoding)
    return _item(channels * dtype.itemsize)


def _item(size):
    return np.dtype({1: 'u1', 2: 'u2', 4: 'u4'}.get(size, 'V%d' % size))


def reduce_by(pixels, factor):
    """Each block of factor by factor pixels becomes its mean; blocks at the far borders may be cut off.

    :param pixels: (height, width) or (height, width, channels) array as as_pixels gives it, in any byte order
    :return: (ceil(height / factor), ceil(width / factor)) array of whole pixels, in the same byte order
    """
    below, beside = (-side % factor for side in pixels.shape[:2])
    native = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder('='))
    if below or beside:
        native = cv2.copyMakeBorder(native, 0, below, 0, beside, cv2.BORDER_REPLICATE)
    height, width = (side // factor for side in native.shape[:2])
    means = cv2.resize(native, (width, height), interpolation=cv2.INTER_AREA).astype(pixels.dtype, copy=False)
    size = means.itemsize * (means.shape[2] if means.ndim == 3 else 1)
    return np.ascontiguousarray(means).view(_item(size)).reshape(height, width)


def _check(data, height, width, step, encoding, pixel_size):
    for name, side in (('height', height), ('width', width)):
        if not 1 <= side <= MAX_SIDE:
            raise ValueError('%s is %d, must be from 1 to %d' % (name, side, MAX_SIDE))
    if step < width * pixel_size:
        raise ValueError('step is %d, a row of %d pixels %s has %d bytes' % (
            step, width, encoding, width * pixel_size))
    if len(data) < height * step:
        raise ValueError('data has %d bytes, height x step is %d x %d = %d' % (
            len(data), height, step, height * step))
