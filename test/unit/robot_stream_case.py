# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of the robot's streams share: stand-ins for rospy's topics and an encoder that keeps what it is given.

A test module has the fixtures by importing them.
"""
from types import SimpleNamespace
from typing import Any, Callable, Iterator, List, Mapping, Optional

import pytest
import rospy
from genpy import Time
from sensor_msgs.msg import LaserScan
from stub_transport import StubTransport

from smokebot_udp.mission.parameters import Parameter
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import ScanSegment
from smokebot_udp.nodes.derived_stream import DerivedStream
from smokebot_udp.nodes.outbox import Outbox
from smokebot_udp.nodes.robot_stream import RobotLink, RobotStream
from smokebot_udp.streams.encoder import Encoded, Encoder, LinkView
from smokebot_udp.streams.parameters import ROBOT
from smokebot_udp.udpros.frame import Frame

NOW = 10
"""By ROS's clock [s]."""


class Topic:
    """Stands in for publishers and subscribers of rospy."""

    def __init__(self, name: str, message_class: Any, *args: Any, **options: Any) -> None:
        self.name, self.message_class, self.args, self.options = name, message_class, args, options
        self.listeners, self.seq, self.impl, self.closed = 1, 0, self, False
        self.published: List[Any] = []
        self.peer = '/operator'

    def get_num_connections(self) -> int:
        return self.listeners

    def publish(self, message: Any) -> None:
        self.published.append(message)
        self.seq += 1

    def publish_frames(self, *frames: Any, limits: Any = None, second: Any = ()) -> int:
        first = self.seq + 1
        for frame in frames:
            number = 'total' if frame.message_class is ScanSegment else 'index'
            self.published += [frame.records[number][row].item() for row in range(len(frame))]
            self.seq += len(frame)
        return first

    def connections(self) -> List[Any]:
        return [{'peer': self.peer, 'address': ('10.0.0.2', 5), 'datagrams': 1, 'bytes': 99}] * self.listeners

    def unregister(self) -> None:
        self.closed = True


class Recorder(Encoder[Any]):
    """Writes a scan's number of ranges into a frame, and keeps what it is asked."""
    MESSAGE, SEGMENTS = LaserScan, {'segments': ScanSegment}
    PARAMETERS: Mapping[str, Parameter] = {**ROBOT, 'repeat_rate': Parameter(20.0, 'Hz', '', above=0.0, live=True)}

    def __init__(self, settings: Mapping[str, Any]) -> None:
        super().__init__(settings)
        self.calls: List[Any] = []
        self.seen = LinkView()      # last

    @staticmethod
    def check(settings: Mapping[str, Any]) -> None:
        if settings['weight'] > 100:
            raise ValueError('weight is %g' % settings['weight'])

    def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
        self.calls.append((len(message.ranges), settings['rate'], link.datagram_size))
        self.seen = link
        if not message.ranges:
            raise ValueError('it has no ranges')
        return Encoded([self.frame(len(message.ranges))])

    @staticmethod
    def frame(number: int) -> Frame:
        frame = Frame(ScanSegment, 1, {})
        frame.records['total'] = number
        return frame


Make = Callable[..., Any]


@pytest.fixture
def logged(monkeypatch: Any) -> List[str]:
    """What is logged as warnings and errors."""
    lines: List[str] = []
    for name in ('logwarn', 'logerr'):
        monkeypatch.setattr(rospy, name, lambda line, *args: lines.append(line % args))
    monkeypatch.setattr(rospy, 'is_shutdown', lambda: False)
    monkeypatch.setattr(rospy.Time, 'now', lambda: Time(NOW, 0))
    return lines


@pytest.fixture
def make(logged: List[str]) -> Iterator[Make]:
    """Makes a stream that is started: its link, its topics as `segments`, `local` and `source`."""
    made = []

    def make_one(kind: Any = Recorder, runner: Any = RobotStream, **changes: Any) -> Any:
        settings = {**{name: parameter.default for name, parameter in kind.PARAMETERS.items()}, 'robot_topic': '/in',
                    'rate': 1000.0, **changes}
        topics: List[Topic] = []

        def topic(*args: Any, **options: Any) -> Topic:
            topics.append(Topic(*args, **options))
            return topics[-1]

        def named(name: str) -> Any:
            return next((one for one in topics if one.name == name), None)

        link = RobotLink(StubTransport(topic), Outbox())
        link.outbox.start()
        derived = [topic] if runner is DerivedStream else []
        stream = runner('scan', settings, kind(settings), link, topic, *derived)
        stream.start()
        made.append((stream, link))
        return SimpleNamespace(stream=stream, link=link, segments=named('/smokebot_udp/scan/segments'), local=topics[0],
                               source=topics[-1], topics=topics, named=named)

    yield make_one
    for stream, link in made:
        stream.close()
        link.outbox.stop()


def scan(number: int, stamp: Optional[int] = None) -> Any:
    message = LaserScan(ranges=[0.0] * number)
    message.header.stamp = Time(number if stamp is None else stamp, 0)
    return message
