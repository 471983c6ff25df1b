# SPDX-License-Identifier: BSD-3-Clause
"""Drives a robot to points of its map by what crosses the link only: the operator's scan and transforms.

Without new data the operator stands still, as a person would. Run as a node on the operator's side, it gets a JSON list
[x, y, seconds] on each line of its standard input, and answers with a JSON object of Leg.
"""
import json
import math
import sys
import threading
import time
from typing import Any, List, NamedTuple, Optional, Tuple

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import Twist
from sensor_msgs.msg import Image, LaserScan
from std_msgs.msg import String

from smokebot_udp.demo.simulated_driving import planar
from smokebot_udp.nodes.operator_control import IN_CONTROL, STATE_TOPIC
from smokebot_udp.simulation.pose import Pose

from .driver_steering import is_reached, nearest_ahead, steer

RATE = 20.0
"""Rate of commands [Hz]."""

BLIND = 0.5
"""Maximum age of data that the operator drives by [s]."""

ZEROS = 1.0
"""Duration of the commands that stand still and come first: an interlock opens only by them [s]."""


class Leg(NamedTuple):
    """The way to one point."""
    reached: bool
    seconds: float
    blind: float
    """Time for which the operator stood still as data were old [s]."""
    least: float
    """The least distance in any scan; infinite: there was no scan [m]."""
    scan_age: Tuple[float, float]
    """Age of the newest scan at each command: p50 and p99 [s]."""
    pose_age: Tuple[float, float]
    """Age of the newest pose at each command: p50 and p99 [s]."""
    image_age: Tuple[float, float]
    """Age of the newest image of the thermal view at each command: p50 and p99 [s]."""


class Seen(NamedTuple):
    """What an operator drives by."""
    pose: Pose
    obstacle: float
    """Distance of the nearest obstacle, see nearest_ahead [m]."""


class Ages(NamedTuple):
    """Ages of the newest data; infinite: there are none [s]."""
    scan: float
    pose: float
    image: float


class Driver:
    """The node's part."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._scan: Optional[Any] = None
        self._least = math.inf
        self._image_stamp = -math.inf
        self._control = ''
        self._transforms = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._transforms)
        self._commands = rospy.Publisher('operator/cmd_vel', Twist, queue_size=5, tcp_nodelay=True)
        rospy.Subscriber('operator/scan', LaserScan, self._on_scan, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber('operator/thermal/image_color', Image, self._on_image, queue_size=1, buff_size=1 << 24)
        rospy.Subscriber(STATE_TOPIC, String, self._on_control, queue_size=5)

    def _on_scan(self, scan: Any) -> None:
        ranges = np.array(scan.ranges, np.float64)
        with self._lock:
            self._scan = scan
            self._least = min(self._least, float(ranges[np.isfinite(ranges)].min(initial=math.inf)))

    def _on_image(self, image: Any) -> None:
        self._image_stamp = image.header.stamp.to_sec()

    def _on_control(self, state: Any) -> None:
        self._control = state.data

    def drive(self, target: Tuple[float, float], seconds: float) -> Leg:
        """Drive to a point of the map.

        :param seconds: at most
        """
        begun = due = time.monotonic()
        blind, reached = 0.0, False
        ages: List[Ages] = []
        with self._lock:
            self._least = math.inf
        while not reached and due < begun + seconds and not rospy.is_shutdown():
            time.sleep(max(0.0, due - time.monotonic()))
            seen, age = self._look()
            ages.append(age)
            motion = 0.0, 0.0
            if due >= begun + ZEROS and self._control == IN_CONTROL:
                if seen is None:
                    blind += 1 / RATE
                else:
                    reached = is_reached(seen.pose, target)
                    motion = (0.0, 0.0) if reached else steer(seen.pose, target, seen.obstacle)
            self._publish(*motion)
            due += 1 / RATE
        columns = [tuple(np.asarray(np.percentile(column, (50, 99))).tolist()) for column in zip(*ages)]
        return Leg(reached, time.monotonic() - begun, blind, self._least, *columns)

    def _look(self) -> Tuple[Optional[Seen], Ages]:
        """What the operator sees; None: nothing that is new enough."""
        pose, stamp = self._pose()
        with self._lock:
            scan = self._scan
        now = rospy.get_time()
        ages = Ages(now - scan.header.stamp.to_sec() if scan else math.inf, now - stamp, now - self._image_stamp)
        if pose is None or scan is None or max(ages.scan, ages.pose) > BLIND:
            return None, ages
        angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        return Seen(pose, nearest_ahead(np.array(scan.ranges, np.float64), angles)), ages

    def _publish(self, forward: float, turn: float) -> None:
        command = Twist()
        command.linear.x, command.angular.z = forward, turn
        self._commands.publish(command)

    def _pose(self) -> Tuple[Optional[Pose], float]:
        """Where the robot is in its map as far as the operator knows, and since when; None: unknown."""
        try:
            found, odom = (self._transforms.lookup_transform(frame, 'base_link', rospy.Time(0))
                           for frame in ('map', 'odom'))
        except tf2_ros.TransformException:
            return None, -math.inf
        pose = PoseMessage(found.transform.translation, found.transform.rotation)
        return planar(pose), odom.header.stamp.to_sec()


def main() -> None:
    """Run the node until its standard input ends."""
    reports, sys.stdout = sys.stdout, sys.stderr    # where rospy logs
    rospy.init_node('blind_driver')
    driver = Driver()
    reports.write('ready\n')
    reports.flush()
    for line in sys.stdin:
        x, y, seconds = json.loads(line)
        reports.write(json.dumps(driver.drive((x, y), seconds)._asdict()) + '\n')
        reports.flush()
    rospy.signal_shutdown('the standard input ended')


if __name__ == '__main__':
    main()
