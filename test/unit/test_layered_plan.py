# SPDX-License-Identifier: BSD-3-Clause
"""Plans: the best of all plans of a small case, budgets kept."""
import itertools
import math
from typing import Dict, Iterator, List, Optional, Tuple

import needs_numba  # noqa: F401
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.arrays import FloatArray, IntArray
from smokebot_udp.codecs.layered.pieces import GROUP, Layer, codes_of, parts_of
from smokebot_udp.codecs.layered.plan import LAYER_BYTES, best_plan, promised, upper_hull, worth
from smokebot_udp.codecs.layered.prices import bytes_at_price, filling_bytes
from smokebot_udp.codecs.layered.survival import survival

HEAD, ROOM = 93, 1379


def curve(length: int, points: int = 60) -> Tuple[IntArray, FloatArray]:
    """(ends, values) of a stream whose error falls ever more slowly."""
    ends = np.unique(np.geomspace(20, length, points).astype(int))
    return ends, worth(76800 * 3000.0 / (ends / 20.0) ** 1.6, 76800, 0.065)


def test_hull_by_hand() -> None:
    hull = upper_hull(np.array([0.0, 1, 2, 3, 4, 5]), np.array([0.0, 4, 5, 9, 9.5, 9]))
    assert hull.points.tolist() == [0, 1, 3, 4]
    assert hull.x.tolist() == [0, 1, 3, 4] and hull.y.tolist() == [0, 4, 9, 9.5]
    assert upper_hull(np.array([0.0, 1]), np.array([3.0, 2])).points.tolist() == [0]


def test_prices_by_hand() -> None:
    # two parts of 100 and 60 bytes; thresholds 4 and 2, which cost a quarter and a half of a byte
    parts = np.array([8.0, 1.0]), np.array([100.0, 60.0]), np.array([3.0, 0.5]), np.array([0.25, 0.5])
    assert bytes_at_price(25.0, *parts).tolist() == [0, 0]
    assert bytes_at_price(5.0, *parts).tolist() == [25, 0]
    assert bytes_at_price(2.0, *parts).tolist() == [15, 50]
    assert bytes_at_price(0.1, *parts).tolist() == [0, 80]
    assert filling_bytes(90.0, *parts).tolist() == [0, 80]
    # at the price of 4 the first part changes from 25 bytes of threshold 4 to 50 of threshold 2: two fifths do
    assert filling_bytes(35.0, *parts) == pytest.approx([15, 20])


def test_worth() -> None:
    errors = np.array([300.0, 75.0, 0.0])
    assert worth(errors, 3, None) == pytest.approx([-125.91254 ** 0.0625, -100.02 ** 0.0625, -25.02 ** 0.0625,
                                                    -0.02 ** 0.0625])
    assert worth(errors, 3, 1.0) == pytest.approx([-10 * math.log10(126.89254), -10 * math.log10(101),
                                                   -10 * math.log10(26), 0])


def all_plans(count: int, space: int, layers: int, step: int) -> Iterator[List[Layer]]:
    """All of so many layers with pieces of multiples of `step` bytes."""
    for thresholds in itertools.combinations(range(1, count + 1), layers):
        left = space - LAYER_BYTES * layers
        for sizes in itertools.product(range(step, left + 1, step), repeat=layers):
            if left - step < sum(sizes) <= left:
                yield [Layer(*layer) for layer in zip(thresholds, sizes)]


@pytest.mark.parametrize('losses', [{0.1: 1.0}, {0.3: 1.0}, {0.05: 0.7, 0.5: 0.3}])
def test_no_small_plan_promises_more(losses: Dict[float, float]) -> None:
    ends, values = curve(4000)
    budget = 4 * (HEAD + 300)
    plan = best_plan(ends, values, budget, losses, None, HEAD, 300)
    likely = survival(plan.count, losses, None)
    promise = promised(plan.count, plan.layers, ends, values, likely)
    space = budget // plan.count - HEAD
    best = max(promised(plan.count, layers, ends, values, likely)
               for number in (1, 2, 3) for layers in all_plans(plan.count, space, number, 24))
    assert promise > best - 0.1


@given(st.integers(1000, 900000), st.integers(300, 400000), st.floats(0, 0.95), st.floats(0, 1),
       st.sampled_from([None, 1.0, 4.0, 50.0]))
@settings(max_examples=60, deadline=None)
def test_plans_are_possible_and_keep_the_budget(budget: int, length: int, loss: float, share: float,
                                                burst: Optional[float]) -> None:
    ends, values = curve(length)
    plan = best_plan(ends, values, budget, {loss: share, 0.6: 1 - share}, burst, HEAD, ROOM)
    count, layers = plan.count, plan.layers
    content = sum(layer.size + LAYER_BYTES for layer in layers)
    assert content <= ROOM and count * (HEAD + content) <= budget
    thresholds = [layer.threshold for layer in layers]
    assert thresholds == sorted(set(thresholds)) and thresholds[0] >= 1
    assert count % codes_of(count) == 0 and thresholds[-1] <= count // codes_of(count) <= GROUP
    assert min(layer.size for layer in layers) >= 1
    # not more than the stream, but for filling the last layer
    filled = sum(layer.size * layer.threshold * parts_of(layer.threshold, count) for layer in layers)
    assert filled < length + sum(layer.threshold * parts_of(layer.threshold, count) for layer in layers)


@pytest.mark.parametrize('budget, head, room', [
    (600, 290, 238),    # a second datagram would have room for 10 bytes
    (1060, 290, 238), (330, 290, 40), (310, 290, 20), (300, 290, 10), (2000, 290, 60)])
def test_plans_of_datagrams_that_are_nearly_all_head(budget: int, head: int, room: int) -> None:
    ends, values = curve(3000)
    for losses in ({0.1: 1.0}, {0.05: 0.7, 0.5: 0.3}):
        plan = best_plan(ends, values, budget, losses, None, head, room)
        content = sum(layer.size + LAYER_BYTES for layer in plan.layers)
        assert min(layer.size for layer in plan.layers) >= 1
        assert content <= room and plan.count * (head + content) <= budget
        assert content > min(room, budget - head) / 2


def test_all_of_a_short_stream_is_sent() -> None:
    ends, values = curve(3000)
    plan = best_plan(ends, values, 40000, {0.1: 1.0}, None, HEAD, ROOM)
    assert sum(layer.size * layer.threshold for layer in plan.layers) >= 3000
    assert survival(plan.count, {0.1: 1.0}, None)[plan.layers[-1].threshold - 1] > 0.999


def test_expected_heavier_losses_lower_the_thresholds() -> None:
    ends, values = curve(60000)
    known, robust = (best_plan(ends, values, 20000, losses, None, HEAD, ROOM)
                     for losses in ({0.05: 1.0}, {0.05: 0.7, 0.5: 0.3}))
    first = [plan.layers[0].threshold / plan.count for plan in (known, robust)]
    assert first[1] < 0.6 < first[0]


@pytest.mark.parametrize('budget, room', [(50, ROOM), (5000, 3)])
def test_too_few_bytes(budget, room) -> None:
    ends, values = curve(3000)
    with pytest.raises(ValueError, match='too few'):
        best_plan(ends, values, budget, {0.1: 1.0}, None, HEAD, room)


@pytest.mark.parametrize('loss, burst, least', [(0.0, None, 1), (0.5, None, 6), (0.5, 10.0, 32), (0.9, None, 38)])
def test_an_image_has_so_many_datagrams_that_one_comes(loss: float, burst: Optional[float], least: int) -> None:
    ends, values = curve(20000)
    for budget in (8000, 20000):
        plan = best_plan(ends, values, budget, {loss: 0.9, 0.95: 0.1}, burst, HEAD, ROOM)
        assert plan.count >= min(least, budget // (4 * HEAD))
        assert plan.count * (HEAD + sum(layer.size + LAYER_BYTES for layer in plan.layers)) <= budget
    few = best_plan(ends, values, 1500, {loss: 1.0}, burst, HEAD, ROOM)
    assert few.count >= min(least, 1500 // (4 * HEAD))


@pytest.mark.parametrize('budget', [8000, 20000, 60000, 150000])
@pytest.mark.parametrize('loss', [0.2, 0.5, 0.9])
def test_the_first_layer_is_restored_nearly_always(budget: int, loss: float) -> None:
    plan = best_plan(*curve(200000), budget, {loss: 1.0}, None, HEAD, ROOM)
    shown = survival(plan.count, {loss: 1.0}, None)[plan.layers[0].threshold - 1]
    assert shown >= 0.98 or plan.layers[0].threshold == 1 and plan.count >= budget // (4 * HEAD)
