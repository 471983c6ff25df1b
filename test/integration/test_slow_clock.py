#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A robot whose clock runs at 0.7 of real time, and an operator with a master and a clock of its own: the view stays
fresh."""
import os
import pathlib
import sys
import tempfile
import time
import unittest
from typing import Any, List, Tuple

import numpy as np
import rospy
import rostest
from sensor_msgs.msg import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from own_masters import Side
from waiting import free_port, stays, undisturbed, wait_for

from smokebot_udp.codecs.display.view import COLOURS, FRESH, FROZEN

HERE = pathlib.Path(__file__).resolve().parent
STREAMS = HERE / 'slow_clock.yaml'
LASTS = 20.0
"""A clock that is taken for one of another rate is 6 s wrong by then [s]."""


class SlowClock(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        robot, desk, port = Side('robot'), Side('desk'), free_port()
        cls.addClassCleanup(robot.close)
        cls.addClassCleanup(desk.close)
        robot.set('/use_sim_time', True)
        robot.start(str(HERE / 'slow_clock_robot.py'))
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        common = 'streams:=%s' % STREAMS, 'key_file:=%s/link.key' % folder.name
        robot.launch('robot.launch', 'link_port:=%d' % port, *common)
        desk.launch('operator.launch', 'robot:=localhost:%d' % port, 'rviz:=false', *common)
        os.environ['ROS_MASTER_URI'] = desk.master.uri
        rospy.init_node('test_slow_clock')
        cls.views: List[Tuple[float, Any]] = []
        rospy.Subscriber('/operator/thermal/view', Image, cls.take, queue_size=10)

    @classmethod
    def take(cls, view: Any) -> None:
        cls.views.append((time.monotonic(), tuple(np.frombuffer(view.data, np.uint8)[:3].tolist())))

    @undisturbed()
    def test_the_view_stays_fresh(self) -> None:
        wait_for(lambda: self.views and self.views[-1][1] == COLOURS[FRESH], 120, 'a fresh view')
        begun = time.monotonic()
        stays(lambda: self.views[-1][1] != COLOURS[FROZEN], LASTS, 'a view that is not red')
        states = [state for at, state in self.views if at > begun + LASTS / 2]
        self.assertGreater(states.count(COLOURS[FRESH]), 0.9 * len(states))


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'slow_clock', SlowClock)
