# SPDX-License-Identifier: BSD-3-Clause
"""Image streams: sensor_msgs/Image of any supported encoding in interleaved segments (D6.3, section 4)."""
import time

import numpy as np
import rospy
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from ..codecs.concealment import fill
from ..codecs.concealment.temporal import Integrated, Memory, received
from ..codecs.wire import interleave, pixels
from ..codecs.wire.partial_image import Picture, mask_of
from ..congestion.operating_points import image_levels
from ..mission.parameters import Parameter
from ..msg import ImageSegment
from ..udpros import Frame
from ..udpros.endpoints import IP_UDP_HEADERS
from . import view
from .base import RobotStream
from .fill_time import CHEAPEST, PATIENCE, FillTime
from .gather import GatheringReceiver
from .parameters import ROBOT
from .segments import as_bytes, room, write_header

LARGEST_REMEMBERED = 1920 * 1200
"""Larger pictures are not integrated over time: it takes some 8 ms a megapixel, and 20 bytes a pixel [pixel]."""


class ImageSender(RobotStream):
    """Cuts each picture so that every datagram shows all of it, coarsely."""
    MESSAGE, SEGMENT = Image, ImageSegment
    PARAMETERS = {
        **ROBOT,
        'scale': Parameter(1, '', 'pictures are reduced by this factor first, by the mean of each block', least=1,
                           most=16, live=True),
        'max_subimages': Parameter(0, '', 'so many subimages are sent of a picture, coarse first; 0: all', least=0,
                                   most=65536, live=True),
        'taste': Parameter(0.75, '', 'what gives way on a slow link: 1: subimages, 0: pictures; between: both',
                           least=0.0, most=1.0, live=True),
    }
    _whole = None   # (subimages of a whole picture, subimages in a datagram, its bytes on the air)

    def levels(self, rate):
        return image_levels(rate, *self._whole, self.asked['taste']) if self._whole else []

    def refine(self, settings, spare):
        subimages, per_segment, size = self._whole
        count = settings['max_subimages'] or subimages
        more = int(spare / (settings['rate'] * size)) * per_segment
        return {**settings, 'max_subimages': 0 if count + more >= subimages else count + more}

    def frames(self, message):
        items = self._items(message)
        frame_id, encoding = message.header.frame_id.encode(), message.encoding.encode()
        left = room(ImageSegment, self.link.datagram_size, frame_id, encoding)
        cut, per_segment = interleave.fit(items.shape[0], items.shape[1], items.dtype.itemsize, left)
        total, asked = (min(settings['max_subimages'] or len(cut), len(cut))
                        for settings in (self.settings, self.asked))
        subimages = cut.split(items).reshape(len(cut), -1).view(np.uint8)[:total]
        # new ones each time: those of the last picture may still be leaving
        frames = subimage_frames(ImageSegment, subimages, per_segment, {
            'header.frame_id': len(frame_id), 'encoding': len(encoding)})
        self._whole = asked, per_segment, frames[0][1].datagram_size + IP_UDP_HEADERS
        for part, frame in frames:
            records = frame.records
            write_header(records, message.header)
            write_subimages(records, cut, part, subimages)
            records['height'], records['width'] = cut.height, cut.width
            records['encoding'] = as_bytes(encoding)
            records['is_bigendian'], records['total'] = bool(message.is_bigendian), total
        return [frame for _, frame in frames]

    def _items(self, message):
        """Its pixels as whole items, reduced where that is asked for."""
        layout = message.data, message.height, message.width, message.step, message.encoding
        if self.settings['scale'] == 1:
            return pixels.as_items(*layout)
        return pixels.reduce_by(pixels.as_pixels(*layout, message.is_bigendian), self.settings['scale'])


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
        'integrate': Parameter('when_still', '', 'when pixels of earlier pictures stand in for missing ones, unless '
                               'the scene changed there', choices=('never', 'when_still', 'always'), live=True),
        'remember': Parameter(5.0, 's', 'how old such a pixel may be', above=0.0, most=3600.0, live=True),
        'fill': Parameter(fill.BEST, '', 'how missing pixels are filled', choices=tuple(fill.METHODS), live=True),
        'fill_time': Parameter(0.1, 's', 'that may take so long, and no longer than pictures come apart; else they are '
                               'filled by %s for %g s' % (CHEAPEST, PATIENCE), above=0.0, most=60.0, live=True),
        'publish_mask': Parameter(False, '', "whether a mask comes out beside each picture, on mask in its topic's "
                                  'namespace: 255 where a pixel came, 128 where one of an earlier picture stands in, 0 '
                                  'where it is filled'),
        **view.PARAMETERS,
    }

    def __init__(self, name, settings, link):
        self._memory = Memory()
        self._view = self._masks = None
        self._fill_time = FillTime(settings['fill'])
        super().__init__(name, settings, link)

    def start(self):
        if self.settings['publish_mask']:
            self._masks = rospy.Publisher(rospy.names.namespace(self.topic) + 'mask', Image, queue_size=2,
                                          tcp_nodelay=True)
        if self.settings['view_topic']:
            self._view = view.ViewPublisher(self.settings, self.link.clock_offset)
        super().start()

    def configure(self, changes):
        super().configure(changes)
        self._fill_time = FillTime(self.settings['fill'])    # what was too slow may be tried again
        if self._view is not None:
            self._view.configure(self.settings)

    def close(self):
        super().close()
        if self._view is not None:
            self._view.close()
        if self._masks is not None:
            self._masks.unregister()

    def figures(self):
        problem = None
        if self._fill_time.method(time.monotonic()) != self.settings['fill']:
            problem = 'filled by %s, for %s takes too long' % (CHEAPEST, self.settings['fill'])
        return {**super().figures(), 'problem': problem}

    def begin(self, head):
        self._fill_time.came(head.stamp)
        return Picture(head.height, head.width, head.depth, pixels.item_type(head.encoding), head.total)

    def parts(self, records):
        return records['index'].astype(int), records['count'], records['data']

    def message(self, head, picture):
        channel, _ = pixels.pixel_type(head.encoding, head.is_bigendian)
        items, came = self._filled(picture, channel), received(picture.have, picture.cut)
        # nothing earlier stands in for a pixel of a whole picture: it need not wait for the memory, see `shown`
        integrated = (Integrated(items, came, 0.0, None) if picture.have.all()
                      else self._integrated(head, picture, items, channel, came))
        items, header = integrated.items, Header(stamp=rospy.Time(*divmod(head.stamp, 10 ** 9)), frame_id=head.frame_id)
        message = Image(height=head.height, width=head.width, encoding=head.encoding, is_bigendian=head.is_bigendian,
                        step=items.strides[0], data=items.tobytes())
        if self._view is not None:
            self._view.show(pixels.as_pixels(message.data, head.height, head.width, message.step, head.encoding,
                                             head.is_bigendian), head.encoding, header, integrated.share)
        if self._masks is not None and self._masks.get_num_connections():
            mask = mask_of(came, integrated.known)
            self._masks.publish(Image(header=header, height=head.height, width=head.width, encoding='mono8',
                                      step=head.width, data=mask.tobytes()))
        return message

    def shown(self, head, picture, message):
        if picture.have.all():
            channel, _ = pixels.pixel_type(head.encoding, head.is_bigendian)
            items = pixels.as_items(message.data, head.height, head.width, message.step, head.encoding)
            self._integrated(head, picture, items, channel, received(picture.have, picture.cut))

    def _filled(self, picture, channel):
        times, limit = self._fill_time, self.settings['fill_time']
        begun = time.monotonic()
        method = times.method(begun)
        items = picture.items(fill.METHODS[method], channel)
        now = time.monotonic()
        if times.took(now - begun, limit, now):
            rospy.logwarn_throttle(60, "stream '%s': filled by %s for a while: %s took %.0f ms" % (
                self.name, CHEAPEST, method, 1e3 * (now - begun)))
        return items

    def _integrated(self, head, picture, items, channel, came):
        """An Integrated: with what is remembered of earlier pictures (D6.3, section 4.2), where that is wanted."""
        when = self.settings['integrate']
        if when == 'never' or head.height * head.width > LARGEST_REMEMBERED:
            self._memory.forget()
            return Integrated(items, came, 0.0, None)
        use = when == 'always' or self.link.motion.stands()
        self._memory.max_age = self.settings['remember']
        integrated = self._memory.complete(items, picture.have, picture.cut, channel, time.monotonic(), use)
        self.link.motion.pictures(integrated.changed)
        return integrated
