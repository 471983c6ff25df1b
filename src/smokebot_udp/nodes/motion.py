# SPDX-License-Identifier: BSD-3-Clause
"""Listens for whether the robot stands still, for the operator's streams; see streams.standstill."""
import math
import threading
import time
from typing import Any, Optional

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry

from ..streams.standstill import StandstillDetector
from .opened import Part


class MotionListener(Part):
    """Feeds a StandstillDetector; any thread may call it.

    :param odom_topic: of nav_msgs/Odometry on the operator's side
    :param cmd_vel_topic: of geometry_msgs/Twist on the operator's side
    """

    def __init__(self, odom_topic: str, cmd_vel_topic: str) -> None:
        super().__init__()
        self._detector = StandstillDetector()
        self._lock = threading.Lock()
        self._opened.topic(rospy.Subscriber(
            odom_topic, Odometry, lambda m: self._note('odometry', m.twist.twist), queue_size=1))
        self._opened.topic(rospy.Subscriber(
            cmd_vel_topic, Twist, lambda m: self._note('command', m), queue_size=1))

    def images_compared(self, changed: Optional[float]) -> None:
        """Note the comparison of two images: the share of their cells that differ; None: not comparable."""
        with self._lock:
            self._detector.images(changed, time.monotonic())

    def is_still(self) -> bool:
        """Whether the robot is known to stand still."""
        with self._lock:
            return self._detector.is_still(time.monotonic())

    def _note(self, source: str, twist: Any) -> None:
        speed = math.sqrt(twist.linear.x ** 2 + twist.linear.y ** 2 + twist.linear.z ** 2)
        with self._lock:
            self._detector.velocity(source, speed, twist.angular.z, time.monotonic())
