# SPDX-License-Identifier: BSD-3-Clause
from typing import List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.teleop.robot_clock import MAX_QUESTIONS, RobotClock, RobotTime

ROBOT = 9
MINUTES = 60.0


def measured(at: float = 10.0, ahead: float = 1000.0, session: int = ROBOT) -> RobotClock:
    """A clock after one exchange: 30 ms there, held for 5 ms, 10 ms back."""
    clock = RobotClock()
    exchange(clock, at, ahead, session)
    return clock


def exchange(clock: RobotClock, at: float, ahead: float, session: int = ROBOT) -> bool:
    echo = clock.ask(at)
    return clock.update(session, echo, 5000, round(1e6 * (at + ahead + 0.035)), at + 0.045)


def test_nothing_is_known_before_the_first_answer() -> None:
    clock = RobotClock()
    assert clock.ask(12.345678) == 12345678
    assert clock.session == 0 and clock.robot_time(12.4) is None


def test_the_question_comes_back_with_the_robots_time() -> None:
    clock = measured()
    assert clock.session == ROBOT and not clock.refused
    made = clock.robot_time(10.045)
    # half of the 40 ms on the way: the robot's clock shows 1010.045, and the estimate is ahead by (30 - 10) / 2 ms
    assert made is not None and made.robot == ROBOT
    assert made.made == pytest.approx(1010055000, abs=2) and made.uncertainty == pytest.approx(20000, abs=2)
    assert made.earliest == pytest.approx(1010.035, abs=1e-5)
    later = clock.robot_time(20.045)
    assert later is not None and later.made - made.made == pytest.approx(10000000, abs=2)
    assert later.uncertainty == pytest.approx(21000, abs=2)     # 1e-4 of drift


@pytest.mark.parametrize('session, echo, reason', [(0, 10000000, 'no session'), (ROBOT, 10000001, 'unasked'),
                                                   (ROBOT, 0, 'unasked'), (ROBOT, 2 ** 64 - 1, 'unasked')])
def test_answers_to_no_question_are_refused(session: int, echo: int, reason: str) -> None:
    clock = RobotClock()
    clock.ask(10.0)
    assert not clock.update(session, echo, 0, 5000000, 10.1)
    assert clock.refused == {reason: 1} and clock.session == 0 and clock.robot_time(10.1) is None


@pytest.mark.parametrize('held, clock_shown, reason', [
    (0, 0, 'no time'), (2 ** 32 - 1, 1000000, 'no time'),       # longer than the robot runs
    (0, 2 ** 64 - 1, 'no time'), (200000, 5000000, 'round trip')])
def test_impossible_answers_are_refused(held: int, clock_shown: int, reason: str) -> None:
    clock = RobotClock()
    assert not clock.update(ROBOT, clock.ask(10.0), held, clock_shown, 10.1)
    assert clock.refused == {reason: 1} and clock.robot_time(10.1) is None


def test_a_repeated_answer_counts_again_and_the_shortest_round_trip_is_used() -> None:
    clock = RobotClock()
    exchange(clock, 5.0, 1000.0, session=1)     # of another session: the shorter round trip is forgotten
    assert clock.update(ROBOT, clock.ask(9.0), 0, 1009050000, 9.3)
    echo = clock.ask(10.0)
    assert clock.update(ROBOT, echo, 0, 1010050000, 10.3)           # 300 ms: the way back was long
    assert clock.update(ROBOT, echo, 280000, 1010330000, 10.38)     # 100 ms: the robot says that it held it
    made = clock.robot_time(10.38)
    assert made is not None and made.uncertainty == pytest.approx(50000, abs=10)
    assert made.made == pytest.approx(1010380000, abs=10)


def test_a_restarted_robot_is_measured_anew() -> None:
    clock = measured()
    assert exchange(clock, 11.0, 5.0, session=10)
    made = clock.robot_time(11.045)
    assert clock.session == 10 and made is not None
    assert made == RobotTime(10, pytest.approx(16055000, abs=2), pytest.approx(20000, abs=2))


def test_a_late_answer_of_the_old_session_changes_nothing() -> None:
    clock = measured()
    late = clock.ask(10.9)
    assert exchange(clock, 11.0, 5.0, session=10)
    assert not clock.update(ROBOT, late, 0, 1010930000, 11.05)
    assert clock.session == 10 and clock.refused == {'unasked': 1}


def test_a_forged_session_does_not_shut_out_the_robot() -> None:
    clock = measured()
    assert exchange(clock, 11.0, 5.0, session=666)
    assert exchange(clock, 11.2, 1000.0)
    made = clock.robot_time(11.245)
    assert made is not None and made.robot == ROBOT and made.made == pytest.approx(1011255000, abs=2)


def test_the_time_is_unknown_after_a_minute_of_silence_and_before_the_last_answer() -> None:
    clock = measured()
    assert clock.robot_time(10.0 + MINUTES) is not None
    assert clock.robot_time(10.1 + MINUTES) is None
    assert clock.robot_time(9.0) is None        # this machine's clock went back


def test_an_answer_that_another_thread_takes_meanwhile_does_not_hide_the_time() -> None:
    clock = measured()      # the answer came at 10.045
    made = clock.robot_time(10.005)
    assert made is not None and made.made == pytest.approx(1010015000, abs=2)
    assert clock.robot_time(9.99) is None


@pytest.mark.parametrize('jump', [10.0, -10.0, 0.05])
def test_a_contradiction_hides_the_time_until_it_is_resolved(jump: float) -> None:
    clock = measured()
    assert not exchange(clock, 11.0, 1000.0 + jump) and clock.robot_time(11.1) is None
    assert exchange(clock, 12.0, 1000.0) and clock.robot_time(12.1) is not None
    for at in (13.0, 14.0):
        assert not exchange(clock, at, 1000.0 + jump) and clock.robot_time(at + 0.1) is None
    assert exchange(clock, 15.0, 1000.0 + jump)
    made = clock.robot_time(15.045)
    assert made is not None and made.made == pytest.approx(1015055000 + 1e6 * jump, abs=2)


def test_old_questions_are_forgotten() -> None:
    clock = RobotClock()
    first = clock.ask(1.0)
    for i in range(MAX_QUESTIONS - 1):
        clock.ask(2.0 + i)
    assert clock.update(ROBOT, first, 0, 5000000, 2.0)
    clock = RobotClock()
    first = clock.ask(1.0)
    for i in range(MAX_QUESTIONS):
        clock.ask(2.0 + i)
    assert not clock.update(ROBOT, first, 0, 5000000, 2.0)


numbers = st.integers(0, 2 ** 64 - 1)


@given(st.lists(st.tuples(st.integers(0, 2 ** 32 - 1), st.booleans(), numbers, st.integers(0, 2 ** 32 - 1), numbers,
                          st.floats(0, 1e6))))
def test_no_answer_raises_and_what_is_known_fits_the_wire(answers: List[Tuple[int, bool, int, int, int, float]],
                                                          ) -> None:
    clock, used = RobotClock(), 0
    for session, asked, echo, held, shown, now in answers:
        used += clock.update(session, clock.ask(now) if asked else echo, held, shown, now)
        made = clock.robot_time(now)
        if made is not None:
            assert made.robot == clock.session != 0
            assert 0 <= made.made < 2 ** 64 and 0 <= made.uncertainty < 2 ** 32
    assert used + sum(clock.refused.values()) == len(answers)
