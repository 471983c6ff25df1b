# SPDX-License-Identifier: BSD-3-Clause
"""Reliable channels over a link that loses, repeats and reorders, with nodes that are restarted."""
import statistics
from typing import List

import pytest
from reliable_sides import DOWN, UP, Link

from smokebot_udp.reliable.bounds import Bounds
from smokebot_udp.reliable.pace import MIN_RATE


def numbered(count: int, size: int = 20) -> List[bytes]:
    return [b'%d ' % number * (size // 8) for number in range(count)]


@pytest.mark.parametrize('ordered', [True, False])
def test_ten_thousand_messages_at_half_the_datagrams_lost(ordered: bool) -> None:
    link = Link(3, loss=0.5, jitter=0.03, duplicates=0.1, channels={UP: {}, DOWN: {'ordered': ordered}})
    link.run(2.0)
    messages = numbered(10000)
    for start in range(0, len(messages), 5):
        for message in messages[start:start + 5]:
            link.send(DOWN, message)
        link.run(0.05)
    link.run(10.0)
    got = link.desk.got[DOWN]
    assert (got if ordered else sorted(got)) == (messages if ordered else sorted(messages))
    assert link.robot.given_up == []


def test_a_call_takes_little_more_than_the_round_trip_at_half_the_datagrams_lost() -> None:
    link = Link(4, loss=0.5, channels={UP: {'ordered': False, 'expedited': True},
                                       DOWN: {'ordered': False, 'expedited': True}})
    link.run(3.0)
    times = []
    for number in range(300):
        began = link.now
        link.send(UP, b'%d' % number)
        while len(link.robot.got[UP]) <= number:
            link.run(0.001)
        link.send(DOWN, b'%d' % number)
        while len(link.desk.got[DOWN]) <= number:
            link.run(0.001)
        times.append(link.now - began)
    times.sort()
    assert statistics.median(times) < 0.15, times


def test_fifty_short_messages_a_second_are_carried_at_the_lowest_pace_and_half_the_datagrams_lost() -> None:
    link = Link(1, loss=0.5, jitter=0.05)
    pace = link.desk.peers.pace
    pace.limit = 4 * MIN_RATE
    for _ in range(100):
        link.run(1.0)
        pace.observe(9.0, 0.1, 0.0, link.now)      # a queue
    assert pace.rate <= 1.2 * MIN_RATE
    messages = numbered(1000, 50)
    for message in messages:
        link.send(UP, message)
        link.run(0.02)
    link.run(5.0)
    assert link.robot.got[UP] == messages and link.desk.given_up == []


@pytest.mark.parametrize('rate', [20e3, 60e3])
def test_a_long_message_leaves_room_on_a_slow_link(rate: float) -> None:
    link = Link(13, rate=rate, channels={UP: {}, DOWN: {'bounds': Bounds(age=600.0)}})
    link.run(2.0)
    message = bytes(1 << 20)
    link.send(DOWN, message)
    link.run(5.0)
    del link.queue_delays[:]
    link.run(120.0)
    assert link.desk.got[DOWN] == [message]
    assert sorted(link.queue_delays)[len(link.queue_delays) * 95 // 100] < 0.25     # [s]


def test_what_has_come_is_delivered_though_what_was_before_it_is_given_up() -> None:
    link = Link(6, channels={UP: {'bounds': Bounds(age=5.0)}, DOWN: {}})
    link.run(1.0)
    link.loss = 1.0
    link.send(UP, b'lost')
    link.run(0.01)
    link.loss = 0.0
    link.send(UP, b'waits')
    link.run(0.12)      # it came, and was acknowledged
    link.loss = 1.0
    link.run(6.0)
    assert link.desk.given_up == [(UP, 1, 'age')] and link.robot.got[UP] == []
    link.loss = 0.0
    link.run(2.0)
    assert link.robot.got[UP] == [b'waits']


@pytest.mark.parametrize('loss', [0.0, 0.3])
def test_a_long_message_is_not_given_up_while_it_arrives(loss: float) -> None:
    """At an operator's rate a message of 1 MB takes 22 s."""
    link = Link(15, loss=loss, channels={UP: {}, DOWN: {}})
    link.desk.peers.pace.limit = 48e3
    message = bytes(1 << 20)
    link.send(UP, message)
    link.run(120.0)
    assert link.robot.got[UP] == [message] and not link.desk.given_up


def test_a_goal_of_some_segments_does_not_arrive_late() -> None:
    """Whatever the link does meanwhile: one segment comes each time that it is there for a moment."""
    link = Link(16, channels={UP: {}, DOWN: {}})
    link.desk.peers.pace.limit = 16e3
    link.run(1.0)
    begun = link.now
    link.send(UP, bytes(30000))
    while link.now < begun + 40.0:
        link.run(0.2)
        link.loss = 1.0
        link.run(7.0)
        link.loss = 0.0
        assert link.now < begun + 10.0 + 30000 / 16e3 + 7.5 or not link.robot.got[UP]
    assert link.desk.given_up == [(UP, 1, 'age')]


def test_a_long_message_is_given_up_when_nothing_of_it_arrives_any_more() -> None:
    link = Link(15, channels={UP: {}, DOWN: {}})
    link.desk.peers.pace.limit = 48e3
    link.send(UP, bytes(1 << 20))
    link.run(15.0)
    link.loss = 1.0
    link.run(9.0)
    assert not link.desk.given_up
    link.run(2.0)
    assert link.desk.given_up == [(UP, 1, 'age')]


def test_at_a_cut_it_gives_up_by_age_and_goes_on_after_it() -> None:
    link = Link(5, channels={UP: {'bounds': Bounds(age=5.0)}, DOWN: {}})
    link.run(1.0)
    link.loss = 1.0
    sent = link.sent
    for message in numbered(10):
        link.send(UP, message)
    link.run(20.0)
    assert link.desk.given_up == [(UP, 10, 'age')]
    assert link.sent - sent < 300
    link.loss = 0.0
    link.send(UP, b'new')
    link.run(1.0)
    assert link.robot.got[UP] == [b'new']


def test_what_is_latched_arrives_after_a_cut() -> None:
    link = Link(6, channels={UP: {}, DOWN: {'bounds': Bounds(age=5.0, keeps_last=True)}})
    link.run(1.0)
    link.loss = 1.0
    for message in (b'first', b'last'):
        link.send(DOWN, message)
        link.run(20.0)
    link.loss = 0.0
    link.run(2.0)
    assert link.desk.got[DOWN] == [b'last'] and link.robot.given_up == [(DOWN, 1, 'age')]


def test_nothing_is_sent_on_a_channel_that_has_ended() -> None:
    link = Link()
    link.run(1.0)
    link.desk.peers.remove(UP)
    assert link.send(UP, b'late') == 0
