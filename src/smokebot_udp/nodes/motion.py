# SPDX-License-Identifier: BSD-3-Clause
"""Whether the robot stands, for the operator's streams: listens to what tells it, see streams.stillness."""
import math
import threading
import time

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry

from ..streams.stillness import Stillness


class Motion:
    """:param odom_topic, cmd_vel_topic: nav_msgs/Odometry and geometry_msgs/Twist on the operator's side"""

    def __init__(self, odom_topic, cmd_vel_topic, stillness=None):
        self._stillness = stillness or Stillness()
        self._lock = threading.Lock()
        self._subscribers = [
            rospy.Subscriber(odom_topic, Odometry, lambda m: self._tell(self._stillness.odometry, m.twist.twist),
                             queue_size=1),
            rospy.Subscriber(cmd_vel_topic, Twist, lambda m: self._tell(self._stillness.command, m), queue_size=1)]

    def _tell(self, source, twist):
        speed = math.sqrt(twist.linear.x ** 2 + twist.linear.y ** 2 + twist.linear.z ** 2)
        with self._lock:
            source(speed, twist.angular.z, time.monotonic())

    def pictures(self, changed):
        """Told by two pictures of a camera: the share of their cells that changed, or None."""
        with self._lock:
            self._stillness.pictures(changed, time.monotonic())

    def stands(self):
        with self._lock:
            return self._stillness.stands(time.monotonic())

    def close(self):
        for subscriber in self._subscribers:
            subscriber.unregister()
