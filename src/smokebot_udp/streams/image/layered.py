# SPDX-License-Identifier: BSD-3-Clause
"""An image that is received in layers, see msg/LayeredSegment.msg: any of its datagrams show all of it."""
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Optional, Tuple

import numpy as np

from ...arrays import Array, BoolArray, IntArray, UInt8Array
from ...codecs.layered.layout import most_bytes
from ...codecs.layered.pieces import MAX_LAYERS, Layer, Restorer, check, parts_of
from .pixel_layers import Layerable, coded_shape, restored
from .references import CodedImage, ends_of, split_motion
from .size_guard import SizeGuard

if TYPE_CHECKING:
    from ...codecs.layered.blend import Course  # compiled


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
        _check_reference(head)
        # each layer is filled up to whole bytes of its pieces
        filled = sum(layer.threshold * parts_of(layer.threshold, head.count) for layer in layers)
        if stream > most_bytes(self.shape.cells, self.shape.itemsize) + filled:
            raise ValueError('a stream of %d bytes for %d cells' % (stream, self.shape.cells))
        # after all others, so that only what is possible in itself counts as announced
        guard.check(self.shape.cells, now)
        self._restorer = Restorer(head.count, layers)   # takes memory
        self._count, self._size = head.count, sum(head.sizes)
        self._ends = ends_of(layers, head.count)
        self._head = head
        self.session, self.picture = head.session, head.picture
        self.reference, self.reference_layers, self.checksum = head.reference, head.reference_layers, head.checksum

    @property
    def complete(self) -> bool:
        """Whether all layers can be restored; further segments bring nothing."""
        return self._restorer.complete

    @property
    def completeness(self) -> float:
        """Received share of the segments, 0..1."""
        return self._restorer.completeness

    @property
    def awaited(self) -> int:
        """The index of the missing segment that matters last, see Restorer.awaited."""
        return self._restorer.awaited

    def places(self, numbers: IntArray) -> IntArray:
        """(m,) int: the places of segments in the order in which they are sent; -1: there is none such."""
        places: IntArray = np.where(numbers < self._count, numbers, -1)
        return places

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

    @property
    def is_predicted(self) -> bool:
        """Whether it can be decoded with its reference only."""
        return bool(self.reference != self.picture)

    @property
    def course(self) -> Optional['Course']:
        """How it is made of its references, if it is predicted; None: that is not known."""
        found = split_motion(self._restorer.restored()) if self._restorer.restorable else None
        if found is None:
            return None
        from ...codecs.layered import blend  # compiled
        try:
            return blend.from_bytes(found[0])
        except ValueError:
            return None

    def decoded(self, prediction: Optional[Array]) -> Optional[Tuple[Any, CodedImage]]:
        """The best image that can be restored now, and what later images may be predicted from.

        What was received of the stream right after the restorable layers is shown, too.

        :param prediction: the displaced reference, if it is predicted
        :return: the first as codecs.layered.image.Decoded; None: there is none
        :raises ImportError: the codec cannot be loaded
        """
        if self.error_byte is None:
            return None
        from ...codecs.layered import image  # compiled: it takes 1 s and 100 MB to import
        known = self._restorer.restored()
        split = split_motion(known) if self.is_predicted else (b'', known)
        data = b'' if split is None else split[1]
        before = len(known) - len(data)
        read = image.read(data, *self.shape, prediction)
        if read is None:
            return None
        ends = [end - before for end in self._ends[:self._restorer.restorable]]
        coded = CodedImage(self.shape, read.prefixes, ends)
        reference = coded.reference(len(ends)) if min(len(data), read.prefixes.length) <= ends[-1] else None
        pixels = read.prefixes.all_pixels() if reference is None else reference.pixels
        return image.Decoded(pixels, read.classes), coded

    def published(self, decoded: Any) -> Array:
        """What a sensor_msgs/Image of this encoding and byte order shows of a decoded image.

        :return: (height, width) or (height, width, channels)
        """
        head = self._head
        return restored(Layerable(decoded.pixels, decoded.classes, head.encoding, head.depth_unit), head.is_bigendian)


def _check_reference(head: SimpleNamespace) -> None:
    """:raises ValueError: what a head says about its reference is impossible"""
    predicted = head.reference != head.picture
    if predicted and not (head.reference < head.picture and 0 < head.reference_layers <= MAX_LAYERS):
        raise ValueError('image %d is predicted from %d layers of image %d' % (
            head.picture, head.reference_layers, head.reference))
    if not predicted and (head.reference_layers or head.checksum):
        raise ValueError('image %d has no reference, but describes one' % head.picture)
