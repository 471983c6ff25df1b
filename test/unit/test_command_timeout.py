# SPDX-License-Identifier: BSD-3-Clause
from typing import List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.teleop.steady import STEP
from smokebot_udp.teleop.timeout import CommandTimeout, State

NOW = 100.0


def timeout(hold: float = 2.0) -> CommandTimeout:
    return CommandTimeout(0.5, 20.0, hold)


def driving(age: float = 0.1) -> CommandTimeout:
    made = timeout()
    made.accepted(NOW, age)
    return made


def published_until(tested: CommandTimeout, end: float) -> List[float]:
    """When on_timeout is published, polled at the deadlines."""
    times = []
    while True:
        due = tested.deadline()
        if due is None or due > end:
            return times
        if tested.poll(due):
            times.append(due)


def test_before_the_first_command_nothing_is_published() -> None:
    tested = timeout()
    assert tested.deadline() is None and not tested.poll(NOW) and tested.state is State.IDLE


def test_a_silence_is_followed_by_on_timeout_for_the_hold_and_then_by_nothing() -> None:
    tested = driving()
    assert tested.state is State.DRIVING and tested.deadline() == pytest.approx(NOW + 0.4)
    assert not tested.poll(NOW + 0.399)
    times = published_until(tested, NOW + 100)
    assert times == pytest.approx([NOW + 0.4 + 0.05 * i for i in range(41)], abs=1e-6)
    assert tested.state is State.IDLE and tested.timeouts == 1


@pytest.mark.parametrize('age, ends', [(0.0, 0.5), (0.1, 0.4), (0.25, 0.25), (0.3, 0.25), (2.0, 0.25), (-0.1, 0.5)])
def test_the_timeout_runs_from_when_the_command_was_made_for_half_of_it_at_least(age: float, ends: float) -> None:
    assert driving(age).deadline() == pytest.approx(NOW + ends)


def test_each_command_begins_it_anew() -> None:
    tested = timeout()
    for i in range(20):
        tested.accepted(NOW + 0.3 * i, 0.1)
        assert not tested.poll(NOW + 0.3 * i + 0.29)
    assert tested.timeouts == 0 and tested.deadline() == pytest.approx(NOW + 5.7 + 0.4)


def test_a_new_command_ends_the_stop_at_once() -> None:
    tested = driving()
    assert tested.poll(NOW + 0.5) and tested.state is State.STOPPING
    tested.accepted(NOW + 0.51, 0.0)
    assert tested.state is State.DRIVING and not tested.poll(NOW + 0.6)


def test_a_hold_of_nothing_publishes_once() -> None:
    tested = timeout(hold=0.0)
    tested.accepted(NOW, 0.0)
    assert len(published_until(tested, NOW + 10)) == 1


def test_a_driver_that_is_gone_stops_the_robot_at_once() -> None:
    tested = driving()
    tested.interrupt(NOW + 0.01)
    assert tested.deadline() == NOW + 0.01 and tested.poll(NOW + 0.01)
    assert tested.state is State.STOPPING and tested.timeouts == 0
    tested.interrupt(NOW + 1.0)     # does not prolong it
    assert published_until(tested, NOW + 10)[-1] == pytest.approx(NOW + 2.01, abs=0.051)


def test_nothing_is_interrupted_where_nobody_drives() -> None:
    tested = timeout()
    tested.interrupt(NOW)
    assert tested.state is State.IDLE and not tested.poll(NOW)


@pytest.mark.parametrize('before', ['idle', 'driving', 'stopping'])
def test_the_emergency_stop_publishes_until_it_is_released(before: str) -> None:
    tested = timeout() if before == 'idle' else driving()
    if before == 'stopping':
        tested.poll(NOW + 0.5)
    tested.set_estop(True, NOW + 0.6)
    tested.set_estop(True, NOW + 0.61)      # repeated: delays nothing
    assert tested.deadline() == NOW + 0.6 and tested.state is State.ESTOP
    assert len(published_until(tested, NOW + 60.6)) == pytest.approx(1201, abs=1)
    tested.accepted(NOW + 60.6, 0.0)
    assert tested.state is State.ESTOP
    tested.set_estop(False, NOW + 60.7)
    assert tested.state is State.IDLE and tested.deadline() is None and not tested.poll(NOW + 60.8)
    tested.set_estop(False, NOW + 60.9)
    assert tested.state is State.IDLE


def test_a_release_does_not_end_what_is_no_emergency_stop() -> None:
    tested = driving()
    tested.set_estop(False, NOW + 0.1)
    assert tested.state is State.DRIVING


def test_changed_parameters_have_effect_at_once() -> None:
    tested = driving(0.0)
    tested.timeout = 0.2
    assert tested.deadline() == pytest.approx(NOW + 0.2) and tested.poll(NOW + 0.2)
    tested.rate, tested.hold = 10.0, 0.25
    assert published_until(tested, NOW + 10) == pytest.approx([NOW + 0.3, NOW + 0.4], abs=1e-6)


def test_a_higher_rate_does_not_wait_for_what_a_lower_one_would_publish_next() -> None:
    tested = timeout()
    tested.rate = 0.01
    tested.set_estop(True, NOW)
    assert tested.poll(NOW) and tested.deadline() == pytest.approx(NOW + 100)
    tested.rate = 20.0
    assert tested.deadline() == pytest.approx(NOW + 0.05) and tested.poll(NOW + 0.051)


def test_a_clock_that_goes_back_stops_the_robot_at_once() -> None:
    tested = driving()
    assert not tested.poll(NOW + 0.1 - STEP)
    assert not tested.poll(NOW + 0.1) and not tested.poll(NOW + 0.1 - 0.9 * STEP)
    assert tested.poll(NOW - 50) and tested.state is State.STOPPING and tested.timeouts == 1
    times = published_until(tested, NOW)
    assert times == pytest.approx([NOW - 50 + 0.05 * i for i in range(1, 41)], abs=1e-6)


def test_a_clock_that_goes_back_does_not_interrupt_the_emergency_stop() -> None:
    tested = timeout()
    tested.set_estop(True, NOW)
    assert tested.poll(NOW) and tested.poll(NOW - 50) and tested.state is State.ESTOP


def test_a_clock_that_jumps_ahead_stops_the_robot() -> None:
    tested = driving()
    assert tested.poll(NOW + 1000) and tested.state is State.STOPPING


events = st.tuples(st.sampled_from(['accepted', 'interrupt', 'engage', 'release', 'poll', 'poll', 'poll']),
                   st.floats(0, 0.3), st.floats(-0.1, 0.5))


@given(st.lists(events, max_size=100))
def test_it_never_drives_on_for_longer_than_the_timeout(events: List[Tuple[str, float, float]]) -> None:
    """And on_timeout is published only after a command, for the hold, or with the emergency stop."""
    tested, now, last, engaged = timeout(), NOW, None, False
    acts = {'interrupt': tested.interrupt, 'engage': lambda at: tested.set_estop(True, at),
            'release': lambda at: tested.set_estop(False, at)}
    for what, wait, age in events:
        now += wait
        if what == 'accepted':
            tested.accepted(now, age)
            last = last if engaged else now
        elif what == 'poll':
            published = tested.poll(now)
            assert tested.state is not State.DRIVING or last is not None and now < last + 0.5
            assert not published or engaged or last is not None
        else:
            acts[what](now)
            engaged = what == 'engage' or (engaged and what != 'release')
        assert (tested.state is State.ESTOP) == engaged
