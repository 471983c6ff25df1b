# SPDX-License-Identifier: BSD-3-Clause
"""What becomes of rospy's TCPROS connections when an address changes, and when they end: real sockets, no master."""
import contextlib
import socket
import threading
from types import SimpleNamespace
from typing import Any, Callable, Iterator, List, Optional, Tuple

import pytest
from polling import wait_for

from smokebot_udp.udpros import rpc, tcp_connections
from smokebot_udp.udpros.negotiation import Refused
from smokebot_udp.udpros.tcp_connections import MAX_RETRY_PERIOD, RETRY_PERIOD, TcpConnections

TOPIC, HERE, ELSEWHERE = '/cmd_vel', 'http://127.0.0.1:1/', 'http://192.0.2.1:1/'
FORMER = '127.0.0.7'


class Connection:
    """As rospy's: without a socket until it is made, and once it is closed."""

    def __init__(self, topic: Any, uri: str, made: Optional[socket.socket]) -> None:
        self._topic, self.name, self.endpoint_id, self.socket = topic, topic.resolved_name, uri, made
        topic.connections.append(self)

    def close(self) -> None:
        if self.socket is not None:
            self.socket.close()
        self._topic.connections.remove(self)


@pytest.fixture
def connect() -> Iterator[Callable[..., Connection]]:
    """f(topic, URI, own address) -> a connection to this machine"""
    with contextlib.ExitStack() as stack, socket.create_server(('127.0.0.1', 0)) as server:
        def make(topic: Any, uri: str, own: str = '127.0.0.1') -> Connection:
            return Connection(topic, uri, stack.enter_context(
                socket.create_connection(server.getsockname(), source_address=(own, 0))))
        yield make


def a_topic() -> Any:
    return SimpleNamespace(resolved_name=TOPIC, connections=[])


def no_attempt(topic: str, uri: str) -> None:
    raise AssertionError('%s is connected already' % topic)


class Attempts:
    """Fails each time, with one error."""

    def __init__(self, error: Exception) -> None:
        self.error = error
        self.made: List[Tuple[str, str]] = []

    def __call__(self, topic: str, uri: str) -> None:
        self.made.append((topic, uri))
        raise self.error


def test_a_connection_from_an_address_that_is_gone_is_closed(connect: Callable[..., Connection],
                                                            monkeypatch: Any) -> None:
    topic, connections = a_topic(), TcpConnections(no_attempt)
    former, kept = connect(topic, ELSEWHERE, FORMER), connect(topic, HERE)
    unmade = Connection(topic, 'http://127.0.0.1:2/', None)
    connections.close_former([topic])
    assert topic.connections == [former, kept, unmade]
    monkeypatch.setattr(tcp_connections, 'is_own', lambda host: host != FORMER)
    connections.close_former([topic])
    assert topic.connections == [kept, unmade]


def test_a_connection_to_an_address_that_its_publisher_has_left_is_closed(connect: Callable[..., Connection]) -> None:
    topic, connections = a_topic(), TcpConnections(no_attempt)
    left, kept = connect(topic, ELSEWHERE), connect(topic, HERE)
    connections.close_former([topic], {HERE})
    assert topic.connections == [left, kept]
    connections.close_former([topic], {HERE, ELSEWHERE})
    assert topic.connections == [kept]


def lost(attempt: Callable[[str, str], None], connect: Callable[..., Connection]) -> Tuple[TcpConnections, Any]:
    """The connections of a topic at time 0, when one has just ended."""
    topic, connections = a_topic(), TcpConnections(attempt)
    ended = connect(topic, HERE)
    connections.restore([topic], {TOPIC: [HERE]}, -1.0)
    ended.close()
    connections.restore([topic], {TOPIC: [HERE]}, 0.0)
    return connections, topic


def test_what_has_ended_is_connected_again_until_it_succeeds(connect: Callable[..., Connection]) -> None:
    attempts = Attempts(rpc.Unreachable('no answer'))
    connections, topic = lost(attempts, connect)
    times: List[float] = []
    for now in range(200):
        before = len(attempts.made)
        connections.restore([topic], {TOPIC: [HERE]}, float(now))
        wait_for(lambda: not threads())
        times += [float(now)] * (len(attempts.made) - before)
    assert times[:4] == [RETRY_PERIOD * k for k in (1, 3, 7, 15)]
    assert times[-1] - times[-2] == MAX_RETRY_PERIOD
    made = len(attempts.made)
    connect(topic, HERE)
    for now in range(200, 300):
        connections.restore([topic], {TOPIC: [HERE]}, float(now))
    wait_for(lambda: not threads())
    assert len(attempts.made) == made


def threads() -> List[threading.Thread]:
    """The attempts that are being made."""
    return [thread for thread in threading.enumerate() if thread.name == 'TCPROS ' + TOPIC]


@pytest.mark.parametrize('error', [rpc.Gone('refused'), Refused('not published')])
def test_a_publisher_that_publishes_no_longer_is_asked_once(error: Exception,
                                                            connect: Callable[..., Connection]) -> None:
    attempts = Attempts(error)
    connections, topic = lost(attempts, connect)
    wait_for(lambda: attempts.made and not threads())
    for now in range(100):
        connections.restore([topic], {TOPIC: [HERE]}, float(now))
    assert attempts.made == [(TOPIC, HERE)]


def test_a_publisher_that_the_master_does_not_know_is_left_alone(connect: Callable[..., Connection]) -> None:
    topic, connections = a_topic(), TcpConnections(no_attempt)
    ended = connect(topic, HERE)
    connections.restore([topic], {TOPIC: [HERE]}, 0.0)
    ended.close()
    connections.restore([topic], {TOPIC: [ELSEWHERE]}, 1.0)
    connections.restore([topic], {TOPIC: [HERE]}, 2.0)
    assert not threads()
