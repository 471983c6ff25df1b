# SPDX-License-Identifier: BSD-3-Clause
import math
import random

import pytest

from smokebot_udp.congestion.capacity import CONFIRMED, Capacity


def test_the_first_measurement_counts_for_nearly_all() -> None:
    capacity = Capacity(1e5)
    capacity.measure(3e5, 0.1, 20, 0.0, 1.0, 1.0)
    assert capacity.value == pytest.approx(3e5, rel=0.01)


def test_noisy_measurements_are_averaged_and_exact_ones_are_not() -> None:
    draw, noisy, values = random.Random(1), Capacity(1e5), []
    for number in range(200):
        noisy.measure(1e5 * draw.gauss(1, 0.1), 0.1, 20, 0.005, 1.0, 0.1 * number)
        values.append(noisy.value)
    errors = [value / 1e5 - 1 for value in values[20:]]
    assert math.sqrt(sum(error ** 2 for error in errors) / len(errors)) < 0.05
    exact = Capacity(1e5)
    for number, rate in enumerate((1e5, 1.02e5, 0.98e5, 1.01e5)):
        exact.measure(rate, 0.1, 100, 0.0, 1.0, 0.1 * number)
        assert exact.value == pytest.approx(rate, rel=0.01)


def test_a_contradiction_shows_that_the_link_has_changed() -> None:
    capacity = Capacity(3e5)
    for number in range(50):
        capacity.measure(3e5, 0.1, 20, 0.003, 1.0, 0.1 * number)
    capacity.measure(0.5e5, 0.1, 20, 0.003, 1.0, 5.0)
    assert capacity.value == pytest.approx(0.5e5, rel=0.1)


def test_a_lower_measurement_counts_as_far_as_it_is_trusted() -> None:
    capacity = Capacity(1e5)
    capacity.measure(0.5e5, 0.1, 1000, 0.0, 0.0, 0.0)
    assert capacity.value == 1e5
    capacity.measure(2e5, 0.1, 1000, 0.0, 0.0, 0.1)
    assert capacity.value == pytest.approx(2e5, rel=0.01)


def test_what_is_carried_raises_the_capacity_and_makes_it_uncertain() -> None:
    capacity = Capacity(1e5)
    for number in range(50):
        capacity.measure(1e5, 0.1, 20, 0.01, 1.0, 0.1 * number)
    capacity.carries(0.9e5)
    assert capacity.value == pytest.approx(1e5)
    capacity.carries(3e5)
    assert capacity.value == 3e5
    capacity.measure(2e5, 0.1, 20, 0.01, 1.0, 5.1)
    assert capacity.value == pytest.approx(2e5, rel=0.1)


def test_a_single_lower_measurement_does_not_count_where_no_queue_follows() -> None:
    """A datagram that was late for another reason, as a busy machine, looks like a queue once."""
    capacity = Capacity(1e6)
    for number in range(10):
        capacity.measure(1e6, 0.1, 20, 0.0, 1.0, 0.1 * number)
    capacity.measure(5e5, 0.1, 20, 0.0, 1.0, 1.0)
    assert capacity.value < 6e5
    capacity.recall(1.0 + CONFIRMED / 2)
    assert capacity.value < 6e5
    capacity.recall(1.01 + CONFIRMED)
    assert capacity.value == pytest.approx(1e6, rel=0.05)


def test_a_lower_capacity_that_is_measured_twice_stays() -> None:
    capacity = Capacity(1e6)
    for number in range(10):
        capacity.measure(1e6, 0.1, 20, 0.0, 1.0, 0.1 * number)
    for number in range(2):
        capacity.measure(5e5, 0.1, 20, 0.0, 1.0, 1.0 + 0.1 * number)
    capacity.recall(2.0)
    assert capacity.value < 6e5


@pytest.mark.parametrize('after', ['forgotten', 'more was carried'])
def test_a_value_that_was_contradicted_does_not_come_back_once_it_is_out_of_date(after: str) -> None:
    capacity = Capacity(1e6)
    for number in range(10):
        capacity.measure(1e6, 0.1, 20, 0.0, 1.0, 0.1 * number)
    capacity.measure(5e5, 0.1, 20, 0.0, 1.0, 1.0)
    if after == 'forgotten':
        capacity.forget()
    else:
        capacity.carries(2e6)
    value = capacity.value
    capacity.recall(1.01 + CONFIRMED)
    assert capacity.value == value
