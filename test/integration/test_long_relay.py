#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A relay of JPEG images beside an image stream, on a link that loses nothing: each gets its share."""
import pathlib
import sys
import threading
import time
import unittest
from typing import Any, List

import numpy as np
import rospy
import rostest
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import CompressedImage, Image

from smokebot_udp.msg import LinkStatus

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, is_sent_here, stamps, undisturbed, wait_for

JPEG = 117000       # bytes
FAIR_RATE = 30.0    # the robot's rate after FAIR_TIME, at least [Mbit/s]
FAIR_TIME = 8.0     # [s]


class LongRelay(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> Any:
        rospy.init_node('long_relay')
        cls.front = rospy.Publisher('/front/image_raw', Image, queue_size=2)
        cls.cam = rospy.Publisher('/cam/compressed', CompressedImage, queue_size=2)
        cls.shown = Collector('/operator/front/image_raw', Image)
        cls.relayed = Collector('/operator/cam/compressed', CompressedImage)
        cls.rates: List[float] = []
        cls.warnings: List[str] = []
        cls.log = rospy.Subscriber('/rosout', Log, lambda log: cls.warnings.append(log.msg)
                                   if log.level == Log.WARN and "'cam'" in log.msg else None)
        cls.link = rospy.Subscriber('/robot_sender/link', LinkStatus, lambda link: cls.rates.append(link.rate))
        for publisher in (cls.front, cls.cam):
            wait_for(publisher.get_num_connections, what='robot_sender')
        for collector in (cls.shown, cls.relayed):
            collector.wait_connected()
        wait_for(lambda: is_sent_here('/rosout', '/robot_sender'), what="the robot's log")

    def publish(self, count: int) -> None:
        """Publish both sources, 10 JPEG images and 5 others a second."""
        random = np.random.default_rng(5)
        pixels, jpeg = random.bytes(640 * 480 * 3), random.bytes(JPEG)
        for number, stamp in enumerate(stamps(count, 10.0)):
            compressed = CompressedImage(format='jpeg', data=jpeg)
            compressed.header.stamp = stamp
            self.cam.publish(compressed)
            if number % 2 == 0:
                image = Image(height=480, width=640, encoding='bgr8', step=1920, data=pixels)
                image.header.stamp = stamp
                self.front.publish(image)

    @undisturbed()
    def test_both_streams_live_from_the_beginning(self) -> None:
        source = threading.Thread(target=self.publish, args=(200,), daemon=True)
        began = time.monotonic()
        source.start()
        self.addCleanup(source.join)
        for collector, what in ((self.shown, 'an image'), (self.relayed, 'a relayed message')):
            wait_for(lambda collector=collector: len(collector.messages) >= 3, 5.0, what)
        wait_for(lambda: self.rates and self.rates[-1] >= FAIR_RATE, FAIR_TIME, 'a rate of %g Mbit/s' % FAIR_RATE)
        source.join()
        for collector, rate in ((self.shown, 5.0), (self.relayed, 10.0)):
            late = [when for when in list(collector.arrivals.values()) if when > began + FAIR_TIME]
            self.assertGreater(len(late), 0.6 * rate * (20.0 - FAIR_TIME))
        stamp, message = max(list(self.relayed.messages.items()))
        self.assertEqual((len(message.data), message.format, message.header.stamp), (JPEG, 'jpeg', stamp))
        self.assertEqual(len(self.warnings), 1, self.warnings)
        self.assertIn('a message takes ', self.warnings[0])


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'long_relay', LongRelay)
