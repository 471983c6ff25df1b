# SPDX-License-Identifier: BSD-3-Clause
"""Layered images as they are received: decoded from all layers that can be restored when the image is finished, and
kept, as later ones may be predicted from them.

An image whose reference is not held exactly as the robot has it is not shown: decoded against anything else it would be
nonsense. The next report (msg/Held) says what is held, and the robot predicts from that, or sends an image without a
reference.
"""
import math
from types import SimpleNamespace
from typing import Counter, Optional

from ...arrays import Array
from ...codecs.concealment.successive import SuccessiveImages
from ...codecs.layered.quality import from_byte
from ...image_error import EIGHT_BITS, ImageError
from ...mission.settings import Settings
from ..frame_assembler import Frame
from ..held import Holding
from .assembled import DecodedImage, DecodingReceiver, image_message
from .layered import LayeredImage
from .references import References
from .size_guard import SizeGuard

MISTRUST = 5.0
"""After a reference that differs from the robot's nothing is held for this long: should both sides decode differently,
few images are lost by it [s]."""


class LayeredReceiver(DecodingReceiver[LayeredImage]):
    """Receives the layered images of one stream: not shown are those of which nothing can be restored, and those
    without their reference."""
    HEAD = ('height', 'width', 'encoding', 'is_bigendian', 'depth_unit', 'count', 'thresholds', 'sizes', 'errors',
            'session', 'picture', 'reference', 'reference_layers', 'checksum')

    def __init__(self, guard: SizeGuard, successive: SuccessiveImages, dropped: Counter[str]) -> None:
        super().__init__(guard, successive, dropped)
        self._references = References()
        self._mistrusted_until = -math.inf      # [s]

    def begin(self, head: SimpleNamespace, now: float) -> LayeredImage:
        return LayeredImage(head, self._guard, now)

    def assemble(self, finished: Frame[LayeredImage], settings: Settings, still: bool, now: float
                 ) -> Optional[DecodedImage]:
        head, image = finished.head, finished.content
        pixels, error = self.decode(image, now), image.error_byte
        if pixels is None or error is None:
            return None
        self._guard.good(image.shape.cells, now)
        shown = DecodedImage(image_message(head, pixels, head.is_bigendian), head.stamp, None, 1.0, pixels, error)
        rms = from_byte(error) * (head.depth_unit or 1.0)
        shown.error = ImageError(rms, EIGHT_BITS) if image.shape.itemsize == 1 else ImageError(
            rms, None, settings['counts_per_unit'], settings['unit'])
        return shown

    def decode(self, image: LayeredImage, now: float) -> Optional[Array]:
        """The pixels of an image, see LayeredImage.published; None: it is not shown.

        :param now: by a steady clock [s]
        :raises ImportError: the codec cannot be loaded
        """
        pixels = self._decode(image, now)
        held = self._references.layers(image.session)
        self.holding = Holding.of_layers(image.session, held)
        return pixels

    def _decode(self, image: LayeredImage, now: float) -> Optional[Array]:
        prediction = None
        if image.is_predicted:
            prediction = self._prediction(image, now)
            if prediction is None:
                return None
        found = image.decoded(prediction)
        if found is None:
            self._dropped['image'] += 1
            return None
        decoded, coded = found
        if now >= self._mistrusted_until:
            self._references.add((image.session, image.picture), coded)
        return image.published(decoded)

    def _prediction(self, image: LayeredImage, now: float) -> Optional[Array]:
        """What an image is predicted to be; None: that is not known, which is counted."""
        first = self._reference(image, image.reference, image.reference_layers, image.checksum, now)
        course = image.course
        second = course.second if course else None
        other = first if second is None else self._reference(
            image, image.picture - second.back, second.layers, second.checksum, now)
        if first is None or other is None or course is None:
            self._dropped['reference' if first is None or other is None else 'image'] += 1
            return None
        from ...codecs.layered import blend  # compiled
        return blend.predicted(course, first, other)

    def _reference(self, image: LayeredImage, number: int, layers: int, checksum: int, now: float) -> Optional[Array]:
        """The pixels of a reference of an image; None: it is not held as the robot has it."""
        reference = self._references.get((image.session, number), layers, image.shape)
        if reference is None:
            return None
        if reference.checksum != checksum:
            self._references.clear()
            self._mistrusted_until = now + MISTRUST
            return None
        return reference.pixels
