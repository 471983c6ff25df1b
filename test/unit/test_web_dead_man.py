# SPDX-License-Identifier: BSD-3-Clause
"""Driving from browsers, by a clock of its own."""
import math
from typing import Any, List, Tuple

from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.teleop.keyboard import PERIOD, STOP, STOP_DURATION, Velocity
from smokebot_udp.web.dead_man import HOLD, IDLE, LEAST_PERIOD, DeadMan, Rest, Ticks, scale_of

FORWARD = Velocity(0.5, 0.0, 0.0, 0.0)


def run(dead_man: DeadMan, start: float, end: float) -> List[Tuple[float, Velocity]]:
    """What is sent in a time, and when."""
    found, now = [], start
    while now < end:
        motion = dead_man.poll(now)
        if motion is not None:
            found.append((round(now - start, 3), motion))
        now = round(now + 0.01, 3)
    return found


def test_nothing_is_sent_before_the_first_command() -> None:
    dead_man = DeadMan()
    assert run(dead_man, 0.0, 2.0) == [] and dead_man.deadline() == math.inf


def test_a_command_ends_without_another_one_and_then_nothing_is_sent() -> None:
    dead_man = DeadMan()
    assert dead_man.drive('tablet', FORWARD, 10.0)
    came = run(dead_man, 10.0, 12.0)
    assert came[0] == (0.0, FORWARD)
    assert [motion for when, motion in came if when < HOLD] == [FORWARD] * 3
    stopped = [when for when, motion in came if motion == STOP]
    assert stopped[0] == HOLD and stopped[-1] < HOLD + STOP_DURATION
    assert len(came) == 3 + len(stopped) and dead_man.deadline() == math.inf


def test_a_released_touch_stops_at_once() -> None:
    dead_man = DeadMan()
    dead_man.drive('tablet', FORWARD, 10.0)
    assert dead_man.poll(10.0) == FORWARD
    dead_man.halt('tablet', 10.05)
    assert dead_man.poll(10.05) == STOP


def test_a_command_right_after_a_released_touch_does_not_hide_the_stop() -> None:
    dead_man = DeadMan()
    dead_man.drive('tablet', FORWARD, 10.0)
    assert dead_man.poll(10.0) == FORWARD
    dead_man.halt('tablet', 10.05)
    assert dead_man.drive('tablet', FORWARD, 10.051) and dead_man.deadline() <= 10.051
    assert [motion for _, motion in run(dead_man, 10.06, 10.2)] == [STOP, FORWARD]


def test_a_lost_browser_stops_at_once_and_one_that_did_not_drive_sends_nothing() -> None:
    dead_man = DeadMan()
    dead_man.drive('tablet', FORWARD, 10.0)
    dead_man.gone('phone', 10.01)
    assert dead_man.poll(10.01) == FORWARD
    dead_man.gone('tablet', 10.05)
    assert dead_man.poll(10.05) == STOP and dead_man.holder(10.05) is None
    run(dead_man, 10.06, 12.0)
    dead_man.halt('tablet', 12.0)
    dead_man.gone('phone', 12.0)
    assert run(dead_man, 12.0, 13.0) == []


def test_a_halt_is_a_neutral_command_also_where_the_stick_was_at_rest() -> None:
    dead_man = DeadMan()
    dead_man.drive('tablet', STOP, 10.0)
    run(dead_man, 10.0, 11.5)
    dead_man.halt('tablet', 11.5)
    assert run(dead_man, 11.5, 12.5)[0] == (0.0, STOP)


def test_one_browser_drives_at_a_time_until_it_is_idle_or_another_one_takes_control() -> None:
    dead_man = DeadMan()
    dead_man.drive('tablet', FORWARD, 10.0)
    dead_man.poll(10.0)
    assert not dead_man.drive('phone', FORWARD, 10.1) and dead_man.holder(10.1) == 'tablet'
    dead_man.take('phone', 10.12)
    assert dead_man.poll(10.12) == STOP
    assert not dead_man.drive('tablet', FORWARD, 10.2) and dead_man.drive('phone', FORWARD, 10.2)
    assert dead_man.drive('tablet', FORWARD, 10.2 + IDLE)
    dead_man.take('phone', 14.0)
    dead_man.halt('tablet', 14.01)      # who drives no longer stops nobody
    assert dead_man.drive('phone', FORWARD, 14.02)
    assert [motion for _, motion in run(dead_man, 14.03, 14.15)] == [STOP, FORWARD]


def test_commands_leave_at_a_limited_rate() -> None:
    dead_man, sent = DeadMan(), []
    for step in range(100):
        now = 10.0 + 0.005 * step
        dead_man.drive('tablet', FORWARD, now)
        sent += [now] if dead_man.poll(now) is not None else []
    assert len(sent) <= 0.5 / LEAST_PERIOD + 1 and PERIOD > LEAST_PERIOD


@given(st.lists(st.tuples(st.sampled_from(['drive', 'halt', 'gone', 'take', 'poll']), st.sampled_from('ab'),
                          st.floats(0.0, 0.5)), max_size=60))
def test_whatever_browsers_do_the_robot_stops_in_time(steps) -> None:
    dead_man, now, driven = DeadMan(), 0.0, -math.inf
    for what, browser, pause in steps:
        now += pause
        motion: Any = None
        if what == 'drive':
            driven = now if dead_man.drive(browser, FORWARD, now) else driven
        elif what == 'poll':
            motion = dead_man.poll(now)
        else:
            getattr(dead_man, what)(browser, now)
        assert motion in (None, STOP) or now < driven + HOLD
    motions = [motion for _, motion in run(dead_man, now + HOLD, now + HOLD + 3.0)]
    assert set(motions) <= {STOP} and dead_man.deadline() == math.inf


def test_a_command_is_as_old_as_the_tick_that_it_answers() -> None:
    ticks = Ticks(4)
    assert ticks.age(0, 5.0) == math.inf
    for step in range(10):
        number = ticks.next(10.0 + 0.1 * step)
    assert round(ticks.age(number, 11.0), 6) == 0.1 and round(ticks.age(number - 3, 11.0), 6) == 0.4
    assert ticks.age(number - 4, 11.0) == math.inf and ticks.age(number + 1, 11.0) == math.inf


def test_ratios_are_speeds() -> None:
    assert scale_of(0.5, 2.0, 0.25)(1.0, -1.0, 0.5) == Velocity(0.5, -0.25, 0.0, 1.0)


def test_after_an_emergency_stop_each_browser_has_to_let_go_of_the_stick() -> None:
    rest = Rest()
    rest.rest('tablet', 0)
    assert rest.may_move('tablet', 0) and not rest.may_move('tablet', 1)
    rest.rest('tablet', 1)
    assert rest.may_move('tablet', 1) and not rest.may_move('phone', 1) and not rest.may_move('tablet', 2)
    rest.gone('tablet')
    assert not rest.may_move('tablet', 1)
