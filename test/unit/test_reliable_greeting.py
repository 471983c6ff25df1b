# SPDX-License-Identifier: BSD-3-Clause
"""How two nodes agree on sessions, and who cannot end one."""
from typing import Any, Dict

import pytest
from reliable_sides import DOWN, UP, Link

from smokebot_udp.reliable.greeting import LONG_INTERVAL
from smokebot_udp.reliable.segment import Kind, Segment


@pytest.fixture
def link() -> Link:
    """Two nodes that have agreed, and exchanged a message."""
    made = Link(7)
    made.run(1.0)
    made.send(UP, b'before')
    made.run(1.0)
    assert made.robot.got[UP] == [b'before']
    return made


def session_of(link: Link, name: str) -> Segment:
    """The last segment that a node sent."""
    return [segment for to, segment in link.seen if to != name][-1]


def still_runs(link: Link) -> None:
    """The session goes on as if nothing had happened."""
    told = list(link.robot.told), list(link.desk.told)
    link.send(UP, b'after')
    link.send(DOWN, b'down')
    link.run(1.0)
    assert link.robot.got[UP] == [b'before', b'after'] and link.desk.got[DOWN] == [b'down']
    assert (link.robot.told, link.desk.told) == told == (['joined'] * 2, ['joined'] * 2)


@pytest.mark.parametrize('loss', [0.0, 0.5, 0.8])
def test_two_nodes_agree(loss: float) -> None:
    link = Link(8, loss=loss)
    link.run(30.0)
    assert link.robot.peers.agreed == ('desk',) and link.desk.peers.agreed == ('robot',)
    if not loss:
        assert link.sent <= 6


@pytest.mark.parametrize('forged', [
    {'session': 77}, {'session': 77, 'number': 5}, {'session': 77, 'number': 5, 'echo': 5}, {'session': 0},
    {'session': 77, 'peer': 'known'}, {'session': 77, 'peer': 'known', 'echo': 2 ** 32 - 1}])
def test_a_forged_greeting_does_not_end_a_session(link: Link, forged: Dict[str, Any]) -> None:
    robot = session_of(link, 'robot').session
    for _ in range(200):
        fields = {**forged, 'peer': robot if forged.get('peer') else 0}
        link.deliver('robot', Segment(Kind.GREETING, **fields))
    sent = link.sent
    link.run(20.0)
    assert link.sent - sent < 60
    still_runs(link)


def test_greetings_of_a_former_life_are_not_taken_again(link: Link) -> None:
    old = [(to, segment) for to, segment in link.seen if segment.kind == Kind.GREETING]
    link.restart('desk')
    link.run(1.0)
    link.send(UP, b'new')
    link.run(1.0)
    assert link.robot.got[UP] == [b'before', b'new']
    assert link.robot.told == ['joined'] * 2 + ['left: restart'] * 2 + ['joined'] * 2
    for to, segment in old * 3:
        link.deliver(to, segment)
        link.run(0.5)
    link.send(UP, b'newer')
    link.run(1.0)
    assert link.robot.got[UP] == [b'before', b'new', b'newer'] and len(link.robot.told) == 6


@pytest.mark.parametrize('loss', [0.0, 0.6])
def test_a_restart_is_noticed_by_who_waits_for_an_answer(link: Link, loss: float) -> None:
    link.loss = loss
    link.restart('robot')
    link.run(10.0)
    assert link.desk.told == ['joined'] * 2 + ['left: restart'] * 2 + ['joined'] * 2


@pytest.mark.parametrize('silence', [1.0, 5.0, 60.0])
def test_a_restart_is_noticed_where_its_answer_was_lost(link: Link, silence: float) -> None:
    """The new robot knows the operator and is content; all that it answers is lost for a while."""
    link.restart('robot')
    link.run(0.09)
    link.loss = 1.0
    link.run(silence)
    link.loss = 0.0
    link.run(2.5)
    assert link.desk.told == ['joined'] * 2 + ['left: restart'] * 2 + ['joined'] * 2
    link.send(UP, b'after')
    link.run(1.0)
    assert link.robot.got[UP] == [b'after']


def test_who_greets_without_answering_is_asked_rarely_and_not_for_ever(link: Link) -> None:
    link.deliver('robot', Segment(Kind.GREETING, session=77, number=5))     # of a robot that is no more
    link.run(20.0)
    asked = link.sent
    link.run(600.0)
    assert link.sent == asked
    still_runs(link)
    link.loss = 1.0
    link.deliver('robot', Segment(Kind.GREETING, session=78, number=5))
    link.run(20.0)
    asked = link.sent
    link.run(600.0)
    assert link.sent - asked <= 600 / LONG_INTERVAL + 1


def test_messages_wait_while_there_is_no_session() -> None:
    link = Link(9, loss=1.0)
    link.run(1.0)
    assert link.send(UP, b'early') == 1
    link.run(3.0)
    link.loss = 0.0
    link.run(2.0)
    assert link.robot.got[UP] == [b'early']


def test_a_peer_that_comes_back_after_it_was_forgotten_agrees_anew(link: Link) -> None:
    link.send(UP, b'arrives')
    link.run(1.0)
    link.loss = 1.0
    link.send(UP, b'is given up')
    for _ in range(8):
        link.run(10.0)
        link.connect('robot', False)
    assert link.robot.told[2:] == ['left: left'] * 2
    link.loss = 0.0
    link.connect('robot', True)
    link.run(3.0)
    link.send(UP, b'again')
    link.run(1.0)
    assert link.robot.got[UP] == [b'before', b'arrives', b'again']
    assert link.desk.given_up == [(UP, 1, 'age')]


@pytest.mark.parametrize('forged, reason', [
    ({'kind': Kind.DATA, 'channel': UP, 'number': 3, 'first': 3, 'parts': 1, 'session': 5}, 'session'),
    ({'kind': Kind.DATA, 'channel': 99, 'number': 3, 'first': 3, 'parts': 1}, 'unknown channel'),
    ({'kind': Kind.ACKNOWLEDGEMENT, 'channel': DOWN, 'next': 9}, 'acknowledgement of what was never sent'),
    ({'kind': Kind.ACKNOWLEDGEMENT, 'channel': DOWN, 'next': 1, 'received': bytes(33)}, 'malformed'),
    ({'kind': Kind.ACKNOWLEDGEMENT, 'channel': UP, 'next': 1}, 'answer on an unknown channel'),
    ({'kind': Kind.UNKNOWN, 'channel': 99}, 'answer on an unknown channel'),
    ({'kind': 200, 'channel': UP}, 'kind'), ({'kind': Kind.GREETING, 'session': 0}, 'no session')])
def test_what_no_node_sends_is_counted(link: Link, forged: Dict[str, Any], reason: str) -> None:
    robot, desk = session_of(link, 'robot').session, session_of(link, 'desk').session
    for _ in range(3):
        link.deliver('robot', Segment(**{'session': desk, 'peer': robot, **forged}))
    assert link.robot.peers.counts() == {reason: 3}
    still_runs(link)


def test_segments_of_nobody_are_counted() -> None:
    link = Link(10)
    link.robot.peers.take('stranger', Segment(Kind.GREETING, session=5), link.now)
    assert link.robot.peers.counts() == {'unknown peer': 1}


def test_peers_are_bounded() -> None:
    link = Link(11)
    link.robot.peers.connect(['desk %d' % number for number in range(50)], link.now)
    assert link.send(DOWN, b'to all') == 16
    assert link.robot.peers.counts()['too many peers'] > 0


def test_a_side_without_the_channel_says_so() -> None:
    link = Link(12)
    link.robot.peers.remove(UP)
    link.run(1.0)
    link.send(UP, b'nobody takes it')
    link.run(20.0)
    assert link.robot.peers.counts()['unknown channel'] > 3 and link.robot.got[UP] == []
    assert link.desk.given_up == [(UP, 1, 'age')]
    assert link.sent < 60
