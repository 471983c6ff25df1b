# SPDX-License-Identifier: BSD-3-Clause
import math
from dataclasses import fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.feedback import (
    CONFIRMED,
    MOST_MARKS,
    ArrivalMark,
    Arrivals,
    Report,
    Reports,
    StreamArrivals,
)
from smokebot_udp.congestion.sent_history import Departures
from smokebot_udp.msg import ArrivalMark as ArrivalMarkMessage
from smokebot_udp.msg import LinkReport
from smokebot_udp.msg import StreamArrivals as StreamArrivalsMessage

AHEAD = 3600.0
"""The operator's steady clock beside the robot's [s]."""


def way(sent=10, every=0.01, lose=(), delay=0.05, size=1000):
    """A robot that sent so many datagrams from its time 100 on, and what the operator took of them."""
    departures, arrivals = Departures(), Arrivals(lambda: 7)
    for k in range(sent):
        left = 100 + k * every
        departures.note('thermal', k + 1, 1, size, left)
        if k not in lose:
            arrivals.note('thermal', k + 1, size, left + delay + AHEAD)
    return departures, arrivals


def test_what_came_is_told_by_both_clocks_differences():
    departures, arrivals = way(lose=(3, 4))
    reports = Reports(departures)
    evidence = reports.take(arrivals.report(100.15 + AHEAD), 100.17)
    assert [point.total for point in evidence.points] == [1000, 2000, 3000, 6000, 7000, 8000, 9000, 10000]
    assert [point.sent for point in evidence.points] == pytest.approx([100 + .01 * k for k in (0, 1, 2, 5, 6, 7, 8, 9)])
    assert [point.delay - AHEAD for point in evidence.points] == pytest.approx([0.05] * 8, abs=1e-5)
    assert evidence.round_trip == pytest.approx(0.07, abs=1e-5)     # 50 ms there, 20 ms back
    assert (evidence.expected, evidence.received, evidence.unreported, evidence.anew) == (0, 0, 0, True)


def test_loss_is_between_two_reports_and_a_lost_report_costs_nothing():
    departures, arrivals = way(sent=4)
    reports = Reports(departures)
    reports.take(arrivals.report(100.09 + AHEAD), 100.11)
    departures.note('thermal', 5, 8, 1000, 100.2)
    for seq in (5, 7, 8, 10):       # 11 and 12 are on their way
        arrivals.note('thermal', seq, 1000, 100.25 + 0.004 * seq + AHEAD)
    arrivals.report(100.3 + AHEAD)  # lost
    evidence = reports.take(arrivals.report(100.4 + AHEAD), 100.41)
    assert (evidence.expected, evidence.received) == (6, 4)
    assert reports.loss == {'thermal': pytest.approx(1 / 3)}
    assert [point.total for point in evidence.points] == [5000, 7000, 8000, 10000]
    assert evidence.unreported == 2000


def test_marks_are_apart_and_bounded():
    _, arrivals = way(sent=1000, every=0.0005)
    marks = arrivals.report(100.55 + AHEAD).marks
    assert len(marks) <= MOST_MARKS
    assert all(earlier.age - later.age >= 2999 for earlier, later in zip(marks, marks[1:]))


def test_late_ones_count_but_are_no_marks():
    arrivals = Arrivals(lambda: 7)
    for seq in (1, 3, 2):
        arrivals.note('tf', seq, 100, 5.0 + seq)
    report = arrivals.report(5.1)
    assert report.streams == [StreamArrivals('tf', 3, 3, 300)]
    assert 2 not in [mark.seq for mark in arrivals.report(8.0).marks]


def test_a_sender_that_began_anew_is_another_session():
    sessions = iter([1, 2])
    arrivals = Arrivals(lambda: next(sessions))
    arrivals.note('tf', 5000, 100, 1.0)
    arrivals.note('tf', 1, 100, 2.0)
    assert arrivals.report(2.0) == Report(2, 2000000, [StreamArrivals('tf', 1, 1, 100)], [ArrivalMark(0, 1, 0)])


@pytest.mark.parametrize('change, reason', [
    (lambda report: replace(report, clock=math.nan), 'no numbers'),
    (lambda report: replace(report, clock=-1), 'no numbers'),
    (lambda report: replace(report, session='7'), 'no numbers'),
    (lambda report: replace(report, streams=[StreamArrivals('thermal', 10, math.nan, 10000)]), 'no numbers'),
    (lambda report: replace(report, marks=[ArrivalMark(0, 1, math.inf)]), 'no numbers'),
    (lambda report: replace(report, streams=report.streams * 65), 'too long'),
    (lambda report: replace(report, marks=report.marks * 65), 'too long'),
    (lambda report: replace(report, streams=[StreamArrivals('thermal', 10, 11, 10000)]), 'received more than sent'),
    (lambda report: replace(report, streams=[StreamArrivals('thermal', 10, 10, 10001)]), 'received more than sent'),
    (lambda report: replace(report, streams=[StreamArrivals('camera', 1, 1, 1)], marks=[]), 'received more than sent'),
    (lambda report: replace(report, marks=[ArrivalMark(0, 11, 0)]), 'never sent'),
    (lambda report: replace(report, marks=[ArrivalMark(1, 1, 0)]), 'no such stream'),
    (lambda report: replace(report, marks=[ArrivalMark(0, 1, 180000)]), 'came before it left'),
    (lambda report: replace(report, marks=[ArrivalMark(0, 1, 2 ** 32 - 1)]), 'came before it left'),
])
def test_what_is_impossible_is_dropped_and_counted(change, reason):
    departures, arrivals = way()
    reports = Reports(departures)
    assert reports.take(change(arrivals.report(100.15 + AHEAD)), 100.17) is None
    assert dict(reports.dropped) == {reason: 1}


@pytest.mark.parametrize('second, reason', [
    (Report(7, 3700150000, [StreamArrivals('thermal', 10, 10, 10000)]), 'time'),                   # told twice
    (Report(7, 3700100000, [StreamArrivals('thermal', 10, 10, 10000)]), 'time'),                   # older
    (Report(7, 7300250000, [StreamArrivals('thermal', 10, 10, 10000)]), 'time'),                   # an hour on
    (Report(7, 3700250000, [StreamArrivals('thermal', 10, 9, 10000)]), 'counts go backwards'),
    (Report(7, 3700250000, [StreamArrivals('thermal', 10, 10, 9999)]), 'counts go backwards'),
    (Report(7, 3700250000, [StreamArrivals('thermal', 9, 10, 10000)]), 'counts go backwards'),
])
def test_what_contradicts_the_report_before_is_dropped(second, reason):
    departures, arrivals = way()
    reports = Reports(departures)
    assert reports.take(arrivals.report(100.15 + AHEAD), 100.17) is not None
    assert reports.take(second, 100.27) is None
    assert dict(reports.dropped) == {reason: 1}


@pytest.mark.parametrize('jump', [3600.0, -3600.0])
def test_a_steady_clock_that_jumps_for_good_is_believed(jump):
    departures, arrivals = way()
    reports = Reports(departures)
    assert reports.take(arrivals.report(100.15 + AHEAD), 100.17).anew
    for k in range(CONFIRMED):
        evidence = reports.take(Report(7, round(1e6 * (100.25 + .1 * k + AHEAD + jump)),
                                       [StreamArrivals('thermal', 10, 10, 10000)]), 100.27 + .1 * k)
        assert (evidence is not None) == (k == CONFIRMED - 1)
    assert evidence.anew and dict(reports.dropped) == {'time': CONFIRMED - 1}
    after = reports.take(Report(7, round(1e6 * (101 + AHEAD + jump)), [StreamArrivals('thermal', 10, 10, 10000)]), 101)
    assert not after.anew


numbers = st.one_of(st.integers(-1, 2 ** 64), st.floats(), st.none(), st.booleans())
any_report = st.builds(
    Report, numbers, numbers,
    st.lists(st.builds(StreamArrivals, st.sampled_from(['thermal', 'camera', '']), numbers, numbers, numbers),
             max_size=3),
    st.lists(st.builds(ArrivalMark, numbers, numbers, numbers), max_size=3))


@given(st.lists(st.tuples(any_report, st.floats(100.1, 101)), max_size=8))
def test_whatever_comes_nothing_is_raised_and_no_more_came_than_left(attack):
    departures, _ = way()
    reports = Reports(departures)
    for report, now in attack:
        evidence = reports.take(report, now)
        if evidence is not None:
            assert 0 <= evidence.received <= evidence.expected
            assert 0 <= evidence.unreported <= departures.total
            assert all(point.total <= departures.total and point.sent <= now for point in evidence.points)


@pytest.mark.parametrize('mirror, message', [
    (Report, LinkReport), (StreamArrivals, StreamArrivalsMessage), (ArrivalMark, ArrivalMarkMessage)])
def test_the_messages_have_the_same_fields(mirror, message):
    assert [field.name for field in fields(mirror)] == [name for name in message.__slots__ if name != 'header']
