# SPDX-License-Identifier: BSD-3-Clause
"""Segments to sensor_msgs/Image. Each part has a coding of its own, and a receiver of it.

An image is not published if nothing of it can be restored, or if its reference is not held. The image before it stays,
and its age grows.
"""
import functools
from types import SimpleNamespace
from typing import Any, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
from sensor_msgs.msg import Image

from ...arrays import BoolArray, Records
from ...codecs.concealment import fill
from ...codecs.concealment.successive import SuccessiveImages
from ...codecs.wire.partial_image import PartialImage
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import CameraInfoSegment, ImageSegment, LayeredSegment, VideoSlice
from ..assembler import Clock, no_clock
from ..concealment_budget import CHEAPEST, FALLBACK
from ..frame_assembler import Frame
from ..held import Holding
from ..segments import INFO, LAYERS, MAIN_PART, VIDEO
from ..stamped_assembler import StampedAssembler
from .assembled import Receiver, ShownImage
from .camera_info import SETTING
from .info_history import InfoHistory
from .interleaved_receiver import InterleavedReceiver
from .layered import LayeredImage
from .layered_receiver import LayeredReceiver
from .size_guard import SizeGuard
from .video import VideoImage
from .video_receiver import Decoder, VideoReceiver
from .view import PARAMETERS as VIEW

Content = Union[PartialImage, LayeredImage, VideoImage]


class ImageAssembler(StampedAssembler[Content, ShownImage]):
    """Makes one image of each stamp's segments. All parts may be received in turns: the newest stamp counts.

    :param clock: measures how long concealment takes [s]
    :param decoder: of video images; None: there are none
    """
    MESSAGE, SEGMENTS = Image, {MAIN_PART: ImageSegment, LAYERS: LayeredSegment, VIDEO: VideoSlice,
                                INFO: CameraInfoSegment}
    COMPILED, DECODED = frozenset([LAYERS, VIDEO]), frozenset([VIDEO])
    HEADS = {MAIN_PART: InterleavedReceiver.HEAD, LAYERS: LayeredReceiver.HEAD, VIDEO: VideoReceiver.HEAD}
    HOLDS_SHOWN = True
    REPORT_INTERVAL = 0.03
    PARAMETERS = {
        **StampedAssembler.PARAMETERS,
        'integrate': Parameter('when_still', '', 'interleaved: when pixels of earlier images replace missing ones, '
                               'unless the scene has changed there', choices=('never', 'when_still', 'always'),
                               live=True),
        'remember': Parameter(5.0, 's', 'maximum age of such a pixel', above=0.0, most=3600.0, live=True),
        'fill': Parameter(fill.BEST, '', 'concealment method for missing pixels', choices=tuple(fill.METHODS),
                          live=True),
        'fill_time': Parameter(0.1, 's', 'longest time for concealment; the frame period limits it, too. If it takes '
                               'longer, %s is used for %g s' % (CHEAPEST, FALLBACK), above=0.0, most=60.0, live=True),
        'publish_mask': Parameter(False, '', 'whether a mask is published with each image, on mask in the namespace of '
                                  'its topic: 255: received pixel, 128: pixel of an earlier image, 0: concealed pixel; '
                                  'all over a layered or video image 255 - error byte (doc/wire_format.md); 255: '
                                  'exact'),
        'camera_info': SETTING,
        'publish_compressed': Parameter(False, '', 'whether images are also published compressed, on compressed below '
                                        'operator_topic, as by image_transport: 8 bits as JPEG, 16 bits as PNG'),
        **VIEW,
    }

    def __init__(self, settings: Mapping[str, Any], clock: Clock = no_clock, decoder: Optional[Decoder] = None
                 ) -> None:
        super().__init__(settings, clock)
        guard, successive = SizeGuard(), SuccessiveImages()
        self._interleaved = InterleavedReceiver(clock, self.warnings)
        self._receivers: Mapping[str, Receiver[Any, Any]] = {
            MAIN_PART: self._interleaved, LAYERS: LayeredReceiver(guard, successive, self.dropped),
            VIDEO: VideoReceiver(decoder, guard, successive, self.dropped)}
        self._infos = InfoHistory(self.dropped) if settings.get('camera_info') else None
        self._held: Optional[Holding] = None    # what is reported
        self._received = 0.0    # when the last batch was [s]

    def subscribed(self) -> Sequence[str]:
        return [part for part in self.SEGMENTS if part != INFO or self._infos is not None]

    def receive(self, records: Records, mask: BoolArray, now: float, part: str = MAIN_PART) -> None:
        if part == INFO:
            if self._infos is not None:
                for row in np.flatnonzero(mask):
                    self._infos.receive(records[row])
            return
        self._received = now
        super().receive(records, mask, now, part)

    def begin(self, head: SimpleNamespace) -> Content:
        content: Content = self._receivers[head.part].begin(head, self._received)
        return content

    def began(self, head: SimpleNamespace) -> None:
        self._frames.configure(max_finished=self._receivers[head.part].MAX_FINISHED)
        if head.part == MAIN_PART:
            self._interleaved.began(head)

    def parts(self, records: Records, part: str) -> Tuple[Any, ...]:
        return self._receivers[part].parts(records)

    def assemble(self, finished: Frame[Content], settings: Settings, still: bool, now: float) -> Optional[ShownImage]:
        receiver = self._receivers[finished.head.part]
        shown: Optional[ShownImage] = receiver.assemble(finished, settings, still, now)
        self._held = receiver.holding   # at once: another thread reads it
        if shown is not None and self._infos is not None:
            shown.camera_info = functools.partial(self._infos.of, shown.stamp, shown.message.height,
                                                  shown.message.width)
        return shown

    def settle(self, finished: Frame[Content], assembled: ShownImage, settings: Settings, now: float) -> None:
        self._receivers[finished.head.part].settle(finished, assembled, settings, now)

    def holding(self) -> Optional[Holding]:
        return self._held

    def problem(self, settings: Settings, now: float) -> Optional[str]:
        if self._interleaved.falls_back(settings, now):
            return 'filled by %s because %s takes too long' % (CHEAPEST, settings['fill'])
        if self._infos is not None and self._infos.unknown:
            return 'the camera_info of its images is not known: is it published beside robot_topic, of their size?'
        return None
