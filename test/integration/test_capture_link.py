#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""An original over a link of 1 Mbit/s that loses half: it arrives exactly, and the stream goes on beside it."""
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest
from typing import Any

import cv2
import numpy as np
import rospy
import rostest
import yaml
from sensor_msgs.msg import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import give_time, undisturbed, wait_for

from evaluation.listener import Listener
from evaluation.own_masters import OwnMasters
from smokebot_udp.link_lab.lab import LabError

FOLDERS = [str(pathlib.Path(__file__).resolve().parents[number]) for number in (2, 0)]
STREAMS = pathlib.Path(__file__).resolve().with_name('capture_link_streams.yaml')
LINK = {'rate': 1e6, 'loss': 0.5, 'delay': 0.02, 'queue': 0.1}
THERMAL, LINK_STATUS = '/operator/thermal/image_raw', '/operator/link'

RATE, WIDTH, HEIGHT = 10.0, 640, 480

SOURCE = """
import sys
import rospy
sys.path[:0] = %r
from test_capture_link import RATE, image
from sensor_msgs.msg import Image
rospy.init_node('camera')
publisher, rate = rospy.Publisher('/thermal/image_raw', Image, queue_size=2), rospy.Rate(RATE)
while not rospy.is_shutdown():
    publisher.publish(image(rospy.Time.now()))
    rate.sleep()
"""

SETTLE, MEASURE = 8.0, 6.0
"""Time until the bad link has settled, and time over which the stream's rate is then measured before the capture
[s]."""

GOAL, LATEST = 15.0, 40.0
"""Duration of a capture that is the goal, and maximum duration on a machine that does other things, too [s]."""

GOAL_RATE, LEAST_RATE = 0.8, 0.5
"""Rate of the stream during the capture as a ratio of its rate before: the goal, and the minimum on a busy machine."""


def image(stamp: Any) -> Any:
    """The image of a moment: a scene with as much noise as a thermal camera has. It takes 250 kB without loss."""
    moment = stamp.to_nsec()
    noise = np.random.RandomState(moment % 2 ** 32).normal(0, 22, (HEIGHT, WIDTH))
    scene = 7500 + 300 * np.sin(np.arange(WIDTH) / 60 + moment / 1e9) + np.arange(HEIGHT)[:, np.newaxis]
    message = Image(height=HEIGHT, width=WIDTH, step=2 * WIDTH, encoding='mono16',
                    data=(scene + noise).astype('<u2').tobytes())
    message.header.stamp, message.header.frame_id = stamp, 'thermal'
    return message


class CaptureLink(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> Any:
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = folder.name
        try:
            cls.stack = OwnMasters(seed=3)
        except LabError as error:
            raise unittest.SkipTest(str(error)) from None
        cls.addClassCleanup(cls.stack.close)
        cls.stack.start('robot', sys.executable, '-c', SOURCE % FOLDERS)
        cls.stack.start_sender('_streams_file:=%s' % STREAMS)
        cls.stack.start_receiver('_streams_file:=%s' % STREAMS, '_capture_directory:=' + cls.folder)
        cls.listener = Listener(cls.stack)
        cls.listener.subscribe([[THERMAL, 'image', 'TCPROS'], [LINK_STATUS, 'link', 'TCPROS']])
        wait_for(lambda: len(cls.images(0.0)) > 20, 60, 'images')

    @classmethod
    def images(cls, since: float) -> Any:
        return [heard for heard in cls.listener.heard if heard.topic == THERMAL and heard.arrival > since]

    def rate(self, begun: float, ended: float) -> float:
        """Rate of the images that arrived in this time [Hz]."""
        return len([image for image in self.images(begun) if image.arrival <= ended]) / (ended - begun)

    @undisturbed()
    def test_an_original_arrives_exactly_and_the_stream_goes_on(self) -> None:
        self.stack.lab.set(LINK)
        give_time(SETTLE)
        begun = time.time()
        give_time(MEASURE)
        before = self.rate(begun, time.time())
        begun = time.time()
        answer = yaml.safe_load(self.stack.lab.run(
            'operator', ['rosservice', 'call', '/operator_receiver/capture', 'stream: thermal'], check=True,
            env=self.stack.environment('operator'), stdout=subprocess.PIPE, timeout=90).stdout)
        ended = time.time()
        self.assertTrue(answer['success'], answer['message'])
        file = pathlib.Path(answer['file'])
        original = image(rospy.Time(**yaml.safe_load(file.with_suffix('.yaml').read_text())['stamp']))
        np.testing.assert_array_equal(cv2.imread(str(file), cv2.IMREAD_UNCHANGED),
                                      np.frombuffer(original.data, '<u2').reshape(HEIGHT, WIDTH))
        meanwhile = self.rate(begun, ended)
        link = [heard.amount for heard in self.listener.heard if heard.topic == LINK_STATUS][-1]
        print('%s; images before: %.1f Hz, meanwhile: %.1f Hz (goal: %.0f s, %.0f %%); link: %s' % (
            answer['message'], before, meanwhile, GOAL, 100 * GOAL_RATE, link), file=sys.stderr)
        self.assertLess(ended - begun, LATEST)
        self.assertGreater(meanwhile, LEAST_RATE * before)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'capture_link', CaptureLink)
