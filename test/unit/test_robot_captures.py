# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of captures between a stub transport and a real outbox."""
import time
from types import SimpleNamespace
from typing import Any, Iterator, List

import numpy as np
import pytest
from genpy import Time
from polling import wait_for
from sensor_msgs.msg import Image
from stub_transport import StubTransport

from smokebot_udp.capture.content import Refused, unpack
from smokebot_udp.capture.history import Histories
from smokebot_udp.capture.receiving import Receiving
from smokebot_udp.capture.sending import Piece
from smokebot_udp.congestion.packet_scheduler import PacketScheduler
from smokebot_udp.msg import CaptureRequest
from smokebot_udp.nodes import robot_captures
from smokebot_udp.nodes.outbox import Outbox
from smokebot_udp.nodes.robot_captures import NAME, RobotCaptures
from smokebot_udp.nodes.robot_stream import RobotLink
from smokebot_udp.serialised import serialised

STREAMS: Any = {'thermal': SimpleNamespace(settings=SimpleNamespace(current=SimpleNamespace(requested={})))}


class Topic:
    """Both topics; the operator's side of the pieces."""

    def __init__(self, *_: Any, **__: Any) -> None:
        self.received, self.limits = Receiving(), []
        self.receive: Any = None

    def subscriber(self, topic: str, class_: Any, callback: Any, **_: Any) -> 'Topic':
        self.receive = callback
        return self

    def publisher(self, *_: Any, **__: Any) -> 'Topic':
        return self

    def publish_frames(self, frame: Any, limits: Any, second: Any) -> int:
        record = frame.records[0]
        self.limits.append(limits)
        self.received.take(Piece(*(int(record[name]) for name in ('size', 'order', 'number', 'length')),
                                 record['data'].tobytes()))
        return 1

    def connections(self) -> List[Any]:
        return [{'peer': '/operator'}, {'peer': '/other'}]

    def unregister(self) -> None:
        pass

    def ask(self, **values: Any) -> None:
        request = CaptureRequest(received=self.received.received, order=self.received.order, **values)
        request._connection_header = {'callerid': '/operator'}
        self.receive(request)


@pytest.fixture
def side() -> Iterator[Any]:
    """(RobotCaptures, Topic, an original)"""
    topic = Topic()
    outbox = Outbox(PacketScheduler(1e5))
    link = RobotLink(StubTransport(topic.publisher, topic.subscriber), outbox, histories=Histories(1 << 24))
    image = Image(height=40, width=50, step=100, encoding='mono16', data=np.random.RandomState(1).bytes(4000))
    assert link.histories is not None
    link.histories.add('thermal', image, Time(5).to_nsec(), 10.0, time.monotonic())
    outbox.start()
    codec: Any = SimpleNamespace(ready=lambda: False)
    lookup: Any = SimpleNamespace(pose=lambda frames, header: None)
    captures = RobotCaptures(link, STREAMS, lookup, codec, 0.4, 'site')
    yield captures, topic, image
    captures.close()
    outbox.stop()


def test_an_original_is_sent_to_its_operator_until_it_is_held(side: Any) -> None:
    captures, topic, image = side
    assert captures.demands(1e5) == {}
    topic.ask(id=7, stream='thermal')
    wait_for(lambda: topic.received.whole is not None)
    assert serialised(unpack(topic.received.whole, Image).message) == serialised(image)
    assert topic.limits and all(limits == {'/other': 0} for limits in topic.limits)
    demand = captures.demands(1e5)[NAME]
    assert demand.min_bitrate == demand.points[0].cost == 4e4 and demand.weight == 0.0
    topic.ask(id=7, stream='thermal')
    assert captures.demands(1e5) == {}      # all is held


def test_a_capture_without_a_pose_says_so(side: Any, monkeypatch: Any) -> None:
    logged: List[str] = []
    monkeypatch.setattr('rospy.logwarn', lambda text, *values: logged.append(text % values))
    side[1].ask(id=9, stream='thermal')
    wait_for(lambda: logged)
    assert logged == ["stream 'thermal': tf knows no transform from '' to 'site or odom': a capture has no pose"]


def test_a_refusal_is_sent_likewise(side: Any) -> None:
    captures, topic, _ = side
    topic.ask(id=8, stream='camera')
    wait_for(lambda: topic.received.whole is not None)
    with pytest.raises(Refused, match="the robot has no stream 'camera'"):
        unpack(topic.received.whole, Image)
    topic.ask(id=8, done=True)
    assert captures.demands(1e5) == {}


@pytest.mark.parametrize('error', [OverflowError('int too big to convert'), MemoryError(), KeyError('x')])
def test_whatever_goes_wrong_the_operator_is_told_at_once(side: Any, monkeypatch: Any,
                                                          error: Exception) -> None:
    def fail(*_: Any) -> None:
        raise error
    monkeypatch.setattr(robot_captures, 'pack', fail)
    _, topic, _ = side
    topic.ask(id=8, stream='thermal')
    wait_for(lambda: topic.received.whole is not None)
    with pytest.raises(Refused, match='the robot cannot send it: %s' % type(error).__name__):
        unpack(topic.received.whole, Image)


def test_a_forged_name_controls_no_terminal(side: Any, monkeypatch: Any) -> None:
    logged: List[str] = []
    monkeypatch.setattr('rospy.logwarn', lambda text, *values: logged.append(text % values))
    side[1].ask(id=9, stream='a\x1b[2J\0')
    wait_for(lambda: logged)
    assert logged == ["a capture of /operator is refused: the robot has no stream 'a\\x1b[2J\\x00'"]
