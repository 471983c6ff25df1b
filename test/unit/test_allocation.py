# SPDX-License-Identifier: BSD-3-Clause
from typing import Dict, List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.allocation import (
    LEAP_FACTOR,
    UPGRADE_DELAY,
    UPGRADE_MARGIN,
    Allocator,
    DatagramSize,
    Decimation,
    Demand,
    Grant,
    datagram_size,
    shares,
)
from smokebot_udp.congestion.operating_points import OperatingPoint, rate_points


def points(*costs: float) -> List[OperatingPoint]:
    return [OperatingPoint({'rate': cost}, float(cost)) for cost in costs]


def costs(grants: Dict[str, Grant]) -> Dict[str, float]:
    return {name: grant.cost for name, grant in grants.items()}


def test_shares_are_proportional_to_weights() -> None:
    assert shares(600, {'a': Demand(points(1000), 2), 'b': Demand(points(1000), 1)}) == {'a': 400, 'b': 200}


def test_what_one_stream_cannot_use_goes_to_the_others() -> None:
    assert shares(600, {'a': Demand(points(100), 4), 'b': Demand(points(1000), 1), 'c': Demand(points(1000), 1)}) == {
        'a': 100, 'b': 250, 'c': 250}


def test_min_bitrates_come_before_weights() -> None:
    demands = {'a': Demand(points(1000), 100), 'b': Demand(points(1000), 0.0, min_bitrate=200)}
    assert shares(500, demands) == {'a': 300, 'b': 200}
    assert shares(100, demands) == {'a': 0, 'b': 100}


def test_min_bitrates_that_do_not_fit_are_scaled_alike() -> None:
    assert shares(150, {'a': Demand(points(1000), 1, 200), 'b': Demand(points(1000), 9, 100)}) == {
        'a': pytest.approx(100), 'b': pytest.approx(50)}


def test_protected_streams_come_first() -> None:
    demands = {'a': Demand(points(100, 300), 1)}
    assert costs(Allocator().allocate(400, demands, 50, 0.0)) == {'a': 300}
    assert costs(Allocator().allocate(400, demands, 150, 0.0)) == {'a': 100}
    assert Allocator().allocate(400, demands, 350, 0.0)['a'] == (50, None, {}, 0.0)
    assert Allocator().allocate(400, demands, 500, 0.0)['a'].point is None


def test_bandwidth_left_between_points_upgrades_others() -> None:
    demands = {'a': Demand(points(100, 500), 1), 'b': Demand(points(100, 600), 1)}
    # 350 each pay for 100 each; what is left for the one
    assert costs(Allocator().allocate(700, demands, 0, 0.0)) == {'a': 500, 'b': 100}


def test_every_stream_shows_something_before_another_keeps_more() -> None:
    demands = {'a': Demand(points(130, 200), 1), 'b': Demand(points(130, 200), 1), 'c': Demand(points(100, 200), 1)}
    allocator = Allocator()
    allocator.allocate(383, {'b': demands['b'], 'c': demands['c']}, 0, 0.0)
    for now in 1.0, 1.0 + UPGRADE_DELAY:    # each share is less than 130
        grants = allocator.allocate(383, demands, 0, now)
    assert costs(grants) == {'a': 130, 'b': 130, 'c': 100}


def test_downgrades_are_immediate_and_upgrades_wait() -> None:
    allocator, demands = Allocator(), {'a': Demand(points(100, 300, 400), 1)}

    def at(budget: float, now: float) -> float:
        return allocator.allocate(budget, demands, 0, now)['a'].cost
    assert at(450, 0.0) == 400
    assert at(399, 0.1) == 300
    assert at(401, 0.2) == 300                      # not by so little
    assert at(400 * UPGRADE_MARGIN + 1, 1.0) == 300         # not at once
    assert at(399, 1.5) == 300                      # it was not for long
    assert at(400 * UPGRADE_MARGIN + 1, 2.0) == 300
    assert at(400 * UPGRADE_MARGIN + 1, 2.0 + UPGRADE_DELAY) == 400


def test_upgrades_are_immediate_on_a_much_faster_link() -> None:
    allocator, demands = Allocator(), {'a': Demand(points(100, 110), 1)}
    assert allocator.allocate(100, demands, 0, 0.0)['a'].cost == 100
    assert allocator.allocate(100 * LEAP_FACTOR - 1, demands, 0, 0.1)['a'].cost == 100
    assert allocator.allocate(100 * LEAP_FACTOR + 1, demands, 0, 0.1)['a'].cost == 110


def test_forget_makes_the_next_division_immediate() -> None:
    allocator = Allocator()
    before = {'thermal': Demand(rate_points(10, 10000), 9), 'lidar': Demand(rate_points(10, 10000), 1)}
    after = {'thermal': Demand(rate_points(10, 10000), 1), 'lidar': Demand(rate_points(10, 10000), 9)}
    first = costs(allocator.allocate(60000, before, 0, 0.0))
    allocator.forget()
    assert costs(allocator.allocate(60000, after, 0, 0.01)) == {'thermal': first['lidar'], 'lidar': first['thermal']}


def test_a_trembling_budget_changes_nothing() -> None:
    allocator = Allocator()
    demands = {name: Demand(rate_points(10, size), weight) for name, size, weight in (
        ('a', 20000, 4), ('b', 9000, 1), ('c', 3000, 0.5))}
    changes, last = 0, None
    for k in range(600):
        now = costs(allocator.allocate(100000 * (1 + 0.06 * (-1) ** k), demands, 5000, 0.1 * k))
        changes, last = changes + (last is not None and now != last), now
    assert changes <= 2


def test_datagrams_are_short_on_a_slow_link() -> None:
    assert datagram_size(20e6 / 8, 1472) == 1472
    assert datagram_size(0.3e6 / 8, 1472) == 450
    assert datagram_size(1000, 1472) == 400


def test_datagrams_are_halved_with_hysteresis() -> None:
    size = DatagramSize(1472)
    assert [size.update(rate) for rate in (1e6, 40000, 70000, 130000, 70000)] == [1472, 736, 736, 1472, 1472]


def test_decimation_ignores_a_dip_and_ends_when_the_link_recovers() -> None:
    decimation, now = Decimation(), 0.0

    def hold(capacity: float, seconds: float) -> float:
        nonlocal now
        for _ in range(round(10 * seconds)):
            now += 0.1
            decimation.update(capacity, 7500 * decimation.part, now)
        return decimation.part
    assert hold(75000, 10) == 1
    assert hold(1000, 0.5) == 1     # a dip
    assert hold(75000, 5) == 1
    assert hold(10000, 10) == 0.5
    assert hold(1000, 10) == 0.25   # the limit
    assert hold(75000, 10) == 1
    assert hold(1000, 10) == 0.25
    assert hold(80000, 0.1) == 1    # there is plenty


some_points = st.lists(st.floats(1, 1e6), min_size=1, max_size=8).map(lambda costs: points(*sorted(costs)))
demand = st.builds(Demand, some_points, st.floats(0, 10), st.floats(0, 1e5))
everything = st.dictionaries(st.sampled_from('abcdef'), demand, max_size=6)


@given(st.lists(st.tuples(st.floats(0, 3e6), st.floats(0, 1e5), everything, st.floats(0, 2)), max_size=6))
def test_the_budget_is_never_exceeded(rounds: List[Tuple[float, float, Dict[str, Demand], float]]) -> None:
    allocator, now = Allocator(), 0.0
    for budget, protected, demands, pause in rounds:
        now += pause
        grants = allocator.allocate(budget, demands, protected, now)
        assert set(grants) == set(demands)
        assert sum(costs(grants).values()) <= max(0, budget - protected) * (1 + 1e-6)


@given(st.floats(0, 3e6), everything)
def test_shares_add_up_and_honour_min_bitrates(budget: float, demands: Dict[str, Demand]) -> None:
    granted = shares(budget, demands)
    assert sum(granted.values()) <= budget * (1 + 1e-9) + 1e-9
    least = {name: min(one.min_bitrate, one.points[-1].cost) for name, one in demands.items()}
    for name, one in demands.items():
        assert granted[name] <= one.points[-1].cost * (1 + 1e-9)
        if sum(least.values()) <= budget:
            assert granted[name] >= least[name] * (1 - 1e-9)
    if all(one.weight > 0.01 for one in demands.values()):     # nothing is left lying while one could use it
        wanted = sum(one.points[-1].cost for one in demands.values())
        assert sum(granted.values()) >= min(budget, wanted) * (1 - 1e-6)
