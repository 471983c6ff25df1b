# SPDX-License-Identifier: BSD-3-Clause
"""The operator's calls in flight: sessions, timeouts, bounds."""
from typing import List, Optional

import pytest

from smokebot_udp.reliable.call_client import GREETING_PERIOD, CallClient
from smokebot_udp.reliable.calls import (
    ANSWERED,
    FAILED,
    MAX_CALLS,
    MAX_SIZE,
    WELCOME,
    Answer,
    Outcome,
    Request,
    unpack_request,
)

CLIENT, ROBOT, RESTARTED, CHECKSUM, TIMEOUT = 11, 21, 22, 31, 10.0
AHEAD = 1000.0      # the robot's clock


class Desk:
    """A client and how its calls ended."""

    def __init__(self) -> None:
        self.client = CallClient(CLIENT, CHECKSUM, TIMEOUT)
        self.outcomes: List[Outcome] = []

    def call(self, now: float, data: bytes = b'') -> None:
        self.client.call(data, now, self.outcomes.append)

    def sent(self, now: float) -> List[Request]:
        """What leaves at this time."""
        found = []
        while True:
            data = self.client.poll(now)
            if data is None:
                return found
            request = unpack_request(data)
            assert request is not None
            found.append(request)

    def answer(self, number: int = 0, kind: int = WELCOME, data: bytes = b'', server: int = ROBOT,
               client: int = CLIENT, now: float = 0.0, clock: float = AHEAD) -> None:
        self.client.receive(Answer(client, server, number, clock, kind, data).pack(), now)

    def last_failure(self) -> Optional[str]:
        return self.outcomes[-1].failure


def connected() -> Desk:
    desk = Desk()
    desk.answer()
    return desk


def test_a_call_and_its_answer() -> None:
    desk = connected()
    desk.call(0.0, b'request')
    assert desk.client.deadline() == -float('inf')
    assert desk.sent(0.0) == [Request(CLIENT, ROBOT, 1, CHECKSUM, AHEAD + TIMEOUT, b'request')]
    desk.answer(1, ANSWERED, b'response')
    assert desk.outcomes == [Outcome(b'response')]
    assert desk.sent(100.0) == [] and desk.client.deadline() is None


def test_a_failure_on_the_robot() -> None:
    desk = connected()
    desk.call(0.0)
    desk.sent(0.0)
    desk.answer(1, FAILED, b'it does not exist')
    assert desk.outcomes == [Outcome(failure='it does not exist')]


def test_answers_in_another_order() -> None:
    desk = connected()
    desk.call(0.0)
    desk.call(0.0)
    assert [request.number for request in desk.sent(0.0)] == [1, 2]
    desk.answer(2, ANSWERED, b'second')
    desk.answer(1, ANSWERED, b'first')
    desk.answer(1, ANSWERED, b'repeated')
    assert [outcome.data for outcome in desk.outcomes] == [b'second', b'first']
    assert desk.client.dropped == {'late': 1}


def test_an_unknown_robot_is_asked_for_its_session_first() -> None:
    desk = Desk()
    desk.call(5.0, b'request')
    assert desk.sent(5.0) == [Request(CLIENT, 0, 2, CHECKSUM, 0.0, b'')]
    assert desk.client.deadline() == 5.0 + GREETING_PERIOD
    assert len(desk.sent(5.0 + GREETING_PERIOD)) == 1
    desk.answer()
    assert [request.data for request in desk.sent(5.3)] == [b'request']


def test_it_may_be_asked_before_the_first_call() -> None:
    desk = Desk()
    assert desk.client.deadline() is None
    desk.client.greet(0.0)
    assert [request.server for request in desk.sent(0.0)] == [0]
    assert desk.client.deadline() is None       # no call waits for it


def test_until_when_it_may_be_executed_by_the_robots_clock() -> None:
    desk = Desk()
    desk.answer(clock=99.9, now=0.1)    # it took 0.1 s
    desk.call(0.2)
    assert desk.sent(0.2)[0].until == pytest.approx(99.8 + 0.2 + TIMEOUT)
    desk.answer(1, ANSWERED, clock=100.29, now=0.3)     # 10 ms: a better bound
    desk.call(0.3)
    assert desk.sent(0.3)[0].until == pytest.approx(99.99 + 0.3 + TIMEOUT)
    desk.answer(2, ANSWERED, clock=100.3, now=3.0)      # it was delayed, and says less
    desk.call(3.0)
    assert desk.sent(3.0)[0].until == pytest.approx(99.99 + 3.0 + TIMEOUT)
    desk.answer(3, server=RESTARTED, clock=5.0, now=5.0)    # another clock
    desk.call(5.0)
    assert desk.sent(5.0)[0].until == pytest.approx(5.0 + TIMEOUT)


def test_a_timeout_says_whether_the_service_may_have_been_called() -> None:
    desk = Desk()
    desk.call(0.0)
    desk.sent(TIMEOUT)
    assert desk.last_failure() == 'no robot answered within 10 s: the service was not called'
    desk.answer()
    desk.call(20.0)
    desk.sent(20.0)
    desk.sent(20.0 + TIMEOUT)
    assert desk.last_failure() == 'no answer within 10 s: whether the service was called is unknown'
    desk.answer(2, ANSWERED)
    assert len(desk.outcomes) == 2 and desk.client.dropped == {'late': 1}


def test_a_restart_of_the_robot_fails_what_was_sent_and_sends_it_never_again() -> None:
    desk = connected()
    desk.call(0.0, b'sent')
    desk.sent(0.0)
    desk.call(0.1, b'not sent yet')
    desk.answer(1, server=RESTARTED)
    assert len(desk.outcomes) == 1 and 'restarted' in str(desk.last_failure())
    assert [(request.server, request.data) for request in desk.sent(0.2)] == [(RESTARTED, b'not sent yet')]


def test_a_session_of_the_channel_that_ended_fails_what_was_sent() -> None:
    desk = connected()
    desk.call(0.0, b'sent')
    desk.sent(0.0)
    assert desk.sent(5.0) == [] and desk.client.deadline() == TIMEOUT      # the channel repeats it
    desk.call(5.0, b'not sent yet')
    desk.client.lost('it was away')
    assert desk.outcomes == [Outcome(failure='it was away: whether the service was called is unknown')]
    assert [request.server for request in desk.sent(5.0)] == [0]
    desk.answer(now=5.1)    # the same node again
    assert [request.data for request in desk.sent(5.1)] == [b'not sent yet']


def test_a_held_up_answer_of_a_node_in_between_is_no_restart() -> None:
    """A robot's node was started twice; the client knows the second one when the first one's answer comes."""
    desk = connected()
    desk.client.greet(0.0)
    asked, = desk.sent(0.0)
    desk.answer(asked.number, server=RESTARTED)
    desk.call(1.0, b'for the present one')
    desk.sent(1.0)
    desk.answer(asked.number, server=RESTARTED + 1)
    assert not desk.outcomes and desk.client.dropped == {'late': 1}


def test_late_answers_of_a_former_session_are_discarded() -> None:
    desk = connected()
    desk.client.greet(0.0)
    asked, = desk.sent(0.0)
    desk.answer(asked.number, server=RESTARTED)
    desk.call(0.0)
    call, = desk.sent(0.0)
    desk.answer()
    desk.answer(call.number, ANSWERED, b'of another call')
    desk.answer(call.number, ANSWERED, b'for another client', RESTARTED, client=12)
    desk.client.receive(b'?', 0.0)
    assert not desk.outcomes and desk.client.dropped == {'another session': 3, 'malformed': 1}
    desk.answer(call.number, ANSWERED, b'right', RESTARTED)
    assert desk.outcomes == [Outcome(b'right')]


def test_a_robot_that_does_not_take_calls() -> None:
    desk = connected()
    desk.call(0.0)
    desk.sent(0.0)
    desk.call(0.1)
    desk.client.refuse('it has no such stream')
    assert desk.outcomes == [Outcome(failure='it has no such stream: it was not called')]


def test_bounds() -> None:
    desk = Desk()
    desk.call(0.0, bytes(MAX_SIZE + 1))
    assert 'bytes' in str(desk.last_failure())
    for _ in range(MAX_CALLS):
        desk.call(0.0)
    assert len(desk.outcomes) == 1
    desk.call(0.0)
    assert desk.last_failure() == '32 calls of it wait for an answer already'
    for _ in range(6):
        desk.client.fail('over')
        desk.call(0.0, bytes(MAX_SIZE))
    for _ in range(4):
        desk.call(0.0, bytes(MAX_SIZE))
    assert '4 calls' in str(desk.last_failure())


def test_all_calls_fail_at_the_end() -> None:
    desk = connected()
    desk.call(0.0)
    desk.call(0.0)
    desk.client.fail('it ends')
    assert desk.outcomes == 2 * [Outcome(failure='it ends')]
