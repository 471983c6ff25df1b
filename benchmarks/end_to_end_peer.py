# SPDX-License-Identifier: BSD-3-Clause
"""The processes around the two sides in the end-to-end benchmark: ``end_to_end_peer.py ROLE TOPIC...``.

* source publishes what a robot's sensors do, sink subscribes to what the operator sees. Each writes "ready" and then
  obeys lines on stdin, each a method's name and its argument as JSON; it answers each with a line of JSON.
* encode and decode are the two sides for images by JPEG: from the first topic to the second one.
"""
import json
import sys
import threading
import time
from typing import Any, Dict, List, Mapping, Sequence, Tuple

import cv2
import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import CompressedImage, Image, PointCloud2
from std_msgs.msg import Header

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.wire import pixels
from smokebot_udp.demo.simulated_topics import cloud
from smokebot_udp.simulation import mounts
from smokebot_udp.simulation.lidar import Lidar
from smokebot_udp.simulation.pinhole import Pinhole
from smokebot_udp.simulation.thermal import ThermalCamera
from smokebot_udp.simulation.world import building

WIDTH, HEIGHT, VIEWS = 640, 480, 8
"""Images change, as on a robot that turns: a lost pixel must not equal that of the image before."""

POSE, TURN = (1.5, 7.0, 0.3), 0.1
"""(x [m], y [m], yaw [rad]) of the first view, and the turn between two views [rad]."""

BUFFER = 1 << 24
QUIET = 0.3
"""After this time without any arrival the missing messages are lost [s]."""

TYPES = {'image': Image, 'cloud': PointCloud2}
"""{last part of a topic's name: its class}"""


Entry = Tuple[float, float, int]
"""(stamp [s], age [s], amount) of a message that arrived."""


def type_of(topic: str) -> Any:
    """The class of a topic's messages."""
    return TYPES[topic.rsplit('/', 1)[1]]


def views() -> List[Array]:
    """VIEWS images, always the same: (HEIGHT, WIDTH) uint16."""
    camera = ThermalCamera(building(1), Pinhole(WIDTH, HEIGHT, np.radians(70), mounts.CAMERA), 1)
    return [camera.look((*POSE[:2], POSE[2] + TURN * i), 0.1 * i) for i in range(VIEWS)]


def points() -> Array:
    """A revolution of the LiDAR: (23 040,) array of simulation.lidar.POINT; always the same."""
    return Lidar(building(1), mounts.LIDAR, 1).scan(POSE, 0.0)


def view_at(stamp: Any) -> int:
    """The index of the view that an image with this rospy.Time shows."""
    return stamp.to_nsec() // 1000 % VIEWS


class Source:
    """Publishes at the requested rates, from a thread of its own."""

    def __init__(self, topics: Sequence[str]) -> None:
        self._views = [view.tobytes() for view in views()]
        self._points = points()
        self._publishers = {topic: rospy.Publisher(topic, type_of(topic), queue_size=2, tcp_nodelay=True)
                            for topic in topics}
        self._stopped = threading.Event()
        self._stamps: Dict[str, List[float]] = {}

    def start(self, rates: Mapping[str, float]) -> None:
        """Publish from now on; rates: {topic: [Hz]}."""
        self._stopped.clear()
        self._stamps = {topic: [] for topic in rates}
        self._thread = threading.Thread(target=self._run, args=(rates,))
        self._thread.start()

    def stop(self, _: Any) -> Dict[str, List[float]]:
        """Publish no longer; {topic: [stamp [s], ...]} of what was published."""
        self._stopped.set()
        self._thread.join()
        return self._stamps

    def _run(self, rates: Mapping[str, float]) -> None:
        due = dict.fromkeys(rates, time.monotonic())
        while True:
            topic = min(due, key=lambda topic: due[topic])
            if self._stopped.wait(max(0.0, due[topic] - time.monotonic())):
                return
            due[topic] += 1.0 / rates[topic]
            message = self._message(topic)
            self._stamps[topic].append(message.header.stamp.to_sec())
            self._publishers[topic].publish(message)

    def _message(self, topic: str) -> Any:
        stamp = rospy.Time.now()
        if type_of(topic) is PointCloud2:
            return cloud(Header(stamp=stamp, frame_id='velodyne'), self._points)
        return Image(header=Header(stamp=stamp, frame_id='thermal'), height=HEIGHT, width=WIDTH, encoding='mono16',
                     step=2 * WIDTH, data=self._views[view_at(stamp)])


class Sink:
    """Records what arrives, and the diagnostics of the nodes."""

    def __init__(self, topics: Sequence[str]) -> None:
        self._views = views()
        self._arrived: Dict[str, List[Entry]] = {topic: [] for topic in topics}
        self._diagnostics: Dict[str, Any] = {}
        self._message_arrived, self._diagnostics_arrived = threading.Condition(), threading.Condition()
        self._subscribers = [rospy.Subscriber(topic, type_of(topic), self._take, topic, buff_size=BUFFER,
                                              tcp_nodelay=True) for topic in topics]
        self._subscribers.append(rospy.Subscriber('/diagnostics', DiagnosticArray, self._listen))

    def _take(self, message: Any, topic: str) -> None:
        age = (rospy.Time.now() - message.header.stamp).to_sec()
        entry = message.header.stamp.to_sec(), age, self._amount(message)
        with self._message_arrived:
            self._arrived[topic].append(entry)
            self._message_arrived.notify_all()

    def _amount(self, message: Any) -> int:
        """The number of the source's pixels or points; all pixels of an image of 8 bits, which cannot be compared."""
        if message._type == PointCloud2._type or message.encoding != 'mono16':
            return message.width * message.height
        shown = np.frombuffer(message.data, np.uint16).reshape(HEIGHT, WIDTH)
        return int(np.count_nonzero(shown == self._views[view_at(message.header.stamp)]))

    def _listen(self, message: Any) -> None:
        with self._diagnostics_arrived:
            self._diagnostics[message._connection_header['callerid']] = message
            self._diagnostics_arrived.notify_all()

    def wait(self, request: Mapping[str, Any]) -> bool:
        """Whether something arrives on each of request['topics'] within request['timeout'] seconds."""
        with self._message_arrived:
            return self._message_arrived.wait_for(lambda: all(self._arrived[topic] for topic in request['topics']),
                                                  request['timeout'])

    def report(self, _: Any) -> Dict[str, List[Entry]]:
        """{topic: [entry, ...]} since the last report, once nothing more arrives."""
        with self._message_arrived:
            while self._message_arrived.wait(QUIET):
                pass
            arrived, self._arrived = self._arrived, {topic: [] for topic in self._arrived}
        return {topic: entries for topic, entries in arrived.items() if entries}

    def diagnostics(self, node: str) -> List[Tuple[str, Dict[str, str]]]:
        """[(name, {key: value}), ...] of the next diagnostics of a node."""
        now = rospy.Time.now()
        with self._diagnostics_arrived:
            self._diagnostics_arrived.wait_for(
                lambda: node in self._diagnostics and self._diagnostics[node].header.stamp > now)
            return [(status.name, {pair.key: pair.value for pair in status.values})
                    for status in self._diagnostics[node].status]


class Jpeg:
    """One side for images by JPEG, as compressed_image_transport does it: quality 80, and 8 bits of 16.

    :param role: encode or decode
    """

    def __init__(self, role: str, source: str, target: str) -> None:
        types = {'encode': (Image, CompressedImage), 'decode': (CompressedImage, Image)}[role]
        self._publisher = rospy.Publisher(target, types[1], queue_size=2, tcp_nodelay=True)
        self._subscriber = rospy.Subscriber(source, types[0], getattr(self, role), queue_size=1, buff_size=BUFFER,
                                            tcp_nodelay=True)

    def encode(self, message: Any) -> None:
        """Publish a CompressedImage of a mono16 Image."""
        image = pixels.as_pixels(message.data, message.height, message.width, message.step, message.encoding,
                                 message.is_bigendian)
        _, data = cv2.imencode('.jpg', cv2.convertScaleAbs(image, alpha=255 / 65535), [cv2.IMWRITE_JPEG_QUALITY, 80])
        self._publisher.publish(CompressedImage(message.header, 'mono16; jpeg compressed mono8', data.tobytes()))

    def decode(self, message: Any) -> None:
        """Publish a mono8 Image of a CompressedImage."""
        image = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
        self._publisher.publish(Image(message.header, *image.shape, 'mono8', 0, image.strides[0], image.tobytes()))


def main(role: str, *topics: str) -> None:
    """Run the node."""
    rospy.init_node('bench_' + role, anonymous=True, disable_signals=True)
    if role in ('encode', 'decode'):
        jpeg = Jpeg(role, *topics)      # noqa: F841, its callbacks do the work
        rospy.spin()
        return
    peer: Any = {'source': Source, 'sink': Sink}[role](topics)
    print('"ready"', flush=True)
    for line in sys.stdin:
        name, argument = line.split(' ', 1)
        print(json.dumps(getattr(peer, name)(json.loads(argument))), flush=True)


if __name__ == '__main__':
    main(*rospy.myargv()[1:])
