# SPDX-License-Identifier: BSD-3-Clause
from typing import List, Optional

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.monitoring.history import ASCII_BARS, BARS, MAX_SERIES, SPAN, History, sparkline


def test_the_last_number_of_a_slot_counts() -> None:
    history: History[str] = History(slots=4)        # of 15 s
    for when, number in (0.0, 1.0), (14.0, 2.0), (16.0, 3.0), (50.0, 4.0):
        history.add({'a': number}, when)
    assert history.series('a', 59.0) == [2.0, 3.0, None, 4.0]
    assert history.series('a', 60.0) == [3.0, None, 4.0, None]
    assert history.series('b', 60.0) == [None] * 4


def test_unknown_numbers_are_gaps_and_old_series_are_forgotten() -> None:
    history: History[int] = History(slots=4)
    history.add({1: 1.0, 2: 1.0}, 0.0)
    history.add({1: None, 2: 1.0}, 20.0)
    assert history.series(1, 20.0) == [None, None, 1.0, None]
    history.add({3: 1.0}, SPAN + 1)
    assert history.series(1, 0.0) == [None] * 4 and history.series(2, 20.0)[-1] == 1.0


def test_the_number_of_series_is_bounded() -> None:
    history: History[int] = History()
    history.add({number: 1.0 for number in range(2 * MAX_SERIES)}, 0.0)
    assert sum(history.series(number, 0.0)[-1] is not None for number in range(2 * MAX_SERIES)) == MAX_SERIES


@pytest.mark.parametrize('numbers, width, line', [
    ([0.0, 1.0, 2.0, 7.0], 4, '▁▂▃█'), ([None, 7.0, None, 0.0], 4, ' █ ▁'), ([0.0, 0.0], 2, '▁▁'),
    ([-3.0, 1.0], 2, '▁█'),
    ([None, None], 2, '  '), ([], 3, ''), ([1.0, 7.0, 0.0, None, None, None], 3, '█▁ '), ([1.0, 7.0, 7.0], 2, '██')])
def test_sparkline(numbers: List[Optional[float]], width: int, line: str) -> None:
    assert sparkline(numbers, width) == line
    assert sparkline(numbers, width, ASCII_BARS) == ''.join(
        sign if sign == ' ' else ASCII_BARS[BARS.index(sign)] for sign in line)


@given(st.lists(st.none() | st.floats(-1e300, 1e300), max_size=60), st.integers(0, 80))
def test_a_sparkline_is_never_longer_than_asked_for(numbers: List[Optional[float]], width: int) -> None:
    line = sparkline(numbers, width)
    assert len(line) <= max(1, width) and set(line) <= set(BARS + ' ')
