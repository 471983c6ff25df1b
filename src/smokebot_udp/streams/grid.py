# SPDX-License-Identifier: BSD-3-Clause
"""Grid streams: nav_msgs/OccupancyGrid, reduced, in interleaved segments, in rounds (D6.3, section 5)."""
import math
import threading
import time
import zlib

import numpy as np
import rospy
from geometry_msgs.msg import Point, Pose, Quaternion
from nav_msgs.msg import MapMetaData, OccupancyGrid
from rospy.numpy_msg import numpy_msg
from std_msgs.msg import Header

from ..codecs.concealment import fill
from ..codecs.wire import grid, pixels
from ..codecs.wire.partial_image import Picture
from ..congestion.operating_points import map_levels
from ..mission.parameters import Parameter
from ..msg import GridSegment
from ..udpros.endpoints import IP_UDP_HEADERS
from .base import OperatorStream, RobotStream
from .image import subimage_frames, write_subimages
from .parameters import OPERATOR, ROBOT
from .rate import Repeater
from .rounds import Rounds
from .segments import head_of, room, same_head, stamps_of, write_header

CELL = pixels.item_type('mono8')
FILLS = {'unknown': grid.unknown, 'nearest': fill.nearest}


class GridSender(RobotStream):
    """Sends a changed map at once, and the same one in rounds."""
    STEADY = False
    MESSAGE, SEGMENT = numpy_msg(OccupancyGrid), GridSegment
    PARAMETERS = {
        **ROBOT,
        'repeat_rate': Parameter(0.2, 'Hz', 'an unchanged map is sent again so often, for what was lost and who came '
                                 'late', above=0.0, most=100.0, live=True),
        'max_cells': Parameter(1300, '', 'cells of a segment', least=1, most=65000, live=True),
        'max_segments': Parameter(256, '', 'a map is reduced until so many carry it', least=1, most=65536, live=True),
    }

    def __init__(self, name, settings, link):
        self._last = None       # the newest map
        self._content = None    # what the frames carry
        self._whole = None      # (segments of the map as it is asked for, bytes of each on the air)
        self._frames, self._header = [], None
        self._rounds = Repeater(name + ' rounds', self._send_round, self._report, 1.0 / settings['repeat_rate'])
        super().__init__(name, settings, link)

    def start(self):
        super().start()
        self._rounds.start()

    def prepare(self):
        super().prepare()
        self._rounds.period = 1.0 / self.settings['repeat_rate']

    def peer_subscribe(self, topic_name, topic_publish, peer_publish):
        """Who came late gets the map at once."""
        self._rounds.wake()

    def _receive(self, message):
        # even where nobody listens yet: a map may come but once
        self._last = message
        self._worker.give(message)

    def _change(self, make):
        super()._change(make)
        if self._last is not None:
            self._worker.give(self._last)   # it is cut anew where the settings now have it otherwise

    def levels(self, rate):
        return map_levels(self.asked['repeat_rate'], *self._whole) if self._whole else []

    def _send(self, message):
        frames = self.frames(message)
        if frames is not None:
            self._frames, self._header = frames, message.header
            self.sent += 1
            self._rounds.wake()

    def frames(self, message):
        """The frames that carry a changed map; None where its content is what the last one's was."""
        info = message.info
        cells = grid.as_cells(message.data, info.height, info.width, info.resolution)
        check_origin(info.origin)
        frame_id = message.header.frame_id.encode()
        (factor, cut, per_segment), (_, whole, in_each) = (grid.fit(
            info.height, info.width, room(GridSegment, self.link.datagram_size, frame_id),
            settings['max_cells'], settings['max_segments']) for settings in (self.settings, self.asked))
        cells = grid.reduce_by(cells, factor)
        content = frame_id, str(info.origin), info.resolution, factor, cut, per_segment, zlib.crc32(cells.tobytes())
        if content == self._content:
            self._header = message.header
            return None
        self._content = content
        subimages = cut.split(cells).reshape(len(cut), -1)
        frames = subimage_frames(GridSegment, subimages, per_segment, {'header.frame_id': len(frame_id)})
        self._whole = -(-len(whole) // in_each), frames[0][1].datagram_size + IP_UDP_HEADERS
        for part, frame in frames:
            write_header(frame.records, message.header)
            write_subimages(frame.records, cut, part, subimages)
            write_info(frame.records['info'], info, cut, factor)
        return [frame for _, frame in frames]

    def _send_round(self):
        frames = self._frames
        if frames and self.wanted and not self.link.outbox.sends(self.name, frames):
            for frame in frames:
                write_header(frame.records, self._header)
            self.put(frames)

    def close(self):
        self._rounds.stop()
        super().close()


def check_origin(origin):
    """:raises ValueError: where a map's place is no place"""
    for part in (origin.position, origin.orientation):
        for axis in part.__slots__:
            if not math.isfinite(getattr(part, axis)):
                raise ValueError('origin.%s is %r' % (axis, getattr(part, axis)))


def write_info(records, info, cut, factor):
    """The MapMetaData of the reduced map, into all segments."""
    for unit in ('secs', 'nsecs'):
        records['map_load_time'][unit] = getattr(info.map_load_time, unit)
    records['resolution'], records['width'], records['height'] = info.resolution * factor, cut.width, cut.height
    for part in ('position', 'orientation'):
        values = getattr(info.origin, part)
        for axis in values.__slots__:
            records['origin'][part][axis] = getattr(values, axis)


class GridReceiver(OperatorStream):
    """Publishes the map, latched, as far as its rounds have brought it; in a thread of its own."""
    MESSAGE, SEGMENT = numpy_msg(OccupancyGrid), GridSegment
    LATCH, STEADY = True, False
    HEAD = 'info', 'depth'
    PARAMETERS = {
        **OPERATOR,
        'max_wait': Parameter(0.5, 's', 'a map is shown at the latest so long after its first segment that is news',
                              above=0.0, most=60.0, live=True),
        'fill': Parameter('nearest', '', 'what becomes of cells that never came', choices=tuple(FILLS),
                          live=True),
    }

    def __init__(self, name, settings, link):
        self._rounds = Rounds(settings['max_wait'])
        self._last = None      # content of the last map published
        self._changed = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        super().__init__(name, settings, link)

    def start(self):
        super().start()
        self._thread.start()

    def configure(self, changes):
        super().configure(changes)
        with self._changed:
            self._rounds.max_wait = self.settings['max_wait']

    @property
    def dropped(self):
        return self._rounds.dropped

    def take(self, records, mask):
        """Sort a batch of segments by their map; the transport's thread."""
        rows = np.flatnonzero(mask)
        with self._changed:
            while len(rows):
                same = same_head(records, rows, self.HEAD)
                stamps = stamps_of(records, rows)
                same &= stamps == stamps[0]
                self._take_map(head_of(records[rows[0]], GridSegment, self.HEAD), records[rows[same]])
                rows = rows[~same]
            self._changed.notify()

    def _take_map(self, head, records):
        load_time, *lies = head.info    # the same map may be loaded anew
        self._rounds.add(head, (head.frame_id, head.depth, lies), lambda: begin(head),
                         (records['index'].astype(int), records['count'], records['data'].view(np.uint8)),
                         time.monotonic())

    def _run(self):
        while True:
            with self._changed:
                while not self._ended:
                    deadline, now = self._rounds.deadline, time.monotonic()
                    if deadline is not None and deadline <= now:
                        break
                    self._changed.wait(None if deadline is None else deadline - now)
                if self._ended:
                    return
                head, picture = self._rounds.poll(now)
                completeness = picture.completeness
                cells = picture.items(FILLS[self.settings['fill']]).view(np.int8)
            try:
                self._show(head, cells, completeness)
            except Exception as error:
                self.report('a map is not shown: %s' % error)

    def _show(self, head, cells, completeness):
        """Publish a map, unless it is what is shown already: rounds repeat it."""
        self.received += 1
        content = head.frame_id, head.info, zlib.crc32(cells)
        if content == self._last:
            return
        self._last = content
        load_time, resolution, width, height, (position, orientation) = head.info
        stamp = rospy.Time(*divmod(head.stamp, 10 ** 9))
        self.publish(self.MESSAGE(
            header=Header(stamp=stamp, frame_id=head.frame_id),
            info=MapMetaData(rospy.Time(*load_time), resolution, width, height,
                             Pose(Point(*position), Quaternion(*orientation))),
            data=cells.reshape(-1)), stamp, completeness)

    def close(self):
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()
        super().close()


def begin(head):
    """An empty map as described; ValueError where the description is impossible."""
    _, resolution, width, height, (position, orientation) = head.info
    if not (math.isfinite(resolution) and resolution > 0 and all(map(math.isfinite, position + orientation))):
        raise ValueError('a map of resolution %r at %r' % (resolution, position))
    return Picture(height, width, head.depth, CELL)
