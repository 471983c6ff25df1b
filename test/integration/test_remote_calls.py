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
from waiting import free_port, wait_for

from smokebot_udp.link.keys import make_key

FOLDER = pathlib.Path(__file__).resolve().parent
STREAMS = 'streams:=%s' % (FOLDER / 'remote_calls.yaml')
START = rospy.Duration(60)      # for nodes on a busy machine
ANSWER = rospy.Duration(10)     # a goal that reaches the operator's node is answered sooner
LOSS = 'loss:=0.3'


class Calls(unittest.TestCase):
    OWN = False
    unknown = 0
    """Calls of which their callers were told that it is unknown whether they were executed."""
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
        except rospy.ServiceException as error:
            cls.unknown += 'whether the service was called is unknown' in str(error)
            return 0

    def assert_called_once_since(self, before: int, unknown: int, after: int) -> None:
        """Between two answers no call was executed but the last; of some, callers were told that it is unknown.

        :param unknown: how many these were at the first answer
        """
        self.assertIn(after, range(before + 1, before + 2 + self.unknown - unknown))

    def restart_robot(self) -> None:
        """Another robot_sender takes the place of the one that is killed."""
        self.robot.stop(self.node)
        type(self).node = self.start_robot('key_file:=' + self.key)

    @staticmethod
    def goal(x: float) -> MoveBaseGoal:
        goal = MoveBaseGoal()
        goal.target_pose.header.frame_id = 'map'
        goal.target_pose.pose.position.x, goal.target_pose.pose.orientation.w = x, 1.0
        return goal

    def send(self, x: float) -> List[Any]:
        """Send a goal; the feedback to it."""
        feedback: List[Any] = []
        self.client.send_goal(self.goal(x), feedback_cb=feedback.append)
        wait_for(lambda: feedback or self.client.get_state() != GoalStatus.PENDING)
        return feedback

    def ends(self, state: int) -> None:
        self.assertTrue(self.client.wait_for_result(START))
        self.assertEqual(GoalStatus.to_string(self.client.get_state()), GoalStatus.to_string(state))

    def outcome(self, x: float) -> str:
        """How a goal ends; empty: a node that has just started, to which its topic is not connected, did not get it."""
        self.client.send_goal(self.goal(x))
        if not self.client.wait_for_result(ANSWER):
            return ''
        return str(GoalStatus.to_string(self.client.get_state()))

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
        self.send(1.0)
        self.ends(GoalStatus.SUCCEEDED)
        feedback = self.send(-1.0)
        wait_for(lambda: len(feedback) > 3, what='feedback')    # it does not end before, however late feedback comes
        self.client.cancel_goal()
        self.ends(GoalStatus.PREEMPTED)

    def test_the_emergency_stop_cancels_goals(self) -> None:
        self.send(-1.0)
        estop = rospy.ServiceProxy('/operator_receiver/estop', SetBool)
        self.addCleanup(estop, False)
        self.assertTrue(estop(True).success)
        self.ends(GoalStatus.PREEMPTED)
        self.send(1.0)
        self.ends(GoalStatus.REJECTED)
        self.assertTrue(estop(False).success)
        self.send(0.1)
        self.ends(GoalStatus.SUCCEEDED)

    def test_a_restart_of_robot_sender(self) -> None:
        feedback = self.send(-1.0)
        before, unknown = wait_for(self.answered), self.unknown
        self.restart_robot()
        self.assert_called_once_since(before, unknown, wait_for(self.answered, START.to_sec(), 'an answer'))
        del feedback[:]
        wait_for(lambda: feedback, START.to_sec(), 'feedback to the goal of before')
        self.client.cancel_goal()
        self.ends(GoalStatus.PREEMPTED)


class CallsOwnMasters(Calls):
    OWN = True


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'remote_calls', CallsOwnMasters if 'own' in sys.argv else Calls)
