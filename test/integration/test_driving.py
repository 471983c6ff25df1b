#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated robot obeys commands as a base's driver, and goals as move_base."""
import math
import pathlib
import sys
import time
import unittest
from typing import Any, List

import rospy
import rostest
import tf2_ros
from actionlib import GoalStatus, SimpleActionClient
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist, Vector3
from move_base_msgs.msg import MoveBaseAction, MoveBaseActionResult, MoveBaseGoal
from nav_msgs.msg import Odometry
from std_msgs.msg import Header
from std_srvs.srv import Trigger

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, ticks, undisturbed, wait_for

from smokebot_udp.simulation.robot import WATCHDOG

TIMEOUT = rospy.Duration(60)
TOUR_PAUSE = 3.0    # in driving.test [s]
FORWARD, STILL = Twist(Vector3(0.4, 0, 0), Vector3()), Twist()


def pose(x: float, y: float, frame: str = 'map', turn: Any = None) -> Any:
    return PoseStamped(Header(stamp=rospy.Time.now(), frame_id=frame),
                       Pose(Point(x, y, 0), turn or Quaternion(0, 0, 0, 1)))


class Driving(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('driving_test')
        cls.commands = rospy.Publisher('/cmd_vel', Twist, queue_size=1, tcp_nodelay=True)
        cls.odometry = Collector('/odom', Odometry)
        cls.client = SimpleActionClient('/move_base', MoveBaseAction)
        assert cls.client.wait_for_server(TIMEOUT)
        cls.transforms = tf2_ros.Buffer()
        cls.listener = tf2_ros.TransformListener(cls.transforms)
        wait_for(cls.commands.get_num_connections, what='the driver')
        wait_for(lambda: cls.odometry.messages, what='the odometry')

    def speeds(self) -> List[float]:
        """The forward speeds that came, in the order of their stamps."""
        return [message.twist.twist.linear.x for _, message in sorted(dict(self.odometry.messages).items())]

    def place(self) -> Any:
        """Where the robot is on the map: (x, y)."""
        found = self.transforms.lookup_transform('map', 'base_link', rospy.Time(0), TIMEOUT)
        return found.transform.translation.x, found.transform.translation.y

    def stop(self) -> None:
        """A stop that is no longer in force: then a goal is accepted."""
        self.drive_still()
        wait_for(lambda: 'outside' in self.refusal(), what='the end of the stop')

    def drive_still(self) -> None:
        """Wait until commands are in force: goals may overtake them."""
        def refused() -> bool:
            self.commands.publish(STILL)
            return self.refusal() == 'the robot is driven by commands'
        wait_for(refused, what='the refusal while commands are in force')

    def refusal(self) -> str:
        """Why a goal is refused that is outside of the building; where commands are in force, for that reason."""
        def refused() -> bool:
            # the first result may be published before the robot has accepted the connection for results
            self.client.send_goal(self.goal(99.0, 2.0))
            return bool(self.client.wait_for_result(rospy.Duration(5)))
        wait_for(refused, what='a result')
        return str(self.client.get_goal_status_text())

    def goal(self, x: float, y: float, **more: Any) -> Any:
        return MoveBaseGoal(target_pose=pose(x, y, **more))

    @undisturbed()
    def test_commands_are_obeyed_until_the_watchdog(self) -> None:
        # a busy machine may deliver the first or the last one late
        wait_for(lambda: abs(self.obeyed_beyond_the_commands() - WATCHDOG) < 0.2, 30, 'a motion that ends in time')
        self.assertAlmostEqual(max(self.speeds()), 0.4, delta=0.01)

    def obeyed_beyond_the_commands(self) -> float:
        """How much longer the robot moves than from the first command to the last one [s]."""
        self.stop()
        self.odometry.clear()
        sent = []
        for _ in zip(range(20), ticks(20.0)):
            self.commands.publish(FORWARD)
            sent.append(time.monotonic())
        wait_for(lambda: self.moving() and abs(self.speeds()[-1]) < 1e-6, 10, 'motion and its end')
        moving = self.moving()
        return moving[-1] - moving[0] - (sent[-1] - sent[0])

    def moving(self) -> List[float]:
        """When the robot moved forward [s]."""
        return sorted(stamp.to_sec() for stamp, message in dict(self.odometry.messages).items()
                      if abs(message.twist.twist.linear.x) > 1e-6)

    @undisturbed()
    def test_a_goal_is_reached_with_feedback(self) -> None:
        self.stop()
        feedback: List[Any] = []
        self.client.send_goal(self.goal(5.0, 7.0), feedback_cb=feedback.append)
        self.assertTrue(self.client.wait_for_result(TIMEOUT))
        self.assertEqual(self.client.get_state(), GoalStatus.SUCCEEDED)
        wait_for(lambda: math.dist(self.place(), (5.0, 7.0)) < 0.05, 5, 'the newest transform')
        self.assertGreater(len(feedback), 5)
        last = feedback[-1].base_position
        self.assertEqual(last.header.frame_id, 'map')
        self.assertLess(math.dist((last.pose.position.x, last.pose.position.y), (5.0, 7.0)), 0.5)

    @undisturbed()
    def test_rviz_goals_are_goals_and_another_one_takes_their_place(self) -> None:
        self.stop()
        results: List[Any] = []
        # without that of a goal of the client, which may come late
        subscriber = rospy.Subscriber('/move_base/result', MoveBaseActionResult, lambda result: None if
                                      result.status.goal_id.id.startswith(rospy.get_name()) else results.append(result))
        goals = rospy.Publisher('/move_base_simple/goal', PoseStamped, queue_size=2)
        self.addCleanup(subscriber.unregister)
        self.addCleanup(goals.unregister)
        wait_for(lambda: goals.get_num_connections() and subscriber.get_num_connections(), what='the robot')
        goals.publish(pose(17.0, 7.0))
        wait_for(lambda: abs(self.speeds()[-1]) > 0.1, 20, 'motion')
        goals.publish(pose(1.0, 0.0, 'base_link'))
        wait_for(lambda: len(results) == 2, 60, 'both results')
        self.assertEqual([result.status.status for result in results], [GoalStatus.PREEMPTED, GoalStatus.SUCCEEDED])

    @undisturbed()
    def test_a_cancelled_goal_stops_the_robot(self) -> None:
        self.stop()
        self.client.send_goal(self.goal(17.0, 7.0))
        wait_for(lambda: abs(self.speeds()[-1]) > 0.1, 20, 'motion')
        self.client.cancel_goal()
        self.assertTrue(self.client.wait_for_result(TIMEOUT))
        self.assertEqual(self.client.get_state(), GoalStatus.PREEMPTED)
        wait_for(lambda: abs(self.speeds()[-1]) < 1e-6, 2, 'the stop')

    @undisturbed()
    def test_a_command_gives_a_goal_up_and_none_is_taken_meanwhile(self) -> None:
        self.stop()
        self.client.send_goal(self.goal(17.0, 7.0))
        wait_for(lambda: abs(self.speeds()[-1]) > 0.1, 20, 'motion')
        self.commands.publish(STILL)
        self.assertTrue(self.client.wait_for_result(TIMEOUT))
        self.assertEqual((self.client.get_state(), self.client.get_goal_status_text()),
                         (GoalStatus.ABORTED, 'the goal is given up: it was driven by commands'))
        self.drive_still()

    def test_goals_that_are_none_are_refused_with_a_reason(self) -> None:
        self.stop()
        for goal, reason in ((self.goal(20.99, 13.99), 'in or behind an obstacle'), (self.goal(99.0, 2.0), 'outside'),
                             (self.goal(5.0, 7.0, frame='elsewhere'), "its frame is 'elsewhere'"),
                             (self.goal(5.0, 7.0, turn=Quaternion()), 'not a quaternion'),
                             (self.goal(math.nan, 7.0), 'not finite'),
                             (self.goal(5.0, 7.0, turn=Quaternion(0, 0, math.nan, 1)), 'not a quaternion')):
            self.client.send_goal(goal)
            self.assertTrue(self.client.wait_for_result(TIMEOUT))
            self.assertEqual(self.client.get_state(), GoalStatus.ABORTED)
            self.assertIn(reason, self.client.get_goal_status_text())

    def test_the_tour_goes_on_after_the_pause(self) -> None:
        begun = rospy.Time.now()
        self.stop()
        stands = rospy.Time.now()       # what was measured before may still be on its way

        def moving() -> Any:
            return min((stamp for stamp, message in dict(self.odometry.messages).items() if stamp > stands and
                        max(abs(message.twist.twist.angular.z), abs(message.twist.twist.linear.x)) > 0.1), default=None)
        self.assertGreater((wait_for(moving, what='motion') - begun).to_sec(), TOUR_PAUSE)

    def test_calls_are_counted(self) -> None:
        rospy.wait_for_service('/count', TIMEOUT)
        count = rospy.ServiceProxy('/count', Trigger)
        answers = [count() for _ in range(3)]
        self.assertTrue(all(answer.success for answer in answers))
        first = int(answers[0].message)
        self.assertEqual([int(answer.message) for answer in answers], [first, first + 1, first + 2])


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'driving', Driving)
