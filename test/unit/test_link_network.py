# SPDX-License-Identifier: BSD-3-Clause
"""A link whose network changes: addresses, cuts, loss, names that do not resolve."""
import os
import random
import socket
import threading
import time
from typing import Any, Iterator, List, Optional, Tuple

import numpy as np
import pytest
from link_pair import KEY, Inbox, Links, frame, links
from polling import WAIT, wait_for
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import String

from smokebot_udp import udpros
from smokebot_udp.link.operator_core import OperatorCore
from smokebot_udp.link.packets import OVERHEAD
from smokebot_udp.link.peer import Peer
from smokebot_udp.link.place import address_of, place_at
from smokebot_udp.link.resolver import Resolver
from smokebot_udp.link.transport import PROBLEM_AFTER, OperatorTransport
from smokebot_udp.msg import Command
from smokebot_udp.transport import BESIDE, UNUSED
from smokebot_udp.udpros.endpoints import BatchSender, DatagramReceiver

TOPIC = '/smokebot_udp/thermal/segments'


class Relay:
    """A network between an operator and a robot's port, as the robot sees it from one address after the other.

    :param port: the robot's
    """

    def __init__(self, port: int) -> None:
        self._robot = ('127.0.0.1', port)
        self._front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._front.bind(('127.0.0.1', 0))
        self.port = self._front.getsockname()[1]
        self._operator: Optional[Tuple[str, int]] = None
        self.loss, self._random = 0.0, random.Random(1)
        self.longest = self.longest_up = 65535      # longer packets are dropped, down and up
        self._backs: List[socket.socket] = []
        self._threads: List[threading.Thread] = []
        self.move()
        self._start(self._forward)

    def move(self) -> None:
        """The operator's packets come from another address from now on; what is sent to the old one is lost."""
        back = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        back.bind(('127.0.0.1', 0))
        self._backs.append(back)
        self._start(self._return, back)

    @property
    def address(self) -> Any:
        """The operator's, as the robot sees it."""
        return self._backs[-1].getsockname()

    def _start(self, target: Any, *arguments: Any) -> None:
        self._threads.append(threading.Thread(target=target, args=arguments, daemon=True))
        self._threads[-1].start()

    def _forward(self) -> None:
        while True:
            data, self._operator = self._front.recvfrom(2000)
            if not data:
                return
            if self._random.random() >= self.loss and len(data) <= self.longest_up:
                self._backs[-1].sendto(data, self._robot)

    def _return(self, back: socket.socket) -> None:
        while True:
            data = back.recv(2000)
            if not data:
                return
            if (back is self._backs[-1] and self._operator and self._random.random() >= self.loss
                    and len(data) <= self.longest):
                self._front.sendto(data, self._operator)

    def close(self) -> None:
        for one in (self._front, *self._backs):
            one.sendto(b'', one.getsockname())      # ends its thread
        for thread in self._threads:
            thread.join(WAIT)
            assert not thread.is_alive()
        for one in (self._front, *self._backs):
            one.close()


@pytest.fixture
def made() -> Iterator[Links]:
    with links() as one:
        yield one


@pytest.fixture
def relayed(made: Links) -> Iterator[Any]:
    """A robot that sends a topic to an operator by way of a Relay."""
    robot, _ = made.robot()
    relay = Relay(robot.port)
    operator, _ = made.operator(relay.port)
    inbox = Inbox()
    operator.subscriber(TOPIC, CompressedImage, batch_callback=inbox.batch, arrived=inbox.arrived)
    publisher = robot.publisher(TOPIC, CompressedImage)
    wait_for(publisher.get_num_connections)
    yield robot, operator, publisher, inbox, relay
    relay.close()


def test_the_session_goes_on_from_another_address(relayed: Any) -> None:
    robot, operator, publisher, inbox, relay = relayed
    whole = frame(CompressedImage, 2, 1000)
    publisher.publish_frames(whole)
    inbox.wait(lambda: len(inbox.records) == 2)
    before = robot.stats(0.0)
    for move in range(3):
        relay.move()
        wait_for(lambda: publisher.connections()[0]['address'] == relay.address)
        publisher.publish_frames(whole)
        inbox.wait(lambda count=4 + 2 * move: len(inbox.records) == count)
    assert len(robot.stats(0.0).peers) == 1 and robot.stats(0.0).peers[0].address == relay.address
    assert robot.stats(0.0).handshakes <= before.handshakes + 3
    assert len({number for number, *_ in inbox.arrivals}) == 1       # one connection


def test_a_cut_ends_nothing(relayed: Any) -> None:
    robot, operator, publisher, inbox, relay = relayed
    publisher.publish_frames(frame(CompressedImage, 1, 100))
    inbox.wait(lambda: len(inbox.records) == 1)
    relay.loss = 1.0
    wait_for(lambda: operator.problem() is not None)
    assert 'no answer from 127.0.0.1:%d' % relay.port in operator.problem()
    relay.loss = 0.0
    wait_for(lambda: operator.problem() is None)
    publisher.publish_frames(frame(CompressedImage, 1, 100))
    inbox.wait(lambda: len(inbox.records) == 2)
    assert len({number for number, *_ in inbox.arrivals}) == 1


def test_what_is_lost_is_counted(made: Links) -> None:
    robot, _ = made.robot()
    publisher = robot.publisher(TOPIC, CompressedImage)
    try:
        udpros.emulate_loss(0.3, 5)
        operator, _ = made.operator(robot.port)
    finally:
        udpros.emulate_loss(0.0)
    inbox = Inbox()
    subscriber = operator.subscriber(TOPIC, CompressedImage, batch_callback=inbox.batch)
    wait_for(publisher.get_num_connections)
    for _ in range(40):
        publisher.publish_frames(frame(CompressedImage, 10, 1000))
        time.sleep(0.002)

    def all_counted() -> bool:
        """But for those after the last one that was received: nothing shows their loss."""
        stats, = subscriber.connections() or [{'received': 0, 'lost': 0}]
        return bool(stats['received'] + stats['lost'] > 400 - 10)
    wait_for(all_counted)
    stats, = subscriber.connections()
    assert 0.6 * 400 < stats['received'] < 0.8 * 400 + 20 and stats['lost'] > 60


def test_a_host_name_is_looked_up(made: Links) -> None:
    robot, _ = made.robot()
    operator = OperatorTransport([('localhost', robot.port)], made.key, name='/desk', report=lambda _: None,
                                 log=lambda _: None)
    made.made.append(operator)
    publisher, inbox = robot.publisher('/chat', String), Inbox()
    operator.subscriber('/chat', String, inbox.message)
    wait_for(publisher.get_num_connections)


def has_second(side: Any) -> bool:
    """Whether a side knows another path to its peer by which copies go."""
    return any(path.use != UNUSED for path in side.stats(0.0).peers[0].others)


def test_the_link_goes_on_over_the_robots_other_address(made: Links) -> None:
    robot, _ = made.robot()
    relays, log = [Relay(robot.port), Relay(robot.port)], []    # type: List[Any], List[str]
    operator = OperatorTransport([('127.0.0.1', relay.port) for relay in relays], made.key, name='/desk',
                                 report=lambda _: None, log=log.append)
    made.made.append(operator)
    publisher, inbox = robot.publisher('/chat', String), Inbox()
    operator.subscriber('/chat', String, inbox.message)
    wait_for(publisher.get_num_connections)

    def uses(number: int) -> bool:
        robots = operator.stats(time.monotonic()).peers
        return bool(robots) and robots[0].address[1] == relays[number].port
    wait_for(lambda: uses(0) and operator.stats(0.0).peers[0].others[0].round_trip is not None)
    relays[0].loss = 1.0
    wait_for(lambda: uses(1))
    wait_for(lambda: robot.stats(0.0).peers[0].address == relays[1].address)
    publisher.publish(String('still here'))
    wait_for(lambda: inbox.messages and inbox.messages[-1].data == 'still here')
    relays[0].loss = 0.0
    wait_for(lambda: uses(0))
    assert '/robot_sender@ugv1 has moved to 127.0.0.1:%d' % relays[1].port in log
    for relay in relays:
        relay.close()


@pytest.mark.parametrize('size', [4, 1000])
def test_what_is_copied_comes_once_whichever_path_is_cut(made: Links, size: int) -> None:
    """Nothing has to be noticed first: the paths that are in use stay the same."""
    robot, _ = made.robot()
    relays = [Relay(robot.port), Relay(robot.port)]
    operator = OperatorTransport([('127.0.0.1', relay.port) for relay in relays], made.key, name='/desk',
                                 report=lambda _: None, log=lambda _: None)
    made.made.append(operator)
    ways = [(a.publisher(topic, Command, copied=True), Inbox(), b, topic)
            for a, b, topic in ((robot, operator, '/down'), (operator, robot, '/up'))]
    for _, inbox, receiver, topic in ways:
        receiver.subscriber(topic, Command, inbox.message)
    wait_for(lambda: all(way[0].get_num_connections() for way in ways))
    wait_for(lambda: all(has_second(side) for side in (robot, operator)))

    def send(number: int) -> None:
        for publisher, inbox, *_ in ways:
            publisher.publish(Command(number=number, data=bytes(size)))
            inbox.wait(lambda inbox=inbox: inbox.messages and inbox.messages[-1].number == number)
    send(1)
    for number in range(2):
        relays[number].loss = 1.0
        send(2 + number)
        relays[number].loss = 0.0
    send(4)
    for _, inbox, *_ in ways:
        assert [message.number for message in inbox.messages] == [1, 2, 3, 4]
    for side in (robot, operator):
        assert 'replayed data' not in side.dropped()
    for relay in relays:
        relay.close()


@pytest.mark.parametrize('says', [True, False])
def test_a_robot_that_says_that_it_leaves_is_not_reported_as_silent(made: Links, says: bool) -> None:
    robot, _ = made.robot()
    relay, told, log = Relay(robot.port), [], []    # type: Any, List[str], List[str]
    operator = OperatorTransport([('127.0.0.1', relay.port)], made.key, name='/desk', report=told.append,
                                 log=log.append)
    made.made.append(operator)
    wait_for(lambda: log and robot.stats(0.0).peers)
    told.clear()                        # a busy machine may be late to join
    if not says:
        relay.loss = 1.0
    robot.close()
    wait_for(lambda: (operator.problem() or '').startswith('no answer'))
    if says:
        wait_for(lambda: log[-1].endswith('has left: closed'))
        operator.report_problem(time.monotonic())                          # it begins to last
        operator.report_problem(time.monotonic() + 2 * PROBLEM_AFTER)
        assert not told
    else:
        wait_for(lambda: told)
        assert told[0].startswith('no answer')
    relay.close()


@pytest.mark.parametrize('host', ['no-such-host.invalid', 'x' * 64 + '.invalid', ''])
def test_a_host_that_does_not_resolve_is_a_problem(made: Links, host: str) -> None:
    told: List[str] = []
    operator = OperatorTransport([(host, 17001)], KEY, name='/desk', report=told.append, log=lambda _: None)
    made.made.append(operator)
    wait_for(lambda: 'does not resolve' in (operator.problem() or ''))
    assert repr(host) in operator.problem()     # type: ignore[operator]
    wait_for(lambda: told)
    assert told == [operator.problem()]


def test_a_numeric_address_is_not_looked_up() -> None:
    resolver, threads = Resolver('10.0.0.7'), threading.active_count()
    resolver.poll(True, 1e9)
    assert resolver.address == '10.0.0.7' and threading.active_count() <= threads     # those of other tests may end


def joined(receiver: DatagramReceiver, port: int) -> Peer:
    """The robot at a port, as a peer of another core than a transport's."""
    core, sender = OperatorCore(KEY, os.urandom, 1472, '/liar'), BatchSender(receiver.socket)
    core.set_places([place_at(('127.0.0.1', port))], time.monotonic())
    while core.robot is None:
        core.poll(time.monotonic())
        for place, packet in core.outputs():
            sender.send_one(packet, to=address_of(place))
        receiver.wait(0.02)
        count = receiver.receive()
        core.receive(receiver.datagrams[:count], receiver.lengths[:count], receiver.sources[:count], time.monotonic())
    return core.robot


def test_random_bytes_on_tables_change_nothing(made: Links) -> None:
    """A peer that has the key, and nothing else that is right."""
    robot, _ = made.robot()
    publisher = robot.publisher('/chat', String)
    operator, _ = made.operator(robot.port)
    inbox = Inbox()
    operator.subscriber('/chat', String, inbox.message)
    wait_for(publisher.get_num_connections)
    receiver = DatagramReceiver('127.0.0.1', 1472)
    try:
        peer, sender, junk = joined(receiver, robot.port), BatchSender(receiver.socket), random.Random(3)
        for number in [*range(4, 16), publisher.topic.id, 99] * 20:
            rows = np.frombuffer(bytes(junk.getrandbits(8) for _ in range(4 * 40)), np.uint8).reshape(4, 40).copy()
            rows[:, :4] = np.frombuffer(number.to_bytes(4, 'little'), np.uint8)
            rows[0, 4:8] = (0, 1, 1, 0)     # whole, as a header goes
            sender.send(peer.seal(rows), 40 + OVERHEAD, 4, to=('127.0.0.1', robot.port))
    finally:
        receiver.close()
    wait_for(lambda: robot.dropped()['unknown topic'])
    publisher.publish(String('hello'))
    inbox.wait(lambda: inbox.messages)


def test_frames_go_by_two_paths_at_once_and_each_message_is_counted_once(made: Links) -> None:
    robot, _ = made.robot()
    relays = [Relay(robot.port), Relay(robot.port)]
    operator = OperatorTransport([('127.0.0.1', relay.port) for relay in relays], made.key, name='/desk',
                                 report=lambda _: None, log=lambda _: None)
    made.made.append(operator)
    publisher, inbox = robot.publisher(TOPIC, CompressedImage), Inbox()
    subscriber = operator.subscriber(TOPIC, CompressedImage, batch_callback=inbox.batch, arrived=inbox.arrived)
    wait_for(publisher.get_num_connections)
    wait_for(lambda: has_second(robot))
    name = robot.stats(0.0).peers[0].name
    keys = [use.key for use in robot.paths(time.monotonic())[name]]
    assert len(set(keys)) == 2          # of one host here
    for second in ((), (name,), (), (name,)):
        publisher.publish_frames(frame(CompressedImage, 10, 1000), second=second)
    inbox.wait(lambda: len(inbox.records) == 40)
    counts = [sum(count for _, _, _, count, _, _, path in inbox.arrivals if path == which) for which in (0, 1)]
    assert counts == [20, 20] and len(set(inbox.records)) == len(inbox.records)
    stats, = subscriber.connections()
    assert (stats['received'], stats['lost']) == (40, 0)
    assert [path.use for path in robot.stats(time.monotonic()).peers[0].others] == [BESIDE]
    shared, = operator.stats(time.monotonic()).peers[0].others
    assert shared.use == BESIDE
    other, = (relay for relay in relays if relay.port == shared.address[1])
    other.loss = 1.0                    # what goes there is lost, the rest is not
    for second in ((), (name,)):
        publisher.publish_frames(frame(CompressedImage, 10, 1000), second=second)
    publisher.publish_frames(frame(CompressedImage, 10, 1000))
    inbox.wait(lambda: len(inbox.records) == 60)
    assert subscriber.connections()[0]['lost'] == 10
    for relay in relays:
        relay.close()
