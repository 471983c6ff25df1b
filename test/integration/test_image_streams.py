#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures through robot_sender and operator_receiver: real nodes, real sockets, real master."""
import itertools
import pathlib
import re
import sys
import threading
import unittest
import xmlrpc.client
from typing import Any

import numpy as np
import rosgraph
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, errors_logged, give_time, stamps, undisturbed, wait_for

from smokebot_udp import udpros, version
from smokebot_udp.codecs.display.view import COLOURS, FRESH, FROZEN, OLD
from smokebot_udp.codecs.wire.pixels import item_type
from smokebot_udp.msg import ImageSegment
from smokebot_udp.streams.frame_end import FIRST_MARGIN

THERMAL = pathlib.Path(__file__).resolve().parents[3] / 'shared' / 'data' / 'thermal'
SIZES = {'mono8': (240, 320), '8UC1': (33, 77), 'mono16': (480, 640), '16UC1': (1, 1), 'bgr8': (479, 641),
         'rgb8': (120, 160), 'bgra8': (48, 64), 'rgba8': (7, 300), '32FC1': (240, 320)}


def image(pixels_bytes, height, width, encoding, stamp, step=None, is_bigendian=0) -> Any:
    message = Image(height=height, width=width, encoding=encoding, data=pixels_bytes, is_bigendian=is_bigendian,
                    step=width * item_type(encoding).itemsize if step is None else step)
    message.header.stamp, message.header.frame_id = stamp, 'somewhere'
    return message


def fragments() -> Any:
    """IPv4 packets that this host has cut in fragments so far."""
    names, values = re.findall(r'^Ip: (.*)$', pathlib.Path('/proc/net/snmp').read_text(), re.MULTILINE)
    return int(dict(zip(names.split(), values.split()))['FragCreates'])


class Wheels(threading.Thread):
    """Publishes odometry to the receiver at 50 %, at a rate of its own, as a base does. It stands at first."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.speed = 0.0
        self._publisher = rospy.Publisher('/loss50/operator/odom', Odometry, queue_size=1)
        self._ended = threading.Event()

    def wait_connected(self) -> None:
        """Wait for the receiver, and start."""
        wait_for(self._publisher.get_num_connections, what='the receiver')
        self.start()

    def run(self) -> None:
        message = Odometry()
        while not self._ended.wait(0.05):
            message.twist.twist.linear.x = self.speed
            self._publisher.publish(message)

    def stop(self) -> None:
        self._ended.set()
        if self.is_alive():
            self.join()
        self._publisher.unregister()


class ImageStreams(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> Any:
        rospy.init_node('image_streams')
        cls.errors = errors_logged()
        cls.source = rospy.Publisher('/thermal/image_raw', Image, queue_size=5)
        cls.out = {loss: Collector(topic, Image) for loss, topic in (
            (0, '/operator/thermal/image_raw'), (50, '/loss50/thermal'), (90, '/loss90/thermal'))}
        for collector in cls.out.values():
            collector.wait_connected()
        wait_for(cls.source.get_num_connections, what='robot_sender')
        wait_for(lambda: cls.udp_subscribers() == 3, what="three receivers' connections")

    @staticmethod
    def udp_subscribers() -> Any:
        master = rosgraph.Master('/image_streams')
        with xmlrpc.client.ServerProxy(master.lookupNode('/robot_sender')) as node:
            return sum(entry[3:5] == ['UDPROS', '/smokebot_udp/thermal/segments']
                       for entry in node.getBusInfo('/image_streams')[2])

    def setUp(self) -> None:
        for collector in self.out.values():
            collector.clear()

    def due(self, count, rate, losses=(0, 50, 90)) -> Any:
        """`count` times, `rate` a second, or as many as the machine bears while others keep it busy.

        Each one's picture is shown at all these losses before the next but one is due, without loss before the next.
        """
        before = []
        for stamp in stamps(count, rate):
            self.await_shown(before[-1:], {0} & set(losses))
            self.await_shown(before[-2:-1], losses)     # where segments are lost, the next picture may be what ends one
            yield stamp
            before.append(stamp)

    def play(self, pictures, rate, losses=(0, 50, 90)) -> Any:
        """Send mono16 pictures when they are due: {stamp: message}."""
        sent = {}
        for stamp, picture in zip(self.due(len(pictures), rate, losses), pictures):
            message = image(picture.tobytes(), picture.shape[0], picture.shape[1], 'mono16', stamp)
            self.source.publish(message)
            sent[stamp] = message
        return sent

    def await_shown(self, wanted, losses) -> None:
        for loss in losses:
            wait_for(lambda shown=self.out[loss]: set(wanted) <= set(shown.messages), 5, 'a picture at %d %%' % loss)

    def check_exact(self, sent) -> None:
        """Without loss every picture arrives, bit for bit."""
        self.await_shown(sent, (0,))
        for stamp, message in sent.items():
            self.assertEqual(self.out[0].messages[stamp].data, message.data)

    @undisturbed(FIRST_MARGIN)
    def test_every_encoding_is_bit_exact(self) -> None:
        for encoding, (height, width) in SIZES.items():
            for is_bigendian in (0, 1):
                step = width * item_type(encoding).itemsize + 6
                data = np.random.RandomState(height).bytes(height * step)
                stamp = rospy.Time.now()
                self.source.publish(image(data, height, width, encoding, stamp, step, is_bigendian))
                got = wait_for(lambda at=stamp: self.out[0].messages.get(at), 5, 'a picture in ' + encoding)
                rows = np.frombuffer(data, np.uint8).reshape(height, step)[:, :-6]
                self.assertEqual(got.data, rows.tobytes())
                self.assertEqual((got.height, got.width, got.step, got.encoding, got.is_bigendian, got.header.frame_id),
                                 (height, width, step - 6, encoding, is_bigendian, 'somewhere'))

    @undisturbed(FIRST_MARGIN)
    def test_a_moving_gradient_at_10_hz_through_loss(self) -> None:
        rows, columns = np.mgrid[:480, :640]
        pictures = [(7000 + 5 * rows + 3 * columns + 40 * k).astype(np.uint16) for k in range(30)]
        before = fragments()
        sent = self.play(pictures, 10.0)
        self.check_exact(sent)
        self.await_shown(sent, (50, 90))
        self.assertEqual(fragments(), before)
        for loss, most in ((50, 12), (90, 40)):   # counts; the gradient is 5 a pixel
            for stamp, message in sent.items():
                error = (np.frombuffer(self.out[loss].messages[stamp].data, np.uint16).astype(int)
                         - np.frombuffer(message.data, np.uint16))
                self.assertLess(np.abs(error).mean(), most)

    def test_a_fill_that_takes_too_long_gives_way_says_so_and_comes_back(self) -> None:
        statuses = []
        self.addCleanup(rospy.Subscriber('/diagnostics', DiagnosticArray, lambda array: statuses.extend(
            status for status in array.status if 'takes too long' in status.message)).unregister)
        rospy.wait_for_service('/loss50/operator_receiver/thermal/set_parameters', 60)   # it follows its parameters
        limit, integrate = ('/loss50/operator_receiver/thermal/' + name for name in ('fill_time', 'integrate'))
        for name in limit, integrate:
            self.addCleanup(rospy.set_param, name, rospy.get_param(name))
        rospy.set_param(integrate, 'never')
        rospy.set_param(limit, 1e-6)
        random = np.random.RandomState(3)

        def inventions() -> Any:
            """The last picture's share of pixels of values that were not sent: nearest invents none."""
            sent = self.play([random.choice([0, 1000], (480, 640)).astype(np.uint16) for _ in range(3)], 3.0)
            last = wait_for(lambda: self.out[50].messages.get(max(sent)), 5, 'the last picture')
            return np.mean(~np.isin(np.frombuffer(last.data, np.uint16), [0, 1000]))
        wait_for(lambda: inventions() == 0, what='pictures filled by the nearest')
        status = wait_for(lambda: statuses and statuses[-1], 5, 'its status')
        self.assertIn('filled by nearest because kriging_clamped takes too long', status.message)
        self.assertGreater(status.level, 0)
        rospy.set_param(limit, 60.0)
        wait_for(lambda: inventions() > 0.3, what='pictures filled by kriging again')

    @undisturbed(FIRST_MARGIN)
    def test_masks_tell_what_came(self) -> None:
        masks = {loss: Collector(topic, Image) for loss, topic in ((0, '/operator/thermal/mask'), (50, '/loss50/mask'))}
        for collector in masks.values():
            collector.wait_connected()
        random = np.random.RandomState(5)
        sent = self.play([random.randint(0, 65536, (480, 640)).astype(np.uint16) for _ in range(5)], 10.0)
        for loss, collector in masks.items():
            wait_for(lambda messages=collector.messages: set(sent) <= set(messages), 5, 'masks at %d %%' % loss)
        for stamp, message in sent.items():
            self.assertEqual(set(masks[0].messages[stamp].data), {255})
            mask, got = masks[50].messages[stamp], self.out[50].messages[stamp]
            self.assertEqual((mask.encoding, mask.height, mask.width, mask.step, mask.header.frame_id),
                             ('mono8', 480, 640, 640, 'somewhere'))
            came = np.frombuffer(mask.data, np.uint8) == 255
            right = np.frombuffer(got.data, np.uint16) == np.frombuffer(message.data, np.uint16)
            self.assertAlmostEqual(came.mean(), 0.5, delta=0.1)
            self.assertTrue(right[came].all())
            self.assertLess(right[~came].mean(), 0.01)

    @undisturbed(FIRST_MARGIN)
    def test_a_standing_robots_picture_fills_in_and_a_moving_ones_is_new(self) -> None:
        odometry = Wheels()
        self.addCleanup(odometry.stop)
        odometry.wait_connected()
        here, there = (np.random.RandomState(seed).randint(7000, 9000, (480, 640)).astype(np.uint16) for seed in (1, 2))
        shares = []
        for k, stamp in enumerate(self.due(26, 10.0)):
            if k == 24:
                odometry.speed = 0.5
                give_time(0.5)      # nothing announces that the receiver knows it
            picture = here if k < 24 else there
            self.source.publish(image(picture.tobytes(), 480, 640, 'mono16', stamp))
            shares.append((stamp, picture))
        got = self.out[50].messages
        wait_for(lambda: shares[-1][0] in got, 5, 'the last picture')
        received = [np.mean(np.frombuffer(got[stamp].data, np.uint16).reshape(480, 640) == picture)
                    for stamp, picture in shares]
        # odometry says so for half a second before it is believed; eight pictures later all is there
        self.assertGreater(received[8 + 8], 0.99)
        self.assertAlmostEqual(received[0], 0.5, delta=0.1)
        for (stamp, picture), share in zip(shares[24:], received[24:]):
            self.assertAlmostEqual(share, 0.5, delta=0.1)
            shown = np.frombuffer(got[stamp].data, np.uint16).reshape(480, 640)
            self.assertLess(np.mean((shown == here) & (shown != picture)), 0.01)

    @unittest.skipUnless(THERMAL.is_dir(), 'the thermal recordings are not on this machine')
    @undisturbed(FIRST_MARGIN)
    def test_thermal_recordings_at_10_hz_through_loss(self) -> None:
        import cv2
        files = sorted(THERMAL.glob('seq_*/*.png')) + sorted(THERMAL.glob('single/*.png'))
        pictures = [cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in files]
        pictures = [p for p in pictures if p.dtype == np.uint16 and p.size >= 640 * 480]
        self.assertGreater(len(pictures), 20)
        sent = self.play(pictures, 10.0)
        self.check_exact(sent)
        self.await_shown(sent, (50, 90))

    @unittest.skipUnless(THERMAL.is_dir(), 'the thermal recordings are not on this machine')
    @undisturbed(FIRST_MARGIN)
    def test_small_thermal_clips_are_bit_exact(self) -> None:
        """160 x 120: too few datagrams for every picture to survive 90 % loss, so only the clean link counts."""
        clips = [np.load(str(file))['frames'] for file in sorted(THERMAL.glob('seq_lepton*/*.npz'))]
        self.assertGreater(len(clips), 3)
        self.check_exact(self.play([frame for clip in clips for frame in clip[:10]], 20.0, (0,)))

    def test_a_frozen_picture_never_looks_live(self) -> None:
        views = []
        subscriber = rospy.Subscriber('/operator/thermal/view', Image, views.append, queue_size=20)
        self.addCleanup(subscriber.unregister)
        wait_for(subscriber.get_num_connections, what='operator_receiver')
        picture = np.full((480, 640), 7000, np.uint16)

        def states() -> Any:
            """In which states a picture is shown, one after the other, until it is frozen."""
            stamp = rospy.Time.now()
            self.source.publish(image(picture.tobytes(), 480, 640, 'mono16', stamp))

            def frames() -> Any:
                return [tuple(view.data[:3]) for view in list(views) if view.header.stamp == stamp]
            wait_for(lambda: COLOURS[FROZEN] in frames(), 10, 'the frozen picture')
            self.assertEqual({view.encoding for view in views}, {'bgr8'})
            return [colour for colour, _ in itertools.groupby(frames())]
        # a busy machine may show it late: then it is old from the beginning, or frozen
        expected = [COLOURS[state] for state in (FRESH, OLD, FROZEN)]
        seen: Any = []
        wait_for(lambda: seen.append(states()) or seen[-1] == expected, 30, 'a picture that grows old')
        for shown in seen:
            self.assertEqual(shown, [colour for colour in expected if colour in shown])

    def test_bad_images_are_told_of_and_the_next_good_one_comes(self) -> None:
        good = bytes(range(16))
        for bad, words in (
                (('encoding', 'nv21'), "encoding is 'nv21'"), (('data', b'short'), 'data has 5 bytes'),
                (('height', 0), 'height is 0'), (('width', 0), 'width is 0')):
            message = image(good, 4, 4, 'mono8', rospy.Time.now())
            setattr(message, *bad)
            del self.errors[:]
            self.source.publish(message)
            wait_for(lambda text=words: any("stream 'thermal'" in e and text in e for e in self.errors), 5, words)
        stamp = rospy.Time.now()
        self.source.publish(image(good, 4, 4, 'mono8', stamp))
        wait_for(lambda: stamp in self.out[0].messages, 5, 'a good picture')

    @undisturbed(FIRST_MARGIN)
    def show_after_hostile_segments(self, hostile, random, picture) -> None:
        """A picture is exact though segments of nonsense come before it."""
        now = rospy.Time.now()
        for _ in range(100):
            segment = ImageSegment(
                height=random.choice([0, 1, 480, 4096, 2 ** 31]), width=random.choice([0, 640, 2 ** 32 - 1]),
                encoding=random.choice(['mono16', 'mono8', 'x' * 50, '']), depth=random.randint(256),
                index=random.randint(65536), count=random.randint(256),
                total=random.choice([0, 1, 1024, 2 ** 32 - 1]), data=random.bytes(random.randint(1200)))
            segment.header.stamp = now - rospy.Duration(random.randint(2) * 100)
            hostile.publish(segment)
        (stamp, message), = self.play([picture], 100.0).items()
        got = wait_for(lambda: self.out[0].messages.get(stamp), 5, 'the good picture')
        wrong = np.frombuffer(got.data, np.uint8) != np.frombuffer(message.data, np.uint8)
        self.assertFalse(wrong.any(), '%g of the bytes are wrong' % wrong.mean())

    def test_hostile_segments_change_nothing(self) -> None:
        hostile = udpros.Publisher('/smokebot_udp/thermal/segments', ImageSegment, queue_size=10,
                                   headers=version.headers())
        wait_for(lambda: len(hostile.connections()) == 3, what='the receivers')
        random = np.random.RandomState(5)
        picture = random.randint(0, 65536, (480, 640)).astype(np.uint16)
        for k in range(10):
            self.show_after_hostile_segments(hostile, random, picture + np.uint16(k))
        hostile.unregister()

    def test_wrong_streams_leave_the_good_ones(self) -> None:
        wanted = {'/smokebot_udp/thermal/segments', '/smokebot_udp/camera/segments'}
        published = {topic for topic, _ in rospy.get_published_topics('/smokebot_udp')}
        self.assertEqual(published & wanted, wanted)
        self.assertFalse([topic for topic in published if 'broken' in topic or 'too_fast' in topic])


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'image_streams', ImageStreams)
