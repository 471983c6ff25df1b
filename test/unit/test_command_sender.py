# SPDX-License-Identifier: BSD-3-Clause
import math
import zlib
from typing import List, Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.teleop.command_copy import MAX_COMMAND_SIZE, Copy
from smokebot_udp.teleop.command_sender import BURST, MAX_GAP, MEAN_GAP, MISS, REACH, CommandSender, copy_gap
from smokebot_udp.teleop.robot_clock import RobotTime

MD5SUM = '9f195f881246fdfa2798d1d3eebca84a'
MADE = RobotTime(9, 5000000, 20000)


def sender(loss: Optional[float] = 0.2, max_age: float = 0.3) -> CommandSender:
    made = CommandSender(7, MD5SUM, max_age)
    made.loss = loss
    return made


def sent_until(source: CommandSender, end: float) -> List[Tuple[float, int]]:
    """(time, number) of the copies, polled at the deadlines."""
    copies = []
    while True:
        due = source.deadline()
        if due is None or due > end:
            return copies
        copy = source.poll(due)
        if copy is not None:
            copies.append((due, copy.number))


def test_a_copy_is_what_the_message_carries() -> None:
    source = sender()
    source.put(b'twist', MADE, 3, 1.0)
    checksum = zlib.crc32(b'twist', zlib.crc32(MD5SUM.encode()))
    assert source.poll(1.0) == Copy(7, 9, 1, 5000000, 20000, 3, checksum, b'twist')
    assert Copy.of(Copy(1, 2, 3, 4, 5, 6, 7, b'8')) == Copy(1, 2, 3, 4, 5, 6, 7, b'8')


def test_a_clock_that_is_known_too_badly_is_of_no_use() -> None:
    """No copy would leave, and nobody would be told why."""
    source = sender(max_age=0.3)
    assert not source.accepts(None) and not source.accepts(RobotTime(9, 5000000, 300000))
    assert source.accepts(RobotTime(9, 5000000, 299000))


def test_before_the_first_command_there_is_nothing_to_send() -> None:
    source = sender()
    assert source.deadline() is None and source.poll(1.0) is None


@pytest.mark.parametrize('loss, times', [
    # the mean gap is 60 ms * ln 3 / (copies - 1); a gap is half of it, and grows by it in 60 ms
    (0.0, [0.0, 16.5, 42.0]), (0.2, [0.0, 6.6, 14.6, 24.4, 36.4, 51.0]),
    (0.5, [0.0, 2.5, 5.3, 8.3, 11.5, 15.0, 18.8, 22.9, 27.4, 32.3, 37.5, 43.2, 49.4, 56.1])])
def test_copies_are_spread_by_the_loss(loss: float, times: List[float]) -> None:
    source = sender(loss)
    source.put(b'', MADE, 3, 1.0)
    assert [1e3 * (at - 1) for at, _ in sent_until(source, 1 + REACH)] == pytest.approx(times, abs=0.06)


@pytest.mark.parametrize('loss', [0.05, 0.1, 0.2, 0.3, 0.4, 0.5])
def test_a_copy_arrives_within_the_reach_almost_surely(loss: float) -> None:
    source = sender(loss)
    source.put(b'', MADE, 3, 1.0)
    assert loss ** len(sent_until(source, 1 + REACH)) <= MISS


@pytest.mark.parametrize('loss', [None, -1.0, 1.1, math.nan, math.inf, -math.inf])
def test_a_loss_that_is_none_is_unknown(loss: Optional[float]) -> None:
    assert copy_gap(loss, 0.0) == copy_gap(0.5, 0.0)


@given(st.floats(0, 1), st.floats(0, 100))
def test_gaps_are_bounded_and_grow_with_age_not_with_loss(loss: float, age: float) -> None:
    assert 0 < copy_gap(loss, age) <= MAX_GAP
    assert copy_gap(loss, age) <= copy_gap(loss, age + 0.01)
    assert copy_gap(min(1.0, loss + 0.1), age) <= copy_gap(loss, age)


def test_the_last_command_is_sent_until_the_robot_could_not_accept_it() -> None:
    source = sender()
    source.put(b'', MADE, 3, 1.0)
    copies = sent_until(source, 2.0)
    assert 1.23 < copies[-1][0] <= 1.28 + 1e-9      # max_age less the uncertainty
    assert source.deadline() is None


def test_a_command_that_is_valid_for_long_is_sent_5_times_a_second() -> None:
    source = sender(max_age=20.0)
    source.put(b'', MADE, 3, 0.0)
    late = [at for at, _ in sent_until(source, 30.0) if at > 10]
    assert len(late) == pytest.approx(50, abs=1)


def test_a_clock_less_certain_than_the_life_sends_nothing() -> None:
    source = sender()
    source.put(b'', RobotTime(9, 5000000, 300001), 3, 1.0)
    assert source.poll(1.0) is None and source.deadline() is None


def test_a_newer_command_replaces_the_last_one_at_once() -> None:
    source = sender()
    source.put(b'old', MADE, 3, 1.0)
    assert sent_until(source, 1.01)[-1][1] == 1
    source.put(b'new', MADE, 3, 1.011)
    assert source.deadline() == 1.011
    copy = source.poll(1.011)
    assert copy is not None and (copy.number, copy.data) == (2, b'new')


def test_a_withdrawn_command_is_not_sent_again() -> None:
    source = sender()
    source.put(b'', MADE, 3, 1.0)
    source.poll(1.0)
    source.withdraw()
    assert source.deadline() is None and source.poll(1.1) is None


def test_a_message_that_is_too_long_is_refused_and_ends_the_last_command() -> None:
    source = sender()
    source.put(b'', MADE, 3, 1.0)
    with pytest.raises(ValueError, match='1025 bytes'):
        source.put(bytes(MAX_COMMAND_SIZE + 1), MADE, 3, 1.01)
    assert source.poll(1.02) is None
    source.put(bytes(MAX_COMMAND_SIZE), MADE, 3, 1.03)
    assert source.poll(1.03) is not None


def test_an_operator_that_sleeps_for_longer_than_the_life_sends_nothing_afterwards() -> None:
    source = sender()
    source.put(b'', MADE, 3, 1.0)
    source.poll(1.0)
    assert source.poll(5.0) is None


def test_after_its_clock_went_back_the_next_command_is_sent_soon() -> None:
    source = sender()
    source.put(b'', MADE, 3, 1000.0)
    source.poll(1000.0)
    assert source.poll(1.0) is None
    source.put(b'', MADE, 3, 1.0)
    assert len(sent_until(source, 1.1)) > 5 and source.deadline() is not None


@given(st.floats(0, 1), st.lists(st.tuples(st.floats(0, 0.2), st.floats(0, 0.02)), max_size=300))
def test_copies_a_second_are_bounded_and_numbers_never_fall(loss: float, steps: List[Tuple[float, float]]) -> None:
    """Sources of any rate, threads that are late, whatever the loss."""
    source, now, copies = sender(loss), 1.0, []
    for wait, late in steps:
        source.put(b'', MADE, 3, now)
        end = now + wait
        while (due := source.deadline()) is not None and due + late <= end:
            now = max(now, due + late)
            copy = source.poll(now)
            if copy is not None:
                copies.append((now, copy.number))
        now = max(now, end)
    times = [at for at, _ in copies]
    assert [number for _, number in copies] == sorted(number for _, number in copies)
    for i in range(len(times)):
        within = sum(1 for at in times[i:] if at <= times[i] + 0.1)
        assert within <= 0.1 / MEAN_GAP + BURST + 2


@pytest.mark.parametrize('rate', [40, 100, 1000])
def test_a_fast_source_gets_200_copies_a_second_after_a_burst(rate: int) -> None:
    source, copies = sender(0.9), []
    source.put(b'', MADE, 3, 1.0)
    for i in range(rate):
        source.put(b'', MADE, 3, 11 + i / rate)
        copies += sent_until(source, 11 + (i + 0.99) / rate)
    assert len(copies) == pytest.approx(200 + BURST, abs=2)
    assert copies[0] == (11.0, 2) and copies[-1][1] >= rate - 10     # always the newest


def test_each_new_command_gets_a_copy_if_the_rate_permits() -> None:
    source, numbers = sender(0.0), []
    for i in range(1, 200):
        source.put(b'', MADE, 3, 0.01 * i)
        numbers += [number for _, number in sent_until(source, 0.01 * i)]
    assert numbers == list(range(1, 200))
