#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Own masters without a key: what operators send the robot is refused on both sides, unless both allow it."""
import os
import pathlib
import sys
import unittest
from typing import Any, List

import rospy
import rostest
from geometry_msgs.msg import Twist, Vector3
from roscpp.srv import GetLoggers
from std_msgs.msg import Int32

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from own_masters import Side
from waiting import free_port, wait_for

STREAMS = pathlib.Path(__file__).resolve().parent / 'unsealed_streams.yaml'
START = 60.0
"""For nodes to start on a busy machine [s]."""

REFUSED = "stream '%s' (%s) is refused: the link has no key, so anybody on the network could use it"
TYPES = {'cmd_vel': 'command', 'list_loggers': 'service', 'goal': 'relay'}


class UnsealedCommands(unittest.TestCase):
    """The test's own node is at the desk."""

    @classmethod
    def setUpClass(cls) -> None:
        cls.robot, cls.desk = Side('robot'), Side('desk')
        cls.addClassCleanup(cls.robot.close)
        cls.addClassCleanup(cls.desk.close)
        os.environ['ROS_MASTER_URI'] = cls.desk.master.uri
        rospy.init_node('test_unsealed_commands')
        cls.plans: List[Any] = []
        rospy.Subscriber('/operator/plan', Int32, cls.plans.append)
        cls.commands = rospy.Publisher('/operator/cmd_vel', Twist, queue_size=1)
        cls.goals = rospy.Publisher('/operator/goal', Int32, queue_size=1)
        cls.robot.start('rostopic', 'pub', '-r', '5', '/plan', 'std_msgs/Int32', '7')

    def start(self, *arguments: str) -> None:
        """Start both nodes, and wait until what comes from the robot arrives."""
        port = free_port()
        for side in (self.robot, self.desk):
            side.forget_output()
        del self.plans[:]
        for side, command in ((self.robot, ('robot.launch', 'link_port:=%d' % port)),
                              (self.desk, ('operator.launch', 'robot:=localhost:%d' % port, 'rviz:=false'))):
            process = side.launch(*command, 'streams:=%s' % STREAMS, *arguments)
            self.addCleanup(side.stop, process)
        wait_for(lambda: self.plans, START, 'the plan')

    def call(self) -> List[Any]:
        rospy.wait_for_service('/operator/get_loggers', START)
        return list(rospy.ServiceProxy('/operator/get_loggers', GetLoggers)().loggers)

    def test_they_are_refused_with_one_sentence(self) -> None:
        self.start()
        for side in (self.robot, self.desk):
            for stream in TYPES.items():
                wait_for(lambda side=side, stream=stream: REFUSED % stream in side.output, START, stream[0])
                self.assertEqual(side.output.count(REFUSED % stream), 1)
            self.assertNotIn("'plan'", side.output)
        with self.assertRaisesRegex(rospy.ServiceException, 'is refused: the link has no key'):
            self.call()
        published = {topic for topic, _ in self.robot.master.call('getSystemState')[0]}
        self.assertFalse(published & {'/cmd_vel', '/goal'})
        self.assertEqual(self.commands.get_num_connections(), 0)

    def test_they_work_where_both_sides_allow_them(self) -> None:
        self.start('allow_unsealed_commands:=true')
        self.robot.start('rostopic', 'echo', '-n', '1', '/cmd_vel/linear/x')
        self.robot.start('rostopic', 'echo', '-n', '1', '/goal/data')

        def came() -> bool:
            self.commands.publish(Twist(linear=Vector3(0.125, 0, 0)))
            self.goals.publish(4711)
            return '0.125' in self.robot.output and '4711' in self.robot.output
        wait_for(came, START, 'a command and a goal')
        self.assertTrue(self.call())
        for side in (self.robot, self.desk):
            self.assertNotIn('is refused', side.output)
            self.assertEqual(side.output.count('anybody on the network can watch, and drive'), 1)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'unsealed_commands', UnsealedCommands)
