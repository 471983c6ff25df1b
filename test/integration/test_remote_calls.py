#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Services and actions through robot_sender and operator_receiver, which lose datagrams.

The argument chooses: `shared`, over one master; `own`, with a master for each side.
"""
import os
import pathlib
import sys
import tempfile
import unittest
from concurrent.futures import ThreadPoolExecutor
from typing import Any, List

import actionlib
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from std_srvs.srv import SetBool, Trigger

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from own_masters import Side
from test_udpros_master import free_port
from waiting import wait_for

from smokebot_udp.link.keys import make_key

FOLDER = pathlib.Path(__file__).resolve().parent
STREAMS = 'streams:=%s' % (FOLDER / 'remote_calls.yaml')
START = rospy.Duration(60)      # for nodes on a busy machine
LOSS = 'loss:=0.3'


class Calls(unittest.TestCase):
    OWN = False
    robot: Side
    desk: Side

    @classmethod
    def setUpClass(cls) -> None:
        cls.robot = Side('robot')
        cls.addClassCleanup(cls.robot.close)
        cls.desk = cls.robot
        if cls.OWN:
            cls.desk = Side('desk')
            cls.addClassCleanup(cls.desk.close)
        os.environ['ROS_MASTER_URI'] = cls.desk.master.uri
        rospy.init_node('test_remote_calls')
        cls.robot.start(sys.executable, str(FOLDER / 'remote_calls_robot.py'))
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.key = str(pathlib.Path(folder.name) / 'key')
        make_key(cls.key)
        cls.port = free_port()
        cls.node = cls.start_robot('key_file:=' + cls.key)
        wait_for(lambda: cls.robot.parameter('/run_id'), START.to_sec(), 'the first launch')    # of one master
        cls.receiver = cls.start_desk('key_file:=' + cls.key, LOSS)
        cls.count = rospy.ServiceProxy('/operator/count', Trigger)
        cls.count.wait_for_service(START)
        wait_for(cls.answered, START.to_sec(), 'the first answer')
        cls.client = actionlib.SimpleActionClient('/operator/move_base', MoveBaseAction)
        assert cls.client.wait_for_server(START)

    @classmethod
    def start_robot(cls, *arguments: str) -> Any:
        return cls.robot.launch('robot.launch', STREAMS, *(['link_port:=%d' % cls.port, *arguments] if cls.OWN else ()))

    @classmethod
    def start_desk(cls, *arguments: str) -> Any:
        link = ['robot:=localhost:%d' % cls.port, *arguments] if cls.OWN else [LOSS]
        return cls.desk.launch('operator.launch', STREAMS, 'rviz:=false', *link)

    @classmethod
    def answered(cls) -> int:
        """The number of calls as the robot counts them, this one included; 0: no answer."""
        try:
            return int(cls.count().message)
        except rospy.ServiceException:
            return 0

    def restart_robot(self) -> None:
        """Another robot_sender takes the place of the one that is killed."""
        self.robot.stop(self.node)
        type(self).node = self.start_robot('key_file:=' + self.key)

    def send(self, x: float) -> List[Any]:
        """Send a goal; the feedback to it."""
        goal, feedback = MoveBaseGoal(), []
        goal.target_pose.header.frame_id = 'map'
        goal.target_pose.pose.position.x, goal.target_pose.pose.orientation.w = x, 1.0
        self.client.send_goal(goal, feedback_cb=feedback.append)
        wait_for(lambda: feedback or self.client.get_state() != GoalStatus.PENDING)
        return feedback

    def ends(self, state: int) -> None:
        self.assertTrue(self.client.wait_for_result(START))
        self.assertEqual(GoalStatus.to_string(self.client.get_state()), GoalStatus.to_string(state))

    def in_control(self) -> bool:
        self.send(0.02)
        self.client.wait_for_result(START)
        return self.client.get_state() == GoalStatus.SUCCEEDED

    def test_each_call_is_executed_once(self) -> None:
        first = self.answered()
        self.assertEqual([self.answered() - first for _ in range(100)], list(range(1, 101)))
        with ThreadPoolExecutor(16) as pool:
            found = list(pool.map(
                lambda _: int(rospy.ServiceProxy('/operator/count', Trigger)().message), range(100)))
        self.assertEqual(sorted(found), list(range(first + 101, first + 201)))

    def test_a_service_that_the_robot_lacks(self) -> None:
        with self.assertRaises(rospy.ServiceException) as caught:
            rospy.ServiceProxy('/operator/missing', Trigger)()
        self.assertIn('on the robot: service [/missing] unavailable', str(caught.exception))

    def test_goals(self) -> None:
        feedback = self.send(1.0)
        self.ends(GoalStatus.SUCCEEDED)
        self.assertGreater(len(feedback), 3)
        self.send(-1.0)
        self.client.cancel_goal()
        self.ends(GoalStatus.PREEMPTED)

    def test_the_emergency_stop_cancels_goals(self) -> None:
        self.send(-1.0)
        estop = rospy.ServiceProxy('/operator_receiver/estop', SetBool)
        self.assertTrue(estop(True).success)
        self.ends(GoalStatus.PREEMPTED)
        self.send(1.0)
        self.ends(GoalStatus.REJECTED)
        self.assertTrue(estop(False).success)
        self.send(0.1)
        self.ends(GoalStatus.SUCCEEDED)

    def test_a_restart_of_robot_sender(self) -> None:
        feedback = self.send(-1.0)
        before = wait_for(self.answered)
        self.restart_robot()
        after = wait_for(self.answered, START.to_sec(), 'an answer')
        self.assertEqual(after, before + 1)
        del feedback[:]
        wait_for(lambda: feedback, START.to_sec(), 'feedback to the goal of before')
        self.client.cancel_goal()
        self.ends(GoalStatus.PREEMPTED)


class CallsOwnMasters(Calls):
    OWN = True

    def test_refused_without_a_key(self) -> None:
        """Callers are told why; the robot executes nothing."""
        before = wait_for(self.answered)
        self.robot.stop(self.node)
        self.desk.stop(self.receiver)
        type(self).node, type(self).receiver = self.start_robot(), self.start_desk()
        self.count.wait_for_service(START)
        with self.assertRaises(rospy.ServiceException) as caught:
            self.count()
        self.assertIn('key', str(caught.exception))
        wait_for(self.client.action_client.pub_goal.get_num_connections)
        self.send(1.0)
        self.ends(GoalStatus.REJECTED)
        self.robot.stop(self.node)
        self.desk.stop(self.receiver)
        type(self).node = self.start_robot('key_file:=' + self.key)
        type(self).receiver = self.start_desk('key_file:=' + self.key, LOSS)
        self.assertEqual(wait_for(self.answered, START.to_sec(), 'an answer'), before + 1)
        self.assertTrue(self.client.wait_for_server(START))
        wait_for(self.in_control, what='control')


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'remote_calls', CallsOwnMasters if 'own' in sys.argv else Calls)
