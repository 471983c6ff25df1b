# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of the experiments over the link: a node that publishes the same data in one of several ways.

Each line on its standard input names the topic that gets a message ten times a second from then on; none: nothing
is sent. What is to cross the link whole goes by udpros.Publisher: a subscriber chooses TCPROS or UDPROS.
"""
import sys
import threading
import time

import cv2
import numpy as np
import rospy
from sensor_msgs.msg import CompressedImage, Image, PointCloud2, PointField

from smokebot_udp import udpros
from smokebot_udp.codecs.perception.voxel import voxel_filter
from smokebot_udp.simulation import mounts
from smokebot_udp.simulation.camera import Camera
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.lidar import Lidar
from smokebot_udp.simulation.pinhole import Pinhole
from smokebot_udp.simulation.world import building

RATE = 10.0
"""[Hz]"""

WIDTH, HEIGHT = 640, 480
JPEG_QUALITY = 80
"""compressed_image_transport's default."""

LEAF = 0.1
"""Of the voxel grid that thins clouds [m]."""

SCENES = 10
"""So many pictures and clouds come again and again, all in a second: the clouds differ in their points."""


def scenes():
    """[(picture (HEIGHT, WIDTH) uint8, points (n, 3) float32), ...] along the drive."""
    drive, world = Drive(), building(1)
    camera = Camera(world, Pinhole(WIDTH, HEIGHT, np.radians(70), mounts.CAMERA), seed=1)
    lidar = Lidar(world, mounts.LIDAR, seed=1)
    for i in range(SCENES):
        pose = drive.pose(i / RATE)
        points = lidar.scan(pose, i / RATE)
        yield (cv2.cvtColor(camera.look(pose, i / RATE), cv2.COLOR_BGR2GRAY),
               np.stack([points['x'], points['y'], points['z']], axis=1))


def image(picture):
    return Image(height=picture.shape[0], width=picture.shape[1], encoding='mono8', step=picture.shape[1],
                 data=picture.tobytes())


def jpeg(picture):
    data = cv2.imencode('.jpg', picture, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))[1]
    return CompressedImage(format='mono8; jpeg compressed ', data=data.tobytes())


def cloud(points):
    return PointCloud2(
        height=1, width=len(points), point_step=12, row_step=12 * len(points), data=points.tobytes(),
        fields=[PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate('xyz')])


def thinned(points):
    return voxel_filter(points[np.isfinite(points).all(axis=1)], LEAF, None)[0]


WAYS = {
    'camera/image_raw': (rospy.Publisher, Image, lambda picture, _: image(picture)),
    'small/image_raw': (rospy.Publisher, Image, lambda picture, _: image(picture[::2, ::2])),
    'velodyne_points': (rospy.Publisher, PointCloud2, lambda _, points: cloud(points)),
    'whole/raw': (udpros.Publisher, Image, lambda picture, _: image(picture)),
    'whole/jpeg': (udpros.Publisher, CompressedImage, lambda picture, _: jpeg(picture)),
    'whole/cloud': (udpros.Publisher, PointCloud2, lambda _, points: cloud(thinned(points))),
}
"""{topic: (kind of publisher, type, f(picture, points) -> message)}; the whole ones cross the link as they are."""


def main():
    rospy.init_node('source')
    publishers = {topic: kind(topic, message_class, queue_size=1) for topic, (kind, message_class, _) in WAYS.items()}
    played, wanted = list(scenes()), ['']
    print('ready', flush=True)

    def obey():
        for line in sys.stdin:
            wanted[0] = line.strip()
        rospy.signal_shutdown('the experiment is over')
    threading.Thread(target=obey, daemon=True).start()
    due, count = time.monotonic(), 0
    while not rospy.is_shutdown():
        time.sleep(max(0.0, due - time.monotonic()))
        due = max(due + 1 / RATE, time.monotonic())
        topic = wanted[0]
        if topic:
            stamp = rospy.Time.now()    # before it is compressed or thinned: that is part of its age
            message = WAYS[topic][2](*played[count % SCENES])
            message.header.stamp, message.header.frame_id = stamp, 'sensor'
            publishers[topic].publish(message)
            count += 1


if __name__ == '__main__':
    main()
