# SPDX-License-Identifier: BSD-3-Clause
"""Image streams: sensor_msgs/Image of any supported encoding in interleaved segments (D6.3, section 4)."""
import numpy as np
from sensor_msgs.msg import Image

from ..codecs import fill, interleave, pixels
from ..codecs.image import Picture
from ..msg import ImageSegment
from ..udpros import Frame
from .base import RobotStream
from .gather import GatheringReceiver
from .parameters import Parameter
from .segments import as_bytes, room, write_header


class ImageSender(RobotStream):
    """Cuts each picture so that every datagram shows all of it, coarsely."""
    MESSAGE, SEGMENT = Image, ImageSegment

    def __init__(self, name, settings, link):
        self._frames = {}   # {layout: subimage_frames}, of the last picture only
        super().__init__(name, settings, link)

    def frames(self, message):
        items = pixels.as_items(message.data, message.height, message.width, message.step, message.encoding)
        frame_id, encoding = message.header.frame_id.encode(), message.encoding.encode()
        left = room(ImageSegment, self.link.max_datagram_size, frame_id, encoding)
        cut, per_segment = interleave.fit(message.height, message.width, items.dtype.itemsize, left)
        subimages = cut.split(items).reshape(len(cut), -1).view(np.uint8)
        key = cut, per_segment, subimages.shape[1], len(frame_id), len(encoding)
        if key not in self._frames:
            self._frames = {key: subimage_frames(ImageSegment, subimages, per_segment, {
                'header.frame_id': len(frame_id), 'encoding': len(encoding)})}
        for part, frame in self._frames[key]:
            records = frame.records
            write_header(records, message.header)
            write_subimages(records, cut, part, subimages)
            records['height'], records['width'] = cut.height, cut.width
            records['encoding'] = as_bytes(encoding)
            records['is_bigendian'], records['total'] = bool(message.is_bigendian), len(cut)
        return [frame for _, frame in self._frames[key]]


def subimage_frames(segment_class, subimages, per_segment, lengths):
    """[(which subimages, Frame), ...]: the full segments of a cut, and a shorter last one.

    :param subimages: (n, size) array of bytes
    """
    full = len(subimages) // per_segment * per_segment
    parts = [(slice(0, full), per_segment), (slice(full, len(subimages)), len(subimages) - full)]
    size = subimages.shape[1]
    return [(part, Frame(segment_class, (part.stop - part.start) // count, {**lengths, 'data': count * size}))
            for part, count in parts if part.stop > part.start]


def write_subimages(records, cut, part, subimages):
    """Some subimages, as many in each record, with what tells where they belong."""
    count = (part.stop - part.start) // len(records)
    records['depth'] = cut.depth
    records['index'], records['count'] = cut.order[part][::count], count
    records['data'] = subimages[part].reshape(len(records), -1)


class ImageReceiver(GatheringReceiver):
    """Publishes each stamp's picture, made of what came of it."""
    MESSAGE, SEGMENT = Image, ImageSegment
    HEAD = 'height', 'width', 'encoding', 'is_bigendian', 'depth', 'total'
    PARAMETERS = {
        **GatheringReceiver.PARAMETERS,
        'fill': Parameter('nearest', '', 'how missing pixels are filled', choices=tuple(fill.METHODS)),
    }

    def __init__(self, name, settings, link):
        self._fill = fill.METHODS[settings['fill']]
        super().__init__(name, settings, link)

    def begin(self, head):
        return Picture(head.height, head.width, head.depth, pixels.item_type(head.encoding), head.total)

    def parts(self, records):
        return records['index'].astype(int), records['count'], records['data']

    def message(self, head, picture):
        items = picture.items(self._fill)
        return Image(height=head.height, width=head.width, encoding=head.encoding, is_bigendian=head.is_bigendian,
                     step=items.strides[0], data=items.tobytes())
