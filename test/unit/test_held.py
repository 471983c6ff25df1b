# SPDX-License-Identifier: BSD-3-Clause
"""Reports of what an operator holds: runs of numbers, and what hostile ones may say."""
import io
from typing import Any, Dict, List, Set

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.msg import Held
from smokebot_udp.serialised import serialised
from smokebot_udp.streams.held import END, MAX_RUNS, Holding, from_message, to_message
from smokebot_udp.udpros.datagram import OVERHEAD

SIZE = 1472


def among(holding: Holding, number: int) -> bool:
    return bool(holding.among(np.array([number]))[0])


def test_numbers_become_runs() -> None:
    holding = Holding.of(7, [9, 3, 1, 2, 3, END - 1])
    assert holding == Holding(7, ((1, 3), (9, 1), (END - 1, 1)))
    assert [number for number in (0, 1, 3, 4, 8, 9, 10, END - 1, END) if among(holding, number)] == [1, 3, 9, END - 1]
    assert Holding.of(7, []) == Holding(7, ())
    assert not among(Holding.of(7, []), 0)


def test_a_run_ends_where_its_count_is_full() -> None:
    assert Holding.of(0, range(5, 70005)).runs == ((5, 65535), (65540, 4465))


def test_the_longest_runs_are_reported_and_of_equal_ones_the_latest() -> None:
    numbers = [10, 11] + list(range(100, 1000, 2))
    holding = Holding.of(1, numbers)
    assert len(holding.runs) == MAX_RUNS
    assert holding.runs[0] == (10, 2)
    assert holding.runs[1:] == tuple((first, 1) for first in range(1000 - 2 * (MAX_RUNS - 1), 1000, 2))


@given(st.sets(st.one_of(st.integers(0, 300), st.integers(0, END - 1)), max_size=MAX_RUNS))
def test_a_report_holds_what_it_was_made_of(numbers: Set[int]) -> None:
    holding = from_message(over_the_wire(to_message(Holding.of(3, numbers), 'map', 4000)))
    assert holding.session == 3
    assert {number for first, count in holding.runs for number in range(first, first + count)} == numbers
    assert all(among(holding, number) for number in numbers)
    assert not any(among(holding, number) for number in {number + 1 for number in numbers} - numbers)


@given(st.dictionaries(st.one_of(st.integers(0, 40), st.integers(0, END - 1)), st.integers(1, 14), max_size=MAX_RUNS))
def test_a_report_of_images_says_how_many_layers_of_each_are_held(layers: Dict[int, int]) -> None:
    holding = from_message(over_the_wire(to_message(Holding.of_layers(3, layers), 'thermal', 4000)))
    assert {number: holding.layers_of(number) for number in layers} == layers
    assert not any(holding.layers_of(number) for number in {number + 1 for number in layers} - set(layers))


def test_images_of_which_the_same_layers_are_held_make_a_run() -> None:
    assert Holding.of_layers(9, {7: 3, 5: 2, 6: 2, 9: 3}) == Holding(9, ((5, 2), (7, 1), (9, 1)), (2, 3, 3))
    assert Holding.of_layers(9, {}) == Holding(9, ()) and Holding.of(9, [4]).layers_of(4) == 0


def test_of_images_the_newest_are_reported_where_not_all_fit() -> None:
    holding = Holding.of_layers(1, {number: 1 + number % 2 for number in range(16)})
    size = OVERHEAD + len(serialised(to_message(Holding(1, ()), 'thermal', SIZE))) + 3 * 7
    found = from_message(over_the_wire(to_message(holding, 'thermal', size)))
    assert found == Holding(1, ((13, 1), (14, 1), (15, 1)), (2, 1, 2))


@pytest.mark.parametrize('layers', [[1], [1, 2, 3], [0, 1]])
def test_layers_that_do_not_belong_to_the_runs_are_refused(layers: List[int]) -> None:
    with pytest.raises(ValueError, match='layers'):
        from_message(Held(first=[1, 5], count=[2, 2], layers=bytes(layers)))


def over_the_wire(message: Held) -> Held:
    buffer = io.BytesIO()
    message.serialize(buffer)
    found = Held()
    found.deserialize(buffer.getvalue())
    return found


def test_a_report_fits_in_a_datagram() -> None:
    holding = Holding.of(1, range(0, 1000, 2))
    message = to_message(holding, 'map', SIZE)
    buffer = io.BytesIO()
    message.serialize(buffer)
    assert SIZE - 6 < len(buffer.getvalue()) + OVERHEAD <= SIZE
    assert set(from_message(message).runs) < set(holding.runs)


@pytest.mark.parametrize(('first', 'count'), [
    ([1], []), ([], [1]), ([5], [0]), ([5, 4], [1, 1]), ([5, 5], [1, 1]), ([5, 7], [3, 1]), ([END - 1], [2]),
    (list(range(0, 2 * MAX_RUNS + 2, 2)), [1] * (MAX_RUNS + 1)),
])
def test_hostile_reports_are_refused(first: List[int], count: List[int]) -> None:
    message: Any = Held(first=first, count=count)
    with pytest.raises(ValueError):
        from_message(message)
