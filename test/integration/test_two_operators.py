#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A second operator, which loses half of its datagrams, joins the first one and is killed: what the first one has."""
import contextlib
import pathlib
import subprocess
import sys
import threading
import time
import unittest
from typing import List, Tuple

import numpy as np
import rospy
import rostest
from sensor_msgs.msg import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, give_time, ticks, undisturbed, wait_for

from smokebot_udp.msg import LinkStatus

STREAMS = pathlib.Path(__file__).resolve().parent / 'two_operators.yaml'
FIRST, SECOND = '/operator/thermal/image_raw', '/operator2/thermal/image_raw'
MAX_RATE = 20.0
"""The parameter max_rate [Mbit/s]. Loopback carries more."""

RATE = 10.0
"""Rate of the camera [Hz]."""


class TwoOperators(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('test_two_operators')
        cls.links: List[Tuple[float, LinkStatus]] = []
        cls.first, cls.second = Collector(FIRST, Image), Collector(SECOND, Image)
        rospy.Subscriber('/robot_sender/link', LinkStatus, lambda link: cls.links.append((time.monotonic(), link)))
        cls.images = rospy.Publisher('/thermal/image_raw', Image, queue_size=1)
        threading.Thread(target=cls.film, daemon=True).start()

    @classmethod
    def film(cls) -> None:
        message = Image(height=120, width=160, encoding='mono16', step=320)
        noise = np.random.RandomState(0)
        with contextlib.suppress(rospy.ROSException):   # the topics are closed: the test has ended
            for _ in ticks(RATE):
                # of what stands still little is sent, by which a link is not known
                message.data = noise.bytes(120 * 320)
                message.header.stamp = rospy.Time.now()
                cls.images.publish(message)

    def rates(self, since: float, until: float = np.inf) -> List[float]:
        """What the robot said that it may send in this time [Mbit/s]."""
        return [link.rate for when, link in list(self.links) if since <= when < until]

    def received(self, seconds: float) -> float:
        """Images that come to the first operator from now on [Hz]."""
        begun = time.monotonic()
        give_time(seconds)
        return sum(when >= begun for when in list(self.first.arrivals.values())) / seconds

    @undisturbed()
    def test_a_second_operator_costs_the_first_one_nothing(self) -> None:
        self.first.wait_connected()
        wait_for(lambda: self.links and self.links[-1][1].rate > 0.9 * MAX_RATE, 60, 'the full rate')
        alone = self.received(4.0)
        self.second.clear()
        second = subprocess.Popen(['rosrun', 'smokebot_udp', 'operator_receiver', '__name:=operator2', '_loss:=0.5',
                                   '_streams_file:=%s' % STREAMS, '%s:=%s' % (FIRST, SECOND)])
        self.addCleanup(second.wait, 10)
        self.addCleanup(second.kill)
        begun = time.monotonic()
        wait_for(lambda: len(self.second.messages) > 20, 60, 'the second operator')
        both = self.received(6.0)
        self.assertGreater(both, 0.8 * alone)
        # half of it in the pauses that measure the path
        self.assertGreater(min(self.rates(begun)), 0.4 * MAX_RATE)
        self.assertTrue(all('as /operator_receiver reports' in link.state or 'as /operator2 reports' in link.state
                            for when, link in list(self.links) if when >= begun))
        second.kill()
        killed = time.monotonic()
        self.assertGreater(self.received(5.0), 0.8 * alone)
        self.assertGreater(min(self.rates(killed)), 0.4 * MAX_RATE)
        self.assertEqual({link.state for when, link in list(self.links) if when >= killed + 1.0},
                         {'as /operator_receiver reports'})


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'two_operators', TwoOperators)
