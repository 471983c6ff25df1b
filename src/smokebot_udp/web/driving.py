# SPDX-License-Identifier: BSD-3-Clause
"""Publishes what browsers command, on the topics of a joystick and of rviz: the same control, interlock and timeouts
apply."""
import math
import time
from typing import Any, Hashable, NamedTuple, Optional, Tuple

import rospy
from geometry_msgs.msg import PoseStamped, Quaternion, Twist
from std_msgs.msg import Bool

from ..codecs.display.overlay import EMERGENCY_STOP
from ..nodes.logging import log_error
from ..nodes.opened import Part
from ..nodes.teleop_keyboard import twist
from ..nodes.worker import DeadlineWorker
from ..teleop.interlock import START_FROM_NEUTRAL
from ..teleop.keyboard import STOP, StopKey, Velocity
from .dead_man import DeadMan, Rest
from .robot import Robot


class Order(NamedTuple):
    """What is to be published."""
    motion: Velocity
    stop: bool
    """Whether the emergency stop is, too."""


class Driving(Part):
    """Lives as long as its node. Any thread may use it."""

    def __init__(self, robot: Robot) -> None:
        super().__init__()
        self._robot = robot
        commands = robot.catalogue.sent('geometry_msgs/Twist', 'command')
        goals = robot.catalogue.sent('geometry_msgs/PoseStamped', 'relay')
        self._commands = None if commands is None else self._publisher(commands, Twist, 1)
        self._goals = None if goals is None else self._publisher(goals, PoseStamped, 2)
        self._estop = self._publisher('operator/estop', Bool, 5)
        self._dead_man, self._rest, self._stop_key = DeadMan(), Rest(), StopKey()
        self._worker: DeadlineWorker[Order] = self._opened.started(DeadlineWorker(
            'driving', self._poll, self._deadline, self._publish, log_error('driving')))

    def drive(self, browser: Hashable, motion: Velocity) -> str:
        """A browser's command; returns why it does not count, empty: it does."""
        if self._commands is None:
            return 'no stream of streams.yaml sends geometry_msgs/Twist as commands'
        known = self._robot.known
        with self._worker.changing():
            if motion == STOP:
                self._rests(browser)
            elif not self._rest.may_move(browser, known.stops):
                return EMERGENCY_STOP if known.control == EMERGENCY_STOP else START_FROM_NEUTRAL
            good = self._dead_man.drive(browser, motion, time.monotonic())
        return '' if good else 'another browser drives: take control'

    def halt(self, browser: Hashable) -> None:
        """The touch was released. After an emergency stop that is the neutral command that the interlock waits for."""
        now = time.monotonic()
        with self._worker.changing():
            if not self._rest.may_move(browser, self._robot.known.stops) and self._dead_man.may_drive(browser, now):
                self._dead_man.take(browser, now)
            self._rests(browser)
            self._dead_man.halt(browser, now)

    def gone(self, browser: Hashable) -> None:
        """A browser is not there any more, or gave control back."""
        with self._worker.changing():
            self._rest.gone(browser)
            self._dead_man.gone(browser, time.monotonic())

    def take(self, browser: Hashable) -> None:
        """A browser takes control."""
        with self._worker.changing():
            self._dead_man.take(browser, time.monotonic())

    def holder(self) -> Optional[Hashable]:
        """The browser that may drive; None: any may."""
        with self._worker.lock:
            return self._dead_man.holder(time.monotonic())

    def stop(self) -> str:
        """Engage the emergency stop; returns what comes of it, in words."""
        with self._worker.changing():
            self._stop_key.press(time.monotonic())
        return 'emergency stop' if self._estop.get_num_connections() else 'NOBODY RECEIVES the emergency stop yet'

    def stop_released(self) -> None:
        """The emergency stop is released on purpose."""
        with self._worker.changing():
            self._stop_key.release()

    def go(self, x: float, y: float, yaw: float) -> Tuple[bool, str]:
        """Publish a goal in the fixed frame: (whether anybody receives it, in words)."""
        if self._goals is None:
            return False, 'no stream of streams.yaml sends geometry_msgs/PoseStamped to the robot'
        goal = PoseStamped()
        goal.header.frame_id, goal.header.stamp = self._robot.fixed, rospy.Time.now()
        goal.pose.position.x, goal.pose.position.y = x, y
        goal.pose.orientation = Quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        if not self._goals.get_num_connections():
            return False, 'nobody receives the goal: does operator_receiver run?'
        self._goals.publish(goal)
        return True, 'goal sent'

    def _rests(self, browser: Hashable) -> None:
        if self._robot.known.control != EMERGENCY_STOP:
            self._rest.rest(browser, self._robot.known.stops)

    def _publisher(self, topic: str, class_: Any, queue: int) -> Any:
        return self._opened.topic(rospy.Publisher(self._robot.resolve(topic), class_, queue_size=queue,
                                                  tcp_nodelay=True))

    def _poll(self, now: float) -> Optional[Order]:
        motion = self._dead_man.poll(now)
        stop = self._stop_key.poll(bool(self._estop.get_num_connections()), now)
        if stop:
            return Order(STOP, True)
        return None if motion is None else Order(motion, False)

    def _deadline(self) -> float:
        return min(self._dead_man.deadline(), self._stop_key.deadline())

    def _publish(self, order: Order) -> None:
        if order.stop:
            self._estop.publish(True)
        if self._commands is not None:
            self._commands.publish(twist(order.motion))
