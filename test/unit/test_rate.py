# SPDX-License-Identifier: BSD-3-Clause
from typing import List

from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.streams.rate import RateLimiter


def passed(limiter: RateLimiter, times: List[float]) -> List[float]:
    """Those of the times at which a message may go at once."""
    gone = []
    for now in times:
        if limiter.wait(now) <= 0:
            limiter.take(now)
            gone.append(now)
    return gone


def test_a_source_at_the_rate_passes_whole_in_spite_of_its_jitter() -> None:
    times = [0.1 * k + (0.03 if k % 2 else 0.0) for k in range(100)]
    assert passed(RateLimiter(10.0), times) == times


def test_a_faster_source_is_held_to_the_rate() -> None:
    gone = passed(RateLimiter(10.0), [k / 1000 for k in range(10000)])
    assert 100 <= len(gone) <= 102


def test_a_clock_set_back_costs_a_period_at_most() -> None:
    limiter = RateLimiter(10.0)
    limiter.take(1000.0)
    limiter.take(1.0)
    assert limiter.wait(1.0) <= 0.1 + 1e-9


def test_another_rate_takes_effect_from_the_last_message_on() -> None:
    limiter = RateLimiter(0.001)
    for _ in range(2):      # one period of slack absorbs jitter
        limiter.take(5.0)
    limiter.rate = 0.001
    assert limiter.wait(5.0) == 1000.0
    limiter.rate = 10.0
    assert limiter.wait(5.0) <= 0.1 and limiter.wait(5.1) == 0
    limiter.rate = 0.001
    assert limiter.due == 1005.0


@given(st.floats(0.1, 100.0), st.lists(st.floats(0.0, 0.5), max_size=200))
def test_never_more_than_the_rate(rate: float, gaps: List[float]) -> None:
    now, times = 0.0, []
    for gap in gaps:
        now += gap
        times.append(now)
    assert len(passed(RateLimiter(rate), times)) <= rate * now + 2


@given(st.floats(0.1, 100.0), st.lists(st.tuples(st.floats(0.0, 0.5), st.floats(-1e-9, 1e-9)), max_size=200))
def test_never_more_than_the_rate_while_it_changes_in_the_last_digits(rate: float, steps: List) -> None:
    limiter, now, count = RateLimiter(rate), 0.0, 0
    for gap, change in steps:
        now += gap
        limiter.rate = rate * (1 + change)
        count += len(passed(limiter, [now]))
    assert count <= rate * now * (1 + 1e-6) + 2
