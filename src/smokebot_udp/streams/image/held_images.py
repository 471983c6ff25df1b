# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of prediction: decodes layered images, and keeps those that later ones may be predicted from.

An image whose reference is not held exactly as the robot has it is not shown: decoded against anything else it would be
nonsense. The next report (msg/Held) says what is held, and the robot predicts from that, or sends an image without a
reference.
"""
import math
from typing import Counter, Optional

from ...arrays import Array
from ..held import Holding
from .layered import LayeredImage
from .references import References

MISTRUST = 5.0
"""After a reference that differs from the robot's nothing is held for this long: should both sides decode differently,
few images are lost by it [s]."""


class HeldImages:
    """Decodes the images of one stream, in one thread.

    :param dropped: {reason: count}: images of which nothing can be restored, and those without their reference
    """

    def __init__(self, dropped: Counter[str]) -> None:
        self.holding: Optional[Holding] = None
        """What is reported; None: there was no image."""
        self._dropped = dropped
        self._references = References()
        self._mistrusted_until = -math.inf      # [s]

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
            reference = self._reference(image, now)
            if reference is None:
                self._dropped['reference'] += 1
                return None
            prediction = image.displaced(reference)
        found = None if image.is_predicted and prediction is None else image.decoded(prediction)
        if found is None:
            self._dropped['image'] += 1
            return None
        decoded, coded = found
        if now >= self._mistrusted_until:
            self._references.add((image.session, image.picture), coded)
        return image.published(decoded)

    def _reference(self, image: LayeredImage, now: float) -> Optional[Array]:
        """The pixels of the reference of an image; None: it is not held as the robot has it."""
        key = image.session, image.reference
        reference = self._references.get(key, image.reference_layers, image.shape)
        if reference is None:
            return None
        if reference.checksum != image.checksum:
            self._references.clear()
            self._mistrusted_until = now + MISTRUST
            return None
        return reference.pixels
