# SPDX-License-Identifier: BSD-3-Clause
"""The robot's measure of the loss of an operator's datagrams."""
from random import Random
from typing import List, Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.teleop.loss import MAX_NUMBERS, MAX_STEP, WINDOW, LossMeter


@pytest.mark.parametrize(('numbers', 'now', 'loss'), [
    ([], 0.0, None),
    ([(0.0, 5)], 0.0, 0.0),
    ([(0.0, 1), (0.1, 2), (0.2, 4)], 0.2, 1 / 4),
    ([(0.0, 1), (0.1, 4), (0.2, 2), (0.3, 3)], 0.3, 0.0),               # reordered
    ([(0.0, 1), (0.1, 1), (0.2, 3), (0.3, 3)], 0.3, 1 / 3),             # repeated
    ([(0.0, 1), (1.0, 5), (1.9, 6)], 1.9, 3 / 6),
    ([(0.0, 1), (1.0, 5), (1.9, 6)], 2.5, 3 / 5),                       # of 2..6
    ([(0.0, 1), (1.0, 5), (1.9, 6)], 3.5, 0.0),                         # of 6
    ([(0.0, 1), (1.0, 5), (1.9, 6)], 4.0, None),
    ([(0.0, 1), (0.1, 5), (2.2, 4), (2.3, 7)], 2.3, 1 / 2),             # 4 belongs to the window before
    ([(0.0, 0xfffffffe), (0.1, 0), (0.2, 1)], 0.2, 1 / 4),              # wraps
    ([(0.0, 1000000), (0.1, 1), (0.2, 2), (0.3, 4)], 0.3, 1 / 4),       # the publisher numbers anew
])
def test_of_one_topic(numbers: List[Tuple[float, int]], now: float, loss: Optional[float]) -> None:
    meter = LossMeter()
    for when, seq in numbers:
        meter.add('commands', seq, when)
    assert meter.loss(now) == (None if loss is None else pytest.approx(loss))


def test_topics_count_together() -> None:
    meter = LossMeter()
    for seq in (1, 2, 3, 4):
        meter.add('requests', seq, 0.0)
    for seq in (7, 10):
        meter.add('commands', seq, 0.0)
    assert meter.loss(0.0) == pytest.approx(2 / 8)


@pytest.mark.parametrize('loss', [0.0, 0.2, 0.5, 0.8])
def test_random_loss(loss: float) -> None:
    meter, random, measured = LossMeter(), Random(1), []
    for number in range(20_000):
        now = number / 200
        if random.random() >= loss:
            for _ in range(1 + (random.random() < 0.1)):
                meter.add('commands', number, now)
        if number > 400 and number % 400 == 0:
            measured.append(meter.loss(now) or 0.0)
    assert sum(measured) / len(measured) == pytest.approx(loss, abs=0.02)
    assert max(abs(one - loss) for one in measured) < 0.12


@given(st.lists(st.tuples(st.floats(0.0, 0.5), st.one_of(
    st.integers(0, 50), st.integers(0, 0xffffffff), st.sampled_from([MAX_STEP, MAX_STEP + 1, 1 << 31])))))
def test_any_numbers_give_a_ratio(numbers: List[Tuple[float, int]]) -> None:
    meter, now = LossMeter(), 0.0
    for pause, seq in numbers:
        now += pause
        meter.add('commands', seq, now)
        loss = meter.loss(now)
        assert loss is None or 0 <= loss <= 1      # None: nothing but repetitions in the window
    assert meter.loss(now + 2 * WINDOW) is None


def test_a_flood_shortens_the_window() -> None:
    meter = LossMeter()
    for seq in range(0, 20 * MAX_NUMBERS, 10):
        meter.add('commands', seq, 0.0)
    assert meter.loss(0.0) == pytest.approx(0.9, abs=0.01)
