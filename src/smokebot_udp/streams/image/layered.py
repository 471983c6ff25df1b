# SPDX-License-Identifier: BSD-3-Clause
"""An image that is received in layers, see msg/LayeredSegment.msg: any of its datagrams show all of it."""
import math
from types import SimpleNamespace
from typing import NamedTuple, Optional

from ...arrays import Array, BoolArray, IntArray, UInt8Array
from ...codecs.layered.layout import most_bytes
from ...codecs.layered.pieces import Layer, Restorer, check, parts_of
from ...codecs.wire.interleave import MAX_SIDE
from ...codecs.wire.pixels import pixel_type
from .pixel_layers import DEPTH, LAYERED, Layerable, restored
from .size_guard import SizeGuard


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


class LayeredImage:
    """The segments of one image, as far as they were received.

    :param head: stamp, frame_id and the fields that its segments repeat, see segments.head_of
    :param guard: of the stream
    :param now: by the guard's clock [s]
    :raises ValueError: the head contradicts itself, or exceeds a limit
    """

    def __init__(self, head: SimpleNamespace, guard: SizeGuard, now: float) -> None:
        self.shape = coded_shape(head.height, head.width, head.encoding, head.depth_unit)
        if not len(head.thresholds) == len(head.sizes) == len(head.errors):
            raise ValueError('there are %d thresholds, %d sizes, %d errors' % (
                len(head.thresholds), len(head.sizes), len(head.errors)))
        layers = [Layer(*layer) for layer in zip(head.thresholds, head.sizes)]
        check(head.count, layers)
        stream = sum(layer.length(head.count) for layer in layers)
        # each layer is filled up to whole bytes of its pieces
        filled = sum(layer.threshold * parts_of(layer.threshold, head.count) for layer in layers)
        if stream > most_bytes(self.shape.cells, self.shape.itemsize) + filled:
            raise ValueError('a stream of %d bytes for %d cells' % (stream, self.shape.cells))
        # after all others, so that only what is possible in itself counts as announced
        guard.check(self.shape.cells, now)
        self._restorer = Restorer(head.count, layers)   # takes memory
        self._count, self._size = head.count, sum(head.sizes)
        self._head = head

    @property
    def ending(self) -> bool:
        """Whether one of the last segments was received."""
        return self._restorer.ending

    @property
    def complete(self) -> bool:
        """Whether all layers can be restored; further segments bring nothing."""
        return self._restorer.complete

    @property
    def completeness(self) -> float:
        """Received share of the segments, 0..1."""
        return self._restorer.completeness

    @property
    def error_byte(self) -> Optional[int]:
        """The error of the image that can be restored now, see codecs.layered.quality; None: nothing can be."""
        restorable = self._restorer.restorable
        return self._head.errors[restorable - 1] if restorable else None

    def add(self, indexes: IntArray, pieces: UInt8Array) -> BoolArray:
        """Add segments.

        :param indexes: (m,) int
        :param pieces: (m, k) uint8: a piece of each layer, one after the other
        :return: (m,) bool, those that fit the image, copies included; the others were dropped
        """
        fit: BoolArray = indexes < self._count
        if pieces.shape[1] != self._size:
            fit[:] = False
        if fit.any():
            self._restorer.add(indexes[fit], pieces[fit])
        return fit

    def pixels(self) -> Optional[Array]:
        """The best image that can be restored now.

        :return: (height, width) or (height, width, channels), as in a sensor_msgs/Image of this encoding and byte
            order; None: there is none
        :raises ImportError: the codec cannot be loaded
        """
        if self.error_byte is None:
            return None
        from ...codecs.layered.image import decode  # compiled: it takes 1 s and 100 MB to import
        decoded = decode(self._restorer.restored(), *self.shape)
        if decoded is None:
            return None
        head = self._head
        return restored(Layerable(decoded.pixels, decoded.classes, head.encoding, head.depth_unit), head.is_bigendian)
