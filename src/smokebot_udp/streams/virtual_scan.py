# SPDX-License-Identifier: BSD-3-Clause
"""Virtual 2D scan streams: the obstacles or the landmarks of a point cloud as a laser scan (D6.3, section 6.2).

After the deliverable's reference [2], see codecs/virtual_scan.py. The scan is published on the robot, too, where it
serves localisation and navigation. It crosses like any scan: its ranges are whole millimetres, so in two datagrams.
"""
import math
import threading
import time

import numpy as np
import rospy
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan, PointCloud2

from ..codecs.perception import virtual_scan
from ..codecs.perception.ground import GroundFinder
from ..codecs.wire.points import as_points
from ..codecs.wire.scan import in_millimetres
from ..mission.parameters import Parameter
from ..msg import ScanSegment
from .base import RobotStream
from .parameters import ROBOT
from .rate import RateLimiter
from .scan import ScanReceiver, scan_frames

Scan = numpy_msg(LaserScan)
SELECT = 'obstacle', 'landmark'
FAN_SETTINGS = ('base_frame', 'mount_height', 'mount_roll', 'mount_pitch', 'min_height', 'slope', 'range_min',
                'range_max')
"""Streams that agree in these share the work."""



class LevelFrame:
    """Takes clouds into a level frame on the ground by tf; one listener for all streams of the process."""
    _buffer = None
    _lock = threading.Lock()

    @classmethod
    def transform(cls, frame, header):
        """(3, 3) rotation and (3,) translation from a cloud's frame at its stamp; None where tf does not know it."""
        import tf2_ros  # a second to import, and needed here only
        with cls._lock:
            if cls._buffer is None:
                cls._buffer = tf2_ros.Buffer()
                cls._listener = tf2_ros.TransformListener(cls._buffer)
        for stamp in (header.stamp, rospy.Time(0)):    # the mount hardly moves: the latest one will do
            try:
                found = cls._buffer.lookup_transform(frame, header.frame_id, stamp).transform
            except tf2_ros.TransformException:
                continue
            q, t = found.rotation, found.translation
            return rotation(q.x, q.y, q.z, q.w), np.array([t.x, t.y, t.z], np.float32)
        return None


def rotation(x, y, z, w):
    """(3, 3) float32 of a unit quaternion."""
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]], np.float32)


def mounting(roll, pitch):
    """(3, 3) float32: from the axes of a tilted sensor to level ones (REP-103: pitch > 0 looks down)."""
    return (rotation(0, math.sin(pitch / 2), 0, math.cos(pitch / 2))
            @ rotation(math.sin(roll / 2), 0, 0, math.cos(roll / 2)))


class Fans:
    """Clouds without their ground, worked out once for all streams that see the same message alike."""

    def __init__(self):
        self._lock = threading.Lock()
        self._message = self._settings = self._result = None
        self._place, self._finder = None, None    # (frame, height of its origin), and the finder for it

    def of(self, message, settings):
        """A cloud's virtual_scan.Fan, and the frame it is in."""
        mine = [settings[name] for name in FAN_SETTINGS]
        with self._lock:
            if message is not self._message or mine != self._settings:
                self._result = self._work_out(message, *mine)
                self._message, self._settings = message, mine
            return self._result

    def _work_out(self, message, base_frame, mount_height, roll, pitch, min_height, slope, range_min, range_max):
        points, _ = as_points(message.data, message.fields, message.height, message.width, message.point_step,
                              message.row_step, message.is_bigendian)
        if not len(points):
            raise ValueError('none of its %d points is finite' % (message.height * message.width))
        place = message.header.frame_id, mount_height
        known = LevelFrame.transform(base_frame, message.header) if base_frame else None
        points = points[points.any(axis=1)]     # drivers write what did not come back as (0, 0, 0)
        if known is not None:
            turn, shift = known
            points, place = points @ turn.T + shift, (base_frame, 0.0)
        elif roll or pitch:
            points = points @ mounting(roll, pitch).T
        if place != self._place:
            self._place, self._finder = place, GroundFinder(place[1])
        return virtual_scan.fan(points, self._finder.find(points), tolerance=min_height, slope=slope,
                                range_min=range_min, range_max=range_max), place[0]


FANS = {}
"""{robot topic: Fans}: the streams of one topic share them."""


class VirtualScanSender(RobotStream):
    """Publishes a scan of each cloud on the robot, and sends it."""
    MESSAGE, SEGMENT = PointCloud2, ScanSegment
    PARAMETERS = {
        **ROBOT,
        'select': Parameter('obstacle', '', 'the nearest obstacles, or as landmarks the farthest walls', choices=SELECT,
                            live=True),
        'scan_topic': Parameter('', '', "where the scan is published on the robot; empty: the stream's name"),
        'base_frame': Parameter('base_link', '',
                                'a level frame on the floor; where tf does not know it the mount counts'),
        'mount_height': Parameter(0.9, 'm', "of the sensor above the floor", least=0.0, most=100.0, live=True),
        'mount_roll': Parameter(0.0, 'rad', 'of the sensor', least=-1.6, most=1.6, live=True),
        'mount_pitch': Parameter(0.0, 'rad', 'of the sensor; > 0 looks down', least=-1.6, most=1.6, live=True),
        'min_height': Parameter(0.1, 'm', 'what rises less above the ground is ground', least=0.0, most=10.0,
                                live=True),
        'slope': Parameter(0.0, '', 'and so much more for each metre away, where the floor is uneven', least=0.0,
                           most=1.0, live=True),
        'max_height': Parameter(1.2, 'm', 'what hangs higher is no obstacle: more than the robot', above=0.0,
                                most=100.0, live=True),
        'range_min': Parameter(0.3, 'm', 'what is nearer is the robot itself', least=0.0, most=10.0, live=True),
        'range_max': Parameter(60.0, 'm', 'what is farther is not seen', above=0.0, most=1000.0, live=True),
    }

    def __init__(self, name, settings, link):
        self._scan_topic = settings['scan_topic'] or name
        super().__init__(name, settings, link)
        self._fans = FANS.setdefault(self.topic, Fans())

    def prepare(self):
        # however slow the link is, the robot has all scans that are asked for
        self._worker.set_rate(self.asked['rate'])
        self._limiter = RateLimiter(self.settings['rate'])
        for low, high in (('min_height', 'max_height'), ('range_min', 'range_max')):
            if self.settings[low] >= self.settings[high]:
                raise ValueError('%s is %g, not below %s, %g' % (low, self.settings[low], high, self.settings[high]))

    def start(self):
        self._scans = rospy.Publisher(self._scan_topic, Scan, queue_size=2)
        super().start()

    @property
    def wanted(self):
        return super().wanted or self._scans.get_num_connections() > 0

    def _send(self, message):
        scan = self.scan(self._told_apart(message))
        self._scans.publish(scan)
        if super().wanted and not self._limiter.wait(time.monotonic()):
            self._limiter.take(time.monotonic())
            self.put(scan_frames(scan, False, self.link.datagram_size))
            self.sent += 1

    def scan(self, message):
        """The LaserScan of a PointCloud2."""
        settings = self.settings
        fan, frame = self._fans.of(message, settings)
        if settings['select'] == 'obstacle':
            ranges = virtual_scan.obstacle_scan(fan, settings['max_height'])
        else:
            ranges = virtual_scan.landmark_scan(fan)
        finite = np.isfinite(ranges)
        ranges[finite] = in_millimetres(np.rint(ranges[finite] * 1000))
        scan = Scan(angle_min=virtual_scan.ANGLE_MIN, angle_increment=virtual_scan.INCREMENT,
                    angle_max=virtual_scan.ANGLE_MIN + (virtual_scan.COLUMNS - 1) * virtual_scan.INCREMENT,
                    range_min=settings['range_min'], range_max=settings['range_max'], ranges=ranges,
                    intensities=np.zeros(0, np.float32))
        scan.header.stamp, scan.header.frame_id = message.header.stamp, frame
        return scan

    def close(self):
        super().close()
        self._scans.unregister()


class VirtualScanReceiver(ScanReceiver):
    """What comes is a scan like any."""
