# SPDX-License-Identifier: BSD-3-Clause
"""Segments to sensor_msgs/Image.

Of interleaved images missing pixels come from earlier images or are concealed (D6.3, section 4.2). Layered images are
decoded from all layers that can be restored when the image is finished. Video images are decoded in their order, from
the slices that came or can be restored. Of an image of which nothing can be restored nothing is published: the one
before goes on growing old. Nor is one whose reference is not held.
"""
import functools
import math
from types import SimpleNamespace
from typing import Any, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
from sensor_msgs.msg import Image

from ...arrays import Array, BoolArray, Records
from ...codecs.concealment import fill
from ...codecs.concealment.successive import SuccessiveImages
from ...codecs.concealment.temporal import FilteredImage, TemporalFilter
from ...codecs.layered.quality import from_byte
from ...codecs.wire.bayer import CELLS, from_cells
from ...codecs.wire.partial_image import PartialImage
from ...codecs.wire.pixels import OF_CELLS, item_type, pixel_type
from ...image_error import EIGHT_BITS, ImageError
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import CameraInfoSegment, ImageSegment, LayeredSegment, VideoSlice
from ..assembler import Clock, no_clock
from ..concealment_budget import CHEAPEST, FALLBACK, ConcealmentBudget
from ..frame_assembler import MAX_FINISHED, Frame
from ..held import Holding
from ..segments import INFO, LAYERS, MAIN_PART, VIDEO
from ..stamped_assembler import StampedAssembler, header_of
from .assembled import AssembledImage, DecodedImage, MosaicImage, RestoredImage, ShownImage
from .camera_info import SETTING
from .held_images import HeldImages
from .info_history import InfoHistory
from .layered import LayeredImage
from .pixel_layers import Layerable, restored
from .size_guard import SizeGuard
from .video import VideoImage
from .video_sequence import Decoder, VideoSequence
from .view import PARAMETERS as VIEW

LARGEST_INTEGRATED = 1920 * 1200
"""Larger images are not integrated over time: it takes some 8 ms a megapixel, and 20 bytes a pixel [pixel]."""

MAX_FINISHED_VIDEO = 8
"""Video images that wait to be decoded: those after a lost one are worse."""

VIDEO_ERROR = 4.0
"""Assumed rms error of video images where it is not known and they are compared [count]."""

Content = Union[PartialImage, LayeredImage, VideoImage]


class ImageAssembler(StampedAssembler[Content, ShownImage]):
    """Makes one image of each stamp's segments. All parts may be received in turns: the newest stamp counts.

    :param clock: measures how long concealment takes [s]
    :param decoder: of video images; None: there are none
    """
    MESSAGE, SEGMENTS = Image, {MAIN_PART: ImageSegment, LAYERS: LayeredSegment, VIDEO: VideoSlice,
                                INFO: CameraInfoSegment}
    COMPILED, DECODED = frozenset([LAYERS, VIDEO]), frozenset([VIDEO])
    HEADS = {
        MAIN_PART: ('height', 'width', 'encoding', 'is_bigendian', 'depth', 'total'),
        LAYERS: ('height', 'width', 'encoding', 'is_bigendian', 'depth_unit', 'count', 'thresholds', 'sizes', 'errors',
                 'session', 'picture', 'reference', 'reference_layers', 'checksum'),
        VIDEO: ('height', 'width', 'encoding', 'session', 'picture', 'sources', 'count', 'flags', 'refresh', 'error')}
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
        self._budget = ConcealmentBudget()
        self._filter = TemporalFilter()
        self._successive = SuccessiveImages()
        self._guard = SizeGuard()
        self._images = HeldImages(self.dropped)
        self._video = VideoSequence(decoder, self.dropped) if decoder is not None else None
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
        if head.part == LAYERS:
            return LayeredImage(head, self._guard, self._received)
        if head.part == VIDEO:
            return VideoImage(head, self._guard, self._received)
        return PartialImage(head.height, head.width, head.depth, item_type(head.encoding), head.total)

    def began(self, head: SimpleNamespace) -> None:
        self._frames.configure(max_finished=MAX_FINISHED_VIDEO if head.part == VIDEO else MAX_FINISHED)
        if head.part == MAIN_PART:
            self._budget.frame_began(head.stamp)

    def parts(self, records: Records, part: str) -> Tuple[Any, ...]:
        if part == LAYERS:
            return records['index'].astype(int), records['data']
        if part == VIDEO:
            return records['index'].astype(int), records['parameter_sets'], records['data']
        return records['index'].astype(int), records['count'], records['data']

    def assemble(self, finished: Frame[Content], settings: Settings, still: bool, now: float) -> Optional[ShownImage]:
        shown = self._shown(finished, settings, still, now)
        if shown is not None and self._infos is not None:
            shown.camera_info = functools.partial(self._infos.of, shown.stamp, shown.message.height,
                                                  shown.message.width)
        return shown

    def _shown(self, finished: Frame[Content], settings: Settings, still: bool, now: float) -> Optional[ShownImage]:
        head, image = finished.head, finished.content
        shown: Optional[ShownImage]
        holding = None      # interleaved images are not reported
        if isinstance(image, LayeredImage):
            shown, holding = self._restored(head, image, settings, now), self._images.holding
        elif isinstance(image, VideoImage):
            shown, holding = self._decoded(head, image, now), self._video.holding if self._video is not None else None
        else:
            shown = self._assembled(head, image, settings, still, now)
        self._held = holding    # at once: another thread reads it
        return shown

    def _restored(self, head: SimpleNamespace, image: LayeredImage, settings: Settings,
                  now: float) -> Optional[RestoredImage]:
        """The image of the layers that were received; None: it cannot be decoded."""
        pixels, error = self._images.decode(image, now), image.error_byte
        if pixels is None or error is None:
            return None
        self._guard.good(image.shape.cells, now)
        restored = RestoredImage(_message(head, pixels, head.is_bigendian), head.stamp, None, error, pixels)
        rms = from_byte(error) * (head.depth_unit or 1.0)
        restored.error = ImageError(rms, EIGHT_BITS) if image.shape.itemsize == 1 else ImageError(
            rms, None, settings['counts_per_unit'], settings['unit'])
        return restored

    def _decoded(self, head: SimpleNamespace, image: VideoImage, now: float) -> Optional[DecodedImage]:
        """The image that follows the last video image; None: nothing can be shown."""
        if self._video is None:
            return None
        pixels = self._video.decode(head, image)
        if pixels is None:
            return None
        self._guard.good(image.shape.cells, now)
        shown = restored(Layerable(pixels, None, head.encoding, 0.0), False)
        known, rms = image.completeness, self._video.error
        decoded = DecodedImage(_message(head, shown, 0), head.stamp, None, pixels, known)
        if math.isfinite(rms):
            decoded.error = ImageError(rms, EIGHT_BITS)
        else:
            decoded.completeness = known
        return decoded

    def _assembled(self, head: SimpleNamespace, image: PartialImage, settings: Settings, still: bool,
                   now: float) -> AssembledImage:
        """The image of the pixels that were received."""
        filtered = FilteredImage(self._concealed(head, image, settings), image.received, None)
        # no earlier pixel replaces one of a complete image: it need not wait for the filter, see `settle`
        if not image.have.all():
            filtered = self._filtered(head, image, filtered, settings, still, now)
        class_, message = AssembledImage, _message(head, filtered.items, head.is_bigendian)
        if head.encoding in OF_CELLS:
            class_, message = MosaicImage, _mosaic(head, filtered.items)
        assembled = class_(message, head.stamp, image.completeness, image.received, filtered)
        assembled.changed = filtered.changed
        return assembled

    def settle(self, finished: Frame[Content], assembled: ShownImage, settings: Settings, now: float) -> None:
        head, image = finished.head, finished.content
        if isinstance(image, PartialImage) and isinstance(assembled, AssembledImage) and image.have.all():
            assembled.changed = self._filtered(head, image, assembled.filtered, settings, False, now).changed
        if isinstance(assembled, RestoredImage) and assembled.error is not None and settings['integrate'] != 'never':
            assembled.changed = self._successive.changed(assembled.pixels, assembled.error.rms)

        if isinstance(assembled, DecodedImage) and settings['integrate'] != 'never':
            rms = VIDEO_ERROR if assembled.error is None else assembled.error.rms
            assembled.changed = self._successive.changed(assembled.pixels, rms)

    def holding(self) -> Optional[Holding]:
        return self._held

    def problem(self, settings: Settings, now: float) -> Optional[str]:
        if settings['fill'] != CHEAPEST and self._budget.falls_back(now):
            return 'filled by %s because %s takes too long' % (CHEAPEST, settings['fill'])
        if self._infos is not None and self._infos.unknown:
            return 'the camera_info of its images is not known: is it published beside robot_topic, of their size?'
        return None

    def _concealed(self, head: SimpleNamespace, image: PartialImage, settings: Settings) -> Array:
        """(height, width) array of whole pixels, the missing ones concealed."""
        began = self._clock()
        method = self._budget.method(settings['fill'], settings['fill_time'], began)
        channel, _ = pixel_type(head.encoding, head.is_bigendian)
        items = image.items(fill.METHODS[method], channel)
        now = self._clock()
        if self._budget.took(method, now - began, now):
            self.warnings.append('images are filled by %s for %g s: %s takes longer than fill_time or the frame period'
                                 % (CHEAPEST, FALLBACK, method))
        return items

    def _filtered(self, head: SimpleNamespace, image: PartialImage, concealed: FilteredImage, settings: Settings,
                  still: bool, now: float) -> FilteredImage:
        """The image with pixels of earlier ones (D6.3, section 4.2), as `integrate` demands."""
        if settings['integrate'] == 'never' or head.height * head.width > LARGEST_INTEGRATED:
            self._filter.reset()
            return concealed
        self._filter.max_age = settings['remember']
        channel, _ = pixel_type(head.encoding, head.is_bigendian)
        return self._filter.apply(image, concealed.items, channel, now, still or settings['integrate'] == 'always')


def _message(head: SimpleNamespace, pixels: Array, is_bigendian: int) -> Image:
    """The image of a head's encoding.

    :param pixels: (height, width, ...) array, C-contiguous
    """
    return Image(header=header_of(head), height=head.height, width=head.width, encoding=head.encoding,
                 is_bigendian=is_bigendian, step=pixels.strides[0], data=pixels.tobytes())


def _mosaic(head: SimpleNamespace, items: Array) -> Image:
    """The image of a head whose encoding is one of OF_CELLS.

    :param items: (height, width) array of cells
    """
    channel, channels = pixel_type(head.encoding, head.is_bigendian)
    pixels = from_cells(items.view(channel).reshape(head.height, head.width, channels))
    whole = SimpleNamespace(**{**vars(head), 'height': pixels.shape[0], 'width': pixels.shape[1],
                               'encoding': head.encoding[:-len(CELLS)]})
    return _message(whole, pixels, head.is_bigendian)
