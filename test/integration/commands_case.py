# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of the way back share: a robot, one or two operators, and what the robot's driver node receives."""
import os
import pathlib
import tempfile
import threading
import time
import unittest
from typing import Any, List, NamedTuple, Tuple

import rospy
from geometry_msgs.msg import Twist
from own_masters import Side
from sensor_msgs.msg import Image
from std_msgs.msg import String
from waiting import free_port, ticks, wait_for

from smokebot_udp.demo.foreign_publishers import register_publishers
from smokebot_udp.link.keys import make_key

STREAMS = pathlib.Path(__file__).resolve().parent / 'commands_streams.yaml'
IN_CONTROL = 'LOCKED: seeing: no image of thermal'
"""The state of an operator who drives; there are images in one test only."""

START = 60.0
"""For nodes to start on a busy machine [s]."""


class Came(NamedTuple):
    """A message of a topic."""
    when: float
    """By time.monotonic() [s]."""
    message: Any


class Listener:
    """Keeps what comes on a topic."""

    def __init__(self, topic: str, message_class: Any) -> None:
        self._came: List[Came] = []
        self._lock = threading.Lock()
        self.subscriber = rospy.Subscriber(topic, message_class, self._take, queue_size=100, tcp_nodelay=True)

    def _take(self, message: Any) -> None:
        with self._lock:
            self._came.append(Came(time.monotonic(), message))

    @property
    def came(self) -> List[Came]:
        with self._lock:
            return list(self._came)

    def clear(self) -> None:
        with self._lock:
            self._came = []


def twist(speed: float) -> Any:
    message = Twist()
    message.linear.x = speed
    return message


class Drive:
    """Publishes a command at 20 Hz while the context lasts."""

    def __init__(self, publisher: Any, message: Any) -> None:
        self._publisher, self._message, self._ended = publisher, message, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        for _ in ticks(20.0):
            if self._ended.is_set():
                return
            self._publisher.publish(self._message)

    def __enter__(self) -> 'Drive':
        self._thread.start()
        return self

    def __exit__(self, *_: Any) -> None:
        self._ended.set()
        self._thread.join()


class CommandsCase(unittest.TestCase):
    """A test case at the operator's side, which is also the robot's driver and camera.

    `link`: whether both sides have masters of their own, and a key.
    """
    link = False
    robot: Side
    desk: Side

    @classmethod
    def setUpClass(cls) -> None:
        cls.robot = Side('robot')
        cls.addClassCleanup(cls.robot.close)
        cls.desk = Side('desk') if cls.link else cls.robot
        if cls.link:
            cls.addClassCleanup(cls.desk.close)
        os.environ['ROS_MASTER_URI'] = cls.desk.master.uri
        rospy.init_node('test_commands')
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        key = str(pathlib.Path(folder.name) / 'key')
        make_key(key)
        port = free_port()
        cls.robot_options = ['link_port:=%d' % port, 'key_file:=' + key] if cls.link else []
        cls.desk_options = ['robot:=localhost:%d' % port, 'key_file:=' + key] if cls.link else []
        cls.robot.launch('robot.launch', 'streams:=%s' % STREAMS, *cls.robot_options)
        # two roslaunch that start at one moment would not agree on a run id
        wait_for(lambda: cls.robot.pid('/robot_sender'), START, 'the robot')
        cls.images = cls.robot_publisher('/thermal/image_raw', Image)
        cls.start_desk()
        cls.state = Listener('/operator/control', String)
        wait_for(lambda: cls.states(cls.state)[-1:] == [IN_CONTROL], START, 'the control: %s' % cls.robot.output)

    @classmethod
    def start_desk(cls, *options: str) -> Any:
        return cls.desk.launch('operator.launch', 'streams:=%s' % STREAMS, 'rviz:=false', *cls.desk_options, *options)

    @classmethod
    def robot_topic(cls, topic: str, message_class: Any) -> Listener:
        """Listen to a topic of robot_sender, as the robot's driver does."""
        if cls.link:
            wait_for(lambda: ('pub', topic) in cls.robot.master.registered('/robot_sender'), START, topic)
            register_publishers(cls.robot.master.uri, '/robot_sender', [topic])
        listener = Listener(topic, message_class)
        wait_for(listener.subscriber.get_num_connections, START, topic)
        return listener

    @classmethod
    def robot_publisher(cls, topic: str, message_class: Any) -> Any:
        """Publish a topic at the robot's master, as its camera does."""
        publisher = rospy.Publisher(topic, message_class, queue_size=1)
        if cls.link:
            cls.robot.master.call('registerPublisher', topic, message_class._type, rospy.get_node_uri())
        return publisher

    @staticmethod
    def states(listener: Listener) -> List[str]:
        return [came.message.data for came in listener.came]

    def wait_for_state(self, listener: Listener, words: str, seconds: float = 20.0) -> float:
        """When an operator's state was first shown with some words, of what was not cleared [s]."""
        return float(wait_for(lambda: next((came.when for came in listener.came if words in came.message.data), None),
                              seconds, words))

    @staticmethod
    def speeds(listener: Listener) -> List[Tuple[float, float]]:
        """[(when, linear.x), ...]"""
        return [(came.when, came.message.linear.x) for came in listener.came]
