# SPDX-License-Identifier: BSD-3-Clause
"""The robot's path monitor and the operator's answers, over a link of real sockets whose path has a hole."""
import time
from types import SimpleNamespace
from typing import Any, Dict, Iterator

import pytest
from link_pair import Links, frame, links
from polling import wait_for
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import String
from test_link_network import Relay

from smokebot_udp.congestion.path_length import USUAL
from smokebot_udp.link.transport import OperatorTransport
from smokebot_udp.nodes.outbox import Outbox
from smokebot_udp.nodes.path_monitor import PathAnswers, PathMonitor
from smokebot_udp.paths import STRAIGHT, Route

IMAGES, STATES = '/smokebot_udp/camera/layers', '/smokebot_udp/status/segments'


class Side:
    """A robot that sends long and short datagrams, and an operator that reports them, over a relay with a hole."""

    def __init__(self, made: Links) -> None:
        self.robot, _ = made.robot()
        self.relay = Relay(self.robot.port)
        self.operator, _ = made.operator(self.relay.port)
        self.received: Dict[str, int] = {}
        self.monitor = PathMonitor(self.robot, Outbox())
        self.answers = PathAnswers(self.operator)
        self.images = self.robot.publisher(IMAGES, CompressedImage)
        self.states = self.robot.publisher(STATES, CompressedImage)
        for topic in (IMAGES, STATES):
            self.operator.subscriber(topic, CompressedImage, batch_callback=self._count(topic))
        wait_for(lambda: self.images.get_num_connections() and self.states.get_num_connections())
        self.begun = time.monotonic()

    def _count(self, topic: str) -> Any:
        def count(records: Any, mask: Any) -> None:
            self.received[topic] = self.received.get(topic, 0) + int(mask.sum())
        return count

    def step(self) -> int:
        """A tenth of a second of a robot's life; returns the longest datagram [byte of UDP payload]."""
        empty = frame(CompressedImage, 1, 0).datagram_size
        for topic, publisher, size, count in ((IMAGES, self.images, self.robot.room, 5), (STATES, self.states, 300, 1)):
            whole = frame(CompressedImage, count, size - empty)
            now = time.monotonic()
            publisher.publish_frames(whole)
            self.monitor.sent(topic, 0, count, whole.datagram_size + self.robot.overhead + 28, now, STRAIGHT)
        time.sleep(0.1)
        streams = [SimpleNamespace(name=name, received=count) for name, count in self.received.items()]
        self.monitor.reported(self.operator.name, SimpleNamespace(streams=streams), time.monotonic())
        self.monitor.tick(time.monotonic())
        return self.robot.room + self.robot.overhead

    def until(self, condition: Any, steps: int) -> float:
        """How long it took [s]."""
        begun = time.monotonic()
        for _ in range(steps):
            self.step()
            if condition():
                return time.monotonic() - begun
        raise AssertionError((self.robot.room, self.monitor.hole, self.received))


@pytest.fixture
def side() -> Iterator[Side]:
    with links() as made:
        one = Side(made)
        yield one
        one.relay.close()


def test_a_hole_comes_and_goes(side: Side) -> None:
    side.until(lambda: side.received.get(IMAGES, 0) > 20, 30)
    assert side.step() == 1472 and side.monitor.hole is None
    side.relay.longest = 1200
    side.until(lambda: side.monitor.hole is not None, 30)
    assert side.step() <= 1200
    before = side.received[IMAGES]
    side.until(lambda: side.received[IMAGES] > before + 10, 10)     # they pass again
    assert side.images.connections()[0]['max_datagram_size'] == side.robot.room
    side.until(lambda: side.monitor.hole == 1172, 60)
    side.relay.longest = 65535
    side.until(lambda: side.monitor.hole is None, 200)
    assert side.step() == 1472


def test_a_long_message_crosses_a_path_with_a_hole(side: Side) -> None:
    """Not only frames: whatever is sent is cut to what passes."""
    side.relay.longest = 1000
    side.until(lambda: side.robot.room + side.robot.overhead == USUAL[0], 60)
    texts = []
    side.operator.subscriber('/chat', String, texts.append)
    chat = side.robot.publisher('/chat', String)
    wait_for(chat.get_num_connections)
    chat.publish(String('x' * 5000))
    wait_for(lambda: texts)


def test_operators_send_what_passes_nearly_everywhere(side: Side) -> None:
    chat, texts = side.operator.publisher('/chat', String), []
    side.robot.subscriber('/chat', String, texts.append)
    wait_for(chat.get_num_connections)
    side.relay.longest_up = USUAL[1]
    chat.publish(String('x' * 5000))
    wait_for(lambda: texts)
    assert chat.connections()[0]['datagrams'] == 5


def test_a_hole_of_the_second_path_is_found() -> None:
    with links() as made:
        robot, _ = made.robot()
        relays = [Relay(robot.port), Relay(robot.port)]
        operator = OperatorTransport([('127.0.0.1', relay.port) for relay in relays], made.key, name='/desk',
                                     report=lambda _: None, log=lambda _: None)
        made.made.append(operator)
        monitor, images = PathMonitor(robot, Outbox()), robot.publisher(IMAGES, CompressedImage)
        made.made.append(monitor)
        answers, received = PathAnswers(operator), [0, 0]
        made.made.append(answers)

        def arrived(connection: int, seq: int, size: int, count: int, when: float, marked: int, path: int) -> None:
            received[path] += count
        operator.subscriber(IMAGES, CompressedImage, batch_callback=lambda records, mask: None, arrived=arrived)
        wait_for(lambda: images.get_num_connections() and robot.stats(0.0).peers[0].others)
        name, used = robot.stats(0.0).peers[0].name, robot.stats(0.0).peers[0].address
        other, = (relay for relay in relays if relay.address != used)
        other.longest = 1200
        empty = frame(CompressedImage, 1, 0).datagram_size

        def step() -> bool:
            whole = frame(CompressedImage, 5, robot.room - empty)
            for route in STRAIGHT, Route(second=(name,)):
                images.publish_frames(whole, second=route.second)
                monitor.sent(IMAGES, 0, 5, whole.datagram_size + robot.overhead + 28, time.monotonic(), route)
            time.sleep(0.1)
            for path, count in enumerate(received):
                report = SimpleNamespace(streams=[SimpleNamespace(name=IMAGES, received=count)])
                monitor.reported(name, report, time.monotonic(), path)
            monitor.tick(time.monotonic())
            return monitor.hole == 1172
        assert any(step() for _ in range(200))
        before = received[1]
        assert any(step() and received[1] > before for _ in range(20))
        for relay in relays:
            relay.close()
