# SPDX-License-Identifier: BSD-3-Clause
"""A process beside the sides in the end-to-end benchmark: ``end_to_end_peer.py ROLE TOPIC...``.

* source publishes what a robot's sensors do, sink subscribes what the operator sees. Each says "ready" when it is, and
  then obeys lines on stdin, each a word and JSON; each is answered by a line of JSON.
* encode and decode are what stands on the sides for pictures by JPEG: from the first topic to the second one.
"""
import json
import sys
import threading
import time

import cv2
import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import CompressedImage, Image, PointCloud2
from std_msgs.msg import Header

from smokebot_udp.codecs.wire import pixels
from smokebot_udp.nodes.simulated_topics import cloud
from smokebot_udp.simulation import mounts
from smokebot_udp.simulation.lidar import Lidar
from smokebot_udp.simulation.pinhole import Pinhole
from smokebot_udp.simulation.thermal import ThermalCamera
from smokebot_udp.simulation.world import building

WIDTH, HEIGHT, VIEWS = 640, 480, 8
"""Pictures change, as of a robot that turns: what is lost of one must not be found in the one before."""

POSE, TURN = (1.5, 7.0, 0.3), 0.1
"""(x [m], y [m], yaw [rad]) of the first view, and how far the robot turns between two [rad]."""

BUFFER = 1 << 24
QUIET = 0.3
"""What has not come when nothing came for so long is lost [s]."""

TYPES = {'image': Image, 'cloud': PointCloud2}
"""By the end of a topic's name."""


def type_of(topic):
    return TYPES[topic.rsplit('/', 1)[1]]


def views():
    """[(HEIGHT, WIDTH) uint16, ...]: always the same."""
    camera = ThermalCamera(building(1), Pinhole(WIDTH, HEIGHT, np.radians(70), mounts.CAMERA), 1)
    return [camera.look((*POSE[:2], POSE[2] + TURN * i), 0.1 * i) for i in range(VIEWS)]


def points():
    """A revolution of the LiDAR: (23 040,) array of simulation.lidar.POINT; always the same."""
    return Lidar(building(1), mounts.LIDAR, 1).scan(POSE, 0.0)


def view_at(stamp):
    """Which of the views a picture of this rospy.Time shows."""
    return stamp.to_nsec() // 1000 % VIEWS


class Source:
    """Publishes at the rates asked for, from a thread of its own."""

    def __init__(self, topics):
        self._views = [view.tobytes() for view in views()]
        self._points = points()
        self._publishers = {topic: rospy.Publisher(topic, type_of(topic), queue_size=2, tcp_nodelay=True)
                            for topic in topics}
        self._thread, self._stopped, self._stamps = None, threading.Event(), {}

    def start(self, rates):
        """:param rates: {topic: [Hz]}"""
        self._stopped.clear()
        self._stamps = {topic: [] for topic in rates}
        self._thread = threading.Thread(target=self._run, args=(rates,))
        self._thread.start()

    def stop(self, _):
        """:return: {topic: [stamp [s], ...]} of what was published"""
        self._stopped.set()
        self._thread.join()
        return self._stamps

    def _run(self, rates):
        due = dict.fromkeys(rates, time.monotonic())
        while True:
            topic = min(due, key=due.get)
            if self._stopped.wait(max(0.0, due[topic] - time.monotonic())):
                return
            due[topic] += 1.0 / rates[topic]
            message = self._message(topic)
            self._stamps[topic].append(message.header.stamp.to_sec())
            self._publishers[topic].publish(message)

    def _message(self, topic):
        stamp = rospy.Time.now()
        if type_of(topic) is PointCloud2:
            return cloud(Header(stamp=stamp, frame_id='velodyne'), self._points)
        return Image(header=Header(stamp=stamp, frame_id='thermal'), height=HEIGHT, width=WIDTH, encoding='mono16',
                     step=2 * WIDTH, data=self._views[view_at(stamp)])


class Sink:
    """Notes what comes, and what the operator's sides say of themselves."""

    def __init__(self, topics):
        self._views = views()
        self._came, self._told = {topic: [] for topic in topics}, {}
        self._changed, self._told_anew = threading.Condition(), threading.Condition()
        self._subscribers = [rospy.Subscriber(topic, type_of(topic), self._take, topic, buff_size=BUFFER,
                                              tcp_nodelay=True) for topic in topics]
        self._subscribers.append(rospy.Subscriber('/diagnostics', DiagnosticArray, self._listen))

    def _take(self, message, topic):
        age = (rospy.Time.now() - message.header.stamp).to_sec()
        entry = message.header.stamp.to_sec(), age, self._amount(message)
        with self._changed:
            self._came[topic].append(entry)
            self._changed.notify_all()

    def _amount(self, message):
        """How many pixels or points of the source's came; of pixels in 8 bits nobody can tell."""
        if message._type == PointCloud2._type or message.encoding != 'mono16':
            return message.width * message.height
        shown = np.frombuffer(message.data, np.uint16).reshape(HEIGHT, WIDTH)
        return int(np.count_nonzero(shown == self._views[view_at(message.header.stamp)]))

    def _listen(self, message):
        with self._told_anew:
            self._told[message._connection_header['callerid']] = message
            self._told_anew.notify_all()

    def wait(self, asked):
        """Whether something came on each of asked['topics'] within asked['patience'] seconds."""
        with self._changed:
            return self._changed.wait_for(lambda: all(self._came[topic] for topic in asked['topics']),
                                          asked['patience'])

    def report(self, _):
        """{topic: [(stamp [s], age [s], amount), ...]} since the last one, once nothing more comes."""
        with self._changed:
            while self._changed.wait(QUIET):
                pass
            came, self._came = self._came, {topic: [] for topic in self._came}
        return {topic: entries for topic, entries in came.items() if entries}

    def diagnostics(self, node):
        """[[name, {key: value}], ...]: what a node says of itself from now on."""
        now = rospy.Time.now()
        with self._told_anew:
            self._told_anew.wait_for(lambda: node in self._told and self._told[node].header.stamp > now)
            return [[status.name, {pair.key: pair.value for pair in status.values}]
                    for status in self._told[node].status]


class Jpeg:
    """A picture's way by JPEG, as compressed_image_transport has it: 80 % quality, and 8 bits of 16."""

    def __init__(self, role, source, target):
        types = {'encode': (Image, CompressedImage), 'decode': (CompressedImage, Image)}[role]
        self._publisher = rospy.Publisher(target, types[1], queue_size=2, tcp_nodelay=True)
        self._subscriber = rospy.Subscriber(source, types[0], getattr(self, role), queue_size=1, buff_size=BUFFER,
                                            tcp_nodelay=True)

    def encode(self, message):
        picture = pixels.as_pixels(message.data, message.height, message.width, message.step, message.encoding,
                                   message.is_bigendian)
        _, data = cv2.imencode('.jpg', cv2.convertScaleAbs(picture, alpha=255 / 65535), [cv2.IMWRITE_JPEG_QUALITY, 80])
        self._publisher.publish(CompressedImage(message.header, 'mono16; jpeg compressed mono8', data.tobytes()))

    def decode(self, message):
        picture = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
        self._publisher.publish(Image(message.header, *picture.shape, 'mono8', 0, picture.strides[0],
                                      picture.tobytes()))


def main(role, *topics):
    rospy.init_node('bench_' + role, anonymous=True, disable_signals=True)
    if role in ('encode', 'decode'):
        jpeg = Jpeg(role, *topics)      # noqa: F841, its callbacks do the work
        rospy.spin()
        return
    peer = {'source': Source, 'sink': Sink}[role](topics)
    print('"ready"', flush=True)
    for line in sys.stdin:
        word, asked = line.split(' ', 1)
        print(json.dumps(getattr(peer, word)(json.loads(asked))), flush=True)


if __name__ == '__main__':
    main(*rospy.myargv()[1:])
