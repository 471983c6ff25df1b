# SPDX-License-Identifier: BSD-3-Clause
"""Images to be published, with what is known of the quality of their pixels."""
from dataclasses import dataclass
from typing import Union

import numpy as np

from ...arrays import Array, BoolArray, UInt8Array
from ...codecs.concealment.temporal import FilteredImage
from ...codecs.layered.quality import to_byte
from ...codecs.wire.partial_image import RECEIVED, mask_of
from ..assembler import Assembled


@dataclass
class AssembledImage(Assembled):
    """An image of interleaved pixels, with their origin."""
    received: BoolArray
    """(height, width), the pixels that were received with this image."""
    filtered: FilteredImage
    """Its pixels, and which of them were received with this image or an earlier one; the others are concealed."""

    @property
    def known_ratio(self) -> float:
        """Share of the pixels that are not concealed, 0..1."""
        return self.filtered.known_ratio

    def mask(self) -> UInt8Array:
        """(height, width) uint8, see partial_image.mask_of."""
        return mask_of(self.received, self.filtered.known)


class MosaicImage(AssembledImage):
    """A mosaic of which `received` and `filtered` are cells of 2 x 2 pixels, see codecs.wire.bayer."""

    def mask(self) -> UInt8Array:
        return super().mask().repeat(2, axis=0).repeat(2, axis=1)


@dataclass
class RestoredImage(Assembled):
    """An image restored from layers. All of its pixels are equally good, as `error` says."""
    error_byte: int
    """See codecs.layered.quality."""
    pixels: Array
    """(height, width) or (height, width, channels): those of the message."""
    known_ratio = 1.0

    def mask(self) -> UInt8Array:
        """(height, width) uint8: RECEIVED where the image is exact, and the less the larger the error is."""
        return np.full((self.message.height, self.message.width), RECEIVED - self.error_byte, np.uint8)


@dataclass
class DecodedImage(Assembled):
    """An image of a video. What its missing slices would have shown is that of the image before; where is not known. So
    `error` is that of all of its pixels; where the robot does not know its part, there is the share of the slices."""
    pixels: Array
    """(height, width) or (height, width, 3), blue, green, red."""
    known_ratio: float
    """Share of its slices that were received or restored, 0..1."""

    def mask(self) -> UInt8Array:
        """(height, width) uint8: as of RestoredImage, or RECEIVED times the share."""
        shade = round(RECEIVED * self.known_ratio) if self.error is None else RECEIVED - to_byte(self.error.rms)
        return np.full((self.message.height, self.message.width), shade, np.uint8)


ShownImage = Union[AssembledImage, RestoredImage, DecodedImage]
