# SPDX-License-Identifier: BSD-3-Clause
"""Interleaved images as they are received: missing pixels come from earlier images or are concealed
(D6.3, section 4.2).
"""
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, List

from ...arrays import Array, BoolArray, UInt8Array
from ...codecs.concealment import fill
from ...codecs.concealment.temporal import FilteredImage, TemporalFilter
from ...codecs.wire.bayer import CELLS, from_cells
from ...codecs.wire.partial_image import PartialImage, mask_of
from ...codecs.wire.pixels import OF_CELLS, item_type, pixel_type
from ...mission.settings import Settings
from ..assembler import Clock
from ..concealment_budget import CHEAPEST, FALLBACK, ConcealmentBudget
from ..frame_assembler import Frame
from .assembled import Receiver, ShownImage, image_message

LARGEST_INTEGRATED = 1920 * 1200
"""Larger images are not integrated over time: it takes some 8 ms a megapixel, and 20 bytes a pixel [pixel]."""


@dataclass
class AssembledImage(ShownImage):
    """An image of interleaved pixels, with their origin."""
    received: BoolArray
    """(height, width), the pixels that were received with this image; of a mosaic its cells, as `filtered` has them."""
    filtered: FilteredImage
    """Its pixels, and which of them were received with this image or an earlier one; the others are concealed."""

    def mask(self) -> UInt8Array:
        """See partial_image.mask_of."""
        mask, cell = mask_of(self.received, self.filtered.known), self.message.height // self.received.shape[0]
        return mask.repeat(cell, axis=0).repeat(cell, axis=1)


class InterleavedReceiver(Receiver[PartialImage, AssembledImage]):
    """Receives images of raw pixels.

    :param clock: measures how long concealment takes [s]
    :param warnings: to be added to
    """
    HEAD = 'height', 'width', 'encoding', 'is_bigendian', 'depth', 'total'
    PARTS = 'count', 'data'

    def __init__(self, clock: Clock, warnings: List[str]) -> None:
        self._clock, self._warnings = clock, warnings
        self._budget = ConcealmentBudget()
        self._filter = TemporalFilter()

    def begin(self, head: SimpleNamespace, now: float) -> PartialImage:
        return PartialImage(head.height, head.width, head.depth, item_type(head.encoding), head.total)

    def began(self, head: SimpleNamespace) -> None:
        """Note that an image begins: a segment fits it."""
        self._budget.frame_began(head.stamp)

    def assemble(self, finished: Frame[PartialImage], settings: Settings, still: bool, now: float) -> AssembledImage:
        head, image = finished.head, finished.content
        filtered = FilteredImage(self._concealed(head, image, settings), image.received, None)
        # no earlier pixel replaces one of a complete image: it need not wait for the filter, see `settle`
        if not image.have.all():
            filtered = self._filtered(head, image, filtered, settings, still, now)
        message = (_mosaic(head, filtered.items) if head.encoding in OF_CELLS else
                   image_message(head, filtered.items, head.is_bigendian))
        shown = AssembledImage(message, head.stamp, image.completeness, filtered.known_ratio, image.received, filtered)
        shown.changed = filtered.changed
        return shown

    def settle(self, finished: Frame[PartialImage], shown: AssembledImage, settings: Settings, now: float) -> None:
        if finished.content.have.all():
            shown.changed = self._filtered(
                finished.head, finished.content, shown.filtered, settings, False, now).changed

    def falls_back(self, settings: Settings, now: float) -> bool:
        """Whether another method is used than `fill` says, as that takes too long."""
        return settings['fill'] != CHEAPEST and self._budget.falls_back(now)

    def _concealed(self, head: SimpleNamespace, image: PartialImage, settings: Settings) -> Array:
        """(height, width) array of whole pixels, the missing ones concealed."""
        began = self._clock()
        method = self._budget.method(settings['fill'], settings['fill_time'], began)
        channel, _ = pixel_type(head.encoding, head.is_bigendian)
        items = image.items(fill.METHODS[method], channel)
        now = self._clock()
        if self._budget.took(method, now - began, now):
            self._warnings.append('images are filled by %s for %g s: %s takes longer than fill_time or the frame period'
                                  % (CHEAPEST, FALLBACK, method))
        return items

    def _filtered(self, head: SimpleNamespace, image: PartialImage, concealed: FilteredImage, settings: Settings,
                  still: bool, now: float) -> FilteredImage:
        """The image with pixels of earlier ones (D6.3, section 4.2), as `integrate` demands."""
        if settings['integrate'] == 'never' or head.height * head.width > LARGEST_INTEGRATED:
            self._filter.reset()
            return concealed
        self._filter.max_age = settings['remember']
        channel, _ = pixel_type(head.encoding, head.is_bigendian)
        return self._filter.apply(image, concealed.items, channel, now, still or settings['integrate'] == 'always')


def _mosaic(head: SimpleNamespace, items: Array) -> Any:
    """The image of a head whose encoding is one of OF_CELLS.

    :param items: (height, width) array of cells
    """
    channel, channels = pixel_type(head.encoding, head.is_bigendian)
    pixels = from_cells(items.view(channel).reshape(head.height, head.width, channels))
    message = image_message(head, pixels, head.is_bigendian)
    message.encoding = head.encoding[:-len(CELLS)]
    return message
