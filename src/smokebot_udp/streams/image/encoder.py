# SPDX-License-Identifier: BSD-3-Clause
"""Image streams: sensor_msgs/Image of any supported encoding, interleaved or layered."""
import math
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Union

from sensor_msgs.msg import Image

from ...codecs.wire import pixels
from ...congestion.operating_points import OperatingPoint
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import ImageSegment, LayeredSegment
from ...udpros.frame import Frame
from ..codec import Codec, ImportedCodec
from ..encoder import Encoder
from ..parameters import ROBOT
from ..segments import LAYERS, MAIN_PART, size_on_air
from .coding_choice import CodingChoice, Conditions
from .interleaved_encoder import InterleavedImages
from .pixel_layers import cannot_be_layered

LAYERED_BACKLOG = 0.05
"""The rest of a layered image is waited for this long: without it, the layers of high thresholds are lost [s]."""

RAW_OVERHEAD = 1.08
"""Size of interleaved images on the air, in terms of their pixels."""


class ImageEncoder(Encoder[Any]):
    """Sends images whose every datagram shows all of the image, by the way of coding that the settings name.

    :param codec: of layered images
    :param clock: steady; measures how long layered coding takes [s]
    """
    MESSAGE, SEGMENTS = Image, {MAIN_PART: ImageSegment, LAYERS: LayeredSegment}
    FORESEES = True
    PARAMETERS = {
        **ROBOT,
        'coding': Parameter('auto', '', 'interleaved: raw pixels; layered: compressed, with protection against '
                            'loss; auto: what shows the better image',
                            choices=('auto', 'interleaved', 'layered'), live=True),
        'scale': Parameter(1, '', 'reduction factor: each block of scale x scale pixels is replaced by its mean',
                           least=1, most=16, live=True),
        'max_subimages': Parameter(0, '', 'interleaved: number of subimages sent of each image, coarse first; 0: all',
                                   least=0, most=65536, live=True),
        'max_bytes': Parameter(0, 'byte', 'layered: maximum size of an image on the air, all headers included; 0: what '
                               'the link allows', least=0, most=1 << 24, live=True),
        'max_quality': Parameter(0.0, 'dB', 'layered: PSNR above which nothing more is sent, of the range of the '
                                 'encoding (255 or 65535 counts); 0: exact', least=0.0, most=150.0, live=True),
        'depth_unit': Parameter(0.0, 'm', 'layered: depth of one count of a 32FC1 image; 0: 32FC1 cannot be layered',
                                least=0.0, most=1.0, live=True),
        'degradation_preference': Parameter(
            0.75, '', 'what is reduced on a slow link: 1: quality (maintain the frame rate), 0: the frame rate '
            '(maintain quality); between: both', least=0.0, most=1.0, live=True),
    }

    def __init__(self, settings: Mapping[str, Any], codec: Optional[Codec] = None,
                 clock: Callable[[], float] = lambda: 0.0) -> None:
        super().__init__(settings)
        self._codec, self._clock = codec or ImportedCodec(), clock
        self._choice = CodingChoice()
        self._interleaved, self._layered = InterleavedImages(), None    # type: InterleavedImages, Any
        self._used: Union[InterleavedImages, Any] = self._interleaved   # for the last image

    def parts(self, settings: Settings) -> Sequence[str]:
        return [MAIN_PART] if settings['coding'] == 'interleaved' else [MAIN_PART, LAYERS]

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        points: List[OperatingPoint] = self._used.operating_points(rate, settings)
        return points

    def refine(self, point: Mapping[str, Any], spare: float) -> Dict[str, Any]:
        # the coding may have changed since the point was made
        used = self._interleaved if 'max_subimages' in point else self._layered
        refined: Dict[str, Any] = used.refine(point, spare)
        return refined

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Frame]:
        if self._may_be_layered(message, settings) and self._is_better_layered(message, settings):
            self._used = self._layered
            began = self._clock()
            frames: List[Frame] = self._layered.encode(message, settings, max_datagram_size, self.outlook)
            self._choice.took(self._clock() - began)
        else:
            self._used = self._interleaved
            frames = self._interleaved.encode(message, settings, max_datagram_size)
        self.backlog = LAYERED_BACKLOG if self._used is self._layered else None
        self.message_size = size_on_air(frames)
        return frames

    def _may_be_layered(self, message: Any, settings: Settings) -> bool:
        """:raises ValueError: it must be layered, and its encoding cannot be"""
        coding = settings['coding']
        if coding == 'interleaved':
            return False
        reason = cannot_be_layered(message, settings['scale'], settings['depth_unit'])
        if reason is not None:
            if coding == 'layered':
                raise ValueError('coding is layered, but ' + reason)
            return False
        if not self._codec.ready() or not self.heard(LAYERS):
            return False
        if self._layered is None:
            from .layered_encoder import LayeredImages  # compiled
            self._layered = LayeredImages()
        return True

    def _is_better_layered(self, message: Any, settings: Settings) -> bool:
        if settings['coding'] == 'layered':
            return True
        height, width = (-(-side // settings['scale']) for side in (message.height, message.width))
        raw = RAW_OVERHEAD * height * width * pixels.item_type(message.encoding).itemsize
        most, source_rate = settings.requested['max_bytes'] or math.inf, self.source_rate or math.inf
        return self._choice.update(Conditions(
            raw * min(settings.requested['rate'], source_rate) if raw <= most else math.inf, self.outlook.room,
            self.outlook.loss(0.5) if self.outlook.air.known else None, 1 / min(settings['rate'], source_rate)),
            self._clock())
