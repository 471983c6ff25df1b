# SPDX-License-Identifier: BSD-3-Clause
"""Video images as they are received, in their order: each is predicted from the ones before.

What was lost of an image is missing in those that follow, until the robot has coded all parts anew: at once in an image
that is not predicted from others, with which a session begins, and else little by little, in `refresh` images. What is
refreshed in the middle of such a cycle is predicted from what is not: so it takes up to two cycles. `unknown` is the
share of the parts that have not been received anew since a session began, or since as many images as a cycle has were
lost in a row. Then nothing is shown until it is below UNKNOWN: what libavcodec makes of more is grey, or nonsense. The
last good image stays, with its age.

Images from then on are reported as held. Where they do not go on, the robot sends an image that is not predicted from
others (refresh_requests.py).
"""
import math
from types import SimpleNamespace
from typing import Counter, Mapping, Optional, Protocol, Tuple

from ...arrays import UInt8Array
from ...codecs.concealment.successive import SuccessiveImages
from ...codecs.layered.quality import UNKNOWN as UNKNOWN_ERROR
from ...codecs.layered.quality import from_byte, to_byte
from ...codecs.video.decoder_request import Request
from ...image_error import EIGHT_BITS, ImageError
from ...mission.settings import Settings
from ..frame_assembler import Frame
from ..held import Holding
from .assembled import DecodedImage, DecodingReceiver, image_message
from .pixel_layers import Layerable, restored
from .size_guard import SizeGuard
from .video import INTRA, VideoImage
from .video_error import VideoError

UNKNOWN = 0.1
"""After a session began, or a cycle of images was lost, nothing is shown while more than this share of the parts is
unknown."""

CYCLES = 2
"""Number of refresh cycles that it takes to receive all parts anew."""

REPORTED = 64
"""Number of the newest images that are reported."""


class Decoder(Protocol):
    """Decodes the images of one stream."""

    @property
    def dropped(self) -> Mapping[str, int]:
        """{reason: count} of the images that were not decoded."""

    def decode(self, request: Request) -> Optional[UInt8Array]:
        """The image: (height, width) or (height, width, 3: blue, green, red) uint8.

        None: there is none, and perhaps nothing to predict the next ones from.
        """


class VideoReceiver(DecodingReceiver[VideoImage]):
    """Receives the video images of one stream.

    :param decoder: None: there is none, and nothing is shown
    :param dropped: for reasons other than the decoder's
    """
    HEAD = 'height', 'width', 'encoding', 'session', 'picture', 'sources', 'count', 'flags', 'refresh', 'error'
    PARTS = 'parameter_sets', 'data'
    MAX_FINISHED = 8    # those after a lost one are worse

    def __init__(self, decoder: Optional[Decoder], guard: SizeGuard, successive: SuccessiveImages,
                 dropped: Counter[str]) -> None:
        super().__init__(guard, successive, dropped)
        self._decoder = decoder
        self._session: Optional[int] = None
        self._picture = 0                       # number of the last image
        self._missing = 1.0                     # of the parts at the beginning
        self._renewed = 0.0                     # of these since then
        self._began = False                     # whether images are shown
        self._parameter_sets = b''              # of the session, as received last
        self._error = VideoError()

    def begin(self, head: SimpleNamespace, now: float) -> VideoImage:
        return VideoImage(head, self._guard, now)

    def assemble(self, finished: Frame[VideoImage], settings: Settings, still: bool, now: float
                 ) -> Optional[DecodedImage]:
        head, image = finished.head, finished.content
        decoded = None if self._decoder is None else self._decoded(self._decoder, head, image)
        if decoded is None:
            return None
        pixels, rms = decoded
        self._guard.good(image.shape.cells, now)
        message = image_message(head, restored(Layerable(pixels, None, head.encoding, 0.0), False), 0)
        if math.isinf(rms):
            return DecodedImage(message, head.stamp, image.completeness, image.completeness, pixels, None)
        shown = DecodedImage(message, head.stamp, None, image.completeness, pixels, to_byte(rms))
        shown.error = ImageError(rms, EIGHT_BITS)
        return shown

    def _decoded(self, decoder: Decoder, head: SimpleNamespace, image: VideoImage
                 ) -> Optional[Tuple[UInt8Array, float]]:
        """The pixels of the next image, as Decoder.decode, and their estimated rms error; inf: not known [count].

        :return: None: nothing can be shown
        """
        slices = image.slices()
        if not slices:
            self._dropped['image'] += 1
            return None     # it counts as lost
        lost, shape = self._follow(head), image.shape
        self._parameter_sets = image.parameter_sets or self._parameter_sets
        pixels = decoder.decode(Request(
            head.session, shape.height, shape.width, shape.channels == 3, self._parameter_sets, slices))
        if pixels is None:
            self._begin_anew()
            return None
        self._refresh(head, lost, image.completeness)
        # of each: what is missing in one image is missing in the next ones
        damage = self._error.add(pixels, image.completeness, lost, bool(head.flags & INTRA), head.refresh)
        if not self._began:
            self._dropped['before refresh'] += 1
            return None
        return pixels, math.inf if head.error == UNKNOWN_ERROR else math.sqrt(from_byte(head.error) ** 2 + damage)

    def _follow(self, head: SimpleNamespace) -> int:
        """The number of images lost between the last one and this one; 0 for the first of a session."""
        session, last = self._session, self._picture
        self._session, self._picture = head.session, head.picture
        if session != head.session:
            self._begin_anew()
            self._parameter_sets = b''
            return 0
        # the robot numbers them by their stamps: a smaller number is forged, or follows a forged one
        return int(head.picture - last - 1 if head.picture > last else head.refresh)

    def _begin_anew(self) -> None:
        self._missing, self._renewed, self._began = 1.0, 0.0, False
        self._error.begin()
        self.holding = Holding(self._session or 0, ())

    def _refresh(self, head: SimpleNamespace, lost: int, share: float) -> None:
        """Note which share of an image came."""
        if lost >= head.refresh:
            self._begin_anew()
        if head.flags & INTRA:
            self._missing, self._renewed = 1 - share, 0.0
        else:
            self._renewed = min(1.0, self._renewed + share / (CYCLES * head.refresh))
        if self._missing * (1 - self._renewed) <= UNKNOWN:
            self._began = True
            self._hold(head.picture)

    def _hold(self, picture: int) -> None:
        assert self.holding is not None and self._session is not None
        held = [number for first, count in self.holding.runs for number in range(first, first + count)]
        self.holding = Holding.of(self._session, [
            *(number for number in held if picture - REPORTED < number < picture), picture])
