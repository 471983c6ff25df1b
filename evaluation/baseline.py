# SPDX-License-Identifier: BSD-3-Clause
"""The baseline: the simulated robot's data as ROS sends them, one message each; images as JPEG, clouds decimated.

A node of the robot's side. A subscriber chooses TCPROS or UDPROS.
"""
from typing import Any, Callable, Dict, Tuple

import cv2
import numpy as np
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CompressedImage, Image, LaserScan, PointCloud2
from tf2_msgs.msg import TFMessage

from smokebot_udp import udpros
from smokebot_udp.arrays import UInt8Array
from smokebot_udp.simulation.lidar import POINT

from .recorder import to_grey
from .sensor_source import JPEG_QUALITY, cloud_message, decimated

RATE = 10.0
"""Rate of odometry and transforms, whose sources are faster [Hz]."""


def jpeg(header: Any, image: UInt8Array) -> Any:
    """A CompressedImage."""
    data = cv2.imencode('.jpg', image, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))[1]
    return CompressedImage(header=header, format='jpeg', data=data.tobytes())


def thermal(message: Any) -> Any:
    """The CompressedImage of an Image of counts."""
    counts = np.frombuffer(message.data, '<u2').reshape(message.height, message.width)
    return jpeg(message.header, to_grey(counts))


def camera(message: Any) -> Any:
    """The CompressedImage of a bgr8 Image."""
    return jpeg(message.header, np.frombuffer(message.data, np.uint8).reshape(message.height, message.width, 3))


def points(message: Any) -> Any:
    """The decimated PointCloud2 of a scanned one."""
    scanned = np.frombuffer(message.data, POINT)
    result = cloud_message(decimated(np.stack([scanned[axis] for axis in 'xyz'], axis=1)))
    result.header = message.header
    return result


def unchanged(message: Any) -> Any:
    """The message itself."""
    return message


TOPICS: Dict[str, Tuple[str, Any, Any, Callable[[Any], Any]]] = {
    'whole/thermal': ('thermal/image_raw', Image, CompressedImage, thermal),
    'whole/camera': ('camera/image_raw', Image, CompressedImage, camera),
    'whole/cloud': ('velodyne_points', PointCloud2, PointCloud2, points),
    'whole/scan': ('scan', LaserScan, LaserScan, unchanged),
    'whole/odom': ('odom', Odometry, Odometry, unchanged),
    'whole/tf': ('/tf', TFMessage, TFMessage, unchanged),
}
"""{topic: (source topic, its class, class, f(source message) -> message)}"""


def relay(topic: str) -> Any:
    """Publish a topic; its subscriber."""
    source, source_class, message_class, convert = TOPICS[topic]
    publisher = udpros.Publisher(topic, message_class, queue_size=1)
    last = 0.0

    def publish(message: Any) -> None:
        nonlocal last
        now = rospy.get_time()
        if now - last >= 0.9 / RATE:    # every fifth message of a source of 50 Hz
            last = now
            publisher.publish(convert(message))
    return rospy.Subscriber(source, source_class, publish, queue_size=1, buff_size=1 << 24, tcp_nodelay=True)


def main() -> None:
    """Run the node."""
    rospy.init_node('baseline')
    for topic in TOPICS:
        relay(topic)
    rospy.spin()


if __name__ == '__main__':
    main()
