# SPDX-License-Identifier: BSD-3-Clause
"""Calls on the robot, within bounds."""
from typing import List, Optional

from smokebot_udp.reliable.call_server import MAX_RUNNING, CallServer, Execution
from smokebot_udp.reliable.calls import (
    GREETING,
    MAX_CALLS,
    MAX_SIZE,
    MAX_TIMEOUT,
    Answer,
    Outcome,
    Request,
    unpack_answer,
)

CHECKSUM, DESK, UNTIL, LATER = 31, '/desk', 10.0, 5.0


class Robot:
    """A server and what it executes."""

    def __init__(self) -> None:
        self.server = CallServer(CHECKSUM, 'std_srvs/Trigger')

    def receive(self, number: int, peer: str = DESK, now: float = 0.0, **other: int) -> Optional[Answer]:
        """Take a request; the answer at once."""
        request = Request(number, CHECKSUM, UNTIL, b'%d' % number)._replace(**other)
        answer = self.server.receive(peer, request.pack(), now)
        return None if answer is None else unpack_answer(answer)

    def take_all(self, now: float = 0.0) -> List[Execution]:
        """All that is executed now."""
        found = []
        while True:
            execution = self.server.take(now)
            if execution is None:
                return found
            found.append(execution)

    def finish(self, execution: Execution, data: bytes = b'done') -> Optional[Answer]:
        return unpack_answer(self.server.finish(execution, Outcome(data), LATER))


def test_a_call() -> None:
    robot = Robot()
    assert robot.receive(1) is None
    taken = robot.take_all()
    assert [(execution.peer, execution.request.data, execution.until) for execution in taken] == [(DESK, b'1', 10.0)]
    assert robot.finish(taken[0]) == Answer(1, LATER, Outcome(b'done'))


def test_a_failure() -> None:
    robot = Robot()
    robot.receive(1)
    execution, = robot.take_all()
    answer = unpack_answer(robot.server.finish(execution, Outcome(failure='it raised'), LATER))
    assert answer == Answer(1, LATER, Outcome(failure='it raised'))


def test_a_greeting_is_answered_with_the_clock() -> None:
    robot = Robot()
    assert robot.receive(GREETING, now=7.0) == Answer(GREETING, 7.0, Outcome())
    assert robot.take_all() == []


def test_another_type_is_not_executed() -> None:
    robot = Robot()
    answer = robot.receive(1, checksum=32)
    assert answer is not None and 'std_srvs/Trigger' in str(answer.outcome.failure)
    assert robot.take_all() == [] and robot.server.dropped == {'type': 1}


def test_several_operators() -> None:
    robot = Robot()
    robot.receive(1)
    robot.receive(1, peer='/other')
    assert [execution.peer for execution in robot.take_all()] == [DESK, '/other']


def test_calls_that_hang_do_not_take_more_than_their_threads() -> None:
    robot = Robot()
    for number in range(1, MAX_CALLS + 1):
        assert robot.receive(number) is None
    hanging = robot.take_all()
    assert len(hanging) == robot.server.running == MAX_RUNNING
    refused = robot.receive(MAX_CALLS + 1)
    assert refused is not None and '32 calls' in str(refused.outcome.failure)
    robot.finish(hanging[0])
    assert [execution.request.number for execution in robot.take_all()] == [MAX_RUNNING + 1]


def test_a_call_that_nobody_waits_for_is_not_executed() -> None:
    robot = Robot()
    robot.receive(1)
    assert robot.take_all(UNTIL) == []
    assert robot.server.dropped == {'too late': 1}


def test_a_call_that_hangs() -> None:
    robot = Robot()
    robot.receive(1)
    robot.receive(2, until=1e6)
    robot.take_all()
    assert [robot.server.overdue(now) for now in (0.0, UNTIL, MAX_TIMEOUT)] == [0, 1, 2]


def test_an_answer_that_is_too_long_is_a_failure() -> None:
    robot = Robot()
    robot.receive(1)
    answer = robot.finish(robot.take_all()[0], bytes(MAX_SIZE + 1))
    assert answer is not None and 'bytes' in str(answer.outcome.failure)


def test_what_is_no_request() -> None:
    robot = Robot()
    assert robot.server.receive(DESK, b'?', 0.0) is None
    assert robot.server.dropped == {'malformed': 1}
