# SPDX-License-Identifier: BSD-3-Clause
"""A picture that arrives in segments, some of its subimages each (D6.3, section 4.2)."""
import numpy as np

from .interleave import Interleave

MAX_PICTURE_SIZE = 4096 * 4096 * 4
"""A picture that would take more memory is refused [byte]."""

ENDING = 4
"""So many segments at a picture's end tell that it is ending: with one alone, its loss would hide it."""

RECEIVED, REMEMBERED, FILLED = 255, 128, 0
"""What a mask says of a pixel: it came with this picture, with an earlier one, or never."""


class Picture:
    """What has come of one picture.

    :param item: dtype of a whole pixel, see pixels.item_type
    :param total: how many subimages are sent of it, the first in order; None: all
    :raises ValueError: where sizes, depth and total contradict each other or a limit
    """

    def __init__(self, height, width, depth, item, total=None):
        self.cut = Interleave(height, width, depth)
        rows, columns = self.cut.shape
        total = len(self.cut) if total is None else total
        if not 1 <= total <= len(self.cut):
            raise ValueError('total is %d, there are %d subimages' % (total, len(self.cut)))
        if len(self.cut) * rows * columns * item.itemsize > MAX_PICTURE_SIZE:
            raise ValueError('%d x %d pixels of %d bytes are too many' % (width, height, item.itemsize))
        self.item, self.total = item, total
        self.have = np.zeros(len(self.cut), bool)
        """(n,) bool: the subimages received, in cut.order."""
        self.ending = False
        """Whether one of the last segments has come: segments are sent in order, so not much can follow."""
        self.duplicates = 0
        """Subimages that came again."""
        self._subimages = np.zeros((len(self.cut), rows * columns), item)

    @property
    def complete(self):
        """Whether all that is sent of it has come."""
        return bool(self.have[:self.total].all())

    @property
    def completeness(self):
        """The share of its pixels that were received, 0..1."""
        return float(np.count_nonzero(self.have)) / len(self.have)

    def add(self, indexes, counts, payloads):
        """Take segments whose payloads have the same length.

        :param indexes: (m,) int, the first subimage of each
        :param counts: (m,) int, how many subimages each says to hold
        :param payloads: (m, k) uint8, their pixels
        :return: (m,) bool, those that fit the picture; the others were dropped
        """
        size = self._subimages.shape[1] * self.item.itemsize
        count, rest = divmod(payloads.shape[1], size)
        inside = indexes < len(self.cut.positions)
        first = self.cut.positions[np.where(inside, indexes, 0)]
        good = inside & (first >= 0) & (first + count <= self.total) & (counts == count)
        if rest or not count:
            good[:] = False
        if good.any():
            places = first[good, np.newaxis] + np.arange(count)
            before = np.count_nonzero(self.have)
            pixels = np.ascontiguousarray(payloads[good]).view(self.item)
            self._subimages[places] = pixels.reshape(places.shape + (-1,))
            self.have[places] = True
            self.duplicates += int(places.size - (np.count_nonzero(self.have) - before))
            self.ending |= bool(places.max() >= self.total - ENDING * count)
        return good

    def items(self, fill, channel=None):
        """The picture, its missing pixels filled.

        :param fill: one of fill.METHODS
        :param channel: dtype of a pixel's numbers, in their byte order, see pixels.pixel_type; None: of no matter
        :return: (height, width) array of `item`; received pixels are as they were sent
        """
        shape = (len(self.cut),) + self.cut.shape
        subimages = self._subimages.view(channel or self.item).reshape(shape + (-1,))
        filled = fill(subimages, self.have, self.cut)
        return self.cut.merge(filled.view(self.item).reshape(shape))


def mask_of(came, known):
    """Tells what was measured from what was filled.

    :param came: (height, width) bool, the pixels that came with this picture
    :param known: (height, width) bool, those that came with it or with an earlier one
    :return: (height, width) uint8: RECEIVED, REMEMBERED or FILLED
    """
    return np.where(came, RECEIVED, np.where(known, REMEMBERED, FILLED)).astype(np.uint8)
