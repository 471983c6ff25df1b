# SPDX-License-Identifier: BSD-3-Clause
"""Image streams: raw or compressed images of any supported encoding, interleaved, layered or as video."""
import math
import os
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple

from sensor_msgs.msg import CameraInfo, Image

from ... import traffic
from ...codecs.wire import pixels
from ...congestion.operating_points import OperatingPoint
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import CameraInfoSegment, ImageSegment, LayeredSegment, VideoSlice
from ...optional import found
from ...udpros.frame import Frame
from ..codec import Codec, ImportedCodec
from ..encoder import Encoded, Encoder, LinkView, Sizing, Traits
from ..held import Holding
from ..parameters import HISTORY, ROBOT
from ..segments import INFO, LAYERS, MAIN_PART, VIDEO, size_on_air
from .camera_info import SETTING, info_topic, parse_region
from .coding import Coding
from .coding_choice import CodingChoice, Conditions
from .held_by_all import HeldByAll
from .image_size import Bound, Grant, grant, period_of
from .info_sender import InfoSender
from .interleaved_encoder import InterleavedImages
from .pixel_layers import cannot_be_layered
from .source import ACCEPTED, SourceImage, source_image
from .video import cannot_be_video

MISSING = ('coding is h264, but PyAV is missing here: install python3-av (sudo apt install python3-av) and restart '
           'this node. Until then images are layered')
BROKEN = ('PyAV cannot be used here: %s: %s. Reinstall python3-av and restart this node. Until then images are not '
          'sent as video')
UNHEARD = 'video is not sent: %s. Until then images are layered'

NO_ROOM = ('coding is h264, but the link has no room for video of %d x %d pixels. Until it has, images are layered: a '
           'larger scale or a lower rate helps')

CONNECTED = 5.0
"""Operators receive a part this long after it is offered; compiling takes longer [s]."""

AT_ONCE = 0.002
"""An interleaved image that leaves within this time is as fresh as can be [s]."""

RAW_OVERHEAD = 1.08
"""Size of interleaved images on the air, in terms of their pixels."""


class ImageEncoder(Encoder[Any]):
    """Sends images by the way of coding that the settings name.

    :param codec: of layered images, and of the parity pieces of video
    :param clock: steady [s]
    :param session: makes random numbers, uint32
    """
    traits = Traits(foresees=True, traffic=traffic.IMAGES)
    MESSAGE, SEGMENTS = Image, {MAIN_PART: ImageSegment, LAYERS: LayeredSegment, VIDEO: VideoSlice,
                                INFO: CameraInfoSegment}
    ACCEPTED = ACCEPTED
    PARAMETERS = {
        **ROBOT,
        **HISTORY,
        'coding': Parameter('auto', '', 'interleaved: raw pixels; layered: compressed, with protection against '
                            'loss; h264: video of 8-bit images, with protection against loss; auto: what shows the '
                            'better image', choices=('auto', 'interleaved', 'layered', 'h264'), live=True),
        'scale': Parameter(1, '', 'reduction factor: each block of scale x scale pixels is replaced by its mean',
                           least=1, most=16, live=True),
        'region': Parameter('', 'pixel', "the part of the source's images that is sent: x, y, width, height of a "
                            'rectangle, before scale; empty: all', live=True),
        'debayer': Parameter(False, '', 'interleaved: whether a Bayer mosaic is sent in colours, at three times the '
                             'size; by the other codings, and at a scale above 1, it always is', live=True),
        'camera_info': SETTING,
        'max_subimages': Parameter(0, '', 'interleaved: number of subimages sent of each image, coarse first; 0: all',
                                   least=0, most=65536, live=True),
        'max_bytes': Parameter(0, 'byte', 'layered, h264: maximum size of an image on the air, all headers included; '
                               '0: what the link has room for', least=0, most=1 << 24, live=True),
        'air_time': Parameter(0.0, 's', 'maximum time that an image takes of what the stream may use of the link; what '
                              'does not fit is not sent; 0: auto, up to 0.95 of the time between images, but less '
                              'where the scene moves fast', least=0.0, most=10.0, live=True),
        'max_quality': Parameter(0.0, 'dB', 'layered: PSNR above which nothing more is sent, of the range of the '
                                 'encoding (255 or 65535 counts); 0: exact', least=0.0, most=150.0, live=True),
        'depth_unit': Parameter(0.0, 'm', 'layered: depth of one count of a 32FC1 image; 0: 32FC1 cannot be layered',
                                least=0.0, most=1.0, live=True),
        'degradation_preference': Parameter(
            0.75, '', 'what is reduced on a slow link: 1: quality (maintain the frame rate), 0: the frame rate '
            '(maintain quality); between: both', least=0.0, most=1.0, live=True),
    }

    def __init__(self, settings: Mapping[str, Any], codec: Optional[Codec] = None,
                 clock: Callable[[], float] = lambda: 0.0,
                 session: Callable[[], int] = lambda: int.from_bytes(os.urandom(4), 'little')) -> None:
        super().__init__(settings)
        self._codec, self._clock, self._session = codec or ImportedCodec(), clock, session
        self._held = HeldByAll()
        self._choice = CodingChoice()
        self._interleaved = InterleavedImages()
        self._layered: Optional[Coding] = None
        self._video: Any = None
        self._infos = InfoSender() if settings['camera_info'] else None
        self._broken = False            # whether there is a PyAV that cannot be used
        self._used: Coding = self._interleaved      # for the last image
        self._size_wished = 0.0     # of an interleaved image, where it would be or is one; 0: it would not be [byte]
        self._unheard_since = math.inf      # since when not all operators receive video [s]
        if settings['coding'] != 'interleaved':
            self._codec.ready()     # loading begins now: the first operator sees no raw pixels for a second

    @staticmethod
    def check(settings: Mapping[str, Any]) -> None:
        parse_region(settings['region'])

    def parts(self, settings: Settings) -> Sequence[str]:
        further = {'interleaved': [], 'h264': [LAYERS] + [VIDEO] * found('av')}.get(settings['coding'], [LAYERS])
        return [MAIN_PART, *further, *([INFO] if self._infos is not None else [])]

    def sources(self, settings: Mapping[str, Any]) -> Dict[str, Any]:
        return {info_topic(settings['robot_topic']): CameraInfo} if self._infos is not None else {}

    def takes(self, message: Any) -> bool:
        if self._infos is None or not isinstance(message, CameraInfo):
            return False
        self._infos.add(message)
        return True

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        return self._used.operating_points(rate, settings)

    def refine(self, point: Mapping[str, Any], spare: float) -> Dict[str, Any]:
        # the coding may have changed since the point was made; compressed images take what is left over by themselves
        return self._interleaved.refine(point, spare) if 'max_subimages' in point else dict(point)

    def held(self, operator: str, holding: Holding) -> None:
        self._held.held(operator, holding)
        if self._video is not None:
            self._video.held(operator, holding, self._clock())

    def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
        source = source_image(message, settings)
        message = source.message
        if source.problem:
            self.warnings.append(source.problem)
        self._size_wished = 0.0
        used = self._used = self._chosen(message, settings, link)
        began, granted = self._clock(), _grant(used, settings, link)
        coded = used.encode(message, settings, link, granted, began)
        if used is self._layered:
            self._choice.took(self._clock() - began, 0.0 if coded.bound is Bound.MAX_QUALITY else coded.error)
        beside = [] if self._infos is None else self._info(self._infos, source, settings['scale'], link)
        size = size_on_air(coded.frames)
        self.message_size = size or self.message_size
        return Encoded(coded.frames, beside, coded.base, used.backlog(link), self._size_wished / AT_ONCE,
                       Sizing(used.CODING, granted.size, size, coded.bound.value, coded.error))

    def _info(self, infos: InfoSender, source: SourceImage, scale: int, link: LinkView) -> List[Frame]:
        """The calibration of an image, if it is due."""
        try:
            return infos.frames(source, scale, link.operators(INFO), self._clock(),
                                max(link.datagram_size, link.longest_datagram))
        except ValueError as error:
            self.warnings.append('%s. It is not sent' % error)
            return []

    def _chosen(self, message: Any, settings: Settings, link: LinkView) -> Coding:
        """The way of coding of an image.

        :raises ValueError: its encoding cannot be what it must be
        """
        if settings['coding'] == 'h264' and self._may_be_video(message, settings, link):
            if self._has_room(message, settings, link):
                video: Coding = self._video
                return video
        elif settings['coding'] == 'interleaved' or not self._may_be_layered(message, settings, link) or (
                not self._is_better_layered(message, settings, link)):
            return self._interleaved
        assert self._layered is not None
        return self._layered

    def _may_be_video(self, message: Any, settings: Settings, link: LinkView) -> bool:
        """:raises ValueError: its encoding cannot be video"""
        reason = cannot_be_video(message, settings['scale'])
        if reason is not None:
            raise ValueError('coding is h264, but ' + reason)
        if not found('av'):
            self.warnings.append(MISSING)
            return False
        if not self._codec.ready() or not self._is_heard(link):
            return False
        return self._loaded() and bool(self._video.fits(message, link))

    def _loaded(self) -> bool:
        """Whether PyAV could be imported, which is tried once."""
        if self._video is None and not self._broken:
            try:
                from .video_encoder import VideoImages  # imports PyAV
                self._video = VideoImages(self._session)
            except Exception as error:      # PyAV of another Python, a missing library, no libx264, ...
                self._broken = True
                self.warnings.append(BROKEN % (type(error).__name__, error))
        return self._video is not None

    def _is_heard(self, link: LinkView) -> bool:
        """Whether all operators receive video now; warns of those that do not."""
        if link.heard(VIDEO):
            self._unheard_since = math.inf
            return True
        now = self._clock()
        self._unheard_since = min(self._unheard_since, now)
        missing = sorted({*link.operators(MAIN_PART), *link.operators(LAYERS)} - set(link.operators(VIDEO)))
        if missing and now - self._unheard_since > CONNECTED:
            self.warnings.append(UNHEARD % '; '.join('%s %s' % (name, link.why_not(VIDEO, name)) for name in missing))
        return False

    def _may_be_layered(self, message: Any, settings: Settings, link: LinkView) -> bool:
        """:raises ValueError: it must be layered, and its encoding cannot be"""
        reason = cannot_be_layered(message, settings['scale'], settings['depth_unit'])
        if reason is not None:
            if settings['coding'] == 'layered':
                raise ValueError('coding is layered, but ' + reason)
            return False
        if not self._codec.ready() or not link.heard(LAYERS):
            return False
        if self._layered is None:
            from .layered_encoder import LayeredImages  # compiled
            self._layered = LayeredImages(self._held, self._session, self._clock)
        return True

    def _is_better_layered(self, message: Any, settings: Settings, link: LinkView) -> bool:
        if settings['coding'] != 'auto':
            return True
        height, width = _reduced(message, settings)
        raw = RAW_OVERHEAD * height * width * pixels.item_type(message.encoding).itemsize
        now = self._clock()
        conditions = Conditions(
            raw if raw <= (settings['max_bytes'] or math.inf) else math.inf, link.outlook.room,
            link.outlook.loss(0.5) if link.outlook.air.known else None,
            1 / link.frame_rate(settings.requested),
            pixels.pixel_type(message.encoding)[0].itemsize == 1)
        layered = self._choice.update(conditions, now)
        self._size_wished = raw if self._choice.is_possible(conditions, now) else 0.0
        return layered

    def _has_room(self, message: Any, settings: Settings, link: LinkView) -> bool:
        """Whether an image is video because the link has room for it, or because it cannot be layered."""
        height, width = _reduced(message, settings)
        room: bool = self._video.has_room(link.outlook.room * period_of(link.frame_rate(settings)),
                                          width * height)
        if room or not self._may_be_layered(message, settings, link):
            return True
        self.warnings.append(NO_ROOM % (width, height))
        return False


def _grant(coding: Coding, settings: Settings, link: LinkView) -> Grant:
    """What a compressed image may take on the air."""
    rest = max(link.waiting - coding.coding_time, 0.0)      # what is left once this image is coded
    awaited = rest if rest <= (coding.backlog(link) or 0.0) else 0.0    # what takes longer is not awaited
    return grant(settings, link.outlook.room * link.outlook.gain(), period_of(link.frame_rate(settings)), awaited)


def _reduced(message: Any, settings: Settings) -> Tuple[int, int]:
    """(height, width) of an image as it is coded."""
    return -(-message.height // settings['scale']), -(-message.width // settings['scale'])
