# SPDX-License-Identifier: BSD-3-Clause
"""An image or a map that is received in segments of some subimages each (D6.3, section 4.2)."""
import copy
from typing import Callable, Optional

import numpy as np

from ...arrays import Array, BoolArray, DType, IntArray, UInt8Array
from .interleave import Interleave

FillMethod = Callable[[Array, BoolArray, Interleave], Array]
"""f(subimages, have, cut) -> subimages, the missing ones filled; see concealment.fill.nearest."""

MAX_IMAGE_SIZE = 4096 * 4096 * 4
"""Images that need more memory are refused [byte]."""

RECEIVED, REMEMBERED, FILLED = 255, 128, 0
"""Values of a mask: the pixel was received with this image, with an earlier one, or never."""


class PartialImage:
    """The subimages of one image, as far as they were received.

    :param depth: of the Interleave
    :param item: dtype of a whole pixel, see pixels.item_type
    :param total: number of subimages that are sent, the first in order; None: all
    :raises ValueError: sizes, depth and total contradict each other or exceed a limit
    """

    def __init__(self, height: int, width: int, depth: int, item: DType, total: Optional[int] = None) -> None:
        self.cut = Interleave(height, width, depth)
        rows, columns = self.cut.shape
        total = len(self.cut) if total is None else total
        if not 1 <= total <= len(self.cut):
            raise ValueError('total is %d, there are %d subimages' % (total, len(self.cut)))
        if len(self.cut) * rows * columns * item.itemsize > MAX_IMAGE_SIZE:
            raise ValueError('%d x %d pixels of %d bytes are too many' % (width, height, item.itemsize))
        self.item, self.total = item, total
        self.have = np.zeros(len(self.cut), bool)
        """(n,) bool: the subimages received, in cut.order."""
        self._per_segment = 1       # subimages, of those that were received
        self._subimages = np.zeros((len(self.cut), rows * columns), item)
        self._received: Optional[BoolArray] = None

    @property
    def complete(self) -> bool:
        """Whether all sent subimages were received."""
        return bool(self.have[:self.total].all())

    @property
    def completeness(self) -> float:
        """Ratio of the subimages received, 0..1."""
        return float(np.count_nonzero(self.have)) / len(self.have)

    @property
    def received(self) -> BoolArray:
        """(height, width) bool: the pixels received. Computed once, and again after `add`; not to be changed."""
        if self._received is None:
            self._received = self.cut.pixel_mask(self.have)
        return self._received

    @property
    def awaited(self) -> int:
        """The place of the missing segment that is sent last; not to be asked of a complete image."""
        return int(np.flatnonzero(~self.have[:self.total])[-1]) // self._per_segment

    def places(self, numbers: IntArray) -> IntArray:
        """The places of segments in the order in which they are sent, where all are as long as those received.

        :param numbers: (m,) int, the first subimage of each
        :return: (m,) int, from 0 on; -1: there is no such segment
        """
        inside = numbers < len(self.cut.positions)
        first = np.where(inside, self.cut.positions[np.where(inside, numbers, 0)], -1)
        places: IntArray = np.where(first < self.total, first, -1) // self._per_segment
        return places

    def add(self, indexes: IntArray, counts: Array, payloads: UInt8Array) -> BoolArray:
        """Add segments whose payloads have the same length.

        :param indexes: (m,) int, the first subimage of each
        :param counts: (m,) int, the number of subimages in each, as declared by the segment
        :param payloads: (m, k) uint8, their pixels
        :return: (m,) bool, those that fit the image; the others were dropped
        """
        size = self._subimages.shape[1] * self.item.itemsize
        count, rest = divmod(payloads.shape[1], size)
        inside = indexes < len(self.cut.positions)
        first = self.cut.positions[np.where(inside, indexes, 0)]
        good: BoolArray = inside & (first >= 0) & (first + count <= self.total) & (counts == count)
        if rest or not count:
            good[:] = False
        if good.any():
            places = first[good, np.newaxis] + np.arange(count)
            pixels = np.ascontiguousarray(payloads[good]).view(self.item)
            self._subimages[places] = pixels.reshape(places.shape + (-1,))
            self.have[places] = True
            self._per_segment = max(self._per_segment, count)
            self._received = None
        return good

    def copy(self) -> 'PartialImage':
        """What was received until now: it does not change when more is added."""
        copied = copy.copy(self)
        copied.have, copied._subimages = self.have.copy(), self._subimages.copy()
        return copied

    def items(self, fill: FillMethod, channel: Optional[DType] = None) -> Array:
        """The image, its missing pixels filled.

        :param channel: dtype of a pixel's numbers, in their byte order, see pixels.pixel_type; None: `item`, for a fill
            that only moves pixels
        :return: (height, width) array of `item`, C-contiguous; received pixels are unchanged
        """
        shape = (len(self.cut),) + self.cut.shape
        subimages = self._subimages.view(channel or self.item).reshape(shape + (-1,))
        filled = fill(subimages, self.have, self.cut)
        return self.cut.merge(filled.view(self.item).reshape(shape))


def mask_of(received: BoolArray, known: BoolArray) -> UInt8Array:
    """A mask that distinguishes measured from filled pixels.

    :param received: (height, width) bool, the pixels received with this image
    :param known: (height, width) bool, those received with it or with an earlier one
    :return: (height, width) uint8: RECEIVED, REMEMBERED or FILLED
    """
    return np.where(received, RECEIVED, np.where(known, REMEMBERED, FILLED)).astype(np.uint8)
