# SPDX-License-Identifier: BSD-3-Clause
"""Which images can be sent in layers, and what is coded of them."""
import math
from typing import NamedTuple

from ...arrays import Array
from ...codecs.wire.interleave import MAX_SIDE
from ...codecs.wire.pixels import pixel_type
from .pixel_layers import DEPTH, LAYERED


class CodedShape(NamedTuple):
    """What is coded of an image."""
    height: int
    width: int
    channels: int
    itemsize: int
    """Of a cell [byte]."""

    @property
    def cells(self) -> int:
        return self.height * self.width * self.channels


def shape_of(pixels: Array) -> CodedShape:
    """The shape of an image as the codec takes it: (height, width) or (height, width, channels)."""
    height, width = pixels.shape[:2]
    return CodedShape(height, width, 1 if pixels.ndim == 2 else pixels.shape[2], pixels.itemsize)


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
    item, channels = pixel_type(encoding)
    return CodedShape(height, width, channels, min(item.itemsize, 2))
