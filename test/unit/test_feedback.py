# SPDX-License-Identifier: BSD-3-Clause
import collections
import math
from dataclasses import fields, replace
from typing import Any, Callable, List, Sequence, Set, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.feedback import (
    CLOCK_CONFIRMATIONS,
    MAX_SAMPLES,
    REPORTED_FOR,
    STREAM_TIMEOUT,
    ArrivalSample,
    FeedbackReader,
    ReceiveHistory,
    Report,
    StreamArrivals,
)
from smokebot_udp.congestion.sent_history import SentHistory
from smokebot_udp.msg import ArrivalMark as ArrivalMarkMessage
from smokebot_udp.msg import LinkReport
from smokebot_udp.msg import StreamArrivals as StreamArrivalsMessage

AHEAD = 3600.0
"""The operator's steady clock beside the robot's [s]."""


def path(sent: int = 10, every: float = 0.01, lose: Sequence[int] = (), delay: float = 0.05,
         size: int = 1000) -> Tuple[SentHistory, ReceiveHistory]:
    """What a robot sent from its time 100 on, and what the operator received of it."""
    history, arrivals = SentHistory(), ReceiveHistory(lambda: 7)
    for k in range(sent):
        left = 100 + k * every
        history.add('thermal', k + 1, 1, size, left)
        if k not in lose:
            arrivals.add('thermal', k + 1, size, left + delay + AHEAD)
    return history, arrivals


def test_feedback_needs_no_common_clock() -> None:
    history, arrivals = path(lose=(3, 4))
    reader = FeedbackReader(history)
    feedback = reader.read(arrivals.report(100.15 + AHEAD), 100.17)
    assert [sample.total for sample in feedback.samples] == [1000, 2000, 3000, 6000, 7000, 8000, 9000, 10000]
    assert [sample.sent for sample in feedback.samples] == pytest.approx(
        [100 + .01 * k for k in (0, 1, 2, 5, 6, 7, 8, 9)])
    assert [sample.delay - AHEAD for sample in feedback.samples] == pytest.approx([0.05] * 8, abs=1e-5)
    assert feedback.round_trip == pytest.approx(0.07, abs=1e-5)     # 50 ms there, 20 ms back
    assert (feedback.expected, feedback.received, feedback.unreported, feedback.restarted) == (0, 0, 0, True)


def test_loss_is_counted_between_reports_and_a_lost_report_costs_nothing() -> None:
    history, arrivals = path(sent=4)
    reader = FeedbackReader(history)
    reader.read(arrivals.report(100.09 + AHEAD), 100.11)
    history.add('thermal', 5, 8, 1000, 100.2)
    for seq in (5, 7, 8, 10):       # 11 and 12 are on their way
        arrivals.add('thermal', seq, 1000, 100.25 + 0.004 * seq + AHEAD)
    arrivals.report(100.3 + AHEAD)  # lost
    feedback = reader.read(arrivals.report(100.4 + AHEAD), 100.41)
    assert (feedback.expected, feedback.received) == (6, 4)
    assert [sample.total for sample in feedback.samples] == [5000, 7000, 8000, 10000]
    assert feedback.unreported == 2000


def test_arrivals_are_counted_by_name_and_an_idle_part_loses_nothing() -> None:
    history, arrivals, last = SentHistory(), ReceiveHistory(lambda: 7), collections.Counter()
    reader = FeedbackReader(history)

    def second(number: int, name: str, lost: Sequence[int] = ()) -> Any:
        """Ten datagrams of one name, and a report."""
        for k in range(10):
            last[name] += 1
            seq, left = last[name], 100 + number + 0.01 * k
            history.add(name, seq, 1, 1000, left)
            if k not in lost:
                arrivals.add(name, seq, 1000, left + 0.02 + AHEAD)
        return reader.read(arrivals.report(100.9 + number + AHEAD), 100.95 + number)

    second(0, 'thermal')
    assert second(1, 'thermal', (3, 4)).arrivals == [('thermal', 10, 8)]
    feedback = second(2, 'thermal/layers')      # the first that is heard of it: nothing to compare with
    assert feedback.arrivals == [('thermal/layers', 0, 0)] and feedback.expected == 0
    assert not feedback.restarted
    feedback = second(3, 'thermal/layers', (0, 1, 2))
    assert feedback.arrivals == [('thermal/layers', 10, 7)] and (feedback.expected, feedback.received) == (10, 7)
    feedback = second(4, 'thermal', (9,))       # its numbers go on where they ended, and the last one is not missed yet
    assert feedback.arrivals[0] == ('thermal', 9, 9) and not feedback.restarted and not reader.dropped


def test_what_was_left_out_for_a_slower_link_has_not_arrived() -> None:
    history, arrivals = path(sent=4)
    reader = FeedbackReader(history)
    reader.read(arrivals.report(100.09 + AHEAD), 100.11)
    history.add('thermal', 5, 4, 1000, 100.2)
    reader.sent.leave_out('thermal', 7, 2, 1000, 100.2)
    for seq in (5, 6):
        arrivals.add('thermal', seq, 1000, 100.25 + 0.004 * seq + AHEAD)
    history.add('thermal', 9, 1, 1000, 100.21)
    arrivals.add('thermal', 9, 1000, 100.3 + AHEAD)
    feedback = reader.read(arrivals.report(100.35 + AHEAD), 100.36)
    assert feedback.arrivals == [('thermal', 5, 3)] and (feedback.expected, feedback.received) == (3, 3)


def test_marks_of_congested_queues_are_news_once() -> None:
    history, arrivals = path(sent=4)
    arrivals.add('thermal', 4, 0, 100.08 + AHEAD, 0, marked=3)
    reader = FeedbackReader(history)
    assert reader.read(arrivals.report(100.09 + AHEAD), 100.11).marked == 0     # since when is unknown
    history.add('thermal', 5, 10, 1000, 100.2)
    arrivals.add('thermal', 9, 5000, 100.25 + AHEAD, 5, marked=2)
    arrivals.report(100.3 + AHEAD)      # lost
    arrivals.add('thermal', 14, 5000, 100.35 + AHEAD, 5, marked=5)
    assert reader.read(arrivals.report(100.4 + AHEAD), 100.41).marked == 7
    assert reader.read(arrivals.report(100.5 + AHEAD), 100.51).marked == 0 and not reader.dropped
    history.add('camera', 1, 2, 1000, 100.55)
    arrivals.add('camera', 2, 2000, 100.56 + AHEAD, 2, marked=1)        # the first that is heard of it
    assert reader.read(arrivals.report(100.6 + AHEAD), 100.61).marked == 1 and not reader.dropped


def test_no_more_is_marked_than_arrived() -> None:
    history, arrivals = path()
    reader = FeedbackReader(history)
    reader.read(arrivals.report(100.15 + AHEAD), 100.17)
    history.add('thermal', 11, 2, 1000, 100.2)
    arrivals.add('thermal', 12, 2000, 100.22 + AHEAD, 2)
    for now, marked in ((100.25, 2), (100.35, 0)):
        forged = replace(arrivals.report(now + AHEAD), marked=2 ** 64 - 1)
        assert reader.read(forged, now + 0.02).marked == marked
    assert dict(reader.dropped) == {'more marked than received': 1}


def test_samples_are_spaced_and_bounded() -> None:
    _, arrivals = path(sent=1000, every=0.0005)
    marks = arrivals.report(100.55 + AHEAD).marks
    assert len(marks) <= MAX_SAMPLES
    assert all(earlier.age - later.age >= 2999 for earlier, later in zip(marks, marks[1:]))


def test_reordered_datagrams_count_but_are_not_sampled() -> None:
    arrivals = ReceiveHistory(lambda: 7)
    for seq in (1, 3, 2):
        arrivals.add('tf', seq, 100, 5.0 + seq)
    report = arrivals.report(5.1)
    assert report.streams == [StreamArrivals('tf', 3, 3, 300)]
    assert 2 not in [mark.seq for mark in arrivals.report(8.0).marks]


def test_a_sender_that_restarted_begins_another_session() -> None:
    sessions = iter([1, 2])
    arrivals = ReceiveHistory(lambda: next(sessions))
    arrivals.add('tf', 5000, 100, 1.0)
    arrivals.add('tf', 1, 100, 2.0)
    assert arrivals.report(2.0) == Report(2, 2000000, [StreamArrivals('tf', 1, 1, 100)], [ArrivalSample(0, 1, 0)])


def test_a_newer_connection_begins_another_session_and_the_older_one_is_ignored() -> None:
    sessions = iter(range(10))
    arrivals = ReceiveHistory(lambda: next(sessions))
    arrivals.add('thermal', 500, 500 * 1500, 1.0, 500, connection=4)
    before = arrivals.report(1.0)
    arrivals.add('thermal', 3, 3 * 1500, 2.0, 3, connection=9)      # not RESTART_GAP numbers behind
    arrivals.add('thermal', 501, 1500, 2.1, connection=4)           # the last one of the older connection
    after = arrivals.report(2.2)
    assert after.session != before.session
    assert after.streams == [StreamArrivals('thermal', 3, 3, 3 * 1500)]


@pytest.mark.parametrize('change, reason', [
    (lambda report: replace(report, clock=math.nan), 'not unsigned integers'),
    (lambda report: replace(report, clock=-1), 'not unsigned integers'),
    (lambda report: replace(report, session='7'), 'not unsigned integers'),
    (lambda report: replace(report, marked=math.nan), 'not unsigned integers'),
    (lambda report: replace(report, streams=[StreamArrivals('thermal', 10, math.nan, 10000)]), 'not unsigned integers'),
    (lambda report: replace(report, marks=[ArrivalSample(0, 1, math.inf)]), 'not unsigned integers'),
    (lambda report: replace(report, streams=report.streams * 65), 'too long'),
    (lambda report: replace(report, marks=report.marks * 65), 'too long'),
    (lambda report: replace(report, streams=[StreamArrivals('thermal', 10, 11, 10000)]), 'received more than sent'),
    (lambda report: replace(report, streams=[StreamArrivals('thermal', 10, 10, 10001)]), 'received more than sent'),
    (lambda report: replace(report, streams=[StreamArrivals('camera', 1, 1, 1)], marks=[]), 'received more than sent'),
    (lambda report: replace(report, marks=[ArrivalSample(0, 11, 0)]), 'never sent'),
    (lambda report: replace(report, streams=[StreamArrivals('thermal', 11, 10, 10000)], marks=[]), 'never sent'),
    (lambda report: replace(report, marks=[ArrivalSample(1, 1, 0)]), 'no such stream'),
    (lambda report: replace(report, marks=[ArrivalSample(0, 1, 180000)]), 'arrived before it was sent'),
    (lambda report: replace(report, marks=[ArrivalSample(0, 1, 2 ** 32 - 1)]), 'arrived before it was sent'),
])
def test_impossible_reports_are_dropped_and_counted(change: Callable[[Report], Report], reason: str) -> None:
    history, arrivals = path()
    reader = FeedbackReader(history)
    assert reader.read(change(arrivals.report(100.15 + AHEAD)), 100.17) is None
    assert dict(reader.dropped) == {reason: 1}


def test_what_is_impossible_in_a_report_is_left_out_and_counted() -> None:
    """As after the robot's restart: camera's counters are from before it; and thermal's newest was not recorded yet."""
    history, arrivals = path()
    reader, report = FeedbackReader(history), arrivals.report(100.15 + AHEAD)
    report.streams += [StreamArrivals('camera', 5000, 4000, 4000000)]
    report.marks += [ArrivalSample(1, 5000, 0), ArrivalSample(0, 11, 0)]
    feedback = reader.read(report, 100.17)
    assert [sample.total for sample in feedback.samples] == [1000 * k for k in range(1, 11)]
    history.add('thermal', 11, 2, 1000, 100.2)
    for seq in (11, 12):
        arrivals.add('thermal', seq, 1000, 100.23 + AHEAD)
    second = arrivals.report(100.25 + AHEAD)
    second.streams += [StreamArrivals('camera', 5000, 4000, 4000000)]
    feedback = reader.read(second, 100.27)
    assert (feedback.expected, feedback.received, feedback.restarted) == (2, 2, False)
    assert dict(reader.dropped) == {'received more than sent': 2, 'never sent': 1}


def test_a_stream_that_was_impossible_once_is_counted_on() -> None:
    history, arrivals = path()
    reader = FeedbackReader(history)
    reader.read(arrivals.report(100.15 + AHEAD), 100.17)
    arrivals.add('thermal', 11, 1000, 100.22 + AHEAD)       # comes before it is recorded as sent
    ahead = arrivals.report(100.25 + AHEAD)
    ahead.streams += [StreamArrivals('camera', 0, 0, 0)]
    history.add('camera', 1, 1, 1000, 100.2)
    assert reader.read(ahead, 100.26).expected == 0
    history.add('thermal', 11, 3, 1000, 100.2)
    arrivals.add('thermal', 13, 1000, 100.31 + AHEAD)
    feedback = reader.read(arrivals.report(100.35 + AHEAD), 100.36)
    assert (feedback.expected, feedback.received) == (3, 2)


def test_a_datagram_is_news_once_even_after_a_restart() -> None:
    history, arrivals = path()
    reader = FeedbackReader(history)
    reader.read(arrivals.report(100.15 + AHEAD), 100.17)
    old = Report(8, 5000000, [StreamArrivals('thermal', 10, 1, 1000)], [ArrivalSample(0, 3, 0), ArrivalSample(0, 9, 0)])
    feedback = reader.read(old, 103.0)
    assert feedback.restarted and feedback.samples == []
    history.add('thermal', 11, 1, 1000, 103.1)
    twice = Report(8, 5200000, [StreamArrivals('thermal', 11, 2, 2000)],
                   [ArrivalSample(0, 11, 50000), ArrivalSample(0, 11, 20000)])
    assert [sample.total for sample in reader.read(twice, 103.2).samples] == [11000]


def test_what_a_stream_lost_while_it_was_not_reported_is_counted() -> None:
    history, arrivals = path()
    reader = FeedbackReader(history)
    reader.read(arrivals.report(100.15 + AHEAD), 100.17)
    history.add('camera', 1, 1, 1000, 101.0)
    arrivals.add('camera', 1, 1000, 101.05 + AHEAD)
    for k in range(40):     # thermal is silent
        history.add('camera', 2 + k, 1, 1000, 101.1 + 0.1 * k)
        arrivals.add('camera', 2 + k, 1000, 101.12 + 0.1 * k + AHEAD)
        report = arrivals.report(101.15 + 0.1 * k + AHEAD)
        assert k < 10 or [one.name for one in report.streams] == ['camera']
        reader.read(report, 101.16 + 0.1 * k)
    history.add('thermal', 11, 5, 1000, 105.2)
    for seq in (11, 15):
        arrivals.add('thermal', seq, 1000, 105.25 + AHEAD)
    feedback = reader.read(arrivals.report(105.3 + AHEAD), 105.31)
    assert feedback.arrivals == [('thermal', 5, 2), ('camera', 0, 0)] and not reader.dropped


def test_a_silent_stream_is_no_longer_reported() -> None:
    arrivals = ReceiveHistory(lambda: 7)
    arrivals.add('camera', 900, 1000, 1.0)
    arrivals.add('thermal', 5, 1000, 2.0)
    arrivals.add('camera', 901, 1000, 3.0)
    report = arrivals.report(3.0 + REPORTED_FOR)
    assert [one.name for one in report.streams] == ['camera', 'thermal']        # samples name it
    report = arrivals.report(7.5)
    assert [one.name for one in report.streams] == ['camera'] and len(report.marks) == 1
    assert arrivals.report(9.0).streams == []
    arrivals.add('thermal', 6, 1000, 13.0)
    report = arrivals.report(13.1)
    assert report.streams == [StreamArrivals('thermal', 6, 2, 2000)] and report.marks == [ArrivalSample(0, 6, 100000)]


def test_a_sender_that_restarted_during_the_silence_begins_another_session() -> None:
    arrivals = ReceiveHistory(iter(range(9)).__next__)
    arrivals.add('thermal', 500, 1000, 1.0)
    first = arrivals.report(1.1).session
    arrivals.add('thermal', 2, 1000, 1.0 + STREAM_TIMEOUT + 1.0)
    report = arrivals.report(1.0 + STREAM_TIMEOUT + 1.1)
    assert report.session != first and report.streams == [StreamArrivals('thermal', 2, 1, 1000)]


def test_reports_are_believed_after_a_long_cut() -> None:
    history, arrivals = path()
    reader = FeedbackReader(history)
    assert reader.read(arrivals.report(100.15 + AHEAD), 100.17) is not None
    for k in range(1, 130):     # neither datagrams nor reports cross
        history.add('thermal', 10 + k, 1, 1000, 100.15 + 0.1 * k)
        arrivals.report(100.2 + 0.1 * k + AHEAD)
    history.add('thermal', 140, 1, 1000, 113.2)
    arrivals.add('thermal', 140, 1000, 113.25 + AHEAD)
    feedback = reader.read(arrivals.report(113.3 + AHEAD), 113.35)
    assert (feedback.expected, feedback.received, len(feedback.samples)) == (130, 1, 1)
    assert not reader.dropped


def test_reports_are_believed_again_after_the_robots_restart() -> None:
    """camera's last datagrams come after thermal's new connection, and then it sends nothing any more."""
    history, arrivals = SentHistory(), ReceiveHistory(iter(range(9)).__next__)
    arrivals.add('thermal', 500, 1000, 100.0 + AHEAD, connection=1)
    arrivals.add('camera', 900, 1000, 100.0 + AHEAD, connection=2)
    reader, now, believed = FeedbackReader(history), 110.0, 0
    for seq in range(1, 300):
        history.add('thermal', seq, 1, 1000, now)
        arrivals.add('thermal', seq, 1000, now + 0.02 + AHEAD, connection=3)
        if seq < 3:
            arrivals.add('camera', 900 + seq, 1000, now + 0.03 + AHEAD, connection=2)
        now += 0.1
        feedback = reader.read(arrivals.report(now + AHEAD), now + 0.02)
        believed += feedback is not None and len(feedback.samples) > 0
    assert believed == 299
    assert reader.dropped['received more than sent'] < 10 * STREAM_TIMEOUT + 3


@given(st.lists(st.tuples(st.sampled_from(['thermal', 'lidar', 'tf']), st.floats(0.0005, 0.05), st.floats(0.02, 0.3),
                          st.booleans()), min_size=1, max_size=60),
       st.sets(st.integers(0, 40)), st.randoms())
def test_what_a_receiver_reports_is_believed(datagrams: List[Tuple[str, float, float, bool]], lost: Set[int],
                                             random: Any) -> None:
    """Datagrams: (stream, time since the one before, delay, whether it is lost). They overtake each other, and each
    stream's thread is up to 50 ms late."""
    history, arrivals, now, events = SentHistory(), ReceiveHistory(lambda: 7), 100.0, []
    seqs = {'thermal': 0, 'lidar': 0, 'tf': 0}
    for stream, wait, delay, gone in datagrams:
        now += wait
        seqs[stream] += 1
        events.append((now, 0, stream, seqs[stream], now))
        if not gone:
            events.append((now + delay + random.uniform(0, 0.05), 1, stream, seqs[stream], now + delay))
    last = max(event[0] for event in events)
    events += [(100 + 0.1 * k, 2, '', 0, 0.0) for k in range(1, int((last - 100) / 0.1) + 4) if k not in lost]
    reader, reported = FeedbackReader(history), []
    for time, kind, stream, seq, when in sorted(events):
        if kind == 0:
            history.add(stream, seq, 1, 1000, time)
        elif kind == 1:
            arrivals.add(stream, seq, 1000, when + AHEAD)
        else:
            feedback = reader.read(arrivals.report(time + AHEAD), time + 0.001)
            assert feedback is not None
            reported += [sample.total for sample in feedback.samples]
    assert not reader.dropped
    assert reported == sorted(set(reported))


@pytest.mark.parametrize('second, reason', [
    (Report(7, 3700150000, [StreamArrivals('thermal', 10, 10, 10000)]), 'clock jumps'),        # twice
    (Report(7, 3700100000, [StreamArrivals('thermal', 10, 10, 10000)]), 'clock jumps'),        # older
    (Report(7, 7300250000, [StreamArrivals('thermal', 10, 10, 10000)]), 'clock jumps'),        # an hour later
    (Report(7, 3700250000, [StreamArrivals('thermal', 10, 9, 10000)]), 'counters go backwards'),
    (Report(7, 3700250000, [StreamArrivals('thermal', 10, 10, 9999)]), 'counters go backwards'),
    (Report(7, 3700250000, [StreamArrivals('thermal', 9, 10, 10000)]), 'counters go backwards'),
    (Report(7, 3700250000, [StreamArrivals('thermal', 10, 10, 10000)], marked=4), 'counters go backwards'),
])
def test_reports_that_contradict_the_one_before_are_dropped(second: Report, reason: str) -> None:
    history, arrivals = path()
    arrivals.add('thermal', 10, 0, 100.14 + AHEAD, 0, marked=5)
    second = replace(second, marked=second.marked or 5)
    reader = FeedbackReader(history)
    assert reader.read(arrivals.report(100.15 + AHEAD), 100.17) is not None
    assert reader.read(second, 100.27) is None
    assert dict(reader.dropped) == {reason: 1}


@pytest.mark.parametrize('jump', [3600.0, -3600.0])
def test_a_steady_clock_that_jumps_permanently_is_believed(jump: float) -> None:
    history, arrivals = path()
    reader = FeedbackReader(history)
    assert reader.read(arrivals.report(100.15 + AHEAD), 100.17).restarted
    for k in range(CLOCK_CONFIRMATIONS):
        feedback = reader.read(Report(7, round(1e6 * (100.25 + .1 * k + AHEAD + jump)),
                                       [StreamArrivals('thermal', 10, 10, 10000)]), 100.27 + .1 * k)
        assert (feedback is not None) == (k == CLOCK_CONFIRMATIONS - 1)
    assert feedback.restarted and dict(reader.dropped) == {'clock jumps': CLOCK_CONFIRMATIONS - 1}
    after = reader.read(Report(7, round(1e6 * (101 + AHEAD + jump)), [StreamArrivals('thermal', 10, 10, 10000)]), 101)
    assert not after.restarted


numbers = st.one_of(st.integers(-1, 2 ** 64), st.floats(), st.none(), st.booleans())
any_report = st.builds(
    Report, numbers, numbers,
    st.lists(st.builds(StreamArrivals, st.sampled_from(['thermal', 'camera', '']), numbers, numbers, numbers),
             max_size=3),
    st.lists(st.builds(ArrivalSample, numbers, numbers, numbers), max_size=3), numbers)


@given(st.lists(st.tuples(any_report, st.floats(100.1, 101)), max_size=8))
def test_no_report_raises_or_counts_more_than_was_sent(attack: List[Tuple[Report, float]]) -> None:
    history, _ = path()
    reader = FeedbackReader(history)
    for report, now in attack:
        feedback = reader.read(report, now)
        if feedback is not None:
            assert 0 <= feedback.received <= feedback.expected
            assert 0 <= feedback.marked <= history.totals('thermal')[0]
            assert 0 <= feedback.unreported <= history.total
            assert all(sample.total <= history.total and sample.sent <= now for sample in feedback.samples)


@pytest.mark.parametrize('mirror, message', [
    (Report, LinkReport), (StreamArrivals, StreamArrivalsMessage), (ArrivalSample, ArrivalMarkMessage)])
def test_the_messages_have_the_same_fields(mirror: Any, message: Any) -> None:
    assert [field.name for field in fields(mirror)] == [name for name in message.__slots__ if name != 'header']
