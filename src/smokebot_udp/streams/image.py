# SPDX-License-Identifier: BSD-3-Clause
"""Image streams: sensor_msgs/Image of any supported encoding in interleaved segments (D6.3, section 4)."""
import collections
import threading
import time

import numpy as np
import rospy
from sensor_msgs.msg import Image

from ..codecs import fill, interleave, pixels
from ..codecs.image import Picture
from ..msg import ImageSegment
from ..udpros import Frame
from ..udpros.datagram import OVERHEAD
from .base import OperatorStream, RobotStream
from .parameters import OPERATOR, ROBOT, Parameter
from .pictures import PictureSequence

FIXED_SIZE = 37
"""Bytes of an ImageSegment whose frame_id, encoding and data are empty."""

SHOWN_AT_MOST = 2
"""Finished pictures that wait to be filled and published; older ones give way."""


class ImageSender(RobotStream):
    """Cuts each picture so that every datagram shows all of it, coarsely."""
    MESSAGE, SEGMENT = Image, ImageSegment
    PARAMETERS = ROBOT

    def __init__(self, name, settings, link):
        self._frames = {}   # {layout: (Frame of full segments, Frame of the last one)}, of the last picture only
        super().__init__(name, settings, link)

    def frames(self, message):
        items = pixels.as_items(message.data, message.height, message.width, message.step, message.encoding)
        frame_id, encoding = message.header.frame_id.encode(), message.encoding.encode()
        room = self.link.max_datagram_size - OVERHEAD - FIXED_SIZE - len(frame_id) - len(encoding)
        cut, per_segment = interleave.fit(message.height, message.width, items.dtype.itemsize, room)
        subimages = cut.split(items).reshape(len(cut), -1).view(np.uint8)
        frames = []
        for start, stop, frame in self._layout(cut, per_segment, subimages.shape[1], len(frame_id), len(encoding)):
            records = frame.records
            stamp = message.header.stamp
            records['header']['stamp']['secs'], records['header']['stamp']['nsecs'] = stamp.secs, stamp.nsecs
            records['header']['frame_id'] = np.array(bytearray(frame_id), np.uint8)
            records['height'], records['width'], records['depth'] = cut.height, cut.width, cut.depth
            records['encoding'] = np.array(bytearray(encoding), np.uint8)
            records['is_bigendian'], records['total'] = bool(message.is_bigendian), len(cut)
            count = (stop - start) // len(frame)
            records['index'], records['count'] = cut.order[start:stop:count], count
            records['data'] = subimages[start:stop].reshape(len(frame), -1)
            frames.append(frame)
        return frames

    def _layout(self, cut, per_segment, size, *lengths):
        """[(first subimage, behind the last one, Frame), ...]: the full segments, and a shorter last one."""
        key = cut, per_segment, size, lengths
        if key not in self._frames:
            full = len(cut) // per_segment * per_segment
            parts = [(0, full, per_segment), (full, len(cut), len(cut) - full)]
            self._frames = {key: [
                (start, stop, Frame(ImageSegment, (stop - start) // count, {
                    'header.frame_id': lengths[0], 'encoding': lengths[1], 'data': count * size}))
                for start, stop, count in parts if stop > start]}
        return self._frames[key]


class ImageReceiver(OperatorStream):
    """Publishes each stamp's picture, made of what came of it."""
    MESSAGE, SEGMENT = Image, ImageSegment
    PARAMETERS = {
        **OPERATOR,
        'max_wait': Parameter(0.2, 's', 'a picture is shown at the latest so long after its first segment came',
                              above=0.0, most=60.0),
        'fill': Parameter('nearest', '', 'how missing pixels are filled', choices=tuple(fill.METHODS)),
    }

    def __init__(self, name, settings, link):
        self._sequence = PictureSequence(settings['max_wait'])
        self._fill = fill.METHODS[settings['fill']]
        self._finished = collections.deque(maxlen=SHOWN_AT_MOST)
        self._changed = threading.Condition()
        self._ended = False
        super().__init__(name, settings, link)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def take(self, records, mask):
        """Sort a batch of segments by their picture; the transport's thread."""
        rows = np.flatnonzero(mask)
        if not len(rows):
            return
        stamps = records['header']['stamp'][rows]
        stamps = stamps['secs'] * np.int64(10 ** 9) + stamps['nsecs']
        begins = np.flatnonzero(np.diff(stamps)) + 1
        with self._changed:
            for same in np.split(rows, begins):
                self._take_picture(records, same)
            self._changed.notify()

    def _take_picture(self, records, rows):
        head = ImageHead.of(records[rows[0]])
        same = head.matches(records, rows)
        self._sequence.dropped['contradiction'] += int(np.count_nonzero(~same))
        rows = rows[same]
        segments = records['index'][rows].astype(int), records['count'][rows], records['data'][rows]
        self._finished.extend(self._sequence.add(
            head.stamp, head.picture, lambda picture: picture.head == head, segments, time.monotonic()))

    def _run(self):
        while True:
            with self._changed:
                while not self._finished and not self._ended:
                    deadline = self._sequence.deadline
                    if deadline is not None and deadline <= time.monotonic():
                        self._finished.append(self._sequence.poll(time.monotonic()))
                    else:
                        self._changed.wait(None if deadline is None else deadline - time.monotonic())
                if self._ended:
                    return
                dated = self._finished.popleft()
            try:
                self.publish(self._message(dated.picture))
            except Exception as error:
                self.report('a picture is not shown: %s' % error)

    def _message(self, picture):
        head = picture.head
        message = Image(height=head.height, width=head.width, encoding=head.encoding, is_bigendian=head.is_bigendian)
        message.header.frame_id = head.frame_id
        message.header.stamp = rospy.Time(*divmod(head.stamp, 10 ** 9))
        items = picture.items(self._fill)
        message.step = items.strides[0]
        message.data = items.tobytes()
        return message

    def close(self):
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()
        super().close()


_HEAD_FIELDS = 'height', 'width', 'is_bigendian', 'depth', 'total'


class ImageHead(collections.namedtuple('ImageHead', ('stamp', 'frame_id', 'encoding') + _HEAD_FIELDS)):
    """What all segments of one picture say alike."""

    @classmethod
    def of(cls, record):
        stamp = record['header']['stamp']
        return cls(int(stamp['secs']) * 10 ** 9 + int(stamp['nsecs']),
                   record['header']['frame_id'].tobytes().decode('utf-8', 'replace'),
                   record['encoding'].tobytes().decode('utf-8', 'replace'),
                   *(int(record[field]) for field in _HEAD_FIELDS))

    def matches(self, records, rows):
        """(m,) bool: those of the rows that say the same; the stamp is known to be."""
        first = records[rows[0]]
        same = np.ones(len(rows), bool)
        for field in _HEAD_FIELDS:
            same &= records[field][rows] == first[field]
        for name, seen, wanted in (('frame_id', records['header'], first['header']), ('encoding', records, first)):
            same &= (seen[name][rows] == wanted[name]).all(axis=1)
        return same

    def picture(self):
        """An empty picture as described; ValueError where the description is impossible."""
        picture = Picture(self.height, self.width, self.depth, pixels.item_type(self.encoding), self.total)
        picture.head = self
        return picture
