# SPDX-License-Identifier: BSD-3-Clause
"""The operator's calls in flight: sessions, timeouts, bounds."""
from typing import List, Optional, Tuple

import pytest

from smokebot_udp.reliable.call_client import CallClient
from smokebot_udp.reliable.calls import GREETING, MAX_CALLS, MAX_SIZE, Answer, Outcome, Request, unpack_request

FIRST, ROBOT, OTHER, CHECKSUM, TIMEOUT = 1, '/robot', '/other', 31, 10.0
AHEAD = 1000.0      # the robot's clock
HELLO = (ROBOT, Request(GREETING, CHECKSUM, 0.0, b''))


class Desk:
    """A client and how its calls ended."""

    def __init__(self) -> None:
        self.client = CallClient(FIRST, CHECKSUM, TIMEOUT)
        self.outcomes: List[Outcome] = []

    def call(self, now: float, data: bytes = b'') -> None:
        self.client.call(data, now, self.outcomes.append)

    def sent(self, now: float) -> List[Tuple[str, Request]]:
        """What leaves at this time: (robot, request)."""
        found = []
        while True:
            message = self.client.poll(now)
            if message is None:
                return found
            request = unpack_request(message.data)
            assert request is not None
            found.append((message.robot, request))

    def answer(self, number: int = GREETING, data: bytes = b'', failure: Optional[str] = None, robot: str = ROBOT,
               now: float = 0.0, clock: float = AHEAD) -> None:
        self.client.receive(robot, Answer(number, clock, Outcome(data, failure)).pack(), now)

    def join(self, now: float = 0.0, robot: str = ROBOT, clock: float = AHEAD) -> None:
        """A session begins, and the robot answers the greeting."""
        self.client.joined(robot)
        self.client.poll(now)
        self.answer(robot=robot, now=now, clock=clock)

    def last_failure(self) -> Optional[str]:
        return self.outcomes[-1].failure


def connected() -> Desk:
    desk = Desk()
    desk.join()
    return desk


def test_a_call_and_its_answer() -> None:
    desk = connected()
    desk.call(0.0, b'request')
    assert desk.client.deadline() == -float('inf')
    assert desk.sent(0.0) == [(ROBOT, Request(FIRST, CHECKSUM, AHEAD + TIMEOUT, b'request'))]
    desk.answer(1, b'response')
    assert desk.outcomes == [Outcome(b'response')]
    assert desk.sent(100.0) == [] and desk.client.deadline() == float('inf')


def test_a_failure_on_the_robot() -> None:
    desk = connected()
    desk.call(0.0)
    desk.sent(0.0)
    desk.answer(1, failure='it does not exist')
    assert desk.outcomes == [Outcome(failure='it does not exist')]


def test_answers_in_another_order() -> None:
    desk = connected()
    desk.call(0.0)
    desk.call(0.0)
    assert [request.number for _, request in desk.sent(0.0)] == [1, 2]
    desk.answer(2, b'second')
    desk.answer(1, b'first')
    desk.answer(1, b'repeated')
    assert [outcome.data for outcome in desk.outcomes] == [b'second', b'first']
    assert desk.client.dropped == {'late': 1}


def test_a_robot_is_greeted_first() -> None:
    desk = Desk()
    desk.call(5.0, b'request')
    assert desk.sent(5.0) == [] and desk.client.deadline() == 5.0 + TIMEOUT
    desk.client.joined(ROBOT)
    assert desk.client.deadline() == -float('inf')
    assert desk.sent(5.1) == [HELLO] and desk.client.deadline() == 5.0 + TIMEOUT     # the channel repeats it
    desk.answer(now=5.2)
    assert [request.data for _, request in desk.sent(5.3)] == [b'request']


def test_a_greeting_that_was_not_answered_is_sent_again_for_the_next_call() -> None:
    desk = Desk()
    desk.client.joined(ROBOT)
    assert desk.sent(0.0) == [HELLO] and desk.sent(100.0) == []
    desk.call(100.0)
    assert desk.sent(100.0) == [HELLO]


def test_until_when_it_may_be_executed_by_the_robots_clock() -> None:
    desk = Desk()
    desk.join(0.1, clock=99.9)      # it took 0.1 s
    desk.call(0.2)
    assert desk.sent(0.2)[0][1].until == pytest.approx(99.8 + 0.2 + TIMEOUT)
    desk.answer(1, clock=100.29, now=0.3)       # 10 ms: a better bound
    desk.call(0.3)
    assert desk.sent(0.3)[0][1].until == pytest.approx(99.99 + 0.3 + TIMEOUT)
    desk.answer(2, clock=100.3, now=3.0)        # it was delayed, and says less
    desk.call(3.0)
    assert desk.sent(3.0)[0][1].until == pytest.approx(99.99 + 3.0 + TIMEOUT)
    desk.client.left(ROBOT, 'it restarted')     # with another clock
    desk.join(5.0, clock=5.0)
    desk.call(5.0)
    assert desk.sent(5.0)[0][1].until == pytest.approx(5.0 + TIMEOUT)


def test_a_timeout_says_whether_the_service_may_have_been_called() -> None:
    desk = Desk()
    desk.call(0.0)
    desk.sent(TIMEOUT)
    assert desk.last_failure() == 'no robot answered within 10 s: the service was not called'
    desk.join()
    desk.call(20.0)
    desk.sent(20.0)
    desk.sent(20.0 + TIMEOUT)
    assert desk.last_failure() == 'no answer within 10 s: whether the service was called is unknown'
    desk.answer(2)
    assert len(desk.outcomes) == 2 and desk.client.dropped == {'late': 1}


def test_the_end_of_a_session_fails_what_was_sent_and_sends_it_never_again() -> None:
    desk = connected()
    desk.call(0.0, b'sent')
    desk.sent(0.0)
    assert desk.sent(5.0) == [] and desk.client.deadline() == TIMEOUT      # the channel repeats it
    desk.client.left(ROBOT, 'it restarted')
    assert desk.outcomes == [Outcome(failure='it restarted: whether the service was called is unknown')]
    desk.call(5.0, b'not sent yet')
    desk.client.joined(ROBOT)
    assert desk.sent(5.0) == [HELLO]
    desk.answer(now=5.1)
    assert [request.data for _, request in desk.sent(5.1)] == [b'not sent yet']
    desk.answer(1, b'of the former session')
    assert len(desk.outcomes) == 1 and desk.client.dropped == {'late': 1}


def test_each_call_goes_to_one_of_several_nodes_of_the_robot() -> None:
    desk = connected()
    desk.call(0.0, b'for the first')
    desk.sent(0.0)
    desk.join(robot=OTHER)
    desk.call(1.0, b'for the other')
    assert [(robot, request.data) for robot, request in desk.sent(1.0)] == [(OTHER, b'for the other')]
    desk.answer(2, b'not its call', robot=ROBOT)
    desk.client.receive(ROBOT, b'?', 0.0)
    assert not desk.outcomes and desk.client.dropped == {'late': 1, 'malformed': 1}
    desk.client.left(ROBOT, 'it was away')
    assert len(desk.outcomes) == 1 and 'away' in str(desk.last_failure())
    desk.answer(2, b'right', robot=OTHER)
    assert desk.outcomes[1:] == [Outcome(b'right')]


def test_a_robot_that_does_not_take_calls() -> None:
    desk = Desk()
    desk.client.joined(ROBOT)
    desk.call(0.1)
    assert desk.sent(0.1) == [HELLO]
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
