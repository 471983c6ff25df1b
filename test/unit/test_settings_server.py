# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, Dict, List

import pytest

from smokebot_udp.mission.remote import MAX_TEXT, PartState, Request
from smokebot_udp.mission.settings_server import (
    BURST,
    INTERVAL,
    LAST_REPEAT,
    MAX_REMEMBERED,
    REQUEST_PERIOD,
    SettingsServer,
)

PARTS: Dict[str, Dict[str, Any]] = {'': {'focus': 'default'}, 'thermal': {'rate': 10.0}, 'map': {'rate': 1.0}}


class Robot(SettingsServer):
    """A server that has sent all that is to be sent at once, and its clock."""

    def __init__(self) -> None:
        super().__init__(7, ['default', 'drive'])
        assert self.deadline() is None and self.poll(0.0) is None
        self.update(PARTS)
        self.now = 0.0
        self.first = self.drained()

    def drained(self) -> List[PartState]:
        """What is sent before the robot rests."""
        states = []
        while not states or self.deadline() == self.now + INTERVAL:
            state = self.poll(self.now + INTERVAL)
            if state is None:
                return states
            self.now += INTERVAL
            states.append(state)
            assert len(states) < 100
        return states


def sendings(server: SettingsServer, until: float) -> Dict[str, List[float]]:
    """{part: when it is sent} until a time."""
    sent: Dict[str, List[float]] = {}
    while True:
        now = server.deadline()
        assert now is not None
        if now > until:
            return sent
        state = server.poll(now)
        assert state is not None and server.poll(now) is None
        sent.setdefault(state.part, []).append(now)


def test_all_parts_are_sent_at_first_then_less_and_less_often() -> None:
    server = Robot()
    assert [state.part for state in server.first] == ['', 'thermal', 'map']
    assert server.first[0] == PartState(7, 1, '', {'focus': 'default'}, ('default', 'drive'))
    assert server.first[1] == PartState(7, 1, 'thermal', {'rate': 10.0})
    sent = sendings(server, 200.0)
    assert list(sent) == ['', 'thermal', 'map']
    for number, times in enumerate(sent.values()):
        first = INTERVAL * (number + 1)
        assert times == pytest.approx([first + after for after in (1, 3, 7, 15, 31, 63, 127, 191)])
        assert max(later - earlier for earlier, later in zip(times, times[1:])) == pytest.approx(LAST_REPEAT)


def test_what_changes_is_sent_at_once_and_nothing_else() -> None:
    server = Robot()
    server.update(PARTS)
    assert server.drained() == []
    server.update({**PARTS, 'map': {'rate': 2.0}})
    assert server.drained() == [PartState(7, 2, 'map', {'rate': 2.0})]
    later = sendings(server, server.now + 10.0)
    assert len(later['map']) == 3       # four in ten seconds


def test_a_new_operator_gets_all() -> None:
    server = Robot()
    sendings(server, 300.0)
    server.now = 300.0
    server.joined()
    assert len(server.drained()) == len(PARTS)
    assert {len(times) for times in sendings(server, 310.0).values()} == {3}


def test_a_request_is_carried_out_once_and_each_repetition_answered() -> None:
    server = Robot()
    request = Request(5, 'thermal', {'rate': 3.0})
    assert server.take(request, 10.0)
    server.update({**PARTS, 'thermal': {'rate': 3.0}})
    server.answer(request, '')
    first = server.drained()[0]
    assert (first.request, first.refusal, first.values, first.revision) == (5, '', {'rate': 3.0}, 2)
    assert not server.take(request, 11.0)
    assert [state.request for state in server.drained()] == [5]


def test_a_refused_request_is_answered_with_the_reason_and_the_values_that_stay() -> None:
    server = Robot()
    request = Request(5, 'thermal', {'rate': -3.0})
    assert server.take(request, 10.0)
    server.answer(request, 'rate is -3')
    answer, = server.drained()
    assert answer == PartState(7, 1, 'thermal', {'rate': 10.0}, (), 5, 'rate is -3')
    server.answer(request, 'x' * 10_000)
    assert len(server.drained()[0].refusal) == MAX_TEXT


def test_of_two_operators_requests_the_last_stands_and_both_are_answered() -> None:
    server = Robot()
    requests = [Request(number, '', {'focus': focus}) for number, focus in ((7, 'drive'), (8, 'default'))]
    for request in requests:
        assert server.take(request, 10.0)
        server.answer(request, '', 'to ' + request.values['focus'])
    for request in (*requests, requests[0]):    # repeated
        assert not server.take(request, 11.0)
    assert [(state.request, state.changes) for state in server.drained()] == [
        (7, 'to drive'), (8, 'to default')] * 2 + [(7, 'to drive')]


def test_impossible_requests_are_counted() -> None:
    server = Robot()
    assert not server.take(Request(0, 'thermal', {}), 0.0) and not server.take(Request(9, 'lidar', {}), 0.0)
    assert server.dropped == {'no id': 1, 'unknown part': 1}


def served(server: SettingsServer, count: int, first: int, now: float) -> int:
    """How many of some new requests are carried out."""
    good = 0
    for number in range(count):
        request = Request(first + number, 'map', {})
        if server.take(request, now):
            server.answer(request, '')
            good += 1
    return good


def test_a_flood_is_limited_in_rate_and_memory() -> None:
    server = Robot()
    assert served(server, 1000, 1, 10.0) == BURST
    assert server.dropped['too many'] == 1000 - BURST
    assert served(server, 1000, 2000, 11.0) == round(1 / REQUEST_PERIOD)
    for second in range(20):
        served(server, 100, 10_000 * (second + 1), 100.0 + second)
    assert len([state for state in server.drained() if state.request]) == MAX_REMEMBERED


def test_time_that_goes_back_costs_nothing() -> None:
    server = Robot()
    assert server.take(Request(1, 'map', {}), 10.0) and server.take(Request(2, 'map', {}), 5.0)


def test_a_state_keeps_the_values_of_its_time() -> None:
    server = Robot()
    state = server.first[0]
    server.update({**PARTS, '': {'focus': 'drive'}})
    assert state.values == {'focus': 'default'}
