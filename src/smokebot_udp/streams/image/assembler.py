# SPDX-License-Identifier: BSD-3-Clause
"""Segments to sensor_msgs/Image; missing pixels come from earlier images or are concealed (D6.3, section 4.2)."""
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Mapping, Optional, Tuple

from sensor_msgs.msg import Image

from ...arrays import Array, BoolArray, Records
from ...codecs.concealment import fill
from ...codecs.concealment.temporal import FilteredImage, TemporalFilter
from ...codecs.wire.partial_image import PartialImage
from ...codecs.wire.pixels import item_type, pixel_type
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import ImageSegment
from ..assembler import Assembled, Clock, no_clock
from ..concealment_budget import CHEAPEST, FALLBACK, ConcealmentBudget
from ..frame_assembler import Frame
from ..stamped_assembler import StampedAssembler, header_of
from .view import PARAMETERS as VIEW

LARGEST_INTEGRATED = 1920 * 1200
"""Larger images are not integrated over time: it takes some 8 ms a megapixel, and 20 bytes a pixel [pixel]."""


@dataclass
class AssembledImage(Assembled):
    """An image to be published, with the origin of its pixels."""
    received: BoolArray
    """(height, width), the pixels that were received with this image."""
    filtered: FilteredImage
    """Its pixels, and which of them were received with this image or an earlier one; the others are concealed."""


class ImageAssembler(StampedAssembler[PartialImage, AssembledImage]):
    """Makes one image of each stamp's segments.

    :param clock: measures how long concealment takes [s]
    """
    MESSAGE, SEGMENT = Image, ImageSegment
    HEAD = 'height', 'width', 'encoding', 'is_bigendian', 'depth', 'total'
    PARAMETERS = {
        **StampedAssembler.PARAMETERS,
        'integrate': Parameter('when_still', '', 'when pixels of earlier images replace missing ones, unless the scene '
                               'has changed there', choices=('never', 'when_still', 'always'), live=True),
        'remember': Parameter(5.0, 's', 'maximum age of such a pixel', above=0.0, most=3600.0, live=True),
        'fill': Parameter(fill.BEST, '', 'concealment method for missing pixels', choices=tuple(fill.METHODS),
                          live=True),
        'fill_time': Parameter(0.1, 's', 'longest time for concealment; the frame period limits it, too. If it takes '
                               'longer, %s is used for %g s' % (CHEAPEST, FALLBACK), above=0.0, most=60.0, live=True),
        'publish_mask': Parameter(False, '', 'whether a mask is published with each image, on mask in the namespace of '
                                  'its topic: 255: received pixel, 128: pixel of an earlier image, 0: concealed pixel'),
        **VIEW,
    }

    def __init__(self, settings: Mapping[str, Any], clock: Clock = no_clock) -> None:
        super().__init__(settings, clock)
        self._budget = ConcealmentBudget()
        self._filter = TemporalFilter()

    def begin(self, head: SimpleNamespace) -> PartialImage:
        self._budget.frame_began(head.stamp)
        return PartialImage(head.height, head.width, head.depth, item_type(head.encoding), head.total)

    def parts(self, records: Records) -> Tuple[Any, ...]:
        return records['index'].astype(int), records['count'], records['data']

    def assemble(self, finished: Frame[PartialImage], settings: Settings, still: bool, now: float) -> AssembledImage:
        head, image = finished.head, finished.content
        filtered = FilteredImage(self._concealed(finished, settings), image.received, None)
        # no earlier pixel replaces one of a complete image: it need not wait for the filter, see `settle`
        if not image.have.all():
            filtered = self._filtered(finished, filtered, settings, still, now)
        items = filtered.items
        message = Image(header=header_of(head), height=head.height, width=head.width, encoding=head.encoding,
                        is_bigendian=head.is_bigendian, step=items.strides[0], data=items.tobytes())
        assembled = AssembledImage(message, head.stamp, image.completeness, image.received, filtered)
        assembled.changed = filtered.changed
        return assembled

    def settle(self, finished: Frame[PartialImage], assembled: AssembledImage, settings: Settings, now: float) -> None:
        if finished.content.have.all():
            assembled.changed = self._filtered(finished, assembled.filtered, settings, False, now).changed

    def problem(self, settings: Settings, now: float) -> Optional[str]:
        if settings['fill'] != CHEAPEST and self._budget.falls_back(now):
            return 'filled by %s because %s takes too long' % (CHEAPEST, settings['fill'])
        return None

    def _concealed(self, frame: Frame[PartialImage], settings: Settings) -> Array:
        """(height, width) array of whole pixels, the missing ones concealed."""
        began = self._clock()
        method = self._budget.method(settings['fill'], settings['fill_time'], began)
        channel, _ = pixel_type(frame.head.encoding, frame.head.is_bigendian)
        items = frame.content.items(fill.METHODS[method], channel)
        now = self._clock()
        if self._budget.took(method, now - began, now):
            self.warnings.append('images are filled by %s for %g s: %s takes longer than fill_time or the frame period'
                                 % (CHEAPEST, FALLBACK, method))
        return items

    def _filtered(self, frame: Frame[PartialImage], image: FilteredImage, settings: Settings, still: bool,
                  now: float) -> FilteredImage:
        """The image with pixels of earlier ones (D6.3, section 4.2), as `integrate` demands."""
        head = frame.head
        if settings['integrate'] == 'never' or head.height * head.width > LARGEST_INTEGRATED:
            self._filter.reset()
            return image
        self._filter.max_age = settings['remember']
        channel, _ = pixel_type(head.encoding, head.is_bigendian)
        return self._filter.apply(frame.content, image.items, channel, now, still or settings['integrate'] == 'always')
