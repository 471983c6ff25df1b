#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Originals on demand through robot_sender and operator_receiver: real nodes, real sockets, half of all lost."""
import pathlib
import random
import shutil
import sys
import threading
import unittest
from typing import Any, Dict

import cv2
import numpy as np
import rospy
import rostest
import yaml
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import Image, PointCloud2, PointField
from tf2_msgs.msg import TFMessage

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, errors_logged, give_time, wait_for

from smokebot_udp import udpros, version
from smokebot_udp.msg import CapturePiece, CaptureProgress, CaptureRequest
from smokebot_udp.srv import Capture

NEAR, FAR = '', '/desk2'
"""Namespaces of the operator without loss, and of that at 50 %."""

HEIGHT, WIDTH = 120, 160


def thermal(number: int) -> Any:
    """An image with noise: none is like another one."""
    noise = np.random.RandomState(number).normal(0, 3, (HEIGHT, WIDTH))
    pixels = (7000 + 20 * np.arange(WIDTH) + noise).astype('<u2')
    return Image(height=HEIGHT, width=WIDTH, step=2 * WIDTH, encoding='mono16', data=pixels.tobytes())


def cloud(number: int) -> Any:
    points = np.random.RandomState(number).uniform(-20, 20, (2000, 4)).astype('<f4')
    fields = [PointField(name, 4 * place, PointField.FLOAT32, 1) for place, name in enumerate(
        ('x', 'y', 'z', 'intensity'))]
    return PointCloud2(height=1, width=2000, point_step=16, row_step=32000, fields=fields, data=points.tobytes())


class Sources(threading.Thread):
    """Publishes images and clouds, and keeps them: {stamp: message}."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.images: Dict[Any, Any] = {}
        self.clouds: Dict[Any, Any] = {}
        self._thermal = rospy.Publisher('/thermal/image_raw', Image, queue_size=5)
        self._camera = rospy.Publisher('/camera/image_raw', Image, queue_size=5)
        self._lidar = rospy.Publisher('/velodyne_points', PointCloud2, queue_size=5)

    def wait_connected(self) -> None:
        wait_for(lambda: all(one.get_num_connections() for one in (self._thermal, self._camera, self._lidar)),
                 what='robot_sender')

    def run(self) -> None:
        number = 0
        while not rospy.is_shutdown():
            number += 1
            for make, kept, frame, publishers in ((thermal, self.images, 'thermal', (self._thermal, self._camera)),
                                                  (cloud, self.clouds, 'velodyne', (self._lidar,))):
                message = make(number)
                message.header.stamp, message.header.frame_id = rospy.Time.now(), frame
                kept[message.header.stamp] = message
                for publisher in publishers:
                    publisher.publish(message)
            give_time(0.2)


class CaptureStreams(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> Any:
        rospy.init_node('capture')
        cls.errors = errors_logged()
        cls.folders = {}
        for place in (NEAR, FAR):
            rospy.wait_for_service(place + '/operator_receiver/capture', 60)
            cls.folders[place] = pathlib.Path(rospy.get_param(place + '/operator_receiver/capture_directory'))
            cls.addClassCleanup(shutil.rmtree, str(cls.folders[place]), ignore_errors=True)
        cls.mount = rospy.Publisher('/tf_static', TFMessage, queue_size=1, latch=True)
        transform = TransformStamped(child_frame_id='thermal')
        transform.header.frame_id, transform.transform.rotation.w = 'map', 1.0
        transform.transform.translation.x = 4.5
        cls.mount.publish([transform])
        cls.sources = Sources()
        cls.sources.wait_connected()
        cls.shown = {place: Collector(place + '/operator/thermal/image_raw', Image) for place in (NEAR, FAR)}
        cls.sources.start()
        for place, collector in cls.shown.items():
            wait_for(lambda found=collector: len(found.messages) > 2, 60, 'images at ' + (place or '/'))
        wait_for(cls.pose_is_known, 60, what="robot_sender's tf")
        wait_for(lambda: len(cls.sources.clouds) > 5, what='earlier originals')

    @classmethod
    def pose_is_known(cls) -> bool:
        file = pathlib.Path(cls.capture(NEAR, stream='thermal').file)
        return bool(file.name) and yaml.safe_load(file.with_suffix('.yaml').read_text())['pose'] != 'unknown'

    @staticmethod
    def capture(place: str, **request: Any) -> Any:
        return rospy.ServiceProxy(place + '/operator_receiver/capture', Capture)(**request)

    def fetched(self, place: str, topic: str, message_class: Any, **request: Any) -> Any:
        """(the message that was published, its file, its description)"""
        response = self.capture(place, **request)
        self.assertTrue(response.success, response.message)
        self.assertIn(response.file, response.message)
        message = rospy.wait_for_message(place + topic, message_class, 20)      # it is latched
        path = pathlib.Path(response.file)
        self.assertEqual(path.parent, self.folders[place])
        return message, path, yaml.safe_load(path.with_suffix('.yaml').read_text())

    def near(self, wanted: Any, message: Any) -> Any:
        """The stamp of a captured message; a busy robot_sender may have got the one beside the one that is wanted."""
        self.assertLess(abs((message.header.stamp - wanted).to_sec()), 1.0)
        return message.header.stamp

    def test_an_earlier_image_arrives_exactly(self) -> None:
        progress = []
        listener = rospy.Subscriber('/operator_receiver/capture_progress', CaptureProgress, progress.append)
        wanted = sorted(self.sources.images)[-4]
        message, path, description = self.fetched(
            NEAR, '/operator/thermal/capture', Image, stream='thermal', stamp=wanted)
        stamp = self.near(wanted, message)
        original = self.sources.images[stamp]
        self.assertEqual(message.header.frame_id, 'thermal')
        self.assertEqual((message.data, message.encoding), (original.data, 'mono16'))
        self.assertEqual(path.suffix, '.png')
        np.testing.assert_array_equal(cv2.imread(str(path), cv2.IMREAD_UNCHANGED),
                                      np.frombuffer(original.data, '<u2').reshape(HEIGHT, WIDTH))
        self.assertEqual(description['stamp'], {'secs': stamp.secs, 'nsecs': stamp.nsecs})
        self.assertEqual(description['scale'], {'counts_per_unit': 25.0, 'zero': -273.15, 'unit': 'degC'})
        self.assertEqual(description['pose']['frame_id'], 'map')
        self.assertEqual(description['pose']['position'], {'x': 4.5, 'y': 0.0, 'z': 0.0})
        wait_for(lambda: progress and progress[-1].state == 'done', what='the progress')
        self.assertEqual((progress[-1].stream, progress[-1].progress), ('thermal', 1.0))
        self.assertGreater(progress[-1].size, 1000)
        listener.unregister()

    def test_what_was_shown_last_arrives_exactly_over_half_of_all_lost(self) -> None:
        before = self.shown[FAR].newest().header.stamp
        message, _, _ = self.fetched(FAR, '/operator/thermal/capture', Image, stream='thermal')
        self.assertGreaterEqual(message.header.stamp, before)
        self.assertEqual(message.data, self.sources.images[message.header.stamp].data)

    def test_a_region_arrives_exactly(self) -> None:
        stamp = sorted(self.sources.images)[-3]
        message, path, description = self.fetched(
            FAR, '/operator/thermal/capture', Image, stream='thermal', stamp=stamp, x=10, y=20, width=30, height=40)
        stamp = self.near(stamp, message)
        whole = np.frombuffer(self.sources.images[stamp].data, '<u2').reshape(HEIGHT, WIDTH)
        self.assertEqual((message.width, message.height, message.step), (30, 40, 60))
        self.assertEqual(message.data, whole[20:60, 10:40].tobytes())
        self.assertEqual(description['region'], {'x': 10, 'y': 20, 'width': 30, 'height': 40})
        self.assertIn('_10-20-30-40.png', path.name)

    def test_a_cloud_arrives_exactly_at_two_operators_at_a_time(self) -> None:
        stamps, found = sorted(self.sources.clouds)[-3:-1], {}

        def fetch(place: str, stamp: Any) -> None:
            found[place] = self.fetched(place, '/operator/lidar/capture', PointCloud2, stream='lidar', stamp=stamp)
        threads = [threading.Thread(target=fetch, args=what) for what in zip((NEAR, FAR), stamps)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for place, stamp in zip((NEAR, FAR), stamps):
            message, path, description = found[place]
            original = self.sources.clouds[self.near(stamp, message)]
            for field in ('height', 'width', 'fields', 'is_bigendian', 'point_step', 'row_step', 'data', 'is_dense'):
                self.assertEqual(getattr(message, field), getattr(original, field))
            self.assertTrue(path.read_bytes().endswith(b'DATA binary\n' + message.data))
            self.assertEqual(description['pose'], 'unknown')

    def test_what_cannot_be_captured_is_refused_with_the_reason(self) -> None:
        for request, reason in (
                ({'stream': 'nothing'}, "stream 'nothing' cannot be captured: there is no such stream"),
                ({'stream': 'scan'}, 'no such stream of type image or cloud'),
                ({'stream': 'camera'}, 'its setting history is 0'),
                ({'stream': 'thermal', 'stamp': rospy.Time(1)}, 'none within 1 s of 1.000'),
                ({'stream': 'thermal', 'x': 150, 'width': 11}, 'is not in the image of 160 x 120'),
                ({'stream': 'lidar', 'width': 1}, 'a region is of an image')):
            response = self.capture(NEAR, **request)
            self.assertFalse(response.success)
            self.assertIn(reason, response.message)
            self.assertEqual(response.file, '')

    def test_forged_messages_harm_nobody(self) -> None:
        requests = udpros.Publisher('/smokebot_udp/capture/request', CaptureRequest, queue_size=10,
                                    headers=version.headers())
        pieces = udpros.Publisher('/smokebot_udp/capture/pieces', CapturePiece, queue_size=10,
                                  headers=version.headers())
        wait_for(lambda: requests.connections() and len(pieces.connections()) == 2, what='the nodes')
        forged = random.Random(1)
        for _ in range(200):
            requests.publish(CaptureRequest(
                id=forged.getrandbits(32), done=forged.random() < 0.2, stream=forged.choice(['thermal', 'lidar', '\0']),
                width=forged.getrandbits(32), order=forged.getrandbits(32), received=bytes(forged.getrandbits(8))))
            pieces.publish(CapturePiece(
                id=forged.choice([0, forged.getrandbits(32)]), size=forged.getrandbits(32), order=forged.getrandbits(4),
                number=forged.getrandbits(16), length=forged.getrandbits(16), data=bytes(forged.getrandbits(8))))
        message, _, _ = self.fetched(NEAR, '/operator/thermal/capture', Image, stream='thermal')
        self.assertEqual(message.data, self.sources.images[message.header.stamp].data)
        requests.unregister()
        pieces.unregister()


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'capture', CaptureStreams)
