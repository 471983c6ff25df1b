#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What sensors really send, through robot_sender and operator_receiver without loss and at 20 %: numbers that
contradict the data, nothing at all, stamps that say little, frames with a slash, doubles in UTM, formats of other
pixels."""
import collections
import pathlib
import sys
import threading
import unittest
from typing import Any, Callable, Counter, Dict, List, Sequence

import cv2
import numpy as np
import rospy
import rostest
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import CompressedImage, Image, LaserScan, PointCloud2, PointField
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import is_sent_here, ticks, wait_for

from smokebot_udp.codecs.display.view import COLOURS, FRESH, FROZEN
from smokebot_udp.codecs.wire.compressed import DEPTH
from smokebot_udp.streams.source_clock import PROOF, REPEATS

PLACES = {0: '', 20: '/loss20'}
"""{loss [%]: namespace of the receiver}"""

UTM = 412345.125, 5401234.5, 312.0625
"""A place in UTM coordinates [m]."""

NUMBERS, LEAST = 100, 85
"""Scans that are sent, and shown at 20 % loss: of 4 in 100 both datagrams are lost."""

ECHOES = 'first', 'last', 'strongest'

MOUNT, WALL = 0.9, 5.0
"""Height of the sensor above the floor, and distance of a wall from the sensor [m]."""


class Shown:
    """What is published of a stream at each loss, but for blank messages in place of old ones."""

    def __init__(self, name: str, class_: Any) -> None:
        self._messages: Dict[int, List[Any]] = {loss: [] for loss in PLACES}
        self._lock = threading.Lock()
        self._subscribers = [rospy.Subscriber('%s/operator/%s' % (place, name), class_, self._take, loss,
                                              queue_size=1000, buff_size=1 << 25) for loss, place in PLACES.items()]

    def _take(self, message: Any, loss: int) -> None:
        with self._lock:
            self._messages[loss].append(message)

    def wait_connected(self) -> None:
        for subscriber in self._subscribers:
            wait_for(lambda name=subscriber.resolved_name: is_sent_here(name), 60, subscriber.resolved_name)

    def clear(self) -> None:
        with self._lock:
            for messages in self._messages.values():
                del messages[:]

    def at(self, loss: int, blank: bool = False) -> List[Any]:
        """The messages since `clear`."""
        with self._lock:
            return [message for message in self._messages[loss] if blank or message.header.stamp]

    def wait_for(self, what: str, test: Callable[[Any], bool] = lambda message: True) -> Dict[int, Any]:
        """At each loss the first message with which a test is true."""
        return {loss: wait_for(lambda at=loss: [one for one in self.at(at) if test(one)][:1], 20, '%s at %d %% loss' % (
            what, loss))[0] for loss in PLACES}


def header(frame_id: str = 'lens', stamp: Any = None) -> Header:
    return Header(stamp=rospy.Time.now() if stamp is None else stamp, frame_id=frame_id)


def cloud(points: Any, frame_id: str = 'lidar', dtype: str = '<f4', **changes: Any) -> PointCloud2:
    """A PointCloud2 of (rows, columns, 3) or (n, 3) points, of now."""
    values = np.asarray(points, dtype).reshape(-1, 3)
    height, width = points.shape[:2] if points.ndim == 3 else (1, len(points))
    size = values.itemsize
    message = PointCloud2(
        header=header(frame_id), height=height, width=width, point_step=3 * size, row_step=3 * size * width,
        data=values.tobytes(), fields=[PointField(name, size * i, 4 + {4: 3, 8: 4}[size], 1) for i, name in enumerate(
            'xyz')])
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def xyz(message: PointCloud2) -> Any:
    """(n, 3), sorted."""
    dtype = {PointField.FLOAT32: '<f4', PointField.FLOAT64: '<f8'}[message.fields[0].datatype]
    found = np.frombuffer(message.data, dtype).reshape(-1, 3)
    return found[np.lexsort(found.T)]


def grid() -> Any:
    """(20, 30, 3) float32"""
    return np.random.RandomState(1).uniform(-9, 9, (20, 30, 3)).astype(np.float32)


def scan(number: int, frame_id: str, stamp: Any = None) -> LaserScan:
    """A scan whose ranges say its number, in millimetres."""
    return LaserScan(header=header(frame_id, stamp), angle_min=-1.8, angle_increment=0.005, angle_max=1.795,
                     range_max=9.0, ranges=[(1000 + number) / 1000] * 720)


def number_of(message: LaserScan) -> int:
    """The number of a scan of which at least a part came."""
    return int(round(1000 * float(np.nanmin(message.ranges)))) - 1000


def state(view: Image) -> Any:
    """The colour of a view's frame."""
    return tuple(np.frombuffer(view.data, np.uint8)[:3].tolist())


class OddSources(unittest.TestCase):
    warnings: Counter[str]

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('odd_sources')
        cls.warnings = collections.Counter()
        rospy.Subscriber('/rosout', Log, cls.take_log, queue_size=1000)
        wait_for(lambda: is_sent_here('/rosout', '/robot_sender'), 60, "the robot's log")
        cls.sources = {topic: rospy.Publisher(topic, class_, queue_size=100) for topic, class_ in (
            ('/organised/points', PointCloud2), ('/utm/points', PointCloud2), ('/slashed/points', PointCloud2),
            ('/ray', LaserScan), ('/echoes', LaserScan), ('/whole_seconds', LaserScan), ('/uptime/image_raw', Image),
            ('/deep/image_raw/compressed', CompressedImage))}
        cls.shown = {name: Shown(name, class_) for name, class_ in (
            ('organised/points', PointCloud2), ('utm/points', PointCloud2), ('slashed/scan', LaserScan),
            ('ray', LaserScan), ('echoes', LaserScan), ('whole_seconds', LaserScan), ('uptime/image_raw', Image),
            ('uptime/view', Image), ('deep/image_raw', Image))}
        for source in cls.sources.values():
            wait_for(source.get_num_connections, 60, source.name)
        for shown in cls.shown.values():
            shown.wait_connected()
        cls.flow('/organised/points', 'organised/points', lambda: cloud(grid()))
        cls.flow('/utm/points', 'utm/points', lambda: cloud(grid()))
        cls.flow('/echoes', 'echoes', lambda: scan(0, 'other'))
        cls.flow('/whole_seconds', 'whole_seconds', lambda: scan(0, 'other'))
        cls.flow('/ray', 'ray', lambda: scan(0, 'other'))

    @classmethod
    def flow(cls, topic: str, name: str, make: Callable[[], Any]) -> None:
        """Wait until a stream reaches both receivers: what is sent before is lost."""
        def flows() -> bool:
            cls.sources[topic].publish(make())
            return all(cls.shown[name].at(loss) for loss in PLACES)
        wait_for(flows, 60, 'a first message of ' + name)

    @classmethod
    def take_log(cls, log: Any) -> None:
        # a source that is silent between two tests is none of them
        if log.level >= Log.WARN and log.name == '/robot_sender' and 'but nothing comes' not in log.msg:
            cls.warnings[log.msg] += 1

    def setUp(self) -> None:
        for shown in self.shown.values():
            shown.clear()

    def told(self, *words: str) -> int:
        """How often a warning or an error with these words was logged."""
        return sum(count for text, count in list(self.warnings.items()) if all(word in text for word in words))

    def wait_told(self, *words: str) -> None:
        wait_for(lambda: self.told(*words), 20, 'a warning: ' + ' '.join(words))

    def send(self, topic: str, name: str, make: Callable[[], Any], test: Callable[[Any], bool]) -> Dict[int, Any]:
        """Publish messages until one that passes a test is shown at each loss."""
        def comes() -> bool:
            self.sources[topic].publish(make())
            return all(any(map(test, self.shown[name].at(loss))) for loss in PLACES)
        wait_for(comes, 20, 'what is wanted of ' + name)
        return {loss: next(one for one in self.shown[name].at(loss) if test(one)) for loss in PLACES}

    # -- numbers that contradict the data, and nothing at all

    def test_the_data_of_an_organised_cloud_decide(self) -> None:
        for row_step in (0, 20 * 30 * 12):
            self.shown['organised/points'].clear()
            found = self.send('/organised/points', 'organised/points', lambda step=row_step: cloud(
                grid(), row_step=step), lambda one: one.width == 600)
            for message in found.values():
                np.testing.assert_array_equal(xyz(message), xyz(cloud(grid())))
        self.wait_told("stream 'organised'", 'row_step is', 'by the data it is 360')
        self.assertEqual(self.told("stream 'organised'", 'by the data it is'), 1)      # whatever row_step is

    def test_nothing_seen_clears_the_display(self) -> None:
        nothing = np.full((2, 3, 3), np.nan)
        for make in (lambda: cloud(nothing[:0, 0]), lambda: cloud(nothing)):
            self.shown['organised/points'].clear()
            self.send('/organised/points', 'organised/points', lambda: cloud(grid()), lambda one: one.width > 0)
            self.shown['organised/points'].clear()
            self.send('/organised/points', 'organised/points', make, lambda one: one.width == 0)
        self.assertEqual(self.told("stream 'organised'", 'finite'), 0)

    def test_a_single_ray_needs_no_increment(self) -> None:
        def ray() -> LaserScan:
            return LaserScan(header=header('ray'), angle_min=0.5, angle_max=0.5, angle_increment=float('nan'),
                             range_max=9.0, ranges=[2.5])
        found = self.send('/ray', 'ray', ray, lambda one: len(one.ranges) == 1)
        for message in found.values():
            self.assertEqual((message.ranges, message.angle_min, message.angle_increment), ((2.5,), 0.5, 0.0))
        self.wait_told("stream 'ray'", 'angle_increment is nan')
        self.assertEqual(self.told("stream 'ray'"), 1)

    # -- stamps that say little

    def play(self, topic: str, make: Callable[[int], Sequence[Any]], skipped: int = 0) -> None:
        """Publish the scans of numbers, as fast as they are shown without loss.

        :param make: f(number) -> the scans
        :param skipped: how many of the first numbers need not be shown
        """
        for number in range(NUMBERS):
            scans = make(number)
            for message in scans:
                self.sources[topic].publish(message)
            if number >= skipped:
                wait_for(lambda scans=scans, number=number: {one.header.frame_id for one in scans} <= {
                    one.header.frame_id for one in self.shown[topic[1:]].at(0) if number_of(one) == number}, 10,
                    'scan %d of %s' % (number, topic))

    def numbers(self, name: str, frame_id: str) -> int:
        """How many scans of a frame were shown at 20 % loss, of which any part came."""
        return len({number_of(one) for one in self.shown[name].at(20) if one.header.frame_id == frame_id})

    def test_echoes_of_one_stamp_are_told_apart_by_their_frames(self) -> None:
        def echoes(number: int) -> List[LaserScan]:
            stamp = rospy.Time.now()
            return [scan(number, frame_id, stamp) for frame_id in ECHOES]
        self.play('/echoes', echoes)
        wait_for(lambda: min(self.numbers('echoes', frame_id) for frame_id in ECHOES) >= LEAST, 20,
                 '%d of each echo at 20 %%' % LEAST)
        self.assertEqual(self.told("stream 'echoes'"), 0)

    def test_stamps_of_whole_seconds_are_named_once_and_replaced(self) -> None:
        self.play('/whole_seconds', lambda number: [scan(number, 'seconds', rospy.Time(rospy.Time.now().secs))],
                  REPEATS + 1)
        wait_for(lambda: self.numbers('whole_seconds', 'seconds') >= LEAST, 20, '%d scans at 20 %%' % LEAST)
        self.assertEqual(self.told("stream 'whole_seconds'", 'repeats its stamps'), 1)
        for loss in PLACES:
            self.assertEqual({one.header.stamp.nsecs for one in self.shown['whole_seconds'].at(loss)
                              if one.header.frame_id == 'seconds'}, {0})

    def test_a_source_that_counts_from_its_start_is_fresh(self) -> None:
        begun, pixels = rospy.Time.now() - rospy.Duration(1234), np.full((48, 64), 90, np.uint8)

        def publish() -> None:
            stamp = rospy.Time(0) + (rospy.Time.now() - begun)
            self.sources['/uptime/image_raw'].publish(Image(
                header=header('lens', stamp), height=48, width=64, encoding='mono8', step=64, data=pixels.tobytes()))
        for _ in zip(range(2 * PROOF), ticks(10.0)):
            publish()
        self.wait_told("stream 'uptime'", 'of another epoch')

        tick = ticks(10.0)

        def fresh() -> bool:
            next(tick)
            publish()
            views = {loss: self.shown['uptime/view'].at(loss)[-1:] for loss in PLACES}
            return all(shown and state(shown[0]) == COLOURS[FRESH] for shown in views.values())
        wait_for(fresh, 30, 'a fresh view')
        for loss in PLACES:
            self.assertLess(self.shown['uptime/image_raw'].at(loss)[-1].header.stamp.to_sec(), 2000.0)
        for loss in PLACES:     # while nothing comes it is old, as any other
            wait_for(lambda at=loss: state(self.shown['uptime/view'].at(at)[-1]) == COLOURS[FROZEN], 20, 'an old view')
        self.assertEqual(self.told("stream 'uptime'"), 1)

    # -- frames

    def test_a_frame_with_a_slash_is_the_one_that_tf_knows(self) -> None:
        static = rospy.Publisher('/tf_static', TFMessage, queue_size=5, latch=True)
        self.addCleanup(static.unregister)
        static.publish(TFMessage([TransformStamped(header('base_link'), 'slashed', Transform(
            Vector3(0, 0, MOUNT), Quaternion(0, 0, 0, 1)))]))
        angles = np.radians(np.arange(-180, 180, 0.5))
        floor = [(r * np.cos(a), r * np.sin(a), -MOUNT) for r in np.arange(1, 4, 0.25) for a in angles]
        wall = [(WALL, y, z - MOUNT) for y in np.arange(-3, 3, 0.02) for z in (0.3, 0.6, 0.9)]
        points = np.array(floor + wall)
        found = self.send('/slashed/points', 'slashed/scan', lambda: cloud(points, '/slashed'),
                          lambda one: one.header.frame_id == 'base_link' and bool(np.isfinite(one.ranges[360])))
        for message in found.values():
            self.assertAlmostEqual(message.ranges[360], WALL, delta=0.02)
            # of all rays in the direction of the wall none sees the floor as an obstacle
            ranges = np.float32(message.ranges)[300:420]
            self.assertGreater(ranges[np.isfinite(ranges)].min(), 4.9)

    def test_a_frame_that_tf_does_not_know_is_told(self) -> None:
        self.send('/slashed/points', 'slashed/scan', lambda: cloud(grid(), '/nowhere'),
                  lambda one: one.header.frame_id == '/nowhere')
        self.wait_told("stream 'slashed'", "tf knows no transform from 'nowhere' to 'base_link'")

    def test_a_frame_with_a_slash_gets_no_second_prefix(self) -> None:
        shown: List[str] = []
        subscriber = rospy.Subscriber('/prefixed/operator/ray', LaserScan, lambda one: shown.append(
            one.header.frame_id))
        self.addCleanup(subscriber.unregister)

        def comes() -> bool:
            for frame_id in ('/robot_0/own', '/bare'):
                self.sources['/ray'].publish(scan(0, frame_id))
            return {'robot_0/own', 'robot_0/bare'} <= set(shown)
        wait_for(comes, 60, 'frames with a prefix, not only %s' % shown)
        self.assertNotIn('robot_0/robot_0/own', shown)

    # -- precision, and formats of other pixels

    def test_doubles_in_utm_keep_their_precision(self) -> None:
        exact = np.random.RandomState(0).uniform(-20, 20, (500, 3)) + UTM
        exact[7, 0] = 1e12      # a wild value costs the others nothing
        found = self.send('/utm/points', 'utm/points', lambda: cloud(exact, dtype='<f8'), lambda one: (
            one.width > 200 and one.fields[0].datatype == PointField.FLOAT64))
        for message in found.values():
            points = xyz(message)
            points = points[np.abs(points[:, 0]) < 1e9]
            nearest = np.abs(points[:, np.newaxis] - exact).max(axis=2).min(axis=1)
            self.assertLess(nearest.max(), 0.002)
        self.wait_told("stream 'utm'", 'coordinates of FLOAT64 are rounded')

    def deep(self, data: bytes, description: str, test: Callable[[Image], bool]) -> None:
        self.send('/deep/image_raw/compressed', 'deep/image_raw', lambda: CompressedImage(
            header=header(), format=description, data=data), test)

    def test_formats_that_are_not_those_of_the_pixels(self) -> None:
        pixels = np.random.RandomState(1).randint(0, 65536, (48, 64)).astype(np.uint16)
        white = cv2.imencode('.jpg', pixels)[1].tobytes()       # as image_transport makes it
        self.deep(white, 'mono16; jpeg compressed ', lambda one: one.encoding == 'mono8')
        self.wait_told("stream 'jpeg'", 'mono16; jpeg compressed', 'what was above 255 is lost')
        depth = DEPTH.pack(0, 0.0, 0.0) + cv2.imencode('.png', pixels)[1].tobytes()
        # noise: what is lost is not guessed
        self.deep(depth, 'mono16; compressedDepth png', lambda one: one.encoding == 'mono16' and bool(
            (np.frombuffer(one.data, np.uint16) == pixels.ravel()).mean() > 0.6))

    # -- the log

    def test_faulty_streams_fill_no_log(self) -> None:
        """Three at 10 Hz, with numbers that change and faults that alternate, wrote 25 lines a second."""
        begun = sum(self.warnings.values())

        def faulty(number: int) -> Sequence[Any]:
            points = cloud(grid())
            points.data = points.data[:number]
            bad = float('inf') if number % 2 else 0.0
            ray = LaserScan(header=header('ray'), ranges=[1.0] * (2 + number), angle_min=bad, angle_max=bad,
                            angle_increment=0.1 * (number % 2))
            image = CompressedImage(header=header(), format='jpeg', data=bytes([number]) * (1 + number % 7))
            return points, ray, image
        for number, _ in zip(range(100), ticks(10.0)):
            for topic, message in zip(('/organised/points', '/ray', '/deep/image_raw/compressed'), faulty(number)):
                self.sources[topic].publish(message)
        self.wait_told("stream 'organised'", 'data has')
        self.wait_told("stream 'jpeg'", 'neither JPEG nor PNG')
        self.wait_told("stream 'ray'", 'angle_min is')
        self.assertLessEqual(sum(self.warnings.values()) - begun, 4 * 4)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'odd_sources', OddSources)
