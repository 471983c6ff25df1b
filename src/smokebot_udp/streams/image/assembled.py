# SPDX-License-Identifier: BSD-3-Clause
"""Images to be published, with what is known of the quality of their pixels; and how those of a coding are received."""
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, Counter, Generic, Optional, Tuple, TypeVar

import numpy as np
from sensor_msgs.msg import Image

from ...arrays import Array, Records, UInt8Array
from ...codecs.concealment.successive import SuccessiveImages
from ...codecs.wire.partial_image import RECEIVED
from ...mission.settings import Settings
from ..assembler import Assembled
from ..frame_assembler import MAX_FINISHED, Frame, PartialFrame
from ..held import Holding
from ..stamped_assembler import header_of
from .size_guard import SizeGuard

ASSUMED_ERROR = 4.0
"""Rms error of images where it is not known and they are compared [count]."""


@dataclass
class ShownImage(Assembled):
    """An image to be published."""
    known_ratio: float
    """Share of the pixels that are not concealed; of a video, of the slices that came or were restored, 0..1."""

    def mask(self) -> UInt8Array:
        """(height, width) uint8: RECEIVED where the image is exact, and less where it is worse."""
        raise NotImplementedError


@dataclass
class DecodedImage(ShownImage):
    """An image that was coded with loss. All of its pixels are equally good: what missing slices would have shown is
    that of the image before, and where is not known."""
    pixels: Array
    """(height, width) or (height, width, channels), as they were coded or as in the message."""
    error_byte: Optional[int]
    """See codecs.layered.quality; None: not known, the share of the slices is shown instead."""

    def mask(self) -> UInt8Array:
        shade = round(RECEIVED * self.known_ratio) if self.error_byte is None else RECEIVED - self.error_byte
        return np.full((self.message.height, self.message.width), shade, np.uint8)


Content = TypeVar('Content', bound=PartialFrame)
Shown = TypeVar('Shown', bound=ShownImage)


class Receiver(Generic[Content, Shown]):
    """Receives the images of a coding."""
    HEAD: ClassVar[Tuple[str, ...]]
    """The fields that are equal in all segments of an image, besides the header."""
    PARTS: ClassVar[Tuple[str, ...]] = ('data',)
    """The further fields that PartialFrame.add takes."""
    MAX_FINISHED: ClassVar[int] = MAX_FINISHED
    """As of FrameAssembler."""
    holding: Optional[Holding] = None
    """What is reported; None: nothing is."""

    def begin(self, head: SimpleNamespace, now: float) -> Content:
        """As StampedAssembler.begin, by a steady clock [s]."""
        raise NotImplementedError

    def parts(self, records: Records) -> Tuple[Any, ...]:
        """As StampedAssembler.parts."""
        return (records['index'].astype(int), *(records[field] for field in self.PARTS))

    def assemble(self, finished: Frame[Content], settings: Settings, still: bool, now: float) -> Optional[Shown]:
        """As Assembler.assemble; None: nothing can be shown."""
        raise NotImplementedError

    def settle(self, finished: Frame[Content], shown: Shown, settings: Settings, now: float) -> None:
        """As Assembler.settle."""
        raise NotImplementedError


class DecodingReceiver(Receiver[Content, DecodedImage]):
    """Receives the images of a coding with loss.

    :param guard: of the stream
    :param successive: compares the images of the stream that are shown
    :param dropped: {reason: count} of the images that are not shown, to be added to
    """

    def __init__(self, guard: SizeGuard, successive: SuccessiveImages, dropped: Counter[str]) -> None:
        self._guard, self._successive, self._dropped = guard, successive, dropped

    def settle(self, finished: Frame[Content], shown: DecodedImage, settings: Settings, now: float) -> None:
        if settings['integrate'] != 'never':
            shown.changed = self._successive.changed(
                shown.pixels, ASSUMED_ERROR if shown.error is None else shown.error.rms)


def image_message(head: SimpleNamespace, pixels: Array, is_bigendian: int) -> Image:
    """The image of a head's encoding.

    :param pixels: (height, width, ...) array, C-contiguous
    """
    return Image(header=header_of(head), height=pixels.shape[0], width=pixels.shape[1], encoding=head.encoding,
                 is_bigendian=is_bigendian, step=pixels.strides[0], data=pixels.tobytes())
