# SPDX-License-Identifier: BSD-3-Clause
"""The replay window against a set of all counters, and the memory of handshakes."""
from typing import List

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.link.replay import MAX_HANDSHAKES, WINDOW, HandshakeMemory, ReplayWindow


def take(window: ReplayWindow, *counters: int) -> List[bool]:
    """Whether each of a batch of authentic counters is taken."""
    numbers = np.array(counters, np.int64)
    fresh = window.fresh(numbers)
    taken = np.zeros(len(numbers), bool)
    taken[fresh] = window.note(numbers[fresh])
    return taken.tolist()


def test_each_counter_once() -> None:
    window = ReplayWindow()
    assert WINDOW >= 1024
    assert take(window, 0, 1, 2) == [True] * 3
    assert take(window, 1, 3, 3, 0, 5) == [False, True, False, False, True]
    assert take(window, 4) == [True]
    assert take(window, 4) == [False]
    assert window.highest == 5


def test_a_late_one_within_the_window() -> None:
    window = ReplayWindow()
    take(window, WINDOW + 9)
    assert take(window, 9, 10, 11, 10) == [False, True, True, False]


def test_a_jump_clears_the_window() -> None:
    window = ReplayWindow()
    take(window, *range(WINDOW))
    assert take(window, 10 * WINDOW) == [True]
    assert take(window, 9 * WINDOW + 1) == [True]
    assert take(window, 9 * WINDOW + 1, WINDOW - 1) == [False, False]


def test_what_is_not_authentic_is_not_noted() -> None:
    window = ReplayWindow()
    assert window.fresh(np.array([1 << 40, 5])).all()
    assert take(window, 5) == [True]


def test_nothing_is_noted_of_an_empty_batch() -> None:
    window = ReplayWindow()
    assert take(window) == [] and window.highest == -1


STEPS = st.lists(st.lists(st.one_of(st.integers(0, 40), st.integers(WINDOW - 20, WINDOW + 20),
                                    st.integers(0, 5 * WINDOW)), max_size=8), max_size=30)


@given(STEPS)
def test_no_counter_is_taken_twice_and_none_is_lost_within_the_window(batches: List[List[int]]) -> None:
    window, taken, highest = ReplayWindow(), set(), -1
    for counters in batches:
        for counter, result in zip(counters, take(window, *counters)):
            if result:
                assert counter not in taken
            elif counter > highest - WINDOW:
                assert counter in taken
            if result:
                taken.add(counter)
        highest = max([highest, *counters])
        assert window.highest == highest


def test_handshakes_are_remembered_for_their_time() -> None:
    memory = HandshakeMemory(120.0)
    memory.add(b'first', 0.0)
    memory.add(b'second', 100.0)
    assert b'first' in memory and b'second' in memory and b'third' not in memory
    memory.add(b'third', 121.0)
    assert b'first' not in memory and b'second' in memory
    assert len(memory) == 2


@pytest.mark.parametrize('extra', [1, 1000])
def test_the_memory_of_handshakes_is_bounded(extra: int) -> None:
    memory = HandshakeMemory(120.0)
    for number in range(MAX_HANDSHAKES + extra):
        memory.add(number.to_bytes(32, 'big'), 1.0)
    assert len(memory) == MAX_HANDSHAKES
    assert extra.to_bytes(32, 'big') in memory and (extra - 1).to_bytes(32, 'big') not in memory
