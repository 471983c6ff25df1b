# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.estimator import (
    HORIZON,
    MBIT,
    REPORT_INTERVAL,
    REPORT_TIMEOUT,
    Estimator,
    Limits,
    Mode,
    target_delay,
)
from smokebot_udp.congestion.feedback import (
    ArrivalSample,
    Feedback,
    FeedbackReader,
    PacketSample,
    Report,
    StreamArrivals,
)
from smokebot_udp.congestion.loss import Loss
from smokebot_udp.congestion.path import LONG_QUEUE
from smokebot_udp.congestion.sent_history import SentHistory


def test_the_target_delay_falls_with_the_rate() -> None:
    assert target_delay(20 * MBIT) == 0.005
    assert target_delay(20 * MBIT / 8) == pytest.approx(0.01)
    assert target_delay(0.1) == 0.04
    assert all(target_delay(rate) < LONG_QUEUE for rate in (1e3, 1e5, 1e8))


def counts(expected: int, received: int) -> Feedback:
    return Feedback([], math.nan, expected, received, 0, False)


def test_loss_while_uncongested_is_the_airs() -> None:
    loss = Loss()
    for _ in range(20):
        loss.update(counts(100, 80), True)
        assert loss.excess == 0
    assert loss.air == pytest.approx(0.2)
    for _ in range(200):
        loss.update(counts(100, 40), False)
    assert loss.excess == pytest.approx(0.5)        # of the 80 that the air lets through


def test_loss_within_chance_is_no_excess() -> None:
    loss = Loss()
    loss.update(counts(100, 100), True)
    loss.update(counts(20, 14), False)
    assert loss.excess == 0


def test_a_loss_that_may_be_the_airs_is_suspicious_before_it_is_excess() -> None:
    loss = Loss()
    for _ in range(10):
        loss.update(counts(100, 80), False)
    assert loss.suspicious and not loss.excess
    bursts = Loss()
    for number in range(60):
        bursts.update(counts(100, 100 if number % 4 else 40), False)
    assert not bursts.suspicious
    loss.set_air(600, 120)
    assert not loss.suspicious


def test_loss_of_one_report_beyond_the_airs() -> None:
    loss = Loss()
    loss.set_air(100, 20)
    assert loss.beyond_air(counts(100, 20).loss) == pytest.approx(0.75)      # of the 80 that the air lets through
    assert loss.beyond_air(counts(100, 90).loss) == 0 and loss.beyond_air(counts(0, 0).loss) == 0


def silent(estimator: Estimator, begun: float, now: float, sent: float) -> None:
    """No report comes from `begun` until `now`."""
    for k in range(1, int((now - begun) / REPORT_INTERVAL)):
        estimator.poll(begun + k * REPORT_INTERVAL, sent)
    estimator.poll(now, sent)


def test_each_report_timeout_halves_the_rate() -> None:
    limits = Limits(min_rate=10000.0, start_rate=100000.0, max_rate=1e6)
    estimator, rates = Estimator(0.0, limits), []
    for k in range(40):
        estimator.poll(0.1 * k, 20000.0)
        rates.append(estimator.link.capacity)
    assert rates[int(10 * REPORT_TIMEOUT)] == 100000
    assert sorted(set(rates), reverse=True) == [100000, 50000, 25000, 12500, 10000]
    assert estimator.timeouts == 7


def test_silence_says_nothing_where_little_is_sent_and_is_answered_at_once_where_more_is() -> None:
    limits = Limits(min_rate=10000.0, start_rate=100000.0)
    estimator = Estimator(0.0, limits)
    for begun, now in ((0.0, 1.1 * REPORT_TIMEOUT), (1.1 * REPORT_TIMEOUT, 3.3 * REPORT_TIMEOUT)):
        silent(estimator, begun, now, limits.min_rate)
        assert estimator.link.capacity == estimator.rate == 100000 and estimator.timeouts == int(now / REPORT_TIMEOUT)
    estimator.poll(3.4 * REPORT_TIMEOUT, 1.1 * limits.min_rate)
    assert estimator.link.capacity == 12500
    silent(estimator, 3.4 * REPORT_TIMEOUT, 20.0, 2e5)
    assert estimator.link.capacity == limits.min_rate


def test_a_node_that_stood_still_has_heard_no_silence() -> None:
    estimator = Estimator(0.0, Limits(min_rate=10000.0, start_rate=100000.0))
    silent(estimator, 0.0, 0.2, 20000.0)
    estimator.poll(3.0, 20000.0)
    assert estimator.link.capacity == 100000 and estimator.mode is Mode.FOLLOW
    silent(estimator, 3.0, 3.3, 20000.0)
    assert estimator.link.capacity == 50000


@pytest.mark.parametrize('unreported, capacity', [(5000, 100000), (5001, 10000)])
def test_a_report_in_which_nothing_of_much_has_come_is_no_answer(unreported: int, capacity: float) -> None:
    """As where a subscriber's address is known, and it cannot receive yet: 0.5 s of min_rate are much."""
    estimator = Estimator(0.0, Limits(min_rate=10000.0, start_rate=100000.0))
    for k in range(1, 40):
        estimator.on_feedback(Feedback([], math.nan, 0, 0, unreported, False), 0.1 * k)
        estimator.poll(0.1 * k + 0.05, 20000.0)
    assert estimator.link.capacity == capacity and bool(estimator.timeouts) == (unreported > 5000)


def single(number: int, late: float = 0.0) -> Feedback:
    """Feedback on one short datagram of those that are sent each half second."""
    sent = 0.5 * number
    sample = PacketSample(sent, sent + 5.02 + late, 200, 200 * (number + 1))
    return Feedback([sample], 0.04, 1, 1, 0, False)


def test_datagrams_that_come_late_one_by_one_do_not_tell_what_the_link_carries() -> None:
    """As where the path jitters: the air was not busy between them."""
    estimator = Estimator(0.0)
    for number in range(60):
        estimator.on_feedback(single(number, (0.0, 0.066, 0.018)[number % 3]), 0.5 * number + 0.1)
    assert estimator.link.capacity >= Limits().start_rate


def test_an_idle_sender_makes_no_pauses_where_the_path_becomes_longer() -> None:
    estimator = Estimator(0.0)
    for number in range(60):
        estimator.on_feedback(single(number, 0.0 if number < 4 else 0.1), 0.5 * number + 0.1)
        assert estimator.rate >= estimator.link.capacity


def burst(now: float, total: int, late: float = 0.0) -> Feedback:
    """Feedback on 100 kB/s in the last 0.1 s."""
    chain = [PacketSample(sent, sent + 5.02 + late, 1000, total + 1000 * at)
             for at, sent in enumerate(now - 0.1 + 0.01 * at for at in range(10))]
    return Feedback(chain, 0.04, 10, 10, 0, False)


@pytest.mark.parametrize('expected, mode', [(14, Mode.FIRST), (13, Mode.FOLLOW)])
def test_much_loss_before_the_first_pause_is_a_reason_to_drain(expected: int, mode: Mode) -> None:
    """The delays so far may be those of a full queue. 3 of 13 are not much."""
    estimator, modes = Estimator(0.0, Limits(start_rate=1e5)), []
    for number in range(1, 20):
        estimator.on_feedback(burst(0.1 * number, 10000 * number - 9000)._replace(expected=expected), 0.1 * number)
        modes.append(estimator.mode)
    assert modes[0] is Mode.FOLLOW and modes[1] is mode and modes[-1] is Mode.FOLLOW
    assert modes.count(Mode.FIRST) < 4      # one pause, no more


def test_what_the_link_carried_before_a_timeout_is_known_until_a_short_queue_shows() -> None:
    before = 1e6
    estimator = Estimator(0.0, Limits(start_rate=before))
    estimator.on_feedback(burst(0.1, 1000), 0.1)
    silent(estimator, 0.1, 3.0, math.inf)
    assert estimator.link.capacity < before / 4
    estimator.on_feedback(burst(3.1, 11000, 0.05), 3.1)
    assert estimator.link.capacity < before / 4
    estimator.on_feedback(burst(3.2, 21000), 3.2)
    assert before / 2 <= estimator.link.capacity < before      # it was no loss of datagrams that took the reports


def test_what_the_link_carried_before_a_timeout_is_known_where_hardly_anything_was_sent() -> None:
    before = 1e6
    estimator = Estimator(0.0, Limits(start_rate=before))
    estimator.on_feedback(single(0), 0.1)
    silent(estimator, 0.1, 3.0, math.inf)
    assert estimator.link.capacity < before / 4
    estimator.on_feedback(single(6, 0.2), 3.1)
    assert estimator.link.capacity == before


def test_without_reports_a_queue_seen_before_does_not_lower_the_rate_for_long() -> None:
    estimator = Estimator(0.0)
    for k in range(20):
        now = 0.1 * (k + 1)
        times = [now - 0.1 + 0.01 * at for at in range(10)]
        chain = [PacketSample(sent, sent + 5 + 0.002 * k, 1000, 10000 * k + 1000 * at)      # later with each report
                 for at, sent in enumerate(times)]
        estimator.on_feedback(Feedback(chain, 0.02, 10, 10, 0, False), now)
        estimator.poll(now, 1e5)
    assert estimator.rate < estimator.link.capacity
    estimator.poll(now + HORIZON / 2, 1e5)
    assert estimator.rate < estimator.link.capacity
    estimator.poll(now + 1.5 * HORIZON, 1e5)
    assert estimator.rate == estimator.link.capacity


@given(st.lists(st.tuples(
    st.integers(0, 3), st.integers(0, 3_000_000), st.integers(0, 50), st.integers(0, 50000),
    st.lists(st.builds(ArrivalSample, st.integers(0, 1), st.integers(0, 60), st.integers(0, 200000)), max_size=5)),
    max_size=30))
def test_no_report_moves_the_rate_beyond_its_limits(
        reports: List[Tuple[int, int, int, int, List[ArrivalSample]]]) -> None:
    limits = Limits(min_rate=10000.0, start_rate=50000.0, max_rate=80000.0)
    history = SentHistory()
    reader, estimator = FeedbackReader(history), Estimator(100.0, limits)
    for k, (session, clock, received, size, marks) in enumerate(reports):
        now = 100.0 + 0.1 * (k + 1)
        history.add('a', 2 * k + 1, 2, 1000, now - 0.1)
        feedback = reader.read(Report(session, clock, [StreamArrivals('a', 2 * k + 2, received, size)], marks), now)
        if feedback is not None:
            estimator.on_feedback(feedback, now)
        estimator.poll(now, estimator.rate)
        assert limits.min_rate <= estimator.rate <= limits.max_rate
        assert limits.min_rate <= estimator.link.capacity <= limits.max_rate


def test_a_receiver_that_claims_instant_arrival_gets_max_rate_at_most() -> None:
    limits = Limits(min_rate=10000.0, start_rate=50000.0, max_rate=200000.0)
    history = SentHistory()
    reader, estimator, seq, rates = FeedbackReader(history), Estimator(100.0, limits), 0, []
    for k in range(200):        # what arrives together counts as measured, and pauses the growth
        first, begun = seq + 1, 100.0 + 0.1 * k
        for _ in range(int(0.1 * estimator.rate / 1000) + 2):
            seq += 1
            history.add('a', seq, 1, 1000, begun + 0.001 * (seq - first) / (estimator.rate / 1e6))
        now = begun + 0.2
        marks = [ArrivalSample(0, at, seq - at) for at in range(max(first, seq - 50), seq + 1)]
        feedback = reader.read(Report(1, round(1e6 * now), [StreamArrivals('a', seq, seq, 1000 * seq)], marks), now)
        assert feedback is not None
        estimator.on_feedback(feedback, now)
        assert max(estimator.rate, estimator.link.capacity) <= limits.max_rate
        rates.append(estimator.link.capacity)
    assert max(rates) == pytest.approx(limits.max_rate)     # it does believe it


def test_where_datagrams_are_marked_less_is_sent_and_no_train_leaves() -> None:
    rates, trains = {}, {}
    for marked in (0, 5, 10):
        estimator, left = Estimator(0.0), []
        for number in range(40):
            now = 0.1 * (number + 1)
            feedback = burst(now, 1000 + 10000 * number)._replace(marked=marked)
            left.append(estimator.on_feedback(feedback, now))
        rates[marked], trains[marked] = estimator.rate / estimator.link.capacity, sum(map(bool, left[20:]))
    assert rates[10] == pytest.approx(rates[0] / 2, rel=0.01) and rates[10] < rates[5] < rates[0]
    assert trains[0] > 0 == trains[10]
