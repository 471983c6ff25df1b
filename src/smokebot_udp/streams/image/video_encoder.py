# SPDX-License-Identifier: BSD-3-Clause
"""Images as video: H.264 in slices of a datagram each, with parity pieces for the losses expected (doc/video.md).

Importing this module loads PyAV, and the compiled codec.
"""
import itertools
import math
import threading
from typing import Any, Callable, Iterable, List, NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import Array
from ...codecs.layered import quality
from ...codecs.video import rate as video_rate
from ...codecs.video.coded_error import CodedError
from ...codecs.video.decoder_request import MAX_BYTES
from ...codecs.video.encoder import LEAST_ROOM, LEAST_SIZE, EncodedImage, VideoEncoder, check_library
from ...codecs.video.protection import LENGTH_BYTES, MAX_PIECES, protect
from ...codecs.video.redundancy import Division, Link, Scene, Sizes, parities
from ...mission.settings import Settings
from ...msg import VideoSlice
from ...udpros.datagram import IP_UDP_HEADERS
from ...udpros.frame import Frame
from ..encoder import LinkView
from ..frame_assembler import MAX_WAIT
from ..held import Holding
from ..outlook import Outlook
from ..segments import VIDEO, as_bytes, room, size_on_air, write_header
from .coding import Coded, CompressedImages
from .image_size import LEAST_BYTES, Bound, Grant
from .pixel_layers import Layerable, layerable
from .refresh_requests import RefreshRequests
from .video import INTRA
from .video_error import NO_IMAGE, SAMPLED, UNKNOWN_CHANGE

PARAMETER_SETS = 48
"""Room for parameter sets in each datagram [byte]."""

LEAST_DATAGRAM = 1024
"""Datagrams are not shorter than this on slow links: libx264 makes no shorter slices [byte of UDP payload]."""

PADDED = 8
"""Slices are padded with zeros to a multiple of this: the layouts of datagrams are few [byte]."""

MAX_SLICES = 160
"""An image has slices for about this many datagrams at most, so that their parity pieces fit into its code."""

MOST_BYTES = MAX_BYTES // 2
"""Size that is planned for a complete image on the air, at most. A single image may be larger, and all of it must fit
the decoder's memory [byte]."""

FULL_BITS = 3.0
"""Size of an image that is as good as the original, 52 dB [bit per pixel]."""

FAIR_BITS = 0.05
"""Size of a fair image of a scene that resembles the one before [bit per pixel]."""

TOO_LARGE = 2.0
"""An image that takes this many times what it may is not sent if it would leave too late."""

LIKELY, MOST_LOSS = 0.7, 0.7
"""A complete image is protected against losses that are not exceeded with the probability LIKELY, but not against more
than MOST_LOSS."""

UNKNOWN_ERROR = 10.0
"""Mean squared error of a coded image before there is one [count^2]."""

BEGINNING_PARITY, BEGINNING_MORE = 0.6, 1.25
"""A beginning may have this many parity pieces for each slice, or this many times those of other images if that is
more, beyond its budget: where it is incomplete, the next images are, too."""

LEAST_BITS, ENOUGH_BITS = 0.01, 0.015
"""Size of an image at the coarsest quantiser, which is refreshed. Without room for LEAST_BITS images are not sent; room
for ENOUGH_BITS brings them back [bit per pixel]."""

SMOOTHING = 0.3
"""Weight of the newest image."""


class _Coder:
    """Codes images of one shape.

    :param shape: of the pixels
    :param room: for a slice [byte]
    """

    def __init__(self, shape: Tuple[int, ...], room: int) -> None:
        self.shape, self.room = shape, room
        self.control = video_rate.SizeControl()
        self.error = math.inf
        """Rms of the last image; inf: not known [count]."""
        self._openings = video_rate.Openings()

    def prepare(self, plan: video_rate.Plan) -> None:
        """Open the encoder anew where that is necessary for the next image, or another refresh cycle repays it."""
        if not self._openings.renew(plan._replace(size=max(plan.size, LEAST_SIZE))):
            return
        opening = self._openings.opening
        assert opening is not None
        encoding = 'bgr8' if len(self.shape) > 2 else 'mono8'
        self._encoder = VideoEncoder(self.shape[0], self.shape[1], encoding, opening.size, self.room, opening.refresh)
        self._error = CodedError(self.shape[0], self.shape[1], len(self.shape) > 2)
        self.control = video_rate.SizeControl()

    @property
    def refresh(self) -> int:
        """Images of a refresh cycle."""
        return self._openings.refresh

    def encode(self, source: Layerable, size: int, intra: bool) -> EncodedImage:
        """Code the next image, once it is prepared for.

        :param size: that it is to have on average [byte]
        """
        opening = self._openings.opening
        assert opening is not None
        # libx264 follows later only where it began with the size that it was opened for
        asked = min(max(self.control.asked(size), LEAST_SIZE), opening.size) if self._openings.age else opening.size
        coded = self._encoder.encode(source.pixels, asked, intra)
        square = self._error.mean_square(coded, source.pixels)
        self.error = math.inf if square is None else math.sqrt(square)
        return coded


class _Image(NamedTuple):
    """An image as it is sent."""
    session: int
    picture: int
    refresh: int
    coded: EncodedImage
    error: float
    """Rms of its coding; inf: not known [count]."""
    pieces: List[bytes]
    """Its slices, and the parity pieces."""


class VideoImages(CompressedImages):
    """Encodes images. `encode` and `fits` are called by one thread, the others by any.

    :param new_session: makes random numbers, uint32
    :raises ValueError: there is no libx264
    """
    CODING = 'h264'

    def __init__(self, new_session: Callable[[], int]) -> None:
        check_library()
        super().__init__()
        self._new_session = new_session
        self._coder: Optional[_Coder] = None
        self._number, self._pictures = 0, 0     # of the session, and images of it until now
        self._coding_error = UNKNOWN_ERROR  # [count^2]
        self._parities: Optional[int] = None    # of the last plan
        self._last: Optional[Array] = None      # the last image, sampled
        self._change: Optional[float] = None    # mean squared difference of two successive ones [count^2]
        self._ratio: Optional[float] = None     # that in terms of two independent ones
        self._has_room = True
        self._lock = threading.Lock()
        self._requests = RefreshRequests()

    def held(self, operator: str, holding: Holding, now: float) -> None:
        """As Encoder.held.

        :param now: by the clock of `encode` [s]
        """
        with self._lock:
            self._requests.held(operator, holding, now)

    @staticmethod
    def fits(message: Any, link: LinkView) -> bool:
        """Whether datagrams have room for the slices of an image."""
        try:
            sizes_of(_datagram_size(link), message.header.frame_id.encode(), message.encoding.encode())
        except ValueError:
            return False
        return True

    def has_room(self, room: float, area: int) -> bool:
        """Whether the link has room for the next image.

        :param room: for it [byte on the air]
        :param area: of it [pixel]
        """
        self._has_room = room >= (LEAST_BITS if self._has_room else ENOUGH_BITS) / 8 * area
        return self._has_room

    def encode(self, message: Any, settings: Settings, link: LinkView, granted: Grant, began: float) -> Coded:
        """Without frames where an image is too large to arrive in time: the refresh repairs it."""
        source, outlook = layerable(message, settings['scale'], 0.0), link.outlook
        texts = message.header.frame_id.encode(), source.encoding.encode()
        sizes, losses = sizes_of(_datagram_size(link), *texts), Link(outlook.air.losses, outlook.air.burst)
        self._compare(source.pixels[::SAMPLED, ::SAMPLED].astype(np.float32))
        # the parameter sets are in one datagram
        whole = self._whole(source, outlook, sizes)
        bound = granted.bound if granted.size < whole else Bound.MAX_QUALITY
        budget = min(granted.size, whole) - PARAMETER_SETS
        plan = video_rate.plan(budget, sizes, self._scene(), losses, self._parities)
        coder, self._parities = self._prepared(source, sizes, plan), plan.division.parities
        with self._lock:
            self._requests.serve(link.operators(VIDEO), began)
            intra = self._requests.wanted()
        coded = coder.encode(source, plan.division.size, intra)
        beginning = coded.intra and coder.refresh > video_rate.EACH
        if beginning or not self._pictures:     # who loses it holds nothing that the next ones are predicted from
            self._number, self._pictures = self._new_session(), 0
        self._coding_error += SMOOTHING * (video_rate.coding_error(coded.qp) - self._coding_error)
        slices = [unit + bytes(-len(unit) % PADDED) for unit in coded.slices]
        scene = self._scene()
        if beginning:
            scene = scene._replace(change=NO_IMAGE, refresh=2 * scene.refresh)
        most = max(MAX_WAIT * outlook.room, TOO_LARGE * budget)
        planned = _beginning_parities(slices, most, sizes, plan.division) if beginning else plan.division.parities
        image = _Image(self._number, self._pictures, coder.refresh, coded, coder.error,
                       slices + _parity(slices, budget, planned, sizes, scene, losses))
        self._pictures += 1
        frames = list(_frames(message, source, image, texts))
        if not beginning:
            coder.control.add(budget, size_on_air(frames))
        if size_on_air(frames) > most:
            if beginning:
                with self._lock:
                    self._requests.too_large(began)
            return Coded([], bound, coder.error)
        with self._lock:
            self._requests.sent(image.session, image.picture, coded.intra, began)
        return Coded(frames, bound, coder.error)

    def _whole(self, source: Layerable, outlook: Outlook, sizes: Sizes) -> float:
        """What a complete image takes on the air [byte]; notes it."""
        area = int(source.pixels.shape[0]) * int(source.pixels.shape[1])
        protected = (1 + sizes.head / sizes.room) / (1 - min(outlook.loss(LIKELY), MOST_LOSS))
        self._fair_size = FAIR_BITS / 8 * area * protected
        whole = max(min(FULL_BITS / 8 * area * protected, MAX_SLICES * (sizes.room + sizes.head), MOST_BYTES),
                    LEAST_BYTES)
        self._note_size(whole)
        return whole

    def _prepared(self, source: Layerable, sizes: Sizes, plan: video_rate.Plan) -> _Coder:
        """What codes an image."""
        coder, shape = self._coder, source.pixels.shape
        if coder is None or (coder.shape, coder.room) != (shape, sizes.room):
            coder, self._pictures = _Coder(shape, sizes.room), 0
        coder.prepare(plan)
        self._coder = coder
        return coder

    def _compare(self, image: Array) -> None:
        """Measure how much the scene changes from one image to the next one."""
        last, self._last = self._last, image
        if last is None or last.shape != image.shape:
            self._change = self._ratio = None
            return
        change = float(np.square(image - last).mean())
        self._change = change if self._change is None else self._change + SMOOTHING * (change - self._change)
        self._ratio = self._change / max(2 * float(image.var()), 1e-9)

    def _scene(self) -> Scene:
        return Scene(self._coding_error, UNKNOWN_CHANGE if self._change is None else self._change,
                     self._coder.refresh if self._coder else video_rate.LONG, video_rate.intra_cost(self._ratio))


def _datagram_size(link: LinkView) -> int:
    return max(link.datagram_size, min(link.longest_datagram, LEAST_DATAGRAM))


def _beginning_parities(slices: List[bytes], most: float, sizes: Sizes, usual: Division) -> int:
    """The parity pieces that a beginning may have.

    :param most: for the image on the air [byte]
    :param usual: of other images
    """
    ratio = max(BEGINNING_PARITY, BEGINNING_MORE * usual.parities / math.ceil(usual.size / sizes.room))
    piece = max(map(len, slices)) + LENGTH_BYTES + sizes.head
    spare = most - PARAMETER_SETS * len(slices) - sum(map(len, slices)) - len(slices) * sizes.head
    return int(max(min(math.ceil(ratio * len(slices)), spare / (piece + PARAMETER_SETS)), 0))


def _parity(slices: List[bytes], budget: float, planned: int, sizes: Sizes, scene: Scene, link: Link) -> List[bytes]:
    """The parity pieces of an image.

    :param planned: they may be so many; where the image is smaller than planned, more of them fit
    """
    lengths = [len(piece) for piece in slices]
    spare = budget - sum(lengths) - len(lengths) * sizes.head
    most = max(planned, int(spare // (max(lengths) + LENGTH_BYTES + sizes.head)))
    return protect(slices, parities(lengths, min(most, MAX_PIECES - len(slices)), sizes, scene, link))


def sizes_of(max_datagram_size: int, *texts: bytes) -> Sizes:
    """Sizes of the datagrams of video.

    :param max_datagram_size: [byte of UDP payload]
    :param texts: frame_id and encoding
    :raises ValueError: slices have too little room
    """
    free = room(VideoSlice, max_datagram_size, *texts)
    left = (free - PARAMETER_SETS - LENGTH_BYTES) // PADDED * PADDED
    if left < LEAST_ROOM:
        raise ValueError('a datagram of %d bytes has too little room for a slice of video' % max_datagram_size)
    return Sizes(left, max_datagram_size + IP_UDP_HEADERS - free)


def _frames(message: Any, source: Layerable, image: _Image, texts: Tuple[bytes, bytes]) -> Iterable[Frame]:
    """The datagrams of an image: those of the same layout in one frame, parity last.

    :param texts: frame_id and encoding
    """
    sources, sets = len(image.coded.slices), image.coded.parameter_sets

    def layout(index: int) -> Tuple[bool, int, int]:
        with_sets = index == 0 or image.coded.intra and image.refresh > video_rate.EACH
        return index >= sources, len(sets) if with_sets else 0, len(image.pieces[index])

    for (_, length, size), group in itertools.groupby(sorted(range(len(image.pieces)), key=layout), layout):
        indexes = list(group)
        frame = Frame(VideoSlice, len(indexes), {'header.frame_id': len(texts[0]), 'encoding': len(texts[1]),
                                                 'parameter_sets': length, 'data': size})
        records = frame.records
        write_header(records, message.header)
        records['height'], records['width'] = source.pixels.shape[:2]
        records['encoding'] = as_bytes(texts[1])
        records['session'], records['picture'] = image.session, image.picture
        records['sources'], records['count'], records['index'] = sources, len(image.pieces), indexes
        records['flags'], records['refresh'] = INTRA if image.coded.intra else 0, image.refresh
        records['error'] = quality.to_byte(image.error)
        records['parameter_sets'] = as_bytes(sets[:length])
        records['data'] = [as_bytes(image.pieces[index]) for index in indexes]
        yield frame
