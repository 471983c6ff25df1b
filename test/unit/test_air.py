# SPDX-License-Identifier: BSD-3-Clause
"""Beliefs about packet loss: what reports say, jumps, bursts, silence, several operators."""
import gc
from typing import Optional

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.streams.air import FORGOTTEN, LOSSES, TIMEOUT, UNKNOWN, UNKNOWN_LOSS, Air, LossBeliefs, merged
from smokebot_udp.streams.outlook import StreamLosses

INTERVAL = 0.1


class Link:
    """Reports on a link that loses datagrams one by one, or in bursts (Gilbert)."""

    def __init__(self, seed: int = 1, per_report: int = 30) -> None:
        self.beliefs, self.now = LossBeliefs(), 100.0
        self._random, self._count, self._bad = np.random.RandomState(seed), per_report, False

    def run(self, seconds: float, loss: float, burst: Optional[float] = None) -> Air:
        for _ in range(round(seconds / INTERVAL)):
            self.now += INTERVAL
            self.beliefs.add(self._count, sum(not self._lost(loss, burst) for _ in range(self._count)), self.now)
        return self.beliefs.air(self.now)

    def _lost(self, loss: float, burst: Optional[float]) -> bool:
        if burst is None:
            return bool(self._random.random_sample() < loss)
        change = 1 / burst if self._bad else loss / burst / (1 - loss)
        self._bad ^= bool(self._random.random_sample() < change)
        return self._bad


def between(air: Air, low: float, high: float) -> float:
    """The probability of a loss between these."""
    return sum(probability for loss, probability in air.losses.items() if low <= loss <= high)


def test_nothing_is_known_without_reports() -> None:
    air = LossBeliefs().air(3.0)
    assert air == UNKNOWN and not air.known and air.burst is None
    assert between(air, 0, UNKNOWN_LOSS) == pytest.approx(0.88)
    assert between(air, 0, 0.33) == pytest.approx(0.44, abs=0.05)
    assert between(air, 0.85, 1) == pytest.approx(0.08)


@pytest.mark.parametrize('loss, low, high', [(0.0, 0, 0.01), (0.05, 0.03, 0.075), (0.2, 0.15, 0.26), (0.5, 0.4, 0.6),
                                             (0.8, 0.7, 0.9)])
def test_reports_tell_the_loss(loss, low, high) -> None:
    air = Link().run(5, loss)
    assert air.known and air.burst is None
    assert between(air, low, high) > 0.75
    assert sum(air.losses.values()) == pytest.approx(1.0) and list(air.losses) == LOSSES.tolist()


def test_heavier_losses_are_always_mixed_in() -> None:
    quiet, lossy = Link().run(10, 0.0), Link().run(10, 0.05)
    assert 0.01 < between(quiet, 0.1, 1) < 0.05
    assert 0.1 < between(lossy, 0.15, 1) < 0.25
    assert between(lossy, 0.4, 1) > 0.008


@pytest.mark.parametrize('seed', range(5))
def test_a_jump_is_seen_within_half_a_second(seed) -> None:
    link = Link(seed, per_report=14)
    assert between(link.run(20, 0.05), 0.24, 0.4) < 0.15     # mixed in
    assert between(link.run(0.5, 0.3), 0.15, 0.45) > 0.8
    assert link.run(0.5, 0.05).loss < 0.2


def test_a_loss_that_came_and_went_is_expected_again() -> None:
    calm, restless = Link(), Link()
    calm.run(10, 0.02)
    for _ in range(5):
        restless.run(1, 0.4)
        restless.run(1, 0.02)
    assert between(restless.run(0.3, 0.02), 0.3, 0.5) > 1.1 * between(calm.run(0.3, 0.02), 0.3, 0.5)


def test_bursts_are_told_from_single_losses() -> None:
    for seed in range(5):
        assert Link(seed).run(10, 0.2).burst is None
        burst = Link(seed).run(10, 0.2, 8.0).burst
        assert burst is not None and 2.5 < burst < 16


def test_an_idle_stream_stays_known_and_silence_ends_that() -> None:
    link = Link()
    before = link.run(5, 0.05)
    for _ in range(50):
        link.now += INTERVAL
        link.beliefs.add(0, 0, link.now)
    idle = link.beliefs.air(link.now)
    assert idle.known and between(before, 0.03, 0.08) > between(idle, 0.03, 0.08) > 0.3
    assert link.beliefs.air(link.now + TIMEOUT - 0.01).known
    silent = link.beliefs.air(link.now + TIMEOUT + 0.01)
    assert not silent.known
    for low, high in ((0.0, 0.15), (0.15, 0.7), (0.7, 1.0)):    # half of what was known, half of what may be
        assert between(silent, low, high) == pytest.approx(
            (between(idle, low, high) + between(UNKNOWN, low, high)) / 2, abs=0.03)
    assert link.beliefs.air(link.now + FORGOTTEN + 0.01) == UNKNOWN
    link.now += 10
    assert between(link.run(0.5, 0.5), 0.35, 0.6) > 0.6


@given(st.lists(st.tuples(st.integers(0, 1 << 40), st.integers(0, 1 << 40), st.floats(-2, 2)), max_size=20))
@settings(max_examples=50, deadline=None)
def test_any_counts_at_any_time_leave_probabilities(reports) -> None:
    beliefs, now = LossBeliefs(), 0.0
    for expected, received, passed in reports:
        now += passed
        beliefs.add(expected, received, now)
        air = beliefs.air(now)
        assert sum(air.losses.values()) == pytest.approx(1.0) and min(air.losses.values()) >= 0
        assert air.burst is None or 1 <= air.burst < 1000


def test_several_operators() -> None:
    near, far, bursty = Link(1).run(5, 0.01), Link(2).run(5, 0.4), Link(3).run(5, 0.2, 8.0)
    assert merged([]) == merged([UNKNOWN]) == UNKNOWN and not merged([UNKNOWN, UNKNOWN]).known
    assert merged([near]) == near and merged([UNKNOWN, near]) == near
    both = merged([far, near])
    assert both.losses == pytest.approx(merged([near, far]).losses)
    assert near.loss < both.loss < far.loss
    assert between(both, 0, 0.05) > 0.5 and between(both, 0.3, 0.5) > 0.25
    assert merged([near, far, bursty]).burst == bursty.burst


def test_operators_of_streams_that_nobody_asks_for_are_not_kept() -> None:
    """Each operator reports on relays, too; of a camera those who left are forgotten with the next question."""
    losses = StreamLosses()
    losses.air('camera', [], 0.0)
    for number in range(50):
        for stream in ('tf', 'status', 'camera'):
            losses.add('operator %d' % number, stream, 100, 80, 1.0 + number)
        assert losses.air('camera', ['operator %d' % number], 1.0 + number).known
    gc.collect()
    assert sum(isinstance(kept, LossBeliefs) for kept in gc.get_objects()) == 1
