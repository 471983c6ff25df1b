# SPDX-License-Identifier: BSD-3-Clause
"""Reliable channels over a real link: sockets, threads, and a robot with two operators."""
import functools
import threading
from typing import Any, Callable, Iterator, List, Tuple

import pytest
from link_pair import Links, links
from polling import WAIT, wait_for

from smokebot_udp.congestion.packet_scheduler import PacketScheduler
from smokebot_udp.msg import ReliableSegment
from smokebot_udp.nodes.channel import ChannelKind, ChannelListener
from smokebot_udp.nodes.outbox import Outbox
from smokebot_udp.nodes.reliable_link import ReliableLink, as_frame
from smokebot_udp.reliable.bounds import Bounds
from smokebot_udp.reliable.segment import Kind, Segment
from smokebot_udp.streams.relay.parameters import TO_OPERATOR, TO_ROBOT

TYPE = 'std_msgs/String', '992ce8a1687cec8c8bd883ec73ca41d1'
ROBOT = '/robot_sender@ugv1'


class Inbox:
    """What a channel delivers, and what else happens to it."""

    def __init__(self) -> None:
        self.messages: List[Tuple[str, bytes]] = []
        self.told: List[Tuple[Any, ...]] = []
        self._new = threading.Condition()

    @property
    def listener(self) -> ChannelListener:
        return ChannelListener(self._message, *(functools.partial(self._tell, what)
                                                for what in ('given up', 'joined', 'left', 'unknown')))

    def _message(self, peer: str, data: bytes) -> None:
        with self._new:
            self.messages.append((peer, data))
            self._new.notify_all()

    def _tell(self, *what: Any) -> None:
        with self._new:
            self.told.append(what)
            self._new.notify_all()

    def wait(self, condition: Callable[[], Any]) -> None:
        with self._new:
            assert self._new.wait_for(condition, WAIT), (self.messages, self.told)


class World:
    """Makes reliable links, and closes them before their transports."""

    def __init__(self, made: Links) -> None:
        self.links, self.reports = made, []     # type: ignore[var-annotated]
        self._closed: List[Any] = []
        self.robot_transport, _ = made.robot()
        self.outbox = Outbox(PacketScheduler(1e6))
        self.robot = self._reliable(self.robot_transport, 'robot', self.outbox)

    def operator(self, name: str = '/operator_receiver@desk1') -> ReliableLink:
        transport, _ = self.links.operator(self.robot_transport.port, name)
        return self._reliable(transport, 'operator')

    def _reliable(self, *arguments: Any) -> ReliableLink:
        made = ReliableLink(*arguments, report=self.reports.append)
        self._closed.append(made)
        return made

    def close(self) -> None:
        for one in self._closed:
            one.close()


@pytest.fixture
def world() -> Iterator[World]:
    with links() as made:
        one = World(made)
        yield one
        one.close()


def channel(link: ReliableLink, direction: str, inbox: Inbox, name: str = 'chat', **options: Any) -> Any:
    return link.channel(ChannelKind(name, direction, *TYPE, **options), inbox.listener)


def test_messages_reach_the_robot_and_each_operator(world: World) -> None:
    inboxes = [Inbox() for _ in range(4)]
    desks = [world.operator(), world.operator('/operator_receiver@desk2')]
    down = channel(world.robot, TO_OPERATOR, inboxes[0])
    channel(world.robot, TO_ROBOT, inboxes[1])
    ups = [channel(desk, TO_ROBOT, Inbox()) for desk in desks]
    for desk, inbox in zip(desks, inboxes[2:]):
        channel(desk, TO_OPERATOR, inbox)
    for link in (world.robot, *desks):
        link.start()
    inboxes[0].wait(lambda: len(inboxes[0].told) == 2)
    assert sorted(world.robot.peers()) == ['/operator_receiver@desk1', '/operator_receiver@desk2']
    long = bytes(range(256)) * 100
    assert down.send(long) == 2 and down.send(b'to one', '/operator_receiver@desk2') == 1
    assert down.send(b'to nobody', '/operator_receiver@desk3') == 0
    inboxes[3].wait(lambda: inboxes[3].messages == [(ROBOT, long), (ROBOT, b'to one')])
    inboxes[2].wait(lambda: inboxes[2].messages == [(ROBOT, long)])
    for up in ups:
        assert up.send(b'up') == 1
    inboxes[1].wait(lambda: sorted(inboxes[1].messages) == [
        ('/operator_receiver@desk1', b'up'), ('/operator_receiver@desk2', b'up')])
    wait_for(lambda: down.stats().delivered == 3)
    assert down.stats().waiting == 0 and down.stats().given_up == {}
    assert world.outbox.protected > 2 * len(long)
    # on a busy machine; a greeting that is faster than the notice that its sender is connected is repeated
    assert set(world.robot.stats()) <= {'repeated', 'session', 'unknown peer'}


def test_a_restarted_operator_joins_anew(world: World) -> None:
    inbox, desk = Inbox(), world.operator()
    down = channel(world.robot, TO_OPERATOR, inbox)
    channel(desk, TO_OPERATOR, Inbox())
    world.robot.start()
    desk.start()
    inbox.wait(lambda: inbox.told)
    desk.close()
    world.links.made[-1].close()
    again, got = world.operator(), Inbox()
    channel(again, TO_OPERATOR, got)
    again.start()
    inbox.wait(lambda: [what[0] for what in inbox.told][-1:] == ['joined'] and len(inbox.told) > 1)
    down.send(b'hello again')
    got.wait(lambda: [data for _, data in got.messages] == [b'hello again'])


def test_a_channel_that_the_other_side_does_not_have(world: World) -> None:
    inbox, desk = Inbox(), world.operator()
    up = channel(desk, TO_ROBOT, inbox, bounds=Bounds(age=4.0))
    world.robot.start()
    desk.start()
    inbox.wait(lambda: inbox.told)
    up.send(b'in vain')
    inbox.wait(lambda: inbox.told[-1] == ('given up', ROBOT, 1, 'age'))
    assert inbox.told.count(('unknown', ROBOT)) >= 3        # who ends may say so once, or twice
    assert len(world.reports) == 1 and "%s does not take 'chat'" % ROBOT in world.reports[0]
    assert world.robot.stats()['unknown channel'] >= 1


def test_a_failing_callback_stops_nobody(world: World) -> None:
    desk, got = world.operator(), Inbox()
    downs = [world.robot.channel(ChannelKind(name, TO_OPERATOR, *TYPE)) for name in ('bad', 'good')]

    def fail(peer: str, data: bytes) -> None:
        raise RuntimeError('a fault of the test')
    desk.channel(ChannelKind('bad', TO_OPERATOR, *TYPE), ChannelListener(received=fail))
    channel(desk, TO_OPERATOR, got, 'good')
    world.robot.start()
    desk.start()
    got.wait(lambda: got.told)
    wait_for(lambda: all(down.send(b'x') for down in downs))
    got.wait(lambda: got.messages)


def test_what_is_not_possible_is_refused(world: World) -> None:
    channel(world.robot, TO_OPERATOR, Inbox())
    with pytest.raises(ValueError, match='there is such a channel'):
        channel(world.robot, TO_OPERATOR, Inbox())
    with pytest.raises(ValueError, match='direction is'):
        channel(world.robot, 'sideways', Inbox())
    with pytest.raises(ValueError, match='only receives chat'):
        channel(world.robot, TO_ROBOT, Inbox()).send(b'')


def test_a_segment_is_an_ordinary_message() -> None:
    segment = Segment(Kind.DATA, 1, 2, 3, 4, 5, 6, 7, 8, b'\1\2', b'data', 9, 10, 11)
    message = ReliableSegment().deserialize(as_frame(segment).rows[0, 12:].tobytes())
    assert (message.header.seq, message.kind, message.channel, message.number, message.first, message.part,
            message.parts, message.next, message.echo, message.arrived, message.received, message.data,
            message.session, message.peer) == (9, 1, 1, 2, 3, 4, 5, 6, 7, 8, b'\1\2', b'data', 10, 11)
