# SPDX-License-Identifier: BSD-3-Clause
"""Image streams: raw or compressed images of any supported encoding, interleaved, layered or as video."""
import math
import os
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union

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
from ..encoder import Encoder, Sizing
from ..held import Holding
from ..parameters import HISTORY, ROBOT
from ..segments import INFO, LAYERS, MAIN_PART, VIDEO, size_on_air
from .camera_info import SETTING, info_topic
from .coding_choice import CodingChoice, Conditions
from .held_by_all import HeldByAll
from .image_size import Bound, Grant, grant, period_of
from .info_sender import InfoSender
from .interleaved_encoder import InterleavedImages
from .pixel_layers import cannot_be_layered
from .region import parse
from .source import ACCEPTED, SourceImage, source_image
from .video import cannot_be_video

MISSING = ('coding is h264, but PyAV is missing here: install python3-av (sudo apt install python3-av) and restart '
           'this node. Until then images are layered')
BROKEN = ('PyAV cannot be used here: %s: %s. Reinstall python3-av and restart this node. Until then images are not '
          'sent as video')
UNHEARD = 'video is not sent: %s. Until then images are layered'

NO_ROOM = ('coding is h264, but the link has no room for video of %d x %d pixels. Until it has, images are layered: a '
           'larger scale or a lower rate helps')

VIDEO_DATAGRAM = 1024
"""Datagrams of video are not shorter than this on slow links: libx264 makes no shorter slices [byte of UDP payload]."""

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
    TRAFFIC = traffic.IMAGES
    MESSAGE, SEGMENTS = Image, {MAIN_PART: ImageSegment, LAYERS: LayeredSegment, VIDEO: VideoSlice,
                                INFO: CameraInfoSegment}
    ACCEPTED = ACCEPTED
    FORESEES = True
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
        self._interleaved, self._layered = InterleavedImages(), None    # type: InterleavedImages, Any
        self._video: Any = None
        self._infos = InfoSender() if settings['camera_info'] else None
        self._broken = False            # whether there is a PyAV that cannot be used
        self._used: Union[InterleavedImages, Any] = self._interleaved   # for the last image
        self._size_wished = 0.0     # of an interleaved image, where it would be or is one; 0: it would not be [byte]
        self._unheard_since = math.inf      # since when not all operators receive video [s]
        if settings['coding'] != 'interleaved':
            self._codec.ready()     # loading begins now: the first operator sees no raw pixels for a second

    @staticmethod
    def check(settings: Mapping[str, Any]) -> None:
        parse(settings['region'])

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
        points: List[OperatingPoint] = self._used.operating_points(rate, settings)
        return points

    def refine(self, point: Mapping[str, Any], spare: float) -> Dict[str, Any]:
        # the coding may have changed since the point was made; compressed images take what is left over by themselves
        return self._interleaved.refine(point, spare) if 'max_subimages' in point else dict(point)

    def held(self, operator: str, holding: Holding) -> None:
        self._held.held(operator, holding)
        if self._video is not None:
            self._video.held(operator, holding, self._clock())

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Frame]:
        source = source_image(message, settings)
        message = source.message
        if source.problem:
            self.warnings.append(source.problem)
        if self._infos is not None:
            self._add_info(self._infos, source, settings['scale'], max(max_datagram_size, self.longest_datagram))
        for_video = max(max_datagram_size, min(self.longest_datagram, VIDEO_DATAGRAM))
        self._size_wished = 0.0
        self._used = self._chosen(message, settings, for_video)
        began = self._clock()
        self.wished = self._size_wished / AT_ONCE
        granted = self._grant(settings)
        if self._used is self._interleaved:
            frames: List[Frame] = self._interleaved.encode(message, settings, max_datagram_size,
                                                            self.outlook.in_air_time(settings))
        elif self._used is self._video:
            frames = self._video.encode(message, settings, for_video, self.outlook, granted, self.operators(VIDEO),
                                        began)
        else:
            frames = self._layered.encode(message, settings, max_datagram_size, self.outlook, granted,
                                          (self.operators(LAYERS), began))
            wished = self._layered.bound is Bound.MAX_QUALITY
            self._choice.took(self._clock() - began, 0.0 if wished else self._layered.error)
        self.backlog, self.base = self._used.BACKLOG, self._used.base
        self.message_size = size_on_air(frames) or self.message_size
        self.sizing = Sizing(self._used.CODING, granted.size, size_on_air(frames), self._used.bound.value,
                             self._used.error)
        return frames

    def _grant(self, settings: Settings) -> Grant:
        """What a compressed image may take on the air."""
        rest = max(self.waiting - self._used.coding_time, 0.0)      # what is left once this image is coded
        room = self.outlook.room * self.outlook.gain()
        return grant(settings, room, period_of(settings, self.source_rate or math.inf),
                     rest if rest <= (self._used.BACKLOG or 0.0) else 0.0)      # what takes longer is not awaited

    def _add_info(self, infos: InfoSender, source: SourceImage, scale: int, datagram_size: int) -> None:
        """Have the calibration of an image sent before it, if that is due."""
        try:
            self.beside += infos.frames(source, scale, self.operators(INFO), self._clock(), datagram_size)
        except ValueError as error:
            self.warnings.append('%s. It is not sent' % error)

    def _chosen(self, message: Any, settings: Settings, for_video: int) -> Any:
        """The way of coding of an image.

        :param for_video: longest datagram of video [byte of UDP payload]
        :raises ValueError: its encoding cannot be what it must be
        """
        if settings['coding'] == 'h264' and self._may_be_video(message, settings, for_video):
            return self._video if self._has_room(message, settings) else self._layered
        if (settings['coding'] != 'interleaved' and self._may_be_layered(message, settings)
                and self._is_better_layered(message, settings)):
            return self._layered
        return self._interleaved

    def _may_be_video(self, message: Any, settings: Settings, datagram_size: int) -> bool:
        """:raises ValueError: its encoding cannot be video"""
        reason = cannot_be_video(message, settings['scale'])
        if reason is not None:
            raise ValueError('coding is h264, but ' + reason)
        if not found('av'):
            self.warnings.append(MISSING)
            return False
        if not self._codec.ready() or not self._is_heard():
            return False
        return self._loaded() and bool(self._video.fits(message, datagram_size))

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

    def _is_heard(self) -> bool:
        """Whether all operators receive video now; warns of those that do not."""
        if self.heard(VIDEO):
            self._unheard_since = math.inf
            return True
        now = self._clock()
        self._unheard_since = min(self._unheard_since, now)
        missing = sorted({*self.operators(MAIN_PART), *self.operators(LAYERS)} - set(self.operators(VIDEO)))
        if missing and now - self._unheard_since > CONNECTED:
            self.warnings.append(UNHEARD % '; '.join('%s %s' % (name, self.why_not(VIDEO, name)) for name in missing))
        return False

    def _may_be_layered(self, message: Any, settings: Settings) -> bool:
        """:raises ValueError: it must be layered, and its encoding cannot be"""
        reason = cannot_be_layered(message, settings['scale'], settings['depth_unit'])
        if reason is not None:
            if settings['coding'] == 'layered':
                raise ValueError('coding is layered, but ' + reason)
            return False
        if not self._codec.ready() or not self.heard(LAYERS):
            return False
        if self._layered is None:
            from .layered_encoder import LayeredImages  # compiled
            self._layered = LayeredImages(self._held, self._session, self._clock)
        return True

    def _is_better_layered(self, message: Any, settings: Settings) -> bool:
        if settings['coding'] != 'auto':
            return True
        height, width = _reduced(message, settings)
        raw = RAW_OVERHEAD * height * width * pixels.item_type(message.encoding).itemsize
        now = self._clock()
        conditions = Conditions(
            raw if raw <= (settings['max_bytes'] or math.inf) else math.inf, self.outlook.room,
            self.outlook.loss(0.5) if self.outlook.air.known else None,
            1 / min(settings.requested['rate'], self.source_rate or math.inf),
            pixels.pixel_type(message.encoding)[0].itemsize == 1)
        layered = self._choice.update(conditions, now)
        self._size_wished = raw if self._choice.is_possible(conditions, now) else 0.0
        return layered

    def _has_room(self, message: Any, settings: Settings) -> bool:
        """Whether an image is video because the link has room for it, or because it cannot be layered."""
        height, width = _reduced(message, settings)
        room: bool = self._video.has_room(self.outlook.room * period_of(settings, self.source_rate or math.inf),
                                          width * height)
        if room or not self._may_be_layered(message, settings):
            return True
        self.warnings.append(NO_ROOM % (width, height))
        return False


def _reduced(message: Any, settings: Settings) -> Tuple[int, int]:
    """(height, width) of an image as it is coded."""
    return -(-message.height // settings['scale']), -(-message.width // settings['scale'])
