# SPDX-License-Identifier: BSD-3-Clause
"""A node that publishes a robot's small states, with noise, and a camera's images beside them, so that the link is
used as it is on a robot: `python3 -m evaluation.state_source`."""
import math
from typing import Any, Mapping, Tuple

import numpy as np
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image, Imu, JointState

RATE = 10.0
"""[Hz]"""

JOINTS = ['joint_%d' % number for number in range(7)]

STREAMS: Mapping[str, Tuple[str, Any]] = {
    'imu': ('/imu/data', Imu), 'joints': ('/joint_states', JointState), 'odom': ('/odom', Odometry)}
"""{stream: its source's topic and type}"""


def imu(time: float, random: Any) -> Any:
    """As a driver publishes it."""
    message = Imu(orientation_covariance=[1e-4, 0, 0, 0, 1e-4, 0, 0, 0, 1e-4])
    message.header.frame_id = 'imu_link'
    message.orientation.z, message.orientation.w = math.sin(time / 20), math.cos(time / 20)
    for vector in message.angular_velocity, message.linear_acceleration:
        vector.x, vector.y, vector.z = random.normal(0, 0.02, 3)
    return message


def joints(time: float, random: Any) -> Any:
    """Those of an arm."""
    return JointState(name=JOINTS, position=list(np.sin(time + np.arange(7)) + random.normal(0, 1e-4, 7)),
                      velocity=list(np.cos(time + np.arange(7))), effort=list(random.normal(0, 0.1, 7)))


def odometry(time: float, random: Any) -> Any:
    """On a circle."""
    message = Odometry(child_frame_id='base_link')
    message.header.frame_id = 'odom'
    message.pose.pose.position.x, message.pose.pose.position.y = 5 * math.sin(time / 10), 5 * math.cos(time / 10)
    message.twist.twist.linear.x, message.twist.twist.angular.z = 0.5 + random.normal(0, 0.01), 0.1
    return message


CAMERA = '/camera/image_raw'
HEIGHT, WIDTH = 240, 320


def image(time: float, random: Any) -> Any:
    """A slope that moves, and noise."""
    slope = np.add.outer(np.arange(HEIGHT), np.arange(WIDTH) + 20 * time) % 160
    pixels = slope + random.randint(0, 60, (HEIGHT, WIDTH))
    return Image(height=HEIGHT, width=WIDTH, step=WIDTH, encoding='mono8', data=pixels.astype(np.uint8).tobytes())


def main() -> None:
    """Run the node."""
    rospy.init_node('state_source')
    random = np.random.RandomState(1)
    makers = {'imu': imu, 'joints': joints, 'odom': odometry}
    publishers = {name: rospy.Publisher(topic, class_, queue_size=5, tcp_nodelay=True)
                  for name, (topic, class_) in STREAMS.items()}
    makers['camera'], publishers['camera'] = image, rospy.Publisher(CAMERA, Image, queue_size=1)
    rate = rospy.Rate(RATE)
    while not rospy.is_shutdown():
        now = rospy.Time.now()
        for name, publisher in publishers.items():
            message = makers[name](now.to_sec() % 1000, random)
            message.header.stamp = now
            publisher.publish(message)
        rate.sleep()


if __name__ == '__main__':
    main()
