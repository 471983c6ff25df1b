# SPDX-License-Identifier: BSD-3-Clause
from typing import List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.operator_share import (
    BURST_DURATION,
    MAX_DEBT,
    MAX_RANGES,
    MAX_WHOLE_DEBT,
    MIN_RANGES,
    OperatorHistory,
    Policer,
)
from smokebot_udp.congestion.sent_history import SentHistory

SIZE = 1000


def passed(policer: Policer, stream: str, rate: float, each: int, every: float, start: float = 0.0,
           until: float = 10.0) -> int:
    """How much of a stream passes from one time to another: `each` datagrams `every` [s]."""
    number, now = 0, start
    while now < until:
        got = policer.conforming(stream, each, SIZE, rate, now)
        policer.spend(got * SIZE)
        number, now = number + got, now + every
    return number


@pytest.mark.parametrize('part, each, every, expected', [
    (1.0, 1, 0.002, 1000), (1.0, 5, 0.01, 1000), (0.9, 5, 0.01, 1000),
    (0.9, 60, 0.1, 500),        # that is a burst
])
def test_no_more_passes_than_the_link_carries(part: float, each: int, every: float, expected: int) -> None:
    assert BURST_DURATION == 0.05
    policer = Policer(0.0)
    policer.parts = {'thermal': part}
    assert passed(policer, 'thermal', 100 * SIZE, each, every) == pytest.approx(expected, rel=0.02)


def test_a_part_of_each_stream_passes_on_a_link_with_room() -> None:
    policer = Policer(0.0)
    policer.parts = {'thermal': 0.3}
    assert passed(policer, 'thermal', 1e7, 2, 0.01) == pytest.approx(600, abs=1)
    assert passed(policer, 'scan', 1e7, 2, 0.01) == 2000


def test_what_keeps_all_its_datagrams_goes_first() -> None:
    policer = Policer(0.0)
    policer.parts = {'thermal': 0.9}
    assert passed(policer, 'thermal', 10 * SIZE, 1, 0.001, until=1.0) == pytest.approx(10, abs=1)
    assert policer.conforming('scan', 1, SIZE, 10 * SIZE, 1.0) == 1
    policer.spend(2 * SIZE)
    assert policer.conforming('scan', 1, SIZE, 10 * SIZE, 1.0) == 0


def test_messages_that_leave_in_any_case_delay_others_for_a_short_time_only() -> None:
    policer = Policer(0.0)
    policer.parts = {'thermal': 0.9}
    policer.spend(1000 * SIZE)
    assert policer.conforming('thermal', 1, SIZE, 100 * SIZE, 0.0) == 0
    assert policer.conforming('thermal', 20, SIZE, 100 * SIZE, MAX_DEBT + 0.021) == 2


def test_a_train_passes_at_its_own_rate() -> None:
    policer = Policer(0.0)
    policer.parts = {'thermal': 0.1}
    assert passed(policer, 'thermal', 50 * SIZE, 1, 0.001, until=0.1) <= 5
    policer.start_probe(500 * SIZE, 10 * SIZE)
    assert passed(policer, 'thermal', 50 * SIZE, 1, 0.001, 0.1, 0.125) == pytest.approx(11, abs=2)
    assert passed(policer, 'thermal', 50 * SIZE, 1, 0.001, 0.125, 0.225) <= 5


def messages(policer: Policer, rate: float, total: int, every: float, until: float, pace: float = 1e9) -> List[bool]:
    """Whether each message of a whole stream passes: one of `total` datagrams every so often [s], in chunks of 4.

    :param pace: of the chunks [byte/s]
    """
    found, number = [], 0
    while number * every < until:
        passed, now = [], number * every
        for start in range(0, total, 4):
            count = min(4, total - start)
            got = policer.conforming('jpeg', count, SIZE, rate, now, start, total)
            policer.spend(got * SIZE)
            passed.append(got)
            now += count * SIZE / pace
        assert sum(passed) in (0, total)
        found.append(sum(passed) == total)
        number += 1
    return found


def whole(part: float) -> Policer:
    policer = Policer(0.0)
    policer.parts, policer.whole = {'jpeg': part}, {'jpeg'}
    return policer


def test_messages_that_are_useless_in_part_pass_whole_and_fewer_of_them() -> None:
    assert messages(whole(0.3), 1000 * SIZE, 15, 0.1, 10.0).count(True) == 30
    assert messages(whole(0.25), 1000 * SIZE, 15, 0.1, 1.0) == [
        False, False, False, True, False, False, False, True, False, False]


def test_whole_messages_do_not_take_more_than_the_link_carries() -> None:
    assert messages(whole(1.0), 100 * SIZE, 15, 0.1, 10.0).count(True) == pytest.approx(66, abs=3)


@pytest.mark.parametrize('total, passes', [(30, True), (31, False)])      # 0.25 s, and what may leave at once
def test_a_message_that_would_wait_too_long_does_not_pass(total: int, passes: bool) -> None:
    assert MAX_WHOLE_DEBT == 0.25
    assert any(messages(whole(0.5), 100 * SIZE, total, 1.0, 10.0)) == passes


def test_other_streams_wait_until_a_whole_message_has_crossed_the_link() -> None:
    policer = whole(1.0)
    policer.parts = {'thermal': 0.9}
    assert messages(policer, 100 * SIZE, 24, 0.1, 0.1) == [True]
    assert policer.conforming('thermal', 4, SIZE, 100 * SIZE, 0.23) == 0
    assert policer.conforming('thermal', 4, SIZE, 100 * SIZE, 0.27) > 0


def test_a_link_that_falls_behind_within_a_message_gets_the_rest_of_it() -> None:
    policer = whole(0.1)
    assert policer.conforming('jpeg', 4, SIZE, 100 * SIZE, 0.0, 8, 20) == 4
    assert policer.conforming('jpeg', 8, SIZE, 100 * SIZE, 0.0, 12, 20) == 8
    assert policer.conforming('jpeg', 4, SIZE, 100 * SIZE, 0.1, 0, 20) == 0
    assert policer.conforming('jpeg', 4, SIZE, 100 * SIZE, 0.1, 4, 20) == 0
    assert policer.conforming('jpeg', 4, SIZE, 100 * SIZE, 0.1, 12, 20) == 4     # of a message whose start passed


def test_a_train_does_not_make_a_message_pass() -> None:
    policer = whole(0.1)
    policer.start_probe(10000 * SIZE, 100 * SIZE)
    assert messages(policer, 100 * SIZE, 20, 0.1, 0.1) == [False]


def test_what_was_left_out_was_not_sent() -> None:
    history = SentHistory()
    own = OperatorHistory(history)
    history.add('thermal', 1, 5, SIZE, 1.0)
    own.leave_out('thermal', 4, 2, SIZE, 1.0)
    history.add('tf', 1, 1, 200, 1.1)
    history.add('thermal', 6, 3, SIZE, 1.2)
    own.leave_out('thermal', 6, 3, SIZE, 1.2)
    history.add('thermal', 9, 1, SIZE, 1.3)
    assert own.total == 4200 and history.total == 9200
    assert own.totals('thermal') == (4, 4000) and own.totals('tf') == (1, 200) and own.totals('map') == (0, 0)
    assert own.find('thermal', 3) == (1.0, SIZE, 3000, 3000)
    assert own.find('tf', 1) == (1.1, 200, 3200, 200)
    assert own.find('thermal', 9) == (1.3, SIZE, 4200, SIZE)
    assert [own.find('thermal', seq) for seq in (4, 5, 6, 8)] == [None] * 4
    assert (own.sent_between('thermal', 3, 9), own.sent_between('thermal', 1, 4)) == (1, 2)
    assert own.reached('thermal', 9) and not own.reached('thermal', 10)


def test_what_was_left_out_was_not_sent_together_with_others() -> None:
    history = SentHistory()
    own = OperatorHistory(history)
    history.add('tf', 1, 1, 200, 1.0)
    history.add('thermal', 1, 5, SIZE, 1.0)
    own.leave_out('thermal', 4, 2, SIZE, 1.0)
    history.add('tf', 2, 1, 200, 1.0)
    assert own.find('tf', 2) == (1.0, 200, 3400, 3400)


def test_sequence_numbers_wrap() -> None:
    history = SentHistory()
    own = OperatorHistory(history)
    history.add('thermal', 2 ** 32 - 2, 6, SIZE, 1.0)
    own.leave_out('thermal', 2 ** 32, 4, SIZE, 1.0)
    assert own.find('thermal', 2 ** 32 - 1) is not None and own.find('thermal', 1) is None
    assert own.sent_between('thermal', 2 ** 32 - 2, 3) == 1


def test_memory_is_bounded_and_recent_datagrams_stay_known() -> None:
    history = SentHistory()
    own = OperatorHistory(history)
    count = 5 * MAX_RANGES
    for k in range(count):
        history.add('thermal', 2 * k + 1, 2, SIZE, float(k))
        own.leave_out('thermal', 2 * k + 2, 1, SIZE, float(k))
    assert own.total == count * SIZE and own.totals('thermal') == (count, count * SIZE)
    assert own.find('thermal', 2 * count) is None
    assert own.find('thermal', 2 * count - 1) == (count - 1.0, SIZE, count * SIZE, SIZE)
    assert own.sent_between('thermal', 2 * count - 201, 2 * count - 1) == 100


@pytest.mark.parametrize('every, most', [(0.001, 4 * MAX_RANGES), (0.1, 2 * 2 * 20 / 0.1), (1.0, 4 * MIN_RANGES)])
def test_what_was_left_out_is_forgotten_as_what_was_sent_is(every: float, most: int) -> None:
    """The ranges of one stream are remembered twice: by datagrams and by bytes."""
    history = SentHistory()
    own = OperatorHistory(history)
    for k in range(3 * MAX_RANGES):
        history.add('thermal', 2 * k + 1, 2, SIZE, every * k)
        own.leave_out('thermal', 2 * k + 2, 1, SIZE, every * k)
        assert own.ranges <= most + 4


@given(st.lists(st.tuples(st.sampled_from(['thermal', 'lidar']), st.integers(1, 5), st.integers(0, 5),
                          st.integers(1, 3)), max_size=30))
def test_it_is_the_history_of_an_operator_who_was_sent_only_that(
        chunks: List[Tuple[str, int, int, int]]) -> None:
    """Chunks: (stream, datagrams, of which are sent to the operator at most, size)."""
    everything, alone = SentHistory(), SentHistory()
    own, seqs = OperatorHistory(everything), {'thermal': 0, 'lidar': 0}
    for number, (stream, count, most, size) in enumerate(chunks):
        first, kept = seqs[stream] + 1, min(count, most)
        seqs[stream] += count
        everything.add(stream, first, count, size, float(number))
        if kept < count:
            own.leave_out(stream, first + kept, count - kept, size, float(number))
        if kept:
            alone.add(stream, first, kept, size, float(number))
    assert own.total == alone.total
    for stream, last in seqs.items():
        assert own.totals(stream) == alone.totals(stream)
        found = [own.find(stream, seq) for seq in range(1, last + 1)]
        assert found == [alone.find(stream, seq) if alone.totals(stream)[0] else None for seq in range(1, last + 1)]
        if last:
            assert own.sent_between(stream, 0, last) == sum(packet is not None for packet in found)
