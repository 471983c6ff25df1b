# SPDX-License-Identifier: BSD-3-Clause
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.copies import copies
from smokebot_udp.streams.grid.copies import MAX_COPIES, ROUND_TRIP, URGENT_TIME, Pattern, sent_for
from smokebot_udp.streams.grid.overview_schedule import PERIOD, REFRESH, OverviewSchedule, datagrams
from smokebot_udp.streams.grid.pace import BURST, Pace


@pytest.mark.parametrize('loss, count', [(0.0, 1), (0.01, 1), (0.1, 2), (0.2, 3), (0.5, 7), (0.8, 21), (1.0, 24)])
def test_copies_by_hand(loss: float, count: int) -> None:
    assert copies(loss, 0.01, MAX_COPIES) == count


@pytest.mark.parametrize('loss, count', [(0.0, 3), (0.1, 5), (0.2, 6), (0.5, 12), (0.8, MAX_COPIES), (1.0, MAX_COPIES)])
def test_datagrams_for_three_by_hand(loss: float, count: int) -> None:
    # at a loss of 0.2 fewer than 3 of 6 arrive with 1.7 %, of 5 with 5.8 %
    assert sent_for(3, loss, 0.02) == count


def test_changes_are_sent_again_before_a_report_can_name_them() -> None:
    pattern = Pattern(0.2, 5.0)
    assert pattern.interval(1, True) == pattern.interval(2, True) == pytest.approx(URGENT_TIME / 3)
    assert pattern.interval(3, True) == pattern.interval(1, False) == ROUND_TRIP
    assert Pattern(0.0, 5.0).interval(1, True) == ROUND_TRIP
    assert Pattern(0.8, 5.0).interval(1, False) == pytest.approx(ROUND_TRIP / 5)


@given(st.floats(0.0, 1.0), st.floats(1.0, 100.0), st.booleans())
def test_many_copies_become_rare_and_none_rarer_than_the_slow_cycle(loss: float, slow: float, urgent: bool) -> None:
    pattern = Pattern(loss, slow)
    intervals = [pattern.interval(tries, urgent) for tries in range(1, 250)]
    assert intervals == sorted(intervals) and intervals[-1] == slow and intervals[0] > 0.01


def test_a_pace_lets_a_burst_and_then_the_rate_through() -> None:
    pace, now, left = Pace(10000.0), 50.0, []
    while now < 52.0:
        wait = pace.wait(now)
        if wait:
            now += wait
            continue
        pace.take(500, now)
        left.append(now)
    assert left.count(50.0) in (2, 3)       # BURST at 10000 byte/s are 1000 bytes
    assert 2 * 20 <= len(left) <= 2 * 20 + BURST * 20 + 1
    assert pace.average(now) == pytest.approx(10000 * (1 - 2.718 ** (-2 / 3)), rel=0.1)
    assert pace.average(now + 60) < 1.0


def test_a_pace_that_changes_keeps_what_left() -> None:
    pace = Pace(1000.0)
    pace.take(600, 0.0)
    assert pace.wait(0.0) == pytest.approx(0.5)
    pace.set_rate(6000.0, 0.0)
    assert pace.wait(0.0) == 0.0
    pace.set_rate(100.0, 0.0)
    assert pace.wait(0.0) == pytest.approx(5.9)


def test_an_overview_leaves_at_once_and_again_within_a_round_trip() -> None:
    schedule, left = OverviewSchedule(), []
    assert schedule.due() > 1e9
    schedule.want()
    now = 10.0
    while now < 11.0:
        if schedule.due() <= now:
            schedule.sent(0.2, now)
            left.append(now)
        now += 0.01
    assert len(left) == copies(0.2, 0.02) == 3
    assert left == pytest.approx([10.0, 10.1, 10.2], abs=0.02)
    assert schedule.refresh_due() == left[-1] + REFRESH


def test_only_at_a_high_loss_copies_are_dense() -> None:
    for loss, dense in ((0.0, False), (0.2, False), (0.5, True), (0.8, True)):
        schedule = OverviewSchedule()
        schedule.want()
        schedule.sent(loss, 10.0)
        assert schedule.dense == dense
        while schedule.due() < 100.0:
            schedule.sent(loss, schedule.due())
        assert not schedule.dense


def test_overviews_keep_their_distance() -> None:
    schedule, began, now = OverviewSchedule(), [], 0.0
    while now < 5.0:
        schedule.want()
        if schedule.due() <= now:
            schedule.sent(0.0, now)
            began.append(now)
        now += 0.01
    assert 9 <= len(began) <= 10
    assert min(after - before for before, after in zip(began, began[1:])) >= PERIOD - 1e-9


def test_an_overview_is_of_fewer_datagrams_where_many_are_lost() -> None:
    assert [datagrams(loss) for loss in (0.0, 0.2, 0.5, 0.8)] == [4, 3, 1, 1]
    assert copies(0.8, 0.02, MAX_COPIES) <= MAX_COPIES
