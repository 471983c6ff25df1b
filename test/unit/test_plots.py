# SPDX-License-Identifier: BSD-3-Clause
from typing import List, Optional

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.monitoring.plots import ASCII_BARS, BARS, MAX_SERIES, SLOTS, SPAN, Plots

SLOT = SPAN / SLOTS


def line(numbers: List[Optional[float]], bars: int = SLOTS) -> str:
    """The sparkline of numbers of a slot each."""
    plots = Plots()
    for at, number in enumerate(numbers):
        plots.begin(bars, at * SLOT)
        drawn = plots.line('a', number)
    assert len(drawn) == plots.width == bars + 1 and drawn[0] == ' '
    return drawn[1:]


@pytest.mark.parametrize('numbers, drawn', [
    ([0.0, 1.0, 2.0, 7.0], '▁▂▃█'), ([7.0, None, 0.0], '█ ▁'), ([0.0, 0.0], '▁▁'), ([-3.0, 1.0], '▁█'), ([None], ' ')])
def test_a_bar_for_each_slot(numbers: List[Optional[float]], drawn: str) -> None:
    assert line(numbers) == drawn.rjust(SLOTS)


def test_fewer_bars_show_the_greatest_number_of_their_parts() -> None:
    numbers = [1.0, 7.0, 0.0, 0.0] + [None] * 8 + [3.5, 0.0, 0.0, 0.0, 7.0, 0.0, 0.0, 0.0]
    assert line(numbers, 5) == '█  ▅█' and line(numbers, 10) == '█▁    ▅▁█▁'


def test_the_greatest_number_of_a_slot_counts() -> None:
    plots = Plots()
    for when, number in (0.0, 7.0), (0.4 * SLOT, 1.0), (SLOT, 3.5):
        plots.begin(SLOTS, when)
        drawn = plots.line('a', number)
    assert drawn.strip() == '█▅'


def test_old_numbers_are_forgotten() -> None:
    plots = Plots()
    plots.begin(SLOTS, 0.0)
    plots.line('a', 7.0)
    plots.begin(SLOTS, SPAN - SLOT)
    assert plots.line('a', None) == ' █' + (SLOTS - 1) * ' '
    plots.begin(SLOTS, SPAN)
    assert plots.line('a', None) == (SLOTS + 1) * ' ' == plots.line('b', None)


def test_the_number_of_series_is_bounded() -> None:
    plots = Plots()
    plots.begin(SLOTS, 0.0)
    assert sum(plots.line(number, 1.0).strip() != '' for number in range(2 * MAX_SERIES)) == MAX_SERIES


def test_without_bars_there_is_nothing() -> None:
    plots = Plots()
    assert plots.line('a', 1.0) == '' and plots.width == 0
    plots.begin(0, 0.0)
    assert plots.line('a', 1.0) == '' and plots.width == 0


def test_ascii_bars() -> None:
    plots = Plots(ASCII_BARS)
    plots.begin(5, 0.0)
    assert plots.line('a', 1.0) == '     #'


@given(st.lists(st.none() | st.floats(-1e300, 1e300), min_size=1, max_size=60), st.sampled_from([5, 10, 20]))
def test_every_sparkline_has_its_width(numbers: List[Optional[float]], bars: int) -> None:
    assert set(line(numbers, bars)) <= set(BARS + ' ')
