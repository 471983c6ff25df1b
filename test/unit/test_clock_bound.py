# SPDX-License-Identifier: BSD-3-Clause
"""A lower bound of another node's clock."""
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.reliable.call_client import CLOCK_WINDOW, ClockBound


def test_the_fastest_message_counts() -> None:
    bound = ClockBound()
    assert bound.at(5.0) == -float('inf')
    bound.add(99.9, 0.0)
    bound.add(100.95, 1.0)
    bound.add(101.0, 2.0)
    assert bound.at(3.0) == 99.95 + 3.0


def test_what_is_old_is_forgotten_once_there_is_something_newer() -> None:
    bound = ClockBound()
    bound.add(100.0, 0.0)
    assert bound.at(10 * CLOCK_WINDOW) == 100.0 + 10 * CLOCK_WINDOW
    bound.add(90.0 + 1.1 * CLOCK_WINDOW, 1.1 * CLOCK_WINDOW)
    assert bound.at(0.0) == 100.0
    bound.add(90.0 + 2.2 * CLOCK_WINDOW, 2.2 * CLOCK_WINDOW)
    assert abs(bound.at(0.0) - 90.0) < 1e-9


@given(st.lists(st.tuples(st.floats(0.0, 1000.0), st.floats(0.0, 5.0)), min_size=1))
def test_it_is_never_above_the_clock(messages) -> None:
    bound = ClockBound()
    for now, delay in sorted(messages):
        bound.add(1e6 + now - delay, now)
        assert bound.at(now) <= 1e6 + now + 1e-6
