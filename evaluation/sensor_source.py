# SPDX-License-Identifier: BSD-3-Clause
"""Simulated sensors for the experiments over the link: a node that publishes the same data by one of several methods.

Each line on its standard input names the topic that is published at RATE from then on; an empty line: none. Topics
under `whole/` cross the link as single messages by udpros.Publisher: a subscriber chooses TCPROS or UDPROS.
"""
import sys
import threading
import time
from typing import Any, Callable, Dict, Iterator, Tuple

import cv2
import numpy as np
import rospy
from sensor_msgs.msg import CompressedImage, Image, PointCloud2, PointField

from smokebot_udp import udpros
from smokebot_udp.arrays import Float32Array, UInt8Array
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

LEAF_SIZE = 0.1
"""Leaf size of the voxel grid filter that decimates clouds [m]."""

SCENES = 10
"""Number of images and clouds that are published in turn."""


def scenes() -> Iterator[Tuple[UInt8Array, Float32Array]]:
    """Images (HEIGHT, WIDTH) and points (n, 3) along the drive."""
    drive, world = Drive(), building(1)
    camera = Camera(world, Pinhole(WIDTH, HEIGHT, np.radians(70), mounts.CAMERA), seed=1)
    lidar = Lidar(world, mounts.LIDAR, seed=1)
    for i in range(SCENES):
        pose = drive.pose(i / RATE)
        points = lidar.scan(pose, i / RATE)
        yield (cv2.cvtColor(camera.look(pose, i / RATE), cv2.COLOR_BGR2GRAY),
               np.stack([points['x'], points['y'], points['z']], axis=1))


def image_message(image: UInt8Array) -> Any:
    """A mono8 Image."""
    return Image(height=image.shape[0], width=image.shape[1], encoding='mono8', step=image.shape[1],
                 data=image.tobytes())


def jpeg_message(image: UInt8Array) -> Any:
    """A CompressedImage."""
    data = cv2.imencode('.jpg', image, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))[1]
    return CompressedImage(format='mono8; jpeg compressed ', data=data.tobytes())


def cloud_message(points: Float32Array) -> Any:
    """A PointCloud2 of (n, 3) points."""
    return PointCloud2(
        height=1, width=len(points), point_step=12, row_step=12 * len(points), data=points.tobytes(),
        fields=[PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate('xyz')])


def decimated(points: Float32Array) -> Float32Array:
    """One point for each occupied voxel."""
    return voxel_filter(points[np.isfinite(points).all(axis=1)], LEAF_SIZE, None)[0]


TOPICS: Dict[str, Tuple[Any, Any, Callable[[UInt8Array, Float32Array], Any]]] = {
    'camera/image_raw': (rospy.Publisher, Image, lambda image, _: image_message(image)),
    'default/image_raw': (rospy.Publisher, Image, lambda image, _: image_message(image)),
    'layered/image_raw': (rospy.Publisher, Image, lambda image, _: image_message(image)),
    'small/image_raw': (rospy.Publisher, Image, lambda image, _: image_message(image[::2, ::2])),
    'velodyne_points': (rospy.Publisher, PointCloud2, lambda _, points: cloud_message(points)),
    'whole/raw': (udpros.Publisher, Image, lambda image, _: image_message(image)),
    'whole/jpeg': (udpros.Publisher, CompressedImage, lambda image, _: jpeg_message(image)),
    'whole/cloud': (udpros.Publisher, PointCloud2, lambda _, points: cloud_message(decimated(points))),
}
"""{topic: (publisher class, message class, f(image, points) -> message)}"""


class Source:
    """Publishes the topic that is asked for."""

    def __init__(self) -> None:
        self._publishers = {topic: publisher_class(topic, message_class, queue_size=1)
                            for topic, (publisher_class, message_class, _) in TOPICS.items()}
        self._scenes = list(scenes())
        self._count = 0
        self.topic = ''

    def obey(self) -> None:
        """Read topics from the standard input until it ends."""
        for line in sys.stdin:
            self.topic = line.strip()
        rospy.signal_shutdown('the experiment is over')

    def run(self) -> None:
        """Publish at RATE until the node is shut down."""
        due = time.monotonic()
        while not rospy.is_shutdown():
            time.sleep(max(0.0, due - time.monotonic()))
            due = max(due + 1 / RATE, time.monotonic())
            topic = self.topic
            if topic:
                self._publish(topic)

    def _publish(self, topic: str) -> None:
        stamp = rospy.Time.now()    # compression and decimation are part of the message's age
        message = TOPICS[topic][2](*self._scenes[self._count % SCENES])
        message.header.stamp, message.header.frame_id = stamp, 'sensor'
        self._publishers[topic].publish(message)
        self._count += 1


def main() -> None:
    """Run the node."""
    rospy.init_node('source')
    source = Source()
    print('ready', flush=True)
    threading.Thread(target=source.obey, daemon=True).start()
    source.run()


if __name__ == '__main__':
    main()
