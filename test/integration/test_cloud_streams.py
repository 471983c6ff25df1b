#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Point clouds and laser scans through robot_sender and operator_receiver: real nodes, sockets and master."""
import pathlib
import sys
import time
from typing import Any, List

import numpy as np
import rospy
import rostest
from sensor_msgs.msg import LaserScan, PointCloud2, PointField

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from streams_case import LOSSES, StreamsCase
from waiting import Collector, give_time, is_sent_here, stamps, undisturbed, wait_for

from smokebot_udp.codecs.perception.voxel import voxel_filter
from smokebot_udp.codecs.wire.points import as_points
from smokebot_udp.msg import CloudChunk, ScanSegment
from smokebot_udp.nodes.operator_stream import CLEARING
from smokebot_udp.simulation.lidar import POINT, RINGS, Lidar
from smokebot_udp.simulation.world import building
from smokebot_udp.streams.frame_end import FIRST_MARGIN

LEAF, BOUND = 0.1, 0.0125      # the defaults
RATE, CLOUDS = 10.0, 40
FIELDS = [PointField(name, POINT.fields[name][1], datatype, 1) for name, datatype in (
    ('x', 7), ('y', 7), ('z', 7), ('intensity', 7), ('ring', 4))]


def cloud(points, stamp=None) -> Any:
    """A PointCloud2 of an array of lidar.POINT."""
    message = PointCloud2(height=1, width=len(points), fields=FIELDS, point_step=points.itemsize,
                          row_step=points.nbytes, data=points.tobytes())
    message.header.stamp, message.header.frame_id = stamp or rospy.Time.now(), 'velodyne'
    return message


def xyz(message) -> Any:
    """(n, 3) float32, in the message's order."""
    return as_points(message)[0]


def scan(ranges, intensities=(), stamp=None, **fields) -> Any:
    message = LaserScan(ranges=ranges, intensities=intensities, range_min=0.05, range_max=30.0, angle_min=-2.0,
                        angle_increment=0.005, angle_max=-2.0 + 0.005 * (len(ranges) - 1), scan_time=0.1)
    message.header.stamp, message.header.frame_id = stamp or rospy.Time.now(), 'laser'
    for name, value in fields.items():
        setattr(message, name, value)
    return message


class CloudStreams(StreamsCase):

    @classmethod
    def setUpClass(cls) -> Any:
        rospy.init_node('cloud_streams')
        cls.lidar = Lidar(building(1), 0.9, 1)
        cls.clouds = rospy.Publisher('/velodyne_points', PointCloud2, queue_size=5)
        cls.scans = rospy.Publisher('/scan', LaserScan, queue_size=5)
        types = {'lidar/points': PointCloud2, 'packed/points': PointCloud2, 'sorted/points': PointCloud2,
                 'scan': LaserScan, 'obstacle_scan': LaserScan, 'landmark_scan': LaserScan}
        cls.out = {(name, loss): Collector('%s/%s' % (where, name), message_class)
                   for name, message_class in types.items() for loss, where in LOSSES.items()}
        for collector in cls.out.values():
            collector.wait_connected()
        cls.on_robot = {name: Collector('/' + name, LaserScan) for name in ('obstacle_scan', 'landmark_scan')}
        for collector in cls.on_robot.values():
            collector.wait_connected()
        cls.listen('lidar', 'packed', 'sorted', 'scan', 'obstacle_scan', 'landmark_scan')
        wait_for(lambda: cls.clouds.get_num_connections() and cls.scans.get_num_connections(), what='robot_sender')
        wait_for(cls.everything_flows, 60, 'a first message of everything')

    @classmethod
    def everything_flows(cls) -> bool:
        """Whether each topic has shown something without loss: publishers may drop what comes while one connects."""
        cls.clouds.publish(cloud(cls.lidar.scan((1.5, 7.0, 0.3), 1.0)[:500]))
        cls.scans.publish(scan([1.0, 2.0, 5.0]))
        give_time(0.1)
        return all(out.messages for (_, loss), out in cls.out.items() if loss == 0)

    def setUp(self) -> None:
        for collector in self.out.values():
            collector.clear()

    def shown(self, message, name, loss=0) -> Any:
        return wait_for(lambda: self.out[name, loss].messages.get(message.header.stamp), 5, name)

    @undisturbed(FIRST_MARGIN)      # a datagram that is later is not waited for
    def test_without_loss_a_cloud_is_the_voxel_filtered_one(self) -> None:
        points = self.lidar.scan((1.5, 7.0, 0.3), 1.0)
        points['x'][::100] = np.nan
        message = cloud(points)
        self.clouds.publish(message)
        centroids, _ = voxel_filter(xyz(message), LEAF)
        got = self.shown(message, 'lidar/points')
        np.testing.assert_array_equal(xyz(got), centroids)
        self.assertEqual((got.header.frame_id, [field.name for field in got.fields]), ('velodyne', ['x', 'y', 'z']))
        packed = self.shown(message, 'packed/points')
        np.testing.assert_allclose(xyz(packed), centroids, rtol=0, atol=BOUND + 1e-5)
        self.assertEqual([field.name for field in packed.fields], ['x', 'y', 'z', 'intensity'])
        ordered = self.shown(message, 'sorted/points')      # the same in another order
        self.assertEqual(ordered.fields, packed.fields)
        self.assertEqual(*(sorted(np.frombuffer(shown.data, '<f4').reshape(-1, 4).tolist())
                           for shown in (packed, ordered)))

    @undisturbed()
    def test_through_loss_a_cloud_thins_evenly_at_the_sources_rate(self) -> None:
        points = self.lidar.scan((1.5, 7.0, 0.3), 1.0)
        whole = voxel_filter(xyz(cloud(points)), LEAF)[0]
        sent = {}
        for stamp in stamps(CLOUDS, RATE):
            # as many a second as the machine bears, while others keep it busy
            for before in list(sent)[-1:]:
                wait_for(lambda at=before: at in self.out['lidar/points', 0].messages, 10, 'the cloud before')
            self.clouds.publish(cloud(points, stamp))
            sent[stamp] = time.monotonic()
        for loss, share in ((50, 0.5), (90, 0.1)):
            out = self.out['lidar/points', loss]
            # of 60 chunks one comes nearly always; the last cloud may wait for its time to be over
            wait_for(lambda messages=out.messages: len(messages) >= CLOUDS - 2, 5, 'the clouds at %d %%' % loss)
            got = [xyz(message) for message in list(out.messages.values())]
            kept = np.mean([len(cloud_points) / len(whole) for cloud_points in got])
            self.assertAlmostEqual(kept, share, delta=0.03)
            came = sorted(out.arrivals)[:-1]
            took, lasted = (times[came[-1]] - times[came[0]] for times in (out.arrivals, sent))
            self.assertAlmostEqual(took / lasted, 1, delta=0.1)
            self.check_evenly(whole, got, share)
        got = [xyz(message) for message in list(self.out['sorted/points', 50].messages.values())]
        # in 10 chunks: of 1 cloud in 1000 nothing is received
        self.assertGreaterEqual(len(got), CLOUDS - 3)
        self.assertAlmostEqual(np.mean([len(cloud_points) / len(whole) for cloud_points in got]), 0.5, delta=0.1)

    def check_evenly(self, whole, got, share) -> None:
        """Each 2 m block of the scene keeps its share, over all clouds."""
        blocks = np.floor(whole / 2).astype(int)
        for block in np.unique(blocks, axis=0):
            there = np.count_nonzero((blocks == block).all(axis=1))
            if there >= 50:
                kept = np.mean([np.count_nonzero((np.floor(cloud_points / 2) == block).all(axis=1))
                                for cloud_points in got]) / there
                self.assertAlmostEqual(kept, share, delta=0.12, msg='block %s' % block)

    @undisturbed(FIRST_MARGIN)
    def test_without_loss_scans_are_right_to_the_millimetre(self) -> None:
        random = np.random.RandomState(4)
        millimetres = (random.randint(0, 30000, 720) / 1000).astype(np.float32)
        millimetres[:3] = np.inf, -np.inf, np.nan
        for ranges, intensities in ((millimetres, random.randint(0, 256, 720)), (random.rand(1081) * 9, ()),
                                    (random.rand(7), random.rand(7)), (random.rand(20000), ()), ([1.0], [2.0])):
            message = scan(np.asarray(ranges, np.float32).tolist(), np.asarray(intensities, np.float32).tolist())
            self.scans.publish(message)
            got = self.shown(message, 'scan')
            most = 0.0 if ranges is millimetres else 0.001      # half a step, or one beside range_min and range_max
            np.testing.assert_allclose(np.float32(got.ranges), np.float32(message.ranges), rtol=1e-6, atol=most)
            np.testing.assert_array_equal(np.float32(got.intensities), np.float32(message.intensities))
            for field in ('angle_min', 'angle_max', 'angle_increment', 'time_increment', 'scan_time', 'range_min',
                          'range_max'):
                self.assertAlmostEqual(getattr(got, field), getattr(message, field), places=5)

    def test_half_a_scan_is_shown(self) -> None:
        ranges = (np.arange(1, 721) / 1000).astype(np.float32)
        for stamp in stamps(CLOUDS, 20.0):
            self.scans.publish(scan(ranges.tolist(), stamp=stamp))
        out = self.out['scan', 50]
        wait_for(lambda: len(out.messages) > CLOUDS // 2, 5, 'scans')
        halves = 0
        for got in [np.float32(message.ranges) for message in list(out.messages.values())]:
            if len(got) != len(ranges):
                continue    # a late one of another test
            there = ~np.isnan(got)
            np.testing.assert_array_equal(got[there], ranges[there])
            self.assertIn(there.mean(), (0.5, 1.0))
            if there.mean() == 0.5:
                halves += 1
                self.assertIn(there[:2].tolist(), ([True, False], [False, True]))
        self.assertGreater(halves, 5)

    @undisturbed(FIRST_MARGIN)
    def test_virtual_scans_are_the_same_on_both_sides_and_true(self) -> None:
        lidar, pose = Lidar(building(1), 0.9, 1, noise=0.0), (10.5, 7.0, 0.3)
        message = cloud(lidar.scan(pose, 1.0))
        self.clouds.publish(message)
        for name, on_robot in self.on_robot.items():
            got = self.shown(message, name)
            local = wait_for(lambda out=on_robot: out.messages.get(message.header.stamp), 5, name)
            np.testing.assert_array_equal(got.ranges, local.ranges)
            # there is no tf here, so the mount counts
            self.assertEqual((len(got.ranges), got.header.frame_id), (720, 'velodyne'))
            self.assertAlmostEqual(got.angle_min + 719 * got.angle_increment, got.angle_max, places=4)
        # along the corridor, to its walls on both sides and its ends: the rays of whole degrees
        scan = np.float32(self.out['obstacle_scan', 0].messages[message.header.stamp].ranges)
        distance, surface = lidar.look(pose)
        height = 0.9 + distance * np.sin(RINGS)
        there = (surface >= 0) & (height > 0.1) & (height < 1.2)
        obstacle = np.where(there, distance * np.cos(RINGS), np.inf).min(axis=1)
        columns = (np.arange(720) + 360) % 720      # the rays of whole half degrees, from straight ahead
        nearest = np.full(720, np.inf)
        nearest[columns] = obstacle[::2]
        close = np.abs(scan - nearest) < 0.3     # the rays between may be nearer, along a wall
        self.assertGreater(close.mean(), 0.95)

    def test_what_is_silent_is_cleared_and_shown_again(self) -> None:
        seen: List[Any] = []
        for topic, message_class in (('/operator/lidar/points', PointCloud2), ('/operator/scan', LaserScan)):
            subscriber = rospy.Subscriber(topic, message_class, seen.append, queue_size=10)
            self.addCleanup(subscriber.unregister)
            wait_for(lambda name=topic: is_sent_here(name), what=topic)
        message = self.flow(seen)
        del seen[:]     # also blank messages after those of the test before

        def cleared() -> List[Any]:
            return [one for one in seen if not one.header.stamp]
        blanks = wait_for(lambda: len(set(map(type, cleared()))) == 2 and cleared(), 20, 'blank messages')
        for one in blanks:
            self.assertTrue(np.isnan(one.ranges).all() if isinstance(one, LaserScan) else one.width == 0)
            self.assertEqual(one.header.frame_id, 'laser' if isinstance(one, LaserScan) else 'velodyne')
        give_time(CLEARING + 2.0)
        count = len(cleared())
        give_time(2.0)
        self.assertIn(len(cleared()) - count, range(2, 7))      # each topic's go on, more slowly
        self.assertNotEqual(self.flow(seen), message)

    def flow(self, seen: List[Any]) -> Any:
        """Publish a cloud and a scan until both arrive; their stamp."""
        def both() -> Any:
            stamp = rospy.Time.now()
            self.clouds.publish(cloud(self.lidar.scan((1.5, 7.0, 0.3), 1.0)[:500], stamp))
            self.scans.publish(scan([1.0, 2.0, 5.0], stamp=stamp))
            give_time(0.2)
            return sum(one.header.stamp == stamp for one in seen) == 2 and stamp
        return wait_for(both, 20, 'both')

    def test_bad_clouds_are_told_of_and_the_next_good_one_comes(self) -> None:
        points = self.lidar.scan((1.5, 7.0, 0.3), 1.0)[:500]
        for message, words in ((self.spoilt(points, fields=FIELDS[:2]), 'no field z'),
                               (self.spoilt(points, fields=FIELDS[1:]), 'no field x'),
                               (self.spoilt(points, data=b'short'), 'data has 5 bytes'),
                               (self.spoilt(points, fields=[*FIELDS[:2], PointField('z', 2000, 7, 1)]),
                                'field z has bytes 2000 to 2003')):
            self.refused(self.clouds, message, 'lidar', words)
        message = cloud(points)
        self.clouds.publish(message)
        self.shown(message, 'lidar/points')

    @staticmethod
    def spoilt(points, **fields) -> Any:
        message = cloud(points)
        for name, value in fields.items():
            setattr(message, name, value)
        return message

    def test_bad_scans_are_told_of_and_the_next_good_one_comes(self) -> None:
        good = [1.0, 2.0, 3.0]
        for message, words in ((scan(good, angle_increment=float('nan'), angle_max=-2.0), 'angle_increment is nan'),
                               (scan(good, angle_min=float('inf'), angle_max=float('nan')), 'angle_min is inf')):
            self.refused(self.scans, message, 'scan', words)
        message = scan(good)
        self.scans.publish(message)
        self.shown(message, 'scan')

    def test_messages_of_one_stamp_are_told_of(self) -> None:
        stamp = rospy.Time.now()
        self.scans.publish(scan([1.0, 2.0], stamp=stamp))
        wait_for(lambda: stamp in self.out['scan', 0].messages, 5, 'the first')
        self.refused(self.scans, scan([3.0, 4.0], stamp=stamp), 'scan', 'cannot be told apart')

    def test_what_has_no_stamp_gets_one(self) -> None:
        message = scan([1.0, 2.0, 4.0])
        message.header.stamp = rospy.Time(0)
        self.scans.publish(message)
        wait_for(lambda: any(len(got.ranges) == 3 for got in list(self.out['scan', 0].messages.values())), 5, 'a scan')

    @undisturbed(FIRST_MARGIN)
    def test_forged_segments_crash_nothing(self) -> None:
        random = np.random.RandomState(3)

        def numbers(*some) -> Any:
            return random.choice(some)

        def forge_chunk() -> Any:
            chunk = CloudChunk(points=numbers(0, 1, 80, 2 ** 21, 2 ** 32 - 1), chunks=numbers(0, 1, 2, 65535),
                               index=numbers(0, 1, 65535), has_intensity=bool(random.randint(2)),
                               step=numbers(0.0, 0.025, -1.0, float('nan'), float('inf')),
                               origin=random.randint(-2 ** 31, 2 ** 31, 3).tolist(), bits=random.bytes(3),
                               intensity_min=float('nan'), intensity_step=1e38, data=random.bytes(random.randint(1300)))
            if random.randint(2):
                chunk.bits, chunk.codes = b'\x08\x08\x08', b'\x02\x11' * (2 + chunk.has_intensity)
            chunk.header.stamp = rospy.Time.now() - rospy.Duration(random.randint(2) * 100)
            return chunk

        def forge_scan() -> Any:
            segment = ScanSegment(total=numbers(0, 1, 720, 2 ** 32 - 1), parts=numbers(0, 1, 2, 65535),
                                  part=numbers(0, 1, 65535), range_size=random.randint(6),
                                  intensity_size=random.randint(6), angle_increment=numbers(0.0, float('nan'), 1.0),
                                  ranges=random.bytes(random.randint(700)), intensities=random.bytes(random.randint(9)))
            segment.header.stamp = rospy.Time.now() - rospy.Duration(random.randint(2) * 100)
            return segment
        self.flood('lidar', CloudChunk, forge_chunk)
        self.flood('packed', CloudChunk, forge_chunk)
        self.flood('sorted', CloudChunk, forge_chunk)
        self.flood('scan', ScanSegment, forge_scan)
        self.setUp()
        wait_for(self.everything_flows, 60, 'what was forged to be taken from the queues')
        self.test_without_loss_a_cloud_is_the_voxel_filtered_one()
        self.test_without_loss_scans_are_right_to_the_millimetre()


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'cloud_streams', CloudStreams)
