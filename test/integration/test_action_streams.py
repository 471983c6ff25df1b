#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Action streams: both runners over real sockets, with actionlib's server and client at a real master."""
import itertools
import pathlib
import sys
import threading
import unittest
import xmlrpc.client
from typing import Any, List, Set, Tuple

import actionlib
import rospy
import rostest
from actionlib import SimpleGoalState
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from move_base_msgs.msg import (
    MoveBaseAction,
    MoveBaseActionGoal,
    MoveBaseActionResult,
    MoveBaseFeedback,
    MoveBaseGoal,
    MoveBaseResult,
)

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from reliable_pair import ReliablePair
from waiting import give_time, stays, undisturbed, wait_for

from smokebot_udp.nodes.operator_action import OperatorAction
from smokebot_udp.nodes.robot_action import RobotAction

MOVE_BASE = {'action_type': 'move_base_msgs/MoveBaseAction', 'robot_action': '/move_base',
             'operator_action': '/operator/move_base', 'max_age': 1.0, 'feedback_rate': 10.0}
TIMEOUT = rospy.Duration(60)


class Server:
    """An action server that follows each goal until it may finish, or is preempted."""

    def __init__(self) -> None:
        self.goals: List[Any] = []
        self.finish = threading.Event()
        self._server = actionlib.SimpleActionServer('/move_base', MoveBaseAction, self._execute, auto_start=False)
        self._server.start()

    def _execute(self, goal: Any) -> None:
        self.goals.append(goal)
        feedback = MoveBaseFeedback()
        while not self.finish.wait(0.01):
            if self._server.is_preempt_requested() or rospy.is_shutdown():
                self._server.set_preempted(text='on request')
                return
            feedback.base_position.header.frame_id = 'map'
            feedback.base_position.pose.position.x += 1.0
            self._server.publish_feedback(feedback)
        self._server.set_succeeded(MoveBaseResult(), 'there')

    def is_active(self) -> bool:
        return bool(self._server.is_active())

    def stop(self) -> None:
        self.finish.set()
        wait_for(lambda: not self.is_active())
        self._server.action_server.stop()


class BareServer:
    """The topics of an action server that says what it is told to."""

    def __init__(self) -> None:
        self.goals: List[Any] = []
        self.cancelled: List[str] = []
        self._status = rospy.Publisher('/move_base/status', GoalStatusArray, queue_size=10)
        self._result = rospy.Publisher('/move_base/result', MoveBaseActionResult, queue_size=10)
        self._topics = [
            self._status, self._result,
            rospy.Subscriber('/move_base/goal', MoveBaseActionGoal, lambda goal: self.goals.append(goal.goal_id)),
            rospy.Subscriber('/move_base/cancel', GoalID, lambda cancel: self.cancelled.append(cancel.id))]

    def connected(self) -> bool:
        return all(topic.get_num_connections() for topic in self._topics)

    def show(self, *goals: Any, value: int = GoalStatus.ACTIVE) -> None:
        """Publish a status with these goals."""
        self._status.publish(GoalStatusArray(status_list=[GoalStatus(goal, value, '') for goal in goals]))

    def succeed(self) -> None:
        self._result.publish(MoveBaseActionResult(status=GoalStatus(self.goals[0], GoalStatus.SUCCEEDED, '')))

    def stop(self) -> None:
        for topic in self._topics:
            topic.unregister()


def goal_at(x: float) -> Any:
    goal = MoveBaseGoal()
    goal.target_pose.header.frame_id = 'ugv1/map'
    goal.target_pose.pose.position.x, goal.target_pose.pose.orientation.w = x, 1.0
    return goal


def connections() -> Set[Tuple[int, str]]:
    """(id, topic) of the connections by which this node sends to itself."""
    with xmlrpc.client.ServerProxy(rospy.get_node_uri()) as proxy:
        node: Any = proxy
        return {(entry[0], entry[4]) for entry in node.getBusInfo(rospy.get_name())[2]
                if entry[1:3] == [rospy.get_name(), 'o']}


class ActionStreams(unittest.TestCase):

    def start(self, loss: float = 0.0, serve: bool = True) -> None:
        """Both sides, an action server and a client, all connected."""
        before = connections()
        self.pair = ReliablePair(loss)
        self.addCleanup(self.pair.close)
        self.server = Server() if serve else None
        if self.server is not None:
            self.addCleanup(self.server.stop)
        self.pair.prefix_frames('ugv1/')
        self.robot = RobotAction('move_base', MOVE_BASE, self.pair.robot)
        self.robot.start()
        self.addCleanup(self.robot.close)
        operator = OperatorAction('move_base', MOVE_BASE, self.pair.operator)
        operator.start()
        self.addCleanup(operator.close)
        self.client = actionlib.SimpleActionClient('/operator/move_base', MoveBaseAction)
        self.addCleanup(self.client.action_client.stop)
        self.feedback: List[Any] = []
        self.wait_for_topics('/operator/move_base', before)
        if serve:
            self.wait_for_topics('/move_base', before)
        wait_for(lambda: self.pair.operator.reliable.peers() and self.pair.robot.reliable.peers(), what='the link')

    @staticmethod
    def wait_for_topics(action: str, before: Set[Tuple[int, str]]) -> None:
        """Wait for connections of all topics of an action that were not there before: they come one by one."""
        wanted = {action + part for part in ('/goal', '/cancel', '/status', '/feedback', '/result')}
        wait_for(lambda: wanted <= {topic for _, topic in connections() - before}, what='the topics of ' + action)

    def send(self, x: float = 1.0) -> None:
        self.client.send_goal(goal_at(x), feedback_cb=self.feedback.append)

    def ends(self, state: int, words: str = '') -> None:
        self.assertTrue(self.client.wait_for_result(TIMEOUT))
        self.assertEqual(GoalStatus.to_string(self.client.get_state()), GoalStatus.to_string(state))
        self.assertIn(words, self.client.get_goal_status_text())

    def check_a_goal(self) -> None:
        self.assertTrue(self.client.wait_for_server(TIMEOUT))
        self.send(7.0)
        wait_for(lambda: len(self.feedback) > 5)
        self.assertEqual(self.client.get_state(), GoalStatus.ACTIVE)
        self.assertEqual(self.feedback[0].base_position.header.frame_id, 'ugv1/map')
        positions = [feedback.base_position.pose.position.x for feedback in self.feedback]
        self.assertEqual(positions, sorted(positions))
        target = self.server.goals[0].target_pose
        self.assertEqual((target.header.frame_id, target.pose.position.x), ('map', 7.0))
        self.server.finish.set()
        self.ends(GoalStatus.SUCCEEDED, 'there')

    def test_a_goal_with_feedback_and_result(self) -> None:
        self.start()
        self.check_a_goal()

    @undisturbed()
    def test_half_of_the_datagrams_are_lost(self) -> None:
        self.start(0.5)
        self.check_a_goal()

    @undisturbed()
    def test_cancel_and_preempt(self) -> None:
        self.start(0.2)
        self.assertTrue(self.client.wait_for_server(TIMEOUT))
        self.send()
        wait_for(lambda: self.feedback)
        self.client.cancel_goal()
        self.ends(GoalStatus.PREEMPTED, 'on request')
        self.send(2.0)
        wait_for(lambda: len(self.server.goals) == 2)
        self.send(3.0)      # takes the place of the one before
        wait_for(lambda: len(self.server.goals) == 3)
        self.client.cancel_all_goals()
        self.ends(GoalStatus.PREEMPTED)
        self.assertEqual([goal.target_pose.pose.position.x for goal in self.server.goals], [1.0, 2.0, 3.0])

    @undisturbed()
    def test_a_cancellation_does_not_overtake_its_goal(self) -> None:
        self.start(0.5)
        self.assertTrue(self.client.wait_for_server(TIMEOUT))
        followed = [self.ends_cancelled() for _ in range(7)]
        self.assertGreaterEqual(sum(followed), 5, followed)

    def ends_cancelled(self) -> bool:
        """Send a goal and cancel it at once; whether its client has followed it until it was cancelled.

        A client takes it for lost without a word when a status comes that is older than the goal.
        """
        self.send()
        self.client.cancel_goal()
        self.assertTrue(self.client.wait_for_result(TIMEOUT))
        state, words = self.client.get_state(), self.client.get_goal_status_text()
        if (state, words) == (GoalStatus.LOST, ''):
            return False
        self.assertIn(state, (GoalStatus.PREEMPTED, GoalStatus.RECALLED), words)
        return True

    @undisturbed()
    def test_a_cancellation_during_a_cut_ends_the_goal_after_it(self) -> None:
        self.start()
        self.assertTrue(self.client.wait_for_server(TIMEOUT))
        self.send()
        wait_for(lambda: self.feedback)
        self.pair.cable.is_cut = True
        self.client.cancel_goal()
        stays(lambda: len(self.server.goals) == 1, 2 * MOVE_BASE['max_age'], 'the goal')
        self.pair.cable.is_cut = False
        self.ends(GoalStatus.PREEMPTED, 'on request')

    @undisturbed()
    def test_what_a_goal_was_to_replace_that_is_lost_in_a_cut_is_cancelled(self) -> None:
        self.start()
        self.assertTrue(self.client.wait_for_server(TIMEOUT))
        self.send()
        wait_for(lambda: self.feedback)
        self.pair.cable.is_cut = True
        self.send(2.0)
        self.ends(GoalStatus.LOST, 'the robot is told to give up what it was to replace: ')
        self.assertTrue(self.server.is_active())
        self.pair.cable.is_cut = False
        wait_for(lambda: not self.server.is_active(), 20, 'the end of the first goal')
        self.assertEqual([goal.target_pose.pose.position.x for goal in self.server.goals], [1.0])

    def test_what_a_refused_goal_was_to_replace_is_cancelled(self) -> None:
        self.start()
        self.assertTrue(self.client.wait_for_server(TIMEOUT))
        self.send()
        wait_for(lambda: self.feedback)
        self.pair.control.change(driver='/operator_receiver@desk2')
        self.send(2.0)
        self.ends(GoalStatus.REJECTED, 'drives; what it was to replace is cancelled: ')
        wait_for(lambda: not self.server.is_active(), 20, 'the end of the first goal')

    def test_emergency_stop_cancels_and_refuses(self) -> None:
        self.start()
        self.assertTrue(self.client.wait_for_server(TIMEOUT))
        self.send()
        wait_for(lambda: self.feedback)
        self.pair.control.change(estop=True)
        self.ends(GoalStatus.PREEMPTED)
        self.send()
        self.ends(GoalStatus.REJECTED, 'the emergency stop is engaged')
        self.assertEqual(len(self.server.goals), 1)
        own = actionlib.SimpleActionClient('/move_base', MoveBaseAction)     # another node of the robot
        self.assertTrue(own.wait_for_server(TIMEOUT))
        own.send_goal(goal_at(1.0))
        self.assertTrue(own.wait_for_result(TIMEOUT))
        self.assertEqual(own.get_state(), GoalStatus.PREEMPTED)
        own.action_client.stop()

    def test_who_does_not_drive_may_only_cancel(self) -> None:
        self.start()
        self.assertTrue(self.client.wait_for_server(TIMEOUT))
        self.send()
        wait_for(lambda: self.feedback)
        self.pair.control.change(driver='/operator_receiver@desk2')
        self.client.cancel_goal()
        self.ends(GoalStatus.PREEMPTED)
        self.send()
        self.ends(GoalStatus.REJECTED, 'not in control: /operator_receiver@desk2 drives')

    def test_without_an_action_server(self) -> None:
        self.start(serve=False)
        self.assertFalse(self.client.wait_for_server(rospy.Duration(1)))
        self.send()
        self.ends(GoalStatus.REJECTED, 'the robot has no action server /move_base')

    def test_without_a_robot_a_goal_is_lost(self) -> None:
        self.start(serve=False)
        self.robot.close()
        self.pair.end_robot()
        self.send()
        self.ends(GoalStatus.LOST, 'the goal was not taken up within 3 s: no robot is connected')

    @undisturbed()
    def test_a_restart_of_the_robots_node(self) -> None:
        """The action server goes on, and the client follows it again."""
        self.start()
        self.assertTrue(self.client.wait_for_server(TIMEOUT))
        self.send()
        wait_for(lambda: self.feedback)
        self.robot.close()
        before = connections()
        self.pair.restart_robot()
        del self.feedback[:]
        self.robot = RobotAction('move_base', MOVE_BASE, self.pair.robot)
        self.robot.start()
        self.addCleanup(self.robot.close)
        self.wait_for_topics('/move_base', before)
        wait_for(lambda: self.feedback)
        self.server.finish.set()
        self.ends(GoalStatus.SUCCEEDED)
        stays(lambda: len(self.server.goals) == 1, 1.0, 'the one goal')

    def test_a_result_that_comes_after_the_goal_has_left_the_status(self) -> None:
        self.start(serve=False)
        bare = BareServer()
        self.addCleanup(bare.stop)
        self.send_to(bare)
        bare.show()
        stays(lambda: self.client.get_state() == GoalStatus.ACTIVE, 1.0, 'the active goal')
        bare.succeed()
        self.ends(GoalStatus.SUCCEEDED)

    def test_a_goal_that_the_action_server_forgets_is_lost(self) -> None:
        self.start(serve=False)
        bare = BareServer()
        self.addCleanup(bare.stop)
        self.send_to(bare)
        self.ends_while(bare.show)

    def test_a_result_that_never_comes(self) -> None:
        """robot_sender was away when the action server published it."""
        self.start(serve=False)
        bare = BareServer()
        self.addCleanup(bare.stop)
        self.send_to(bare)
        self.ends_while(lambda: bare.show(bare.goals[0], value=GoalStatus.SUCCEEDED))

    def ends_while(self, show: Any) -> None:
        """The goal is lost after some statuses."""
        for _ in itertools.takewhile(lambda _: self.client.simple_state != SimpleGoalState.DONE, range(100)):
            show()
            give_time(0.2)
        self.ends(GoalStatus.LOST, 'its result has not come from the robot')

    def test_a_lost_goal_that_the_robot_has_all_the_same_is_cancelled(self) -> None:
        self.start(serve=False)
        bare = BareServer()
        self.addCleanup(bare.stop)
        wait_for(bare.connected)

        def arrived() -> Any:
            self.send()
            self.ends(GoalStatus.LOST, 'no status of the action server has it')
            return bare.goals
        wait_for(arrived, what='the goal')
        self.assertEqual(bare.cancelled, [])
        bare.show(bare.goals[0])
        wait_for(lambda: bare.cancelled == [bare.goals[0].id])

    def send_to(self, bare: Any) -> None:
        """Send a goal that becomes active."""
        wait_for(bare.connected)
        self.send()

        def arrived() -> bool:
            if self.client.simple_state == SimpleGoalState.DONE:
                self.send()     # it was older than max_age when it could have arrived
            return bool(bare.goals)
        wait_for(arrived, what='the goal')
        bare.show(bare.goals[0])
        wait_for(lambda: self.client.get_state() == GoalStatus.ACTIVE)


if __name__ == '__main__':
    rospy.init_node('action_streams')
    rostest.rosrun('smokebot_udp', 'action_streams', ActionStreams)
