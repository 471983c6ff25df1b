# SPDX-License-Identifier: BSD-3-Clause
"""Which stamps identify a source's messages and say how old they are."""
from typing import Any, Iterable, List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.streams.source_clock import OTHER_EPOCH, PROOF, REPEATED, REPEATS, SourceClock

S = 10 ** 9
NOW = 1700000000


def take(clock: SourceClock, messages: Iterable[Tuple[float, float]]) -> Tuple[List[Any], List[str]]:
    """What crosses of messages (stamp, arrival) [s]: the arrival [ns], 0, or None where a message is refused."""
    given_, warnings = [], []   # type: List[Any], List[str]
    for stamp, arrival in messages:
        try:
            given_.append(clock.take(int(round(stamp * S)), int(round(arrival * S)), warnings))
        except ValueError:
            given_.append(None)
    return given_, warnings


def arrivals(messages: Iterable[Tuple[float, float]]) -> Any:
    return pytest.approx([S * arrival for _, arrival in messages], abs=1e6)


def steady(count: int, age: float, begin: float = NOW, period: float = 0.1) -> List[Tuple[float, float]]:
    return [(begin + period * k - age, begin + period * k) for k in range(count)]


@pytest.mark.parametrize('age', [-0.09, 0.0, 0.05, 3.0, 29.9])
def test_a_stamp_of_this_epoch_is_enough(age: float) -> None:
    assert take(SourceClock(), steady(20, age)) == ([0] * 20, [])


@pytest.mark.parametrize('age', [NOW - 77.0, 3600.0, 30.1, -0.2, -3600.0])
def test_a_steady_source_in_another_epoch_is_recognised_and_named_once(age: float) -> None:
    messages = steady(200, age)
    found, warnings = take(SourceClock(), messages)
    assert found[:PROOF - 1] == [0] * (PROOF - 1) and found[PROOF - 1:] == arrivals(messages[PROOF - 1:])
    assert warnings == [OTHER_EPOCH % age]


def test_a_driver_that_falls_behind_is_never_taken_for_one() -> None:
    """It works at 8 of 10 Hz: its messages grow old, and look old."""
    messages = [(NOW + 0.1 * k, NOW + 0.125 * k) for k in range(5000)]
    found, warnings = take(SourceClock(), messages)
    assert not any(found) and not warnings


def test_nor_is_a_backlog_that_is_worked_off() -> None:
    messages = [(NOW + 0.1 * k, NOW + 30 + 0.01 * k) for k in range(300)]
    found, warnings = take(SourceClock(), [*steady(20, 0.02, NOW - 10), *messages])
    assert not any(found) and not warnings


def test_nor_is_a_driver_that_stood_still_and_stays_behind() -> None:
    messages = [*steady(20, 0.02, NOW - 40), *steady(300, 35.0)]
    found, warnings = take(SourceClock(), messages)
    assert not any(found) and not warnings


def test_a_single_old_message_is_old() -> None:
    """As of a latched topic."""
    assert take(SourceClock(), [(NOW - 300.0, NOW)]) == ([0], [])


def test_a_clock_that_is_set_is_followed_both_ways() -> None:
    clock = SourceClock()
    assert not any(take(clock, steady(20, 0.02))[0])
    found, warnings = take(clock, steady(20, 5000.0, NOW + 10))
    assert all(found[PROOF:]) and len(warnings) == 1
    found, warnings = take(clock, steady(20, 0.02, NOW + 20))
    assert not any(found[PROOF:]) and not warnings


def test_whole_seconds_are_told_apart() -> None:
    """A camera of 10 Hz: of 100 images all but a few came, without this 10."""
    messages = [(float(NOW + k // 10), NOW + 0.1 * k) for k in range(100)]
    found, warnings = take(SourceClock(), messages)
    assert found[:REPEATS] == [0, None, None] and warnings == [REPEATED]
    assert found[REPEATS:] == arrivals(messages[REPEATS:]) and len(set(found[REPEATS:])) == 97


@pytest.mark.parametrize('stamp', [NOW, 5.0])
def test_a_stamp_that_never_changes_is_named_once(stamp: float) -> None:
    found, warnings = take(SourceClock(), [(stamp, NOW + 0.1 * k) for k in range(100)])
    assert found.count(None) == (REPEATS - 1) and warnings.count(REPEATED) == 1
    assert len(set(found[REPEATS:])) == 97


def test_a_message_that_comes_twice_is_refused() -> None:
    messages = steady(20, 0.02)
    messages.insert(7, messages[6])
    found, warnings = take(SourceClock(), messages)
    assert found == [0] * 7 + [None] + [0] * 13 and not warnings


def test_two_publishers_of_two_clocks_take_turns() -> None:
    messages = [(NOW + 0.1 * k - 0.3 * (k % 2), NOW + 0.1 * k) for k in range(50)]
    found, warnings = take(SourceClock(), messages)
    assert all(found[2 * REPEATS:]) and warnings == [REPEATED]


def test_messages_at_one_time_get_different_ones() -> None:
    """By a simulation's clock that stands still."""
    found, _ = take(SourceClock(), [(NOW, NOW)] * 20)
    assert len(set(found[REPEATS:])) == 17


@given(st.lists(st.tuples(st.integers(0, 20 * S), st.integers(0, 20 * S)), max_size=60))
def test_what_crosses_identifies_a_message(times: List[Tuple[int, int]]) -> None:
    clock, last, crossed = SourceClock(), None, []     # type: SourceClock, Any, List[int]
    for stamp, arrival in times:
        try:
            given_ = clock.take(stamp, arrival, [])
        except ValueError:
            assert stamp == last
            continue
        finally:
            last = stamp
        if given_:
            assert not crossed or given_ > crossed[-1]
            crossed.append(given_)
