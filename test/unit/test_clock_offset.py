# SPDX-License-Identifier: BSD-3-Clause
import math
import random
from typing import List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.monitoring.clock_offset import CONFIRMATIONS, DRIFT, MAX_EXCHANGES, SLACK, ClockOffset

EPOCH = 1.7e9
HOUR = 3600.0
Times = Tuple[float, float, float, float, float]


class Link:
    """Two machines: exchanges between them, at a time of a steady clock that began with 0."""

    def __init__(self, offset: float) -> None:
        self.here, self.there = EPOCH, EPOCH + offset   # what the clocks showed at 0

    def exchange(self, now: float, go: float = 0.01, back: float = 0.01, work: float = 0.001) -> Times:
        """(asked, received, answered, came, now of its end)"""
        return (self.here + now, self.there + now + go, self.there + now + go + work,
                self.here + now + go + work + back, now + go + work + back)


def test_equal_delays_give_the_exact_offset() -> None:
    for offset in (0.0, 0.25, -0.25, HOUR, -30 * 24 * HOUR):
        clock = ClockOffset()
        assert clock.add(*Link(offset).exchange(5.0))
        assert clock.best.offset == pytest.approx(offset, abs=1e-6)
        assert clock.best.round_trip == pytest.approx(0.02, abs=1e-6)


def test_nothing_is_known_before_the_first_exchange() -> None:
    clock = ClockOffset()
    assert clock.best is None and clock.estimate(0.0) is None


def test_the_exchange_of_least_round_trip_counts() -> None:
    link, clock = Link(2.0), ClockOffset()
    clock.add(*link.exchange(0.0, go=0.5))
    assert clock.best.offset == pytest.approx(2.0 + 0.245)    # queued on the way there: too far ahead by half of it
    clock.add(*link.exchange(1.0))
    clock.add(*link.exchange(2.0, back=0.8))
    assert clock.best.offset == pytest.approx(2.0, abs=1e-6) and clock.best.round_trip == pytest.approx(0.02, abs=1e-6)


@given(st.integers(0, 2 ** 32), st.floats(-1e5, 1e5), st.floats(0, 0.9))
def test_the_error_is_below_the_uncertainty_despite_loss_and_queues(seed: int, offset: float, loss: float) -> None:
    draw, link, clock = random.Random(seed), Link(offset), ClockOffset()
    for second in range(100):
        if draw.random() >= loss:
            # queues fill on the way back only, as video leaves the robot
            clock.add(*link.exchange(second, go=0.002 + draw.expovariate(500), back=0.002 + draw.expovariate(5)))
    now = 102.0
    if clock.best is not None:
        assert not clock.jumps and not clock.refused['contradiction']
        assert abs(clock.best.offset - offset) <= clock.best.uncertainty(now) + 1e-6
    if loss < 0.1:
        assert clock.estimate(now) and abs(clock.best.offset - offset) < 0.05


def test_clocks_that_drift_apart_are_followed() -> None:
    clock = ClockOffset()
    for second in range(600):
        clock.add(*Link(1.0 + 0.5 * DRIFT * second).exchange(second))
        assert abs(clock.best.offset - (1.0 + 0.5 * DRIFT * second)) <= clock.best.uncertainty(second) + 1e-6
    assert not clock.jumps and not clock.refused


def test_an_old_exchange_is_replaced_by_a_worse_one() -> None:
    link, clock = Link(0.0), ClockOffset(window=1000.0)
    clock.add(*link.exchange(0.0))
    clock.add(*link.exchange(1.0, go=0.011))
    assert clock.best.round_trip == pytest.approx(0.02, abs=1e-6)
    clock.add(*link.exchange(1.0 + 0.002 / DRIFT, go=0.012))
    assert clock.best.round_trip == pytest.approx(0.022, abs=1e-6)


@pytest.mark.parametrize('machine', ['here', 'there'])
@pytest.mark.parametrize('step', [HOUR, -HOUR, 0.2, -0.2])
def test_a_clock_jump_is_accepted_when_confirmed(machine: str, step: float) -> None:
    link, clock = Link(0.5), ClockOffset()
    for second in range(30):
        clock.add(*link.exchange(second))
    setattr(link, machine, getattr(link, machine) + step)
    for again in range(1, CONFIRMATIONS):
        assert not clock.add(*link.exchange(30 + again))
        assert clock.best.offset == pytest.approx(0.5, abs=1e-6)
    assert clock.add(*link.exchange(40.0))
    assert clock.best.offset == pytest.approx(0.5 + (step if machine == 'there' else -step), abs=1e-6)
    assert clock.jumps == 1 and clock.refused['contradiction'] == CONFIRMATIONS - 1


def test_inconsistent_forged_exchanges_are_never_used() -> None:
    link, clock, draw = Link(0.5), ClockOffset(), random.Random(1)
    for second in range(200):
        clock.add(*link.exchange(second))
        for _ in range(3):
            link_of_a_liar = Link(draw.uniform(-1e6, 1e6))
            assert not clock.add(*link_of_a_liar.exchange(second + 0.1))
    assert clock.best.offset == pytest.approx(0.5, abs=1e-6) and not clock.jumps
    assert clock.refused['contradiction'] == 600


def test_a_forged_exchange_after_a_jump_only_delays() -> None:
    link, clock = Link(0.0), ClockOffset()
    clock.add(*link.exchange(0.0))
    link.there += HOUR
    clock.add(*link.exchange(1.0))
    clock.add(*Link(-HOUR).exchange(1.5))
    for second in range(2, 2 + CONFIRMATIONS):
        clock.add(*link.exchange(second))
    assert clock.best.offset == pytest.approx(HOUR, abs=1e-6)


def test_small_differences_are_no_contradiction() -> None:
    clock = ClockOffset()
    clock.add(*Link(0.0).exchange(0.0, go=0.0, back=0.0))
    assert clock.add(*Link(0.9 * SLACK).exchange(1.0, go=0.0, back=0.0))


@pytest.mark.parametrize('place', range(5))
@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_times_that_are_not_finite_are_refused(place: int, value: float) -> None:
    clock, times = ClockOffset(), list(Link(0.0).exchange(0.0))
    times[place] = value
    assert not clock.add(*times)
    assert dict(clock.refused) == {'no time': 1} and clock.best is None


@pytest.mark.parametrize('reason, times', [
    ('no time', (EPOCH, 0.0, EPOCH, EPOCH + 1)),             # a field that was not set
    ('no time', (EPOCH, -EPOCH, EPOCH, EPOCH + 1)),
    ('no time', (EPOCH, 1e300, 1e300, EPOCH + 1)),
    ('order', (EPOCH, EPOCH, EPOCH, EPOCH - HOUR)),          # heard before it was asked
    ('order', (EPOCH, EPOCH, EPOCH - HOUR, EPOCH + 1)),      # answered before it came
    ('round trip', (EPOCH, EPOCH, EPOCH + 2, EPOCH + 1)),    # there for longer than away from here
    ('round trip', (EPOCH, EPOCH, EPOCH + HOUR, EPOCH + 1)),     # their clock jumped as it answered
    ('round trip', (EPOCH, EPOCH, EPOCH, EPOCH + HOUR)),     # ours jumped, or it took an hour
])
def test_impossible_exchanges_are_refused_and_counted(reason: str, times: Tuple[float, float, float, float]) -> None:
    clock = ClockOffset()
    assert not clock.add(*times, 1.0)
    assert dict(clock.refused) == {reason: 1} and clock.best is None and clock.estimate(1.0) is None


@given(st.lists(st.tuples(*[st.floats()] * 4 + [st.floats(0, 1e6)])))
def test_no_input_raises(exchanges: List[Times]) -> None:
    clock = ClockOffset()
    for exchange in exchanges:
        clock.add(*exchange)
    if clock.best is not None:
        assert math.isfinite(clock.best.offset) and clock.best.round_trip >= 0


def test_it_is_valid_for_the_window() -> None:
    clock = ClockOffset(window=10.0)
    clock.add(*Link(0.0).exchange(0.0, 0.0, 0.0, 0.0))
    assert clock.estimate(10.0) and clock.estimate(10.1) is None and clock.estimate(-0.1) is None
    assert clock.best.offset == 0.0      # the last that is known
    clock.add(*Link(0.0).exchange(20.0, 0.5, 0.5, 0.0))
    assert clock.best.round_trip == pytest.approx(1.0)   # the better one is too old


def test_memory_is_bounded() -> None:
    clock = ClockOffset()
    for i in range(2000):
        clock.add(*Link(0.0).exchange(i * 1e-3))
    assert clock.exchanges == MAX_EXCHANGES
