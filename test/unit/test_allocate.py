# SPDX-License-Identifier: BSD-3-Clause
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.allocation import HOLD, LEAP, MARGIN, Allocator, Demand, datagram_size, shares
from smokebot_udp.congestion.operating_points import Level, rate_levels


def levels(*costs):
    return [Level({'rate': cost}, float(cost)) for cost in costs]


def costs(grants):
    return {name: grant.cost for name, grant in grants.items()}


def test_shares_go_by_weights():
    assert shares(600, {'a': Demand(levels(1000), 2), 'b': Demand(levels(1000), 1)}) == {'a': 400, 'b': 200}


def test_what_one_cannot_use_flows_to_the_others():
    assert shares(600, {'a': Demand(levels(100), 4), 'b': Demand(levels(1000), 1), 'c': Demand(levels(1000), 1)}) == {
        'a': 100, 'b': 250, 'c': 250}


def test_floors_come_before_weights():
    demands = {'a': Demand(levels(1000), 100), 'b': Demand(levels(1000), 0.0, floor=200)}
    assert shares(500, demands) == {'a': 300, 'b': 200}
    assert shares(100, demands) == {'a': 0, 'b': 100}


def test_floors_that_do_not_fit_give_way_alike():
    assert shares(150, {'a': Demand(levels(1000), 1, 200), 'b': Demand(levels(1000), 9, 100)}) == {
        'a': pytest.approx(100), 'b': pytest.approx(50)}


def test_what_is_protected_comes_first():
    demands = {'a': Demand(levels(100, 300), 1)}
    assert costs(Allocator().allocate(400, demands, 50, 0.0)) == {'a': 300}
    assert costs(Allocator().allocate(400, demands, 150, 0.0)) == {'a': 100}
    assert Allocator().allocate(400, demands, 350, 0.0)['a'] == (50, None, {}, 0.0)
    assert Allocator().allocate(400, demands, 500, 0.0)['a'].level is None


def test_what_levels_leave_over_lifts_others():
    demands = {'a': Demand(levels(100, 500), 1), 'b': Demand(levels(100, 600), 1)}
    # 350 each pay for 100 each; what is left for the one
    assert costs(Allocator().allocate(700, demands, 0, 0.0)) == {'a': 500, 'b': 100}


def test_down_at_once_up_with_patience():
    allocator, demands = Allocator(), {'a': Demand(levels(100, 300, 400), 1)}

    def at(budget, now):
        return allocator.allocate(budget, demands, 0, now)['a'].cost
    assert at(450, 0.0) == 400
    assert at(399, 0.1) == 300
    assert at(401, 0.2) == 300                      # not by so little
    assert at(400 * MARGIN + 1, 1.0) == 300         # not at once
    assert at(399, 1.5) == 300                      # it was not for long
    assert at(400 * MARGIN + 1, 2.0) == 300
    assert at(400 * MARGIN + 1, 2.0 + HOLD) == 400


def test_up_at_once_where_the_link_has_become_much_wider():
    allocator, demands = Allocator(), {'a': Demand(levels(100, 110), 1)}
    assert allocator.allocate(100, demands, 0, 0.0)['a'].cost == 100
    assert allocator.allocate(100 * LEAP - 1, demands, 0, 0.1)['a'].cost == 100
    assert allocator.allocate(100 * LEAP + 1, demands, 0, 0.1)['a'].cost == 110


def test_a_new_focus_takes_effect_at_once():
    allocator = Allocator()
    before = {'thermal': Demand(rate_levels(10, 10000), 9), 'lidar': Demand(rate_levels(10, 10000), 1)}
    after = {'thermal': Demand(rate_levels(10, 10000), 1), 'lidar': Demand(rate_levels(10, 10000), 9)}
    first = costs(allocator.allocate(60000, before, 0, 0.0))
    allocator.forget()
    assert costs(allocator.allocate(60000, after, 0, 0.01)) == {'thermal': first['lidar'], 'lidar': first['thermal']}


def test_a_budget_that_trembles_changes_nothing():
    allocator = Allocator()
    demands = {name: Demand(rate_levels(10, size), weight) for name, size, weight in (
        ('a', 20000, 4), ('b', 9000, 1), ('c', 3000, 0.5))}
    changes, last = 0, None
    for k in range(600):
        now = costs(allocator.allocate(100000 * (1 + 0.06 * (-1) ** k), demands, 5000, 0.1 * k))
        changes, last = changes + (last is not None and now != last), now
    assert changes <= 2


def test_datagrams_are_short_where_the_link_is_slow():
    assert datagram_size(20e6 / 8, 1472) == 1472
    assert datagram_size(0.3e6 / 8, 1472) == 450
    assert datagram_size(1000, 1472) == 400


some_levels = st.lists(st.floats(1, 1e6), min_size=1, max_size=8).map(lambda costs: levels(*sorted(costs)))
demand = st.builds(Demand, some_levels, st.floats(0, 10), st.floats(0, 1e5))
everything = st.dictionaries(st.sampled_from('abcdef'), demand, max_size=6)


@given(st.lists(st.tuples(st.floats(0, 3e6), st.floats(0, 1e5), everything, st.floats(0, 2)), max_size=6))
def test_the_budget_is_never_exceeded(rounds):
    allocator, now = Allocator(), 0.0
    for budget, protected, demands, pause in rounds:
        now += pause
        grants = allocator.allocate(budget, demands, protected, now)
        assert set(grants) == set(demands)
        assert sum(costs(grants).values()) <= max(0, budget - protected) * (1 + 1e-6)


@given(st.floats(0, 3e6), everything)
def test_shares_add_up_and_honour_floors(budget, demands):
    granted = shares(budget, demands)
    assert sum(granted.values()) <= budget * (1 + 1e-9) + 1e-9
    floors = {name: min(one.floor, one.levels[-1].cost) for name, one in demands.items()}
    for name, one in demands.items():
        assert granted[name] <= one.levels[-1].cost * (1 + 1e-9)
        if sum(floors.values()) <= budget:
            assert granted[name] >= floors[name] * (1 - 1e-9)
    if all(one.weight > 0.01 for one in demands.values()):     # nothing is left lying while one could use it
        wanted = sum(one.levels[-1].cost for one in demands.values())
        assert sum(granted.values()) >= min(budget, wanted) * (1 - 1e-6)
