# SPDX-License-Identifier: BSD-3-Clause
"""When a publisher is asked for a connection: a real XML-RPC server, no master."""
import errno
import socket
import threading
import time
import xmlrpc.server
from typing import Any, Iterator, List

import pytest
import rosgraph.network
import rospy
from std_msgs.msg import String

from smokebot_udp.udpros import connector, rpc
from smokebot_udp.udpros.connector import Connector
from smokebot_udp.udpros.rospy_transports import SubscriberOptions, UdpSubscriberImpl


class Publisher:
    """A node that refuses all connections."""

    def __init__(self) -> None:
        self.server = xmlrpc.server.SimpleXMLRPCServer(('127.0.0.1', 0), logRequests=False)
        self.server.register_function(self.request, 'requestTopic')
        self.uri = 'http://127.0.0.1:%d/' % self.server.server_address[1]
        self.topics: List[str] = []
        self.ports: List[int] = []
        self.failures, self.reason = 0, 'not today'
        threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True).start()

    def request(self, caller: str, topic: str, offers: Any) -> Any:
        self.topics.append(topic)
        self.ports.append(offers[0][3])
        if len(self.ports) <= self.failures:
            raise OSError('the answer is lost')
        return [0, self.reason, 0]


@pytest.fixture
def publisher() -> Iterator[Publisher]:
    made = Publisher()
    yield made
    made.server.shutdown()
    made.server.server_close()


def subscriber(publisher: Publisher, wanted: Any, monkeypatch: Any) -> UdpSubscriberImpl:
    impl = UdpSubscriberImpl('/topic', String, SubscriberOptions(('UDPROS',), 1472, 1 << 16, 0.0, None, wanted))
    impl.publishers = (publisher.uri,)

    class Manager:
        """Stands in for rospy's, which has a master."""
        @staticmethod
        def get_subscriber_impl(topic: str) -> UdpSubscriberImpl:
            return impl
    monkeypatch.setattr(connector, 'get_topic_manager', Manager)
    monkeypatch.setattr(rpc, 'RETRY_PERIOD', 0.01)
    monkeypatch.setattr(rospy, 'logerr', lambda *_: None)
    return impl


def test_a_publisher_is_asked_once_it_is_wanted(publisher: Publisher, monkeypatch: Any) -> None:
    requests_before: List[int] = []

    def wanted() -> bool:
        requests_before.append(len(publisher.topics))
        return len(requests_before) == 4
    impl = subscriber(publisher, wanted, monkeypatch)
    assert Connector(lambda *_: (0, 'by TCPROS', 0)).connect_topic('/topic', publisher.uri)[0] == 0
    assert requests_before == [0, 0, 0, 0] and publisher.topics == ['/topic'] and not impl.connecting


@pytest.mark.parametrize('reason, told', [
    ('not today', True), ('not a publisher of [/topic]', False), ('Not a publisher of [/topic]', False)])
def test_that_a_publisher_has_unregistered_is_no_error(
        reason: str, told: bool, publisher: Publisher, monkeypatch: Any) -> None:
    lines: List[str] = []
    publisher.reason = reason
    subscriber(publisher, lambda: True, monkeypatch)
    monkeypatch.setattr(rospy, 'logerr', lambda text, *values: lines.append(text % values))
    Connector(lambda *_: (0, 'by TCPROS', 0)).connect_topic('/topic', publisher.uri)
    assert [line for line in lines if publisher.uri in line] == told * [
        '[/topic]: %s refuses: requestTopic: %s' % (publisher.uri, reason)]


def test_a_subscriber_that_ends_before_asks_nobody(publisher: Publisher, monkeypatch: Any) -> None:
    def wanted() -> bool:
        impl.close()
        return False
    impl = subscriber(publisher, wanted, monkeypatch)
    assert Connector(lambda *_: (0, 'by TCPROS', 0)).connect_topic('/topic', publisher.uri)[0] == 0
    assert publisher.topics == [] and not impl.connecting


def test_a_publisher_that_did_not_answer_is_asked_for_the_same_port(publisher: Publisher, monkeypatch: Any) -> None:
    publisher.failures = 2
    subscriber(publisher, lambda: True, monkeypatch)
    assert Connector(lambda *_: (0, 'by TCPROS', 0)).connect_topic('/topic', publisher.uri) == (
        0, 'requestTopic: not today', 0)
    assert len(publisher.ports) == 3 and len(set(publisher.ports)) == 1
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(('', publisher.ports[0]))


@pytest.mark.parametrize('address', ['0.0.0.0', '127.0.0.1', '::', '::1'])
def test_datagrams_cross_by_ipv4_where_ros_uses_ipv6(address: str, publisher: Publisher, monkeypatch: Any) -> None:
    """See ROS_IPV6: rosgraph then names an IPv6 address to bind to."""
    monkeypatch.setattr(rosgraph.network, 'get_bind_address', lambda: address)
    monkeypatch.setattr(rpc, 'MAX_RETRY_PERIOD', 0.01)
    impl = subscriber(publisher, lambda: True, monkeypatch)
    timer = threading.Timer(5.0, impl.close)        # it would be tried for ever
    timer.start()
    assert Connector(lambda *_: (0, 'by TCPROS', 0)).connect_topic('/topic', publisher.uri) == (
        0, 'requestTopic: not today', 0)
    timer.cancel()
    assert len(publisher.ports) == 1


@pytest.mark.parametrize('failures, told', [(connector.TRANSIENT, False), (20, True)])
def test_what_lasts_and_is_this_machines_fault_is_told_once(
        failures: int, told: bool, publisher: Publisher, monkeypatch: Any) -> None:
    left, lines, opened = [failures], [], connector.open_receiver

    def no_sockets(*given: Any) -> Any:
        left[0] -= 1
        if left[0] >= 0:
            raise OSError(errno.EMFILE, 'Too many open files')
        return opened(*given)
    subscriber(publisher, lambda: True, monkeypatch)
    monkeypatch.setattr(rpc, 'MAX_RETRY_PERIOD', 0.01)
    monkeypatch.setattr(rospy, 'logerr', lambda text, *values: lines.append(text % values))
    monkeypatch.setattr(connector, 'open_receiver', no_sockets)
    Connector(lambda *_: (0, 'by TCPROS', 0)).connect_topic('/topic', publisher.uri)
    assert [line for line in lines if 'refuses' not in line] == told * [
        '[/topic]: no connection to %s, retrying: [Errno 24] Too many open files' % publisher.uri]


def test_a_topic_that_is_wanted_late_is_asked_for_soon(publisher: Publisher, monkeypatch: Any) -> None:
    asked: List[float] = []

    def wanted() -> bool:
        asked.append(time.monotonic())
        return len(asked) == 15
    subscriber(publisher, wanted, monkeypatch)
    Connector(lambda *_: (0, 'by TCPROS', 0)).connect_topic('/topic', publisher.uri)
    assert len(publisher.topics) == 1 and asked[-1] - asked[0] < 12    # 3.5 s; with a growing period 14 s
