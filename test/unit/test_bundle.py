# SPDX-License-Identifier: BSD-3-Clause
"""Two paths to one operator as one link, driven by reports of each."""
import itertools
import math
from typing import Any, Dict, List, Sequence

import pytest
from controlled_robot import LIMITS, SIZE, Receiver, image

from smokebot_udp.congestion.bundle import ASK, LATE, MAX_LEAD, SILENCE, Bundle
from smokebot_udp.congestion.controller import Controller
from smokebot_udp.congestion.sent_history import SentHistory
from smokebot_udp.paths import STRAIGHT, PathPolicy, PathUse
from smokebot_udp.units import MBIT

BOTH = [PathUse('wifi'), PathUse('lte')]


class TwoPaths:
    """A robot that sends to one operator over two links, as fast as its controller allows."""

    def __init__(self, first: float, second: float, delays: Sequence[float] = (0.02, 0.02)) -> None:
        self.controller, self.now = Controller(LIMITS, True, 1472), 1000.0
        self.links = [Receiver('/op', first), Receiver('/op', second)]
        for link, delay in zip(self.links, delays):
            link.delay = delay
        self.lost: Dict[int, float] = {}        # {path: share of its datagrams}
        self.arrivals: List[Any] = []
        self.controller.on_arrivals = lambda *what: self.arrivals.append(what)
        self.demand = image(rate=30.0)
        self._seq = itertools.count(1)

    def drive(self, seconds: float, uses: Sequence[PathUse] = BOTH) -> List[int]:
        """How many datagrams went by each path."""
        until, next_tick, went = self.now + seconds, self.now, [0, 0]
        while self.now < until:
            if self.now >= next_tick:
                next_tick += 0.1
                self.controller.on_paths({'/op': uses}, self.now)
                for path, link in enumerate(self.links[:len(uses)]):
                    self.controller.on_report('/op', link.report(self.now), self.now, 1, path)
                self.controller.tick(self.now, {'thermal': self.demand}, 0)
            seq = next(self._seq)
            route = self.controller.route('thermal', 1, SIZE, self.now, waiting=100 * SIZE)
            self.controller.on_sent('thermal', seq, 1, SIZE, self.now, route)
            path = int('/op' in route.second)
            went[path] += 1
            if went[path] * self.lost.get(path, 0.0) % 1 <= 1 - self.lost.get(path, 0.0) or path not in self.lost:
                self.links[path].receive(seq, self.now)
            rate = self.controller.rate(self.now)
            assert rate is not None
            self.now += (SIZE + route.withheld) / rate
        return went


@pytest.mark.parametrize('first,second', [(2.0, 1.0), (1.0, 3.0), (1.5, 4.0)])
def test_two_links_are_one_that_carries_what_both_do(first: float, second: float) -> None:
    robot = TwoPaths(first * MBIT, second * MBIT)
    robot.drive(8.0)
    for link in robot.links:
        link.received = 0
    robot.drive(5.0)
    for link, rate in zip(robot.links, (first, second)):
        assert link.received * SIZE / 5 > 0.85 * rate * MBIT
    state = robot.controller.stats(robot.now)
    assert state.capacity == pytest.approx((first + second) * MBIT, rel=0.15)
    assert state.loss == 0.0 and state.refused_reports == {} and state.queue_delay < 0.06


def test_a_narrow_link_costs_a_fast_one_nothing() -> None:
    """A datagram takes 24 ms on the first link and 3 ms on the second, so a part of the first one is not used."""
    robot = TwoPaths(0.5 * MBIT, 4 * MBIT)
    robot.drive(8.0)
    for link in robot.links:
        link.received = 0
    robot.drive(5.0)
    narrow, fast = (link.received * SIZE / 5 for link in robot.links)
    assert narrow > 0.5 * 0.5 * MBIT and fast > 0.85 * 4 * MBIT
    assert robot.controller.stats(robot.now).queue_delay < 0.06


def test_what_went_by_the_other_path_is_no_loss() -> None:
    robot = TwoPaths(2 * MBIT, 1 * MBIT)
    robot.drive(6.0)
    assert sum(expected for _, _, expected, _, _ in robot.arrivals) > 500
    assert all(expected == received for _, _, expected, received, _ in robot.arrivals)


def test_the_loss_is_the_mixture() -> None:
    robot = TwoPaths(2 * MBIT, 2 * MBIT)
    robot.lost[1] = 0.3
    robot.drive(8.0)
    assert robot.controller.stats(robot.now).loss == pytest.approx(0.15, abs=0.06)


def test_a_path_that_is_silent_carries_nothing_and_comes_back_with_its_estimate() -> None:
    robot = TwoPaths(2 * MBIT, 2 * MBIT)
    robot.drive(6.0)
    robot.drive(SILENCE + 0.3, [BOTH[0], PathUse('lte', 1.0)])      # it is heard, by reports
    assert robot.drive(0.5, [BOTH[0], PathUse('lte', 1.0)])[1] > 0
    robot.links[1].report = lambda now: Receiver('/op', 1.0).report(now)        # type: ignore[method-assign]
    robot.drive(SILENCE + 0.2, [BOTH[0], PathUse('lte', 1.0)])
    assert robot.drive(0.5, [BOTH[0], PathUse('lte', 1.0)])[1] == 0
    assert robot.controller.stats(robot.now).capacity < 2.5 * MBIT
    del robot.links[1].report
    robot.drive(0.2)
    assert robot.drive(0.5)[1] > 0 and robot.controller.stats(robot.now).capacity > 3 * MBIT


def test_after_a_move_the_estimate_is_that_of_the_path_which_is_left() -> None:
    robot = TwoPaths(3 * MBIT, 1 * MBIT)
    robot.drive(6.0)
    assert robot.controller.stats(robot.now).capacity > 3.2 * MBIT
    robot.controller.on_paths({'/op': [BOTH[1]]}, robot.now)
    assert robot.controller.stats(robot.now).capacity == pytest.approx(1 * MBIT, rel=0.3)
    assert robot.controller.route('thermal', 1, SIZE, robot.now) == STRAIGHT
    robot.links[0].rate = robot.links[1].rate
    robot.drive(3.0, [BOTH[1]])
    assert robot.controller.stats(robot.now).capacity == pytest.approx(1 * MBIT, rel=0.2)
    assert robot.controller.stats(robot.now).loss < 0.05


def test_while_the_first_path_is_quiet_all_goes_by_the_second_one() -> None:
    robot, quiet = TwoPaths(3 * MBIT, 1 * MBIT), [BOTH[0]._replace(is_quiet=True), BOTH[1]]
    robot.drive(6.0)
    assert robot.controller.on_paths({'/op': quiet}, robot.now)
    assert not robot.controller.on_paths({'/op': quiet}, robot.now)
    assert robot.controller.stats(robot.now).capacity == pytest.approx(1 * MBIT, rel=0.3)
    first, second = robot.drive(0.3, quiet)
    assert first == 0 and second * SIZE / 0.3 < 1.5 * MBIT
    assert not robot.controller.on_paths({'/op': BOTH}, robot.now)
    assert robot.controller.stats(robot.now).capacity > 3.2 * MBIT and robot.drive(0.3)[0] > 0


def test_a_quiet_path_is_used_where_there_is_no_other_one() -> None:
    bundle = Bundle(SentHistory(), LIMITS, 0.0)
    assert not bundle.follow([BOTH[0]._replace(is_quiet=True)], 0.0)
    assert bundle.choose(SIZE, SIZE, 0.0) == (0, 0.0) and bundle.rate == LIMITS.start_rate


def test_the_end_of_a_message_does_not_wait_for_the_slow_path() -> None:
    robot = TwoPaths(2 * MBIT, 2 * MBIT, delays=(0.02, 0.06))
    robot.drive(6.0)
    robot.now += 2 * MAX_LEAD           # nothing is on its way
    chosen = []
    for left in range(20, 0, -1):       # an image, paced
        route = robot.controller.route('thermal', 1, SIZE, robot.now, waiting=left * SIZE)
        robot.controller.on_sent('thermal', 10 ** 6 - left, 1, SIZE, robot.now, route)
        chosen.append('/op' in route.second)
        robot.now += (SIZE + route.withheld) / (4 * MBIT)
    last = len(chosen) - 1 - chosen[::-1].index(True)
    assert 4 <= sum(chosen) < 10 and 20 - 1 - last >= 0.04 * 2 * MBIT / SIZE - 2
    assert '/op' not in robot.controller.route('gas', 1, 100, robot.now + 1.0).second        # urgent


def test_what_a_slow_path_cannot_carry_in_time_is_no_capacity() -> None:
    near, far = (TwoPaths(2 * MBIT, 2 * MBIT, delays=(0.02, delay)) for delay in (0.02, 0.02 + LATE / 2))
    for robot in (near, far):
        robot.drive(8.0)
    capacities = [robot.controller.stats(robot.now).capacity for robot in (near, far)]
    assert capacities == [pytest.approx(4 * MBIT, rel=0.12), pytest.approx(3 * MBIT, rel=0.12)]


def test_a_late_path_carries_all_where_the_early_one_carries_far_less_until_it_carries_more_again() -> None:
    robot = TwoPaths(2 * MBIT, 1 * MBIT, delays=(0.02, 0.2))
    robot.drive(8.0)
    assert robot.drive(1.0)[0] > 100
    robot.links[0].rate, robot.lost[0] = 0.1 * MBIT, 0.5
    robot.drive(8.0)
    early, late = robot.drive(4.0)
    assert late * SIZE / 4 > 0.8 * MBIT and 4 / ASK - 1 <= early < 0.05 * late
    state = robot.controller.stats(robot.now)
    assert state.capacity == pytest.approx(MBIT, rel=0.1) and state.loss == 0.0
    robot.links[0].rate = 2 * MBIT
    del robot.lost[0]
    robot.drive(4.0)
    early, late = robot.drive(1.0)
    assert early * SIZE > 1.6 * MBIT and late < 0.2 * early


def test_an_early_path_that_costs_is_not_asked() -> None:
    robot, costs = TwoPaths(1 * MBIT, 1 * MBIT, delays=(0.02, 0.2)), PathUse('wifi', policy=PathPolicy(metered=True))
    robot.drive(4.0, [costs, BOTH[1]])
    assert robot.drive(4.0, [costs, BOTH[1]])[0] == 0


def test_an_early_path_that_was_left_does_not_replace_a_quiet_one() -> None:
    """The operator says soon whether the first one is cut; until then far less would be sent."""
    robot = TwoPaths(1 * MBIT, 0.1 * MBIT, delays=(0.2, 0.02))
    robot.drive(8.0)
    assert not robot.controller.on_paths({'/op': [BOTH[0]._replace(is_quiet=True), BOTH[1]]}, robot.now)
    assert robot.controller.stats(robot.now).capacity == pytest.approx(MBIT, rel=0.1)


def test_the_early_path_is_used_beside_what_the_late_one_carries_in_time() -> None:
    """20 ms later: a part of the late one is used, so that both are better than each."""
    robot = TwoPaths(0.3 * MBIT, 2 * MBIT, delays=(0.02, 0.04))
    robot.drive(8.0)
    assert min(robot.drive(2.0)) > 0


def test_a_path_without_reports_is_no_better_than_it_begins() -> None:
    bundle = Bundle(SentHistory(), LIMITS, 0.0)
    bundle.follow(BOTH, 0.0)
    assert bundle.capacity == bundle.rate == 2 * LIMITS.start_rate
    assert math.isnan(bundle.link.round_trip) and not bundle.timed_out
    assert bundle.read(object(), 2, 0.0) is None
    for step in range(1, 60):
        bundle.poll(0.1 * step, 0.0)
    assert bundle.tokens(6.0) == (0.0, 0.0)


def test_reports_of_a_path_that_is_not_used_are_ignored() -> None:
    robot = TwoPaths(2 * MBIT, 1 * MBIT)
    robot.drive(3.0)
    report = robot.links[1].report(robot.now)
    robot.controller.on_paths({'/op': BOTH[:1]}, robot.now)
    assert robot.controller.on_report('/op', report, robot.now, 1, 1) is None


def test_a_path_that_costs_carries_nothing_beside_another_one_and_little_by_itself() -> None:
    robot, costs = TwoPaths(2 * MBIT, 2 * MBIT), PathUse('lte', policy=PathPolicy(0.3 * MBIT, metered=True))
    robot.drive(4.0, [BOTH[0], costs])
    assert robot.drive(1.0, [BOTH[0], costs])[1] == 0
    robot.drive(1.0, [costs])
    state = robot.controller.stats(robot.now)
    assert state.capacity == pytest.approx(0.3 * MBIT) and state.rate <= 0.3 * MBIT
    robot.links.reverse()       # the other one is there again, but not yet preferred
    robot.drive(1.0, [costs, BOTH[0]])
    assert robot.drive(2.0, [costs, BOTH[0]])[0] == 0
    assert robot.controller.stats(robot.now).capacity > 1.5 * MBIT


def test_a_path_that_costs_carries_the_cheapest_images_where_the_other_one_does_not() -> None:
    robot, costs = TwoPaths(0.3 * MBIT, 2 * MBIT), PathUse('lte', policy=PathPolicy(MBIT, metered=True))
    robot.drive(4.0, [BOTH[0], costs])
    assert robot.drive(1.0, [BOTH[0], costs])[1] == 0
    robot.demand = image(rate=30.0, is_base=True)
    base = robot.demand.base
    assert base == pytest.approx(30 / 2 * robot.demand.points[0].cost) and 0.3 * MBIT < base < MBIT
    robot.drive(4.0, [BOTH[0], costs])
    assert 0.5 * base < robot.drive(4.0, [BOTH[0], costs])[1] * SIZE / 4 <= 1.1 * base
    robot.links[0].rate = 4 * MBIT
    robot.drive(8.0, [BOTH[0], costs])
    assert robot.drive(1.0, [BOTH[0], costs])[1] == 0


def test_a_path_that_costs_carries_all_while_the_first_one_is_quiet() -> None:
    robot, costs = TwoPaths(2 * MBIT, 2 * MBIT), PathUse('lte', policy=PathPolicy(0.3 * MBIT, metered=True))
    robot.drive(4.0, [BOTH[0], costs])
    went = robot.drive(1.0, [BOTH[0]._replace(is_quiet=True), costs])
    assert went[0] == 0 and went[1] * SIZE == pytest.approx(0.3 * MBIT, rel=0.2)
    assert robot.drive(1.0, [BOTH[0], costs])[1] == 0


def test_a_path_may_be_used_in_part_and_up_to_a_rate() -> None:
    robot = TwoPaths(2 * MBIT, 2 * MBIT)
    limited = [BOTH[0]._replace(policy=PathPolicy(weight=0.5)), BOTH[1]._replace(policy=PathPolicy(0.25 * MBIT))]
    robot.drive(8.0)
    robot.drive(1.0, limited)
    went = [count * SIZE / 4 for count in robot.drive(4.0, limited)]
    assert went[0] == pytest.approx(MBIT, rel=0.1) and 0.15 * MBIT < went[1] <= 0.25 * MBIT
    assert 0.95 * MBIT < robot.controller.stats(robot.now).capacity < 1.3 * MBIT        # see LATE


def test_who_lost_one_of_two_paths_is_reached_over_the_other_one_only() -> None:
    wifi, lte = PathUse('wifi', host='10.0.0.9', interface='wlan0'), PathUse('lte', host='100.64.0.9')
    bundle = Bundle(SentHistory(), LIMITS, 0.0)
    for second, used, only in [
            (1.0, [wifi], ''), (2.0, [lte], ''),        # it has moved: it never had both
            (3.0, [wifi, lte], ''), (4.0, [wifi], 'wlan0'), (5.0, [lte], '100.64.0.9'), (6.0, [lte, wifi], ''),
            (7.0, [wifi, lte._replace(silence=SILENCE)], 'wlan0'),
            (8.0, [wifi, lte._replace(policy=PathPolicy(metered=True))], '')]:
        bundle.follow(used, second)
        assert bundle.only == only, second
    bundle.follow([wifi, lte], 8.5)
    assert [path.name for path in bundle.shares(0.0)] == ['wlan0', '100.64.0.9']
    bundle.on_return(9.0)       # it may have been started with one
    assert bundle.shares(0.0) == []
    bundle.follow([wifi], 9.0)
    assert bundle.only == ''
