# SPDX-License-Identifier: BSD-3-Clause
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.estimator import FULL, MBIT, SILENCE, Estimator, Limits, peak, target
from smokebot_udp.congestion.feedback import ArrivalMark, Evidence, Point, Report, Reports, StreamArrivals
from smokebot_udp.congestion.loss import Loss
from smokebot_udp.congestion.probing import GAINS, LASTS, PAUSE, Trains
from smokebot_udp.congestion.sent_history import Departures


def points(*ways, size=1000):
    """Points of (sent, arrived), one after the other."""
    return [Point(sent, arrived, size, size * (k + 1)) for k, (sent, arrived) in enumerate(ways)]


def test_the_peak_is_what_was_offered_where_it_came_as_it_left():
    assert peak(points((0, 5), (0.01, 5.01), (0.02, 5.02)), 0.0) == pytest.approx(100000)


def test_the_peak_is_what_was_carried_where_it_came_more_slowly():
    assert peak(points((0, 5), (0.01, 5.02), (0.02, 5.04)), 0.0) == pytest.approx(50000)


def test_what_comes_in_clumps_is_not_faster_than_it_left():
    assert peak(points((0, 5.03), (0.01, 5.0301), (0.02, 5.0302)), 0.0) == pytest.approx(100000)


def test_one_way_between_two_is_no_train():
    assert peak(points((0, 5), (0.01, 5.01)), 0.0) == 0.0


def test_the_slow_keeps_a_longer_queue_than_the_fast():
    assert target(20 * MBIT) == 0.005
    assert target(20 * MBIT / 16) == pytest.approx(0.01)
    assert target(0.1) == 0.04
    assert all(target(rate) < FULL for rate in (1e3, 1e5, 1e8))


def counts(expected, received):
    return Evidence([], math.nan, expected, received, 0, False)


def test_what_is_lost_when_little_is_sent_the_air_loses():
    loss = Loss()
    for _ in range(20):
        loss.note(counts(100, 80), True)
        assert loss.excess == 0
    assert loss.air == pytest.approx(0.2)
    for _ in range(20):
        loss.note(counts(100, 40), False)
    assert loss.excess == pytest.approx(0.5)        # of the 80 that the air lets through


def test_a_few_lost_by_chance_are_no_excess():
    loss = Loss()
    loss.note(counts(100, 100), True)
    loss.note(counts(20, 14), False)
    assert loss.excess == 0


def test_trains_grow_while_they_get_through_and_pause_when_not():
    trains, capacity = Trains(), 1e6
    newest = Point(0.0, 0.0, 1000, 50000)
    first = trains.next(capacity, True, True, newest, 2000, 1.0)
    assert first == (GAINS[0] * capacity, LASTS * capacity)
    assert trains.next(capacity, True, True, newest, 2000, 1.1) is None         # it has not come
    came = newest._replace(total=52000 + int(first.size))
    second = trains.next(2 * capacity, True, True, came, 0, 1.2)
    assert second == (GAINS[1] * 2 * capacity, LASTS * 2 * capacity)
    came = came._replace(total=came.total + int(second.size))
    assert trains.next(2 * capacity, True, True, came, 0, 1.3) is None          # it told nothing new
    assert trains.next(2 * capacity, True, True, came, 0, 1.2 + PAUSE) is None
    assert trains.next(2 * capacity, True, True, came, 0, 1.3 + PAUSE).rate == GAINS[0] * 2 * capacity


def test_no_train_leaves_for_nothing():
    newest = Point(0.0, 0.0, 1000, 50000)
    assert Trains().next(1e6, True, False, newest, 0, 1.0) is None


def test_reports_that_stay_away_lower_the_rate_step_by_step():
    limits = Limits(floor=10000.0, start=100000.0, max_rate=1e6)
    estimator, rates = Estimator(0.0, limits), []
    for k in range(40):
        estimator.poll(0.1 * k)
        rates.append(estimator.link.capacity)
    assert rates[int(10 * SILENCE)] == 100000
    assert sorted(set(rates), reverse=True) == [100000, 50000, 25000, 12500, 10000]
    assert estimator.missing == 4


@given(st.lists(st.tuples(
    st.integers(0, 3), st.integers(0, 3_000_000), st.integers(0, 50), st.integers(0, 50000),
    st.lists(st.builds(ArrivalMark, st.integers(0, 1), st.integers(0, 60), st.integers(0, 200000)), max_size=5)),
    max_size=30))
def test_no_report_pushes_the_rate_out_of_its_limits(reports):
    limits = Limits(floor=10000.0, start=50000.0, max_rate=80000.0)
    departures = Departures()
    checked, estimator = Reports(departures), Estimator(100.0, limits)
    for k, (session, clock, received, size, marks) in enumerate(reports):
        now = 100.0 + 0.1 * (k + 1)
        departures.note('a', 2 * k + 1, 2, 1000, now - 0.1)
        evidence = checked.take(Report(session, clock, [StreamArrivals('a', 2 * k + 2, received, size)], marks), now)
        if evidence is not None:
            estimator.take(evidence, now)
        estimator.poll(now)
        assert limits.floor <= estimator.rate <= limits.max_rate
        assert limits.floor <= estimator.link.capacity <= limits.max_rate


def test_who_claims_that_all_came_at_once_gets_max_rate_and_no_more():
    limits = Limits(floor=10000.0, start=50000.0, max_rate=200000.0)
    departures = Departures()
    checked, estimator, seq, rates = Reports(departures), Estimator(100.0, limits), 0, []
    for k in range(100):
        first, begun = seq + 1, 100.0 + 0.1 * k
        for _ in range(int(0.1 * estimator.rate / 1000) + 2):
            seq += 1
            departures.note('a', seq, 1, 1000, begun + 0.001 * (seq - first) / (estimator.rate / 1e6))
        now = begun + 0.2
        marks = [ArrivalMark(0, at, seq - at) for at in range(max(first, seq - 50), seq + 1)]
        evidence = checked.take(Report(1, round(1e6 * now), [StreamArrivals('a', seq, seq, 1000 * seq)], marks), now)
        assert evidence is not None
        estimator.take(evidence, now)
        assert max(estimator.rate, estimator.link.capacity) <= limits.max_rate
        rates.append(estimator.link.capacity)
    assert max(rates) == limits.max_rate        # it does believe it
