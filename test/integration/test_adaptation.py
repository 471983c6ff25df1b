#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What the robot sends follows what an emulated link carries, while the whole stack runs.

Bounds are wide: experiments/link/adaptation.py measures how well it follows.
"""
import math
import pathlib
import sys
import time
import unittest
from typing import Any, List

import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import give_time, undisturbed, wait_for

from evaluation.listener import Listener
from evaluation.stack import Stack
from smokebot_udp.link_lab.lab import LabError

FORGER = pathlib.Path(__file__).resolve().parent / 'forged_reports.py'
LINK, TOLD = '/robot_sender/link', '/diagnostics'
PICTURES, ODOM, CLOUDS = '/operator/thermal/image_raw', '/operator/odom', '/operator/lidar/points'
AIR = {'delay': 0.02, 'loss': 0.05, 'queue': 0.2}
FLOOR = 0.1
"""min_rate [Mbit/s]"""


class Adaptation(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> Any:
        try:
            cls.stack = Stack(seed=7)
        except LabError as error:
            raise unittest.SkipTest(str(error)) from None
        cls.addClassCleanup(cls.stack.close)
        cls.stack.lab.set({'rate': 5e6, **AIR, 'loss': 0.0})
        cls.stack.start_node('robot', 'simulated_robot', '_width:=320', '_height:=240')
        cls.stack.start_node('robot', 'robot_sender', '_min_rate:=%g' % FLOOR)
        cls.stack.start_node('operator', 'operator_receiver')
        cls.robot, cls.operator = Listener(cls.stack, 'robot'), Listener(cls.stack)
        cls.robot.subscribe([[LINK, 'link', 'TCPROS'], [TOLD, 'diagnostics', 'TCPROS']])
        cls.operator.subscribe([[PICTURES, 'image', 'TCPROS'], [ODOM, 'odometry', 'TCPROS'],
                                [CLOUDS, 'cloud', 'TCPROS']])
        missing = {PICTURES, ODOM} - set(cls.operator.first([PICTURES, ODOM], 60.0))
        assert not missing, 'nothing comes on %s' % missing

    def setUp(self) -> None:
        self.link(5.0)

    def link(self, rate, **sides) -> None:
        """Change the link to a rate [Mbit/s]."""
        self.stack.lab.set({'rate': 1e6 * rate, **AIR}, **sides)

    def told(self, since) -> Any:
        """What the robot told of the link since a time: [{rate, capacity, ...}, ...]."""
        return [heard.amount for heard in list(self.robot.heard) if heard.topic == LINK and heard.arrival >= since]

    def texts(self, since: float) -> List[str]:
        """What diagnostics of the robot say since a time."""
        return [text for heard in list(self.robot.heard) if heard.topic == TOLD and heard.arrival >= since
                for text in heard.amount]

    def wait(self, condition, seconds, what) -> None:
        """Until the mean of what the robot told of its rate in a second fulfils a condition [Mbit/s]."""
        def fulfilled() -> bool:
            rates = [amount['rate'] for amount in self.told(time.time() - 1.0)]
            return len(rates) >= 5 and condition(sum(rates) / len(rates))
        wait_for(fulfilled, seconds, what)

    def counted(self, seconds) -> Any:
        """(pictures, odometry messages) that came to the operator from now on."""
        topics = [heard.topic for heard in self.operator.during(seconds)]
        return topics.count(PICTURES), topics.count(ODOM)

    def follows(self, rate) -> None:
        self.link(rate)
        self.wait(lambda mean: mean <= 1.3 * rate, 10.0, 'not above what the link carries')
        self.wait(lambda mean: mean >= 0.6 * rate, 15.0, 'most of what the link carries')

    @undisturbed()
    def test_the_rate_follows_the_link_down_and_up_and_something_of_all_keeps_coming(self) -> None:
        self.wait(lambda mean: mean >= 3.0, 15.0, 'a good link is used')
        for rate in (1.0, 0.3):
            self.follows(rate)
            pictures, odometry = self.counted(5.0)
            self.assertGreaterEqual(pictures, 4, rate)
            self.assertGreaterEqual(odometry, 5, rate)
        self.follows(5.0)
        # what had to wait comes again
        self.assertIn(CLOUDS, self.operator.first([CLOUDS], 20.0))

    @undisturbed()
    def test_without_reports_the_rate_falls_to_its_floor_and_diagnostics_say_so(self) -> None:
        self.wait(lambda mean: mean >= 3.0, 15.0, 'a good link is used')
        self.link(5.0, operator={'loss': 1.0})
        self.wait(lambda mean: mean <= 1.1 * FLOOR, 20.0, 'the floor')
        begun = time.time()
        wait_for(lambda: [text for text in self.texts(begun) if text.startswith('no reports of /operator_receiver')],
                 15, 'the problem')
        pictures, odometry = self.counted(5.0)
        self.assertGreaterEqual(odometry, 3)    # nothing is lost on the robot's way
        self.link(5.0)
        self.wait(lambda mean: mean >= 3.0, 20.0, 'once reports come again')

    @undisturbed()
    def test_forged_reports_change_nothing(self) -> None:
        # this link is full: of one that is not, a train that came too fast is believed for seconds
        self.follows(1.0)
        forger = self.stack.start('operator', sys.executable, str(FORGER))
        begun = time.time()
        try:
            wait_for(lambda: any('reports refused' in text for text in self.texts(begun)), 30, 'refused reports')
            since = time.time()
            give_time(5.0)
            rates = [amount['rate'] for amount in self.told(since)]
        finally:
            self.stack.end(forger)
        mean = sum(rates) / len(rates)
        self.assertTrue(0.6 <= mean <= 1.3, mean)
        self.assertTrue(all(math.isfinite(rate) and rate <= 20.0 for rate in rates), rates)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'adaptation', Adaptation)
