# SPDX-License-Identifier: BSD-3-Clause
"""Images as raw pixels in interleaved segments (D6.3, section 4): every datagram shows the image, at low resolution."""
from typing import Any, Dict, List, Mapping, NamedTuple, Optional

import numpy as np

from ...arrays import Array
from ...codecs.wire import interleave, pixels
from ...congestion.operating_points import OperatingPoint, image_points
from ...mission.settings import Settings
from ...msg import ImageSegment
from ...udpros.datagram import IP_UDP_HEADERS
from ...udpros.frame import Frame
from ..encoder import LinkView
from ..segments import as_bytes, room, write_header
from ..subimages import subimage_frames, write_subimages
from .coding import Coded, Coding
from .image_size import Bound, Grant


class _Requested(NamedTuple):
    """Size of an image on the wire with the requested settings."""
    subimages: int
    per_segment: int
    datagram: int
    """[byte of IP packet]"""


class InterleavedImages(Coding):
    """Encodes images, and knows the size of the last one."""
    CODING = 'interleaved'

    def __init__(self) -> None:
        self._requested: Optional[_Requested] = None

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        if self._requested is None:
            return []
        return image_points(rate, *self._requested, settings.requested['degradation_preference'])

    def refine(self, point: Mapping[str, Any], spare: float) -> Dict[str, Any]:
        """As Encoder.refine."""
        if self._requested is None:
            return dict(point)
        subimages, per_segment, datagram = self._requested
        count = (point['max_subimages'] or subimages) + int(spare / (point['rate'] * datagram)) * per_segment
        if count < subimages:
            return {**point, 'max_subimages': count}
        # the requested max_subimages stays in effect: 0 would be all subimages
        return {name: value for name, value in point.items() if name != 'max_subimages'}

    def encode(self, message: Any, settings: Settings, link: LinkView, granted: Grant, began: float) -> Coded:
        """Whatever is granted, all subimages are sent that leave within `air_time`."""
        items = _items(message, settings['scale'])
        frame_id, encoding = message.header.frame_id.encode(), message.encoding.encode()
        cut, per_segment = interleave.fit(items.shape[0], items.shape[1], items.dtype.itemsize,
                                          room(ImageSegment, link.datagram_size, frame_id, encoding))
        total, requested = (min(values['max_subimages'] or len(cut), len(cut))
                            for values in (settings, settings.requested))
        if settings['air_time']:
            most = settings['air_time'] * link.outlook.room
            total = min(total, per_segment * int(max(1.0, min(most / (link.datagram_size + IP_UDP_HEADERS), total))))
        subimages = cut.split(items).reshape(len(cut), -1).view(np.uint8)[:total]
        parts = subimage_frames(ImageSegment, subimages, per_segment, {
            'header.frame_id': len(frame_id), 'encoding': len(encoding)})
        for part, frame in parts:
            records = frame.records
            write_header(records, message.header)
            write_subimages(records, cut, part, subimages)
            records['height'], records['width'] = cut.height, cut.width
            records['encoding'] = as_bytes(encoding)
            records['is_bigendian'], records['total'] = bool(message.is_bigendian), total
        frames: List[Frame] = [frame for _, frame in parts]
        self._requested = _Requested(requested, per_segment, frames[0].datagram_size + IP_UDP_HEADERS)
        return Coded(frames, Bound.EXACT if total == len(cut) else Bound.ROOM)


def _items(message: Any, scale: int) -> Array:
    """The pixels of an Image, one item each: (height, width), reduced by a factor."""
    layout = message.data, message.height, message.width, message.step, message.encoding
    if scale == 1:
        return pixels.as_items(*layout)
    return pixels.whole(pixels.reduce_by(pixels.as_pixels(*layout, message.is_bigendian), scale))
