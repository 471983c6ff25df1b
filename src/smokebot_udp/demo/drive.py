# SPDX-License-Identifier: BSD-3-Clause
"""Drives the demo's robot from the operator's side, and measures on the robot's side whether it obeys.

First a goal crosses the link, then commands do until the end. Each command has a turn rate of its own, by which it is
known on the robot.
"""
import bisect
import contextlib
import itertools
import math
import threading
import time
from typing import Any, Callable, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import rospy
import tf2_ros
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Pose, PoseStamped, Twist, Vector3
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult
from std_msgs.msg import String

from ..nodes.operator_control import IN_CONTROL, STATE_TOPIC
from ..nodes.parameters import SIMULATED_ROBOT
from ..simulation.drive import ahead
from ..streams import classified
from ..streams.frame_prefix import with_prefix
from ..streams.relay.parameters import TO_ROBOT
from ..udpros import rpc
from .foreign_publishers import published_at
from .simulated_driving import planar, pose_message

ROBOT_GOAL, ROBOT_RESULT, ROBOT_COMMAND = '/move_base_simple/goal', '/move_base/result', '/cmd_vel'
ROBOT_TAKEN, ROBOT_ODOMETRY = '/move_base/goal', '/odom'
"""Topics of the simulated robot."""

POLL_PERIOD = 0.1
"""[s]"""

CONNECTION_TIMEOUT = 20.0
"""For the operator's side to listen, and to be in control, and for the robot's navigation to run [s]."""

REPEAT_PERIOD = 2.0
"""A goal that the robot has not taken up is sent again after this time: its nodes may be just connecting [s]."""

GOAL_DISTANCE = 1.5
"""Distance from the robot to its goal [m]."""

GOAL_SHARE = 0.7
"""Maximum part of the duration in which the robot drives to its goal; then the commands begin."""

RATE = 20.0
"""Rate of the commands [Hz]."""

TURN_RATE, TURN_STEP = 0.3, 1e-6
"""Turn rate of the first command, and its increase from one command to the next [rad/s]."""

IN_FORCE = 1 / RATE + 0.02
"""A command counts as in force if it, or a newer one, is on the robot after this time: one period and 20 ms. Half of
the round trip is 0 on one machine [s]."""

GOOD_SHARE = 0.95
"""Minimum ratio of commands that are in force for a good result."""

LATE = IN_FORCE / 4
"""A command passes four threads on its way: this one, operator_receiver, robot_sender, and this process again. Where
each wakes late by this, no link is fast enough [s]."""

SLOW = 0.9
"""A machine that has time for all makes at least this share of the odometry that it should: nothing of it has crossed
the link yet, and it needs less time than anything else of the robot."""

ODOMETRY_RATE = SIMULATED_ROBOT['odom_rate'].default
"""[Hz]"""


def lateness(waits: Sequence[float], rate: float) -> str:
    """Whether the machine had too little time, in words; empty: it had enough.

    :param waits: by how much this process woke later than it had asked for, each time [s]
    :param rate: of the odometry as it came to this process [Hz]
    """
    worst = sorted(waits)[-max(1, len(waits) // 20)] if waits else 0.0
    found = ['it woke %.0f ms late one time in twenty' % (1e3 * worst)] if worst >= LATE else []
    if rate < SLOW * ODOMETRY_RATE:
        found.append('it made %.0f of %.0f Hz of odometry' % (rate, ODOMETRY_RATE))
    return ', '.join(found)


class Topics(NamedTuple):
    """The resolved names on the operator's side of what drives the robot."""
    goal: str
    """PoseStamped"""
    command: str
    """Twist"""
    control: str
    """String, which says whether commands would be obeyed."""


def share_in_force(sent: Sequence[float], arrived: Sequence[Tuple[float, int]], limit: float) -> float:
    """The share of commands that were in force in time, or a newer one was, 0..1.

    :param sent: when each command was sent, in order [s]
    :param arrived: [(when [s], index of the command)], in the order of arrival
    :param limit: [s]
    """
    times, newest = [], []      # type: List[float], List[int]
    for when, index in arrived:
        times.append(when)
        newest.append(max(index, newest[-1] if newest else -1))
    good = 0
    for index, when in enumerate(sent):
        before = bisect.bisect_right(times, when + limit)
        good += bool(before and newest[before - 1] >= index)
    return good / len(sent)


def topics_of(definitions: Mapping[str, Dict[str, Any]], in_namespace: Callable[[str], str]) -> Optional[Topics]:
    """The topics of the streams that drive the simulated robot; None: it cannot be driven.

    :param definitions: {name: settings} of all streams
    :param in_namespace: f(operator_topic) -> its resolved name
    """
    found = classified(definitions)
    goals = {one['robot_topic']: one['operator_topic'] for one in found.reliable.values()
             if one['direction'] == TO_ROBOT}
    commands = {one['robot_topic']: one['operator_topic'] for one in found.commands.values()}
    if ROBOT_GOAL not in goals or ROBOT_COMMAND not in commands:
        return None
    return Topics(in_namespace(goals[ROBOT_GOAL]), in_namespace(commands[ROBOT_COMMAND]),
                  in_namespace(STATE_TOPIC))


class DemoDrive:
    """Drives and measures.

    :param frame_prefix: what the operator's side puts before the robot's frames
    """

    def __init__(self, topics: Topics, frame_prefix: str) -> None:
        self._topics, self._frame = topics, with_prefix('map', frame_prefix)
        self._sent: List[float] = []
        self._arrived: List[Tuple[float, int]] = []
        self._waits: List[float] = []
        self._odometry = itertools.count()
        self._rate = ODOMETRY_RATE
        self._goal = 'no goal was sent'
        self._result: Optional[Any] = None
        self._taken, self._over = threading.Event(), threading.Event()      # the goal
        self._control = ''
        self._transforms = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._transforms)
        self._goals = rospy.Publisher(topics.goal, PoseStamped, queue_size=1)
        self._commands = rospy.Publisher(topics.command, Twist, queue_size=5, tcp_nodelay=True)
        rospy.Subscriber(ROBOT_COMMAND, Twist, self._obeyed, queue_size=100, tcp_nodelay=True)
        rospy.Subscriber(ROBOT_ODOMETRY, rospy.AnyMsg, lambda _: next(self._odometry), queue_size=100)
        rospy.Subscriber(topics.control, String, self._take_control, queue_size=5)
        rospy.Subscriber(ROBOT_TAKEN, MoveBaseActionGoal, lambda _: self._taken.set(), queue_size=5)
        self._results = rospy.Subscriber(ROBOT_RESULT, MoveBaseActionResult, self._ended, queue_size=5)

    @contextlib.contextmanager
    def connected(self, master: str, look: Callable[[], None]) -> Iterator[None]:
        """A context in which the operator's side listens, and the robot obeys it.

        :param master: URI of the operator's master; empty: this process's
        :param look: f(), called meanwhile
        """
        with contextlib.ExitStack() as stack:
            if master:
                with contextlib.suppress(rpc.Unreachable, rpc.Refused):
                    stack.enter_context(published_at(master, {self._topics.goal: PoseStamped._type,
                                                              self._topics.command: Twist._type}))
            deadline = time.monotonic() + CONNECTION_TIMEOUT
            while not self._ready() and time.monotonic() < deadline and not rospy.is_shutdown():
                look()
                time.sleep(POLL_PERIOD)
            yield

    def _ready(self) -> bool:
        return bool(self._goals.get_num_connections() and self._commands.get_num_connections()
                    and self._results.get_num_connections() and self._control.startswith(IN_CONTROL))

    def run(self, seconds: float) -> None:
        """Drive for this time [s]."""
        begun, before = time.monotonic(), next(self._odometry)
        end = begun + seconds
        self._send_goal(GOAL_SHARE * seconds)
        due = time.monotonic()
        while due < end and not rospy.is_shutdown():
            if due > time.monotonic():
                time.sleep(max(0.0, due - time.monotonic()))
                self._waits.append(time.monotonic() - due)
            turn = TURN_RATE + TURN_STEP * len(self._sent)
            self._sent.append(time.monotonic())
            self._commands.publish(Twist(Vector3(), Vector3(0.0, 0.0, turn)))
            due += 1 / RATE
        time.sleep(IN_FORCE)
        self._rate = (next(self._odometry) - before) / (time.monotonic() - begun)

    def line(self) -> str:
        """The report."""
        if not self._sent:
            return 'goal: ' + self._goal
        share, late = share_in_force(self._sent, list(self._arrived), IN_FORCE), lateness(self._waits, self._rate)
        good = self._result is not None and self._result.status == GoalStatus.SUCCEEDED and share >= GOOD_SHARE
        verdict = 'good' if good else 'poor, and this machine, not the link, was late: ' + late if late else 'poor'
        return 'goal: %s, commands in force %.1f %% (of %d): %s' % (self._goal, 100 * share, len(self._sent), verdict)

    def _send_goal(self, timeout: float) -> None:
        """Send a goal, and wait until it is over.

        :param timeout: [s]
        """
        try:
            here = self._transforms.lookup_transform('map', 'base_link', rospy.Time(0), rospy.Duration(timeout))
        except tf2_ros.TransformException as error:
            self._goal = 'not sent: %s' % error
            return
        place, turn = here.transform.translation, here.transform.rotation
        goal = PoseStamped(pose=pose_message(ahead(planar(Pose(place, turn)), GOAL_DISTANCE)))
        goal.header.stamp, goal.header.frame_id = rospy.Time.now(), self._frame
        begun, sent = time.monotonic(), -math.inf
        while time.monotonic() < begun + timeout and not rospy.is_shutdown():
            if not self._taken.is_set() and time.monotonic() >= sent + REPEAT_PERIOD:
                self._goals.publish(goal)
                sent = time.monotonic()
            waited = time.monotonic()
            if self._over.wait(POLL_PERIOD):
                break
            self._waits.append(time.monotonic() - waited - POLL_PERIOD)
        seconds = time.monotonic() - begun
        if self._result is None:
            self._goal = 'not reached within %.1f s' % seconds
        elif self._result.status == GoalStatus.SUCCEEDED:
            self._goal = 'reached in %.1f s' % seconds
        else:
            self._goal = 'not reached: %s' % self._result.text

    def _obeyed(self, twist: Any) -> None:
        index = round((twist.angular.z - TURN_RATE) / TURN_STEP)
        if 0 <= index < len(self._sent):    # not a stop
            self._arrived.append((time.monotonic(), index))

    def _take_control(self, state: Any) -> None:
        self._control = state.data

    def _ended(self, result: Any) -> None:
        if result.status.status != GoalStatus.PREEMPTED:    # by its repetition
            self._result = result.status
            self._over.set()
