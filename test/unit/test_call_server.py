# SPDX-License-Identifier: BSD-3-Clause
"""Calls on the robot: each executed at most once, within bounds."""
from typing import List, Optional

from smokebot_udp.reliable.call_server import (
    MAX_ANSWERS,
    MAX_FORMER,
    MAX_OPERATORS,
    MAX_RUNNING,
    WINDOW,
    CallServer,
    Execution,
)
from smokebot_udp.reliable.calls import (
    ANSWERED,
    FAILED,
    MAX_CALLS,
    MAX_SIZE,
    MAX_TIMEOUT,
    WELCOME,
    Answer,
    Outcome,
    Request,
    unpack_answer,
)

ROBOT, CHECKSUM, DESK, UNTIL, LATER = 21, 31, '/desk', 10.0, 5.0
REPEATED = 100.0


class Robot:
    """A server and what it executes."""

    def __init__(self) -> None:
        self.server = CallServer(ROBOT, CHECKSUM, 'std_srvs/Trigger')

    def receive(self, number: int, peer: str = DESK, client: int = 11, now: float = 0.0,
                **other: int) -> Optional[Answer]:
        """Take a request; the answer at once."""
        request = Request(client, ROBOT, number, CHECKSUM, UNTIL, b'%d' % number)._replace(**other)
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

    def serve(self, number: int, **options: int) -> bool:
        """Whether a request is executed."""
        self.receive(number, **options)
        taken = self.take_all()
        for execution in taken:
            self.finish(execution)
        return bool(taken)


def test_a_call() -> None:
    robot = Robot()
    assert robot.receive(1) is None
    taken = robot.take_all()
    assert [(execution.peer, execution.request.data, execution.until) for execution in taken] == [(DESK, b'1', 10.0)]
    assert robot.finish(taken[0]) == Answer(11, ROBOT, 1, LATER, ANSWERED, b'done')


def test_a_repeat_gets_the_answer_that_was_kept() -> None:
    robot = Robot()
    robot.receive(1)
    assert robot.receive(1) is None         # it waits
    taken = robot.take_all()
    assert robot.receive(1) is None         # it is executed
    answer = robot.finish(taken[0])
    assert robot.receive(1, now=REPEATED) == answer
    assert robot.take_all() == [] and robot.server.dropped == {'repeated': 3}


def test_a_long_answer_is_not_repeated_while_it_may_still_be_crossing() -> None:
    robot = Robot()
    robot.receive(1)
    answer = robot.finish(robot.take_all()[0], bytes(32000))     # takes two seconds
    assert robot.receive(1, now=LATER + 1.9) is None
    assert robot.receive(1, now=LATER + 2.1) == answer
    assert robot.receive(1, now=LATER + 4.0) is None
    assert robot.receive(1, now=LATER + 4.2) == answer


def test_a_failure_is_kept_as_well() -> None:
    robot = Robot()
    robot.receive(1)
    execution, = robot.take_all()
    answer = unpack_answer(robot.server.finish(execution, Outcome(failure='it raised'), LATER))
    assert answer == Answer(11, ROBOT, 1, LATER, FAILED, b'it raised') == robot.receive(1, now=REPEATED)


def test_another_session_of_the_robot_is_not_executed() -> None:
    robot = Robot()
    assert robot.receive(1, server=20) == Answer(11, ROBOT, 1, 0.0, WELCOME)
    assert robot.receive(7, server=0) == Answer(11, ROBOT, 7, 0.0, WELCOME)
    assert robot.take_all() == [] and robot.server.dropped == {'another session': 1}


def test_another_type_is_not_executed() -> None:
    robot = Robot()
    answer = robot.receive(1, checksum=32)
    assert answer is not None and answer.kind == FAILED and b'std_srvs/Trigger' in answer.data
    assert robot.take_all() == [] and robot.server.dropped == {'type': 1}


def test_several_operators_and_several_sessions_of_one() -> None:
    robot = Robot()
    robot.receive(1)
    robot.receive(1, peer='/other')
    robot.receive(1, client=12)
    taken = robot.take_all()
    assert len(taken) == 3
    assert {(execution.peer, execution.request.client) for execution in taken} == {
        (DESK, 11), ('/other', 11), (DESK, 12)}


def test_calls_that_hang_do_not_take_more_than_their_threads() -> None:
    robot = Robot()
    for number in range(1, MAX_CALLS + 1):
        assert robot.receive(number) is None
    hanging = robot.take_all()
    assert len(hanging) == robot.server.running == MAX_RUNNING
    refused = robot.receive(MAX_CALLS + 1)
    assert refused is not None and refused.kind == FAILED and b'32 calls' in refused.data
    robot.finish(hanging[0])
    assert [execution.request.number for execution in robot.take_all()] == [MAX_RUNNING + 1]


def test_a_call_that_nobody_waits_for_is_not_executed() -> None:
    robot = Robot()
    robot.receive(1)
    assert robot.take_all(UNTIL) == []
    assert robot.server.dropped == {'too late': 1}
    assert robot.receive(1, now=10.1) is not None and robot.take_all(10.1) == []


def test_a_call_that_hangs() -> None:
    robot = Robot()
    robot.receive(1)
    robot.receive(2, until=1e6)
    robot.take_all()
    assert [robot.server.overdue(now) for now in (0.0, UNTIL, MAX_TIMEOUT)] == [0, 1, 2]


def test_late_and_reordered_numbers() -> None:
    robot = Robot()
    assert robot.serve(WINDOW + 10)
    assert robot.serve(11) and not robot.serve(11)
    assert not robot.serve(10)      # it may have been executed: it is not remembered
    answer = robot.receive(10)
    assert answer is not None and answer.kind == FAILED


def test_a_slow_call_among_many_fast_ones() -> None:
    robot = Robot()
    robot.receive(1)
    slow, = robot.take_all()
    for number in range(2, 2 * WINDOW):
        assert robot.serve(number)
    assert robot.receive(1) is None
    assert robot.finish(slow) == Answer(11, ROBOT, 1, LATER, ANSWERED, b'done') == robot.receive(1, now=REPEATED)


def test_no_more_answers_are_kept_than_the_bound() -> None:
    robot = Robot()
    for number in range(1, MAX_ANSWERS + 2):
        assert robot.serve(number)
    first, second = robot.receive(1, now=REPEATED), robot.receive(2, now=REPEATED)
    assert first is not None and first.kind == FAILED
    assert second is not None and second.kind == ANSWERED
    for number in (1000, 1001):
        robot.receive(number)
        robot.finish(robot.take_all()[0], bytes(MAX_SIZE))
    older, newest = robot.receive(1000, now=REPEATED), robot.receive(1001, now=REPEATED)
    assert older is not None and older.kind == FAILED
    assert newest is not None and len(newest.data) == MAX_SIZE


def test_an_answer_that_is_too_long_is_a_failure() -> None:
    robot = Robot()
    robot.receive(1)
    answer = robot.finish(robot.take_all()[0], bytes(MAX_SIZE + 1))
    assert answer is not None and answer.kind == FAILED


def test_a_session_that_was_silent_repeats_nothing() -> None:
    robot = Robot()
    assert robot.serve(5)
    for client in range(100, 100 + MAX_OPERATORS):
        assert robot.serve(1, client=client)
    assert not robot.serve(5) and not robot.serve(4) and robot.serve(6)


def test_strangers_do_not_fill_the_memory() -> None:
    robot = Robot()
    for client in range(1, MAX_FORMER + 100):
        assert robot.serve(1, client=client)
    assert not robot.serve(1, client=200)


def test_one_operator_does_not_drive_out_the_calls_of_another() -> None:
    robot = Robot()
    robot.receive(1)
    running, = robot.take_all()
    for client in range(1, MAX_FORMER + 100):
        assert robot.serve(1, peer='/other', client=client)
    assert robot.receive(1) is None and robot.take_all() == []
    assert robot.finish(running) == robot.receive(1, now=REPEATED)


def test_what_is_no_request() -> None:
    robot = Robot()
    assert robot.server.receive(DESK, b'?', 0.0) is None
    assert robot.server.dropped == {'malformed': 1}
