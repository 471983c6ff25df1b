# SPDX-License-Identifier: BSD-3-Clause
"""A topic's connections without a node: real sockets, no master."""
import socket
import threading
import time
from typing import Any

import pytest
from polling import WAIT
from rospy.impl.tcpros_pubsub import QueuedConnection
from rospy.impl.transport import OUTBOUND, Transport
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String

from smokebot_udp.udpros import Frame
from smokebot_udp.udpros.negotiation import Request
from smokebot_udp.udpros.rospy_transports import PublisherOptions, PublisherTransport, UdpPublisherImpl


@pytest.fixture
def impl() -> Any:
    made = UdpPublisherImpl('/topic', String, PublisherOptions(('UDPROS', 'TCPROS'), 1472))
    yield made
    if made.c_lock.acquire(timeout=WAIT):       # else a deadlock, which the test has found
        made.close()
        made.c_lock.release()


@pytest.fixture
def listening() -> Any:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(('127.0.0.1', 0))
        bound.settimeout(WAIT)
        yield bound


def connection(port, name='/subscriber') -> Any:
    return PublisherTransport('/topic', Request('127.0.0.1', port, {'callerid': name}), 1, 1472)


def closed_port() -> Any:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('127.0.0.1', 0))
        return probe.getsockname()[1]


class Listener:
    """A SubscribeListener that does something, and does nothing when a subscriber leaves."""

    def __init__(self, peer_subscribe) -> None:
        self.peer_subscribe = peer_subscribe

    def peer_unsubscribe(self, *_) -> None:
        pass


def check_no_deadlock(impl, listening) -> None:
    """A subscriber is added while another thread, which is publishing, drops a dead one."""
    dead = connection(closed_port(), '/dead')
    impl.add_connection(dead)
    publishing = threading.Event()
    close = dead.close

    def close_slowly() -> None:
        publishing.set()
        time.sleep(0.2)     # meanwhile the other one is added
        close()

    def publish() -> None:
        while not dead.done:
            impl.acquire()
            impl.publish(String('x'))
            impl.release()

    dead.close = close_slowly

    def add() -> None:
        publishing.wait(WAIT)
        impl.add_connection(connection(listening.getsockname()[1]))

    threads = [threading.Thread(target=target, daemon=True) for target in (publish, add)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(WAIT)
        assert not thread.is_alive(), 'deadlock'
    assert [c.endpoint_id for c in impl.connections] == ['/subscriber']


def test_a_latched_topic_with_a_dead_subscriber(impl, listening) -> None:
    impl.enable_latch()
    impl.latch = String('latched')
    check_no_deadlock(impl, listening)
    assert listening.recv(100)


def test_a_listener_that_publishes(impl, listening) -> None:
    def publish(*_) -> None:
        impl.acquire()
        impl.publish(String('to all'))
        impl.release()

    impl.add_subscriber_listener(Listener(publish))
    check_no_deadlock(impl, listening)
    assert listening.recv(100).endswith(b'to all')


def test_a_listener_publishes_to_the_new_subscriber(impl, listening) -> None:
    impl.add_subscriber_listener(Listener(lambda name, to_all, to_one: to_one(String('to you ' + name))))
    impl.add_connection(connection(listening.getsockname()[1]))
    assert listening.recv(100).endswith(b'to you /topic')


class Tcp(Transport):
    def __init__(self, name='/tcp') -> None:
        super().__init__(OUTBOUND, '/topic')
        self.endpoint_id = name

    def write_data(self, _) -> bool:
        return True


def test_a_connection_does_not_end_others_of_the_same_name(impl, listening) -> None:
    """Anybody can use it; only by TCPROS, rospy's rule holds."""
    first, second = (connection(listening.getsockname()[1]) for _ in range(2))
    tcp = [Tcp('/subscriber') for _ in range(2)]
    for one in (first, tcp[0], second, tcp[1]):
        impl.add_connection(one)
    assert impl.connections == [first, second, tcp[1]]
    assert [one.done for one in (first, second, *tcp)] == [False, False, True, False]
    first.close()
    assert impl.connections == [second, tcp[1]]


def test_a_tcp_subscriber_has_its_queue_while_a_udp_subscriber_is_added(impl, listening) -> None:
    impl.set_queue_size(3)
    entered, leave = threading.Event(), threading.Event()

    def subscribed(*_) -> None:
        entered.set()
        leave.wait(WAIT)

    impl.add_subscriber_listener(Listener(subscribed))
    udp = threading.Thread(target=impl.add_connection, args=(connection(listening.getsockname()[1]),), daemon=True)
    udp.start()
    assert entered.wait(WAIT)
    assert impl.queue_size == 3
    leave.set()
    udp.join(WAIT)
    impl.add_connection(Tcp())
    queued = impl.connections[-1]
    assert (queued.endpoint_id, type(queued)) == ('/tcp', QueuedConnection)
    queued.close()


@pytest.mark.parametrize('limit, expected', [(None, [1, 2, 3, 4, 5]), (4, [1, 2, 3, 4]), (2, [1, 2]), (0, [])])
def test_a_subscriber_gets_only_the_first_messages_of_frames(limit, expected) -> None:
    impl = UdpPublisherImpl('/topic', LaserScan, PublisherOptions(('UDPROS', 'TCPROS'), 1472))
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    for bound, name in zip(sockets, ('/fast', '/slow')):
        bound.bind(('127.0.0.1', 0))
        bound.settimeout(WAIT)
        impl.add_connection(connection(bound.getsockname()[1], name))
    frames = [Frame(LaserScan, count, {'ranges': 1}) for count in (3, 2)]
    impl.publish_frames(frames, {} if limit is None else {'/slow': limit})
    impl.publish_frames([Frame(LaserScan, 1, {'ranges': 1})], {})       # the last one
    for bound, seqs in zip(sockets, ([1, 2, 3, 4, 5], expected)):
        assert [int.from_bytes(bound.recv(100)[12:16], 'little') for _ in range(len(seqs) + 1)] == [*seqs, 6]
        bound.close()
    impl.close()


def test_a_frame_to_one_subscriber_is_numbered_as_it_is(impl, listening) -> None:
    scans = UdpPublisherImpl('/scans', LaserScan, PublisherOptions(('UDPROS',), 1472))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(('127.0.0.1', 0))
        other.setblocking(False)
        scans.add_connection(connection(listening.getsockname()[1]))
        scans.add_connection(connection(other.getsockname()[1], '/other'))
        frame = Frame(LaserScan, 1, {'ranges': 3})
        frame.records['header']['seq'] = 77
        scans.send_to('/subscriber', frame)
        scans.send_to('/nobody', frame)
        assert listening.recv(2000)[8:] == frame.rows[0, 8:].tobytes()
        with pytest.raises(BlockingIOError):
            other.recv(2000)
    assert frame.records['header']['seq'] == 77 and scans.seq == 0
    scans.close()
