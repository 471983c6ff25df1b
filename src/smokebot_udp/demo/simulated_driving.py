# SPDX-License-Identifier: BSD-3-Clause
"""Drives the simulated robot: by commands as a base's driver, and to goals as a navigation stack, with their names.

Topics and services: see demo/simulated_robot.py. The robot itself is simulation.robot.Robot.
"""
import itertools
import math
import threading
from typing import Any, Callable, Optional, Tuple

import rospy
from actionlib import SimpleActionServer
from geometry_msgs.msg import Point, Pose, PoseStamped, Twist
from move_base_msgs.msg import MoveBaseAction, MoveBaseActionGoal, MoveBaseFeedback
from std_srvs.srv import Trigger, TriggerResponse

from ..frame_names import frame_name
from ..simulation.odometry import Odometry
from ..simulation.pose import Pose as PlanarPose
from ..simulation.pose import compose
from ..simulation.robot import REACHED, Robot
from .simulated_topics import quaternion

FEEDBACK_PERIOD = 0.1
"""[s]"""

MIN_QUATERNION = 1e-3
"""Shorter ones are none: a message that nobody has filled in."""


class SharedRobot:
    """A Robot for several threads; see there."""

    def __init__(self, robot: Robot) -> None:
        self._robot, self._lock = robot, threading.Lock()

    def pose(self, time: float) -> PlanarPose:
        with self._lock:
            return self._robot.pose(time)

    def travelled(self, time: float) -> float:
        with self._lock:
            return self._robot.travelled(time)

    def twist(self, time: float) -> Tuple[float, float]:
        with self._lock:
            return self._robot.twist(time)

    def command(self, forward: float, turn: float, time: float) -> None:
        with self._lock:
            self._robot.command(forward, turn, time)

    def go_to(self, goal: PlanarPose, time: float) -> int:
        with self._lock:
            return self._robot.go_to(goal, time)

    def cancel(self, number: int, time: float) -> None:
        with self._lock:
            self._robot.cancel(number, time)

    def outcome(self, number: int, time: float) -> Optional[str]:
        with self._lock:
            return self._robot.outcome(number, time)


def planar(pose: Any) -> PlanarPose:
    """The (x, y, yaw) of a geometry_msgs/Pose.

    :raises ValueError: where its orientation is none
    """
    q = pose.orientation
    length = math.sqrt(q.x ** 2 + q.y ** 2 + q.z ** 2 + q.w ** 2)
    if not length > MIN_QUATERNION or math.isinf(length):
        raise ValueError('its orientation (%g, %g, %g, %g) is not a quaternion' % (q.x, q.y, q.z, q.w))
    yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), q.w ** 2 + q.x ** 2 - q.y ** 2 - q.z ** 2)
    return pose.position.x, pose.position.y, yaw


def pose_message(pose: PlanarPose) -> Any:
    """The geometry_msgs/Pose of a (x, y, yaw)."""
    return Pose(Point(pose[0], pose[1], 0.0), quaternion(pose[2]))


class Commands:
    """Obeys cmd_vel.

    :param now: f() -> the simulation's time [s]
    """

    def __init__(self, robot: SharedRobot, now: Callable[[], float]) -> None:
        self._robot, self._now = robot, now
        rospy.Subscriber('cmd_vel', Twist, self._obey, queue_size=1)

    def _obey(self, twist: Any) -> None:
        self._robot.command(twist.linear.x, twist.angular.z, self._now())


class MoveBase:
    """The action move_base, and the topic move_base_simple/goal, which starts the action, as move_base has them.

    :param odometry: of the robot
    :param now: f() -> the simulation's time [s]
    """

    def __init__(self, robot: SharedRobot, odometry: Odometry, now: Callable[[], float]) -> None:
        self._robot, self._odometry, self._now = robot, odometry, now
        self._preempted = threading.Event()
        self._server = SimpleActionServer('move_base', MoveBaseAction, self._execute, auto_start=False)
        self._server.register_preempt_callback(self._preempted.set)
        self._server.start()
        self._goals = rospy.Publisher('move_base/goal', MoveBaseActionGoal, queue_size=5)
        rospy.Subscriber('move_base_simple/goal', PoseStamped, self._start, queue_size=1)

    def _start(self, goal: Any) -> None:
        message = MoveBaseActionGoal()
        message.header.stamp = rospy.Time.now()
        message.goal.target_pose = goal
        self._goals.publish(message)

    def _execute(self, goal: Any) -> None:
        try:
            number = self._robot.go_to(self._in_map(goal.target_pose), self._now())
        except ValueError as error:
            rospy.logerr('the goal is refused: %s', error)
            self._server.set_aborted(text=str(error))
            return
        outcome = self._follow(number)
        if outcome is None:
            self._robot.cancel(number, self._now())
            self._server.set_preempted(text='the goal was cancelled')
        elif outcome == REACHED:
            self._server.set_succeeded(text='the goal is reached')
        else:
            rospy.logwarn('the goal is given up: %s', outcome)
            self._server.set_aborted(text='the goal is given up: ' + outcome)

    def _follow(self, number: int) -> Optional[str]:
        """The outcome of a goal, once there is one; None: it was cancelled, or another one came."""
        while not self._server.is_preempt_requested() and not rospy.is_shutdown():
            self._preempted.clear()
            outcome = self._robot.outcome(number, self._now())
            if outcome is not None:
                return outcome
            feedback = MoveBaseFeedback()
            feedback.base_position.header.stamp, feedback.base_position.header.frame_id = rospy.Time.now(), 'map'
            feedback.base_position.pose = pose_message(self._robot.pose(self._now()))
            self._server.publish_feedback(feedback)
            self._preempted.wait(FEEDBACK_PERIOD)
        return None

    def _in_map(self, goal: Any) -> PlanarPose:
        """The (x, y, yaw) of a PoseStamped in the map.

        :raises ValueError: where it is in another frame than the robot's, or no pose
        """
        pose, time, frame = planar(goal.pose), self._now(), frame_name(goal.header.frame_id)
        if frame == 'map':
            return pose
        if frame == 'odom':
            return compose(self._odometry.correction(time), pose)
        if frame == 'base_link':
            return compose(self._robot.pose(time), pose)
        raise ValueError("its frame is '%s', must be map, odom or base_link" % goal.header.frame_id)


class Counter:
    """The service count: counts its calls, for whoever wants to see that each is executed once."""

    def __init__(self) -> None:
        self._numbers = itertools.count(1)
        rospy.Service('count', Trigger, self._count)

    def _count(self, _: Any) -> Any:
        return TriggerResponse(True, str(next(self._numbers)))
