# SPDX-License-Identifier: BSD-3-Clause
import time
from typing import List, Tuple

from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.teleop.stall import MIN_SUSPENSION, Suspension

delays = st.floats(0, 5)


def test_a_suspension_is_noticed_once() -> None:
    tested = Suspension()
    assert not tested.notice(10.0, 15.0, 10.001)
    assert not tested.notice(11.0, 16.0, 11.001)
    assert tested.notice(12.0, 17.1, 12.001)
    assert not tested.notice(13.0, 18.1, 13.001)
    assert tested.notice(13.0, 3618.1, 13.001)


@given(st.lists(st.tuples(delays, delays, delays), max_size=30))
def test_threads_that_wait_between_the_clocks_are_no_suspension(reads: List[Tuple[float, float, float]]) -> None:
    tested, now = Suspension(), 100.0
    for wait, first, second in reads:
        now += wait
        assert not tested.notice(now, now + first + 7.0, now + first + second)
        now += first + second


@given(st.lists(st.tuples(delays, delays), max_size=30), st.floats(MIN_SUSPENSION + 0.001, 1e6))
def test_it_is_noticed_by_the_first_look_that_does_not_wait(reads: List[Tuple[float, float]], length: float) -> None:
    tested, now = Suspension(), 100.0
    tested.notice(now, now, now)
    for first, second in reads:
        now += first + second
        tested.notice(now - first - second, now - second, now)
    assert tested.notice(now, now + length, now)


def test_the_clocks_of_this_machine() -> None:
    tested = Suspension()
    assert not any(tested.notice(time.monotonic(), time.clock_gettime(time.CLOCK_BOOTTIME), time.monotonic())
                   for _ in range(1000))
