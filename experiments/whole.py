# SPDX-License-Identifier: BSD-3-Clause
"""What the simulated robot sees, sent whole as ROS does it: one message each, pictures as JPEG, clouds thinned.

A node of the robot's side. A subscriber chooses TCPROS or UDPROS.
"""
import cv2
import numpy as np
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CompressedImage, Image, LaserScan, PointCloud2
from tf2_msgs.msg import TFMessage

from smokebot_udp import udpros
from smokebot_udp.simulation.lidar import POINT

from .keeper import to_grey
from .source import JPEG_QUALITY, cloud, thinned

RATE = 10.0
"""Of what comes faster: odometry and transforms [Hz]."""


def jpeg(header, picture):
    data = cv2.imencode('.jpg', picture, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))[1]
    return CompressedImage(header=header, format='jpeg', data=data.tobytes())


def thermal(message):
    counts = np.frombuffer(message.data, '<u2').reshape(message.height, message.width)
    return jpeg(message.header, to_grey(counts))


def camera(message):
    return jpeg(message.header, np.frombuffer(message.data, np.uint8).reshape(message.height, message.width, 3))


def points(message):
    found = np.frombuffer(message.data, POINT)
    result = cloud(thinned(np.stack([found[axis] for axis in 'xyz'], axis=1)))
    result.header = message.header
    return result


CARGO = {
    'whole/thermal': ('thermal/image_raw', Image, CompressedImage, thermal),
    'whole/camera': ('camera/image_raw', Image, CompressedImage, camera),
    'whole/cloud': ('velodyne_points', PointCloud2, PointCloud2, points),
    'whole/scan': ('scan', LaserScan, LaserScan, lambda message: message),
    'whole/odom': ('odom', Odometry, Odometry, lambda message: message),
    'whole/tf': ('/tf', TFMessage, TFMessage, lambda message: message),
}
"""{topic: (of which topic, its type, type, f(message) -> message)}"""


def relay(topic):
    source, source_class, message_class, convert = CARGO[topic]
    publisher = udpros.Publisher(topic, message_class, queue_size=1)
    last = [0.0]

    def take(message):
        # a source of 50 Hz: each fifth
        now = rospy.get_time()
        if now - last[0] >= 0.9 / RATE:
            last[0] = now
            publisher.publish(convert(message))
    return rospy.Subscriber(source, source_class, take, queue_size=1, buff_size=1 << 24, tcp_nodelay=True)


def main():
    rospy.init_node('whole')
    for topic in CARGO:
        relay(topic)
    rospy.spin()


if __name__ == '__main__':
    main()
