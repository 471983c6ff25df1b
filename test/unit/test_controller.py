# SPDX-License-Identifier: BSD-3-Clause
"""The link controller as robot_sender uses it: several operators, streams, protected messages, and forged reports."""
import collections
import itertools
import math
from typing import Any, Deque, Dict, Iterable, List, Mapping, Optional, Tuple

import pytest

from smokebot_udp.congestion.controller import (
    GRANT_TOLERANCE,
    MAX_OPERATORS,
    NEAR,
    OPERATOR_TIMEOUT,
    PLANNING_SHARE,
    SOURCE_TIMEOUT,
    Controller,
    Demand,
    Plan,
)
from smokebot_udp.congestion.estimator import Limits
from smokebot_udp.congestion.feedback import ArrivalSample, ReceiveHistory, Report, StreamArrivals
from smokebot_udp.congestion.operating_points import OperatingPoint, image_points, rate_points
from smokebot_udp.congestion.probe_rtt import DIP_GAIN
from smokebot_udp.congestion.probing import ProbeTrain
from smokebot_udp.monitoring.stats import LinkStats
from smokebot_udp.units import MBIT

LIMITS = Limits(min_rate=0.1 * MBIT, start_rate=0.5 * MBIT, max_rate=10 * MBIT)
SIZE = 1500     # of a datagram on the air
IMPOSSIBLE = Report(7, 10 ** 12, [StreamArrivals('thermal', 10 ** 6, 10 ** 6, 10 ** 9)], [])


def image(rate: float = 10.0, **options: Any) -> Demand:
    """The demand of images of 64 datagrams, ten a second: 640 datagrams a second."""
    def refine(settings: Mapping[str, Any], spare: float) -> Dict[str, Any]:
        count = (settings['max_subimages'] or 64) + int(spare / (settings['rate'] * SIZE))
        return {**settings, 'max_subimages': 0 if count >= 64 else count}
    return Demand(image_points(rate, 64, 1, SIZE), rate=rate, refine=refine, **options)


def taken(grant: Optional[Dict[str, Any]], rate: float = 10.0) -> float:
    """What images take of the link as they are granted [byte/s]."""
    if grant is None:
        return 0.0
    settings = {'rate': rate, 'max_subimages': 0, **grant}
    return settings['rate'] * (settings['max_subimages'] or 64) * SIZE


class Receiver:
    """An operator at the end of a link of `rate` [byte/s] and 20 ms."""

    def __init__(self, name: str, rate: float) -> None:
        self.name, self._rate = name, rate
        self._history, self._free = ReceiveHistory(lambda: 7), 0.0
        self._arriving: Deque[Tuple[float, int]] = collections.deque()
        self.received = 0

    def receive(self, seq: int, now: float) -> None:
        self.received += 1
        self._free = max(self._free, now) + SIZE / self._rate
        self._arriving.append((self._free + 0.02, seq))

    def report(self, now: float) -> Report:
        while self._arriving and self._arriving[0][0] <= now:
            arrived, seq = self._arriving.popleft()
            self._history.add('thermal', seq, SIZE, arrived)
        return self._history.report(now)


class Robot:
    """Sends datagrams as fast as a controller allows; time passes as they leave."""

    def __init__(self, limits: Limits = LIMITS, adapt: bool = True) -> None:
        self.controller, self.now = Controller(limits, adapt, 1472), 1000.0
        self.demands = {'thermal': image(rate=30.0)}
        self.plans: List[Plan] = []
        self.trains: List[ProbeTrain] = []
        self._seq = itertools.count(1)

    @property
    def rate(self) -> float:
        rate = self.controller.rate(self.now)
        assert rate is not None
        return rate

    @property
    def state(self) -> LinkStats:
        return self.controller.stats(self.now)

    def tick(self) -> Plan:
        self.plans.append(self.controller.tick(self.now, self.demands, 0))
        return self.plans[-1]

    def drive(self, receivers: Iterable[Receiver], seconds: float) -> None:
        """All receivers get each datagram that conforms, and report ten times a second."""
        until, next_report, receivers = self.now + seconds, self.now + 0.1, list(receivers)
        while self.now < until:
            seq = next(self._seq)
            limits = self.controller.conforming('thermal', 1, SIZE, self.now)
            self.controller.on_sent('thermal', seq, 1, SIZE, self.now, limits)
            for receiver in receivers:
                if limits.get(receiver.name, 1):
                    receiver.receive(seq, self.now)
            self.now += SIZE / self.rate
            if self.now >= next_report:
                next_report += 0.1
                for receiver in receivers:
                    train = self.controller.on_report(receiver.name, receiver.report(self.now), self.now, 1)
                    self.trains += [train] if train else []
                self.tick()


def settled(capacity: float, demands: Mapping[str, Demand], controller: Optional[Controller] = None,
            protected: float = 0.0) -> Plan:
    """The plan on a link of fixed capacity after upgrades had their time [byte/s]."""
    controller = controller or Controller(Limits(max_rate=capacity), False, 1472)
    for step in range(50):
        plan = controller.tick(0.1 * step, demands, round(0.1 * step * protected))
    return plan


# operators and their reports


def test_the_rate_follows_what_arrives() -> None:
    robot = Robot()
    assert robot.rate == LIMITS.start_rate
    robot.drive([Receiver('/op', 2 * MBIT)], 8.0)
    assert 0.8 * 2 * MBIT < robot.rate < 1.2 * 2 * MBIT
    state = robot.state
    assert state.operator == '/op' and not state.timeout and state.refused_reports == {}
    assert state.capacity == pytest.approx(2 * MBIT, rel=0.15) and state.round_trip > 0
    assert state.sent == pytest.approx(2 * MBIT, rel=0.2) and state.wanted == pytest.approx(30 * 64 * SIZE)


def test_a_report_may_ask_for_a_train() -> None:
    robot, fixed = Robot(), Robot(adapt=False)
    robot.drive([Receiver('/op', 5 * MBIT)], 2.0)
    assert robot.trains and robot.trains[0].rate > LIMITS.start_rate
    fixed.drive([Receiver('/op', 20 * MBIT)], 2.0)
    assert fixed.trains == []


def test_streams_plan_with_the_capacity_while_the_rate_dips() -> None:
    robot = Robot()
    robot.drive([Receiver('/op', 5 * MBIT)], 20.0)
    dips = [plan for plan in robot.plans[50:] if plan.rate is not None and plan.rate < 1.1 * DIP_GAIN * 5 * MBIT]
    assert dips
    assert all(sum(plan.shares.values()) > 0.9 * PLANNING_SHARE * 5 * MBIT for plan in dips)


def test_a_slow_link_slows_no_other_operator() -> None:
    robot, near, far = Robot(), Receiver('/near', 5 * MBIT), Receiver('/far', 1 * MBIT)
    robot.controller.on_operators({'/near': 3, '/far': 3}, robot.now)
    robot.drive([near], 6.0)
    alone = robot.rate
    robot.drive([near, far], 6.0)
    assert robot.rate > 0.9 * alone
    near.received = far.received = 0
    robot.drive([near, far], 4.0)
    assert near.received * SIZE / 4 > 0.9 * 5 * MBIT
    assert far.received * SIZE / 4 == pytest.approx(1 * MBIT, rel=0.15)
    state = robot.state
    assert (state.operator, list(state.slower)) == ('/near', ['/far'])
    assert state.slower['/far'] == pytest.approx(1 * MBIT, rel=0.2) and state.state == 'as /near reports, less for /far'
    assert state.loss == 0.0 and state.refused_reports == {}


def test_streams_are_planned_for_links_that_carry_nearly_as_much() -> None:
    robot, one, other = Robot(), Receiver('/one', 5 * MBIT), Receiver('/other', (NEAR + 0.05) * 5 * MBIT)
    robot.drive([one, other], 10.0)
    assert robot.state.operator == '/other' and robot.state.slower == {}
    assert robot.state.capacity == pytest.approx((NEAR + 0.05) * 5 * MBIT, rel=0.1)
    one.received = other.received = 0
    robot.drive([one, other], 4.0)
    assert other.received > 0.85 * one.received     # what is sent at full gain; a plan is below the capacity


def test_an_operator_that_left_no_longer_counts() -> None:
    robot, near, far = Robot(), Receiver('/near', 5 * MBIT), Receiver('/far', 4.5 * MBIT)
    robot.controller.on_operators({'/near': 3, '/far': 3, '/rviz': 1}, robot.now)
    robot.drive([near, far], 8.0)
    assert robot.state.operator == '/far' and robot.rate < 4.96 * MBIT
    robot.controller.on_operators({'/near': 3, '/rviz': 1}, robot.now)
    assert robot.state.operator == '/near'
    robot.controller.on_report('/far', far.report(robot.now), robot.now)    # it was on its way
    assert robot.state.operator == '/near' and robot.state.refused_reports == {'not of an operator': 1}
    robot.controller.on_operators({'/near': 3, '/far': 3}, robot.now)
    robot.drive([near, far], 3.0)
    assert robot.state.operator == '/far'


def test_who_stays_looks_for_the_room_of_who_left() -> None:
    robot, near = Robot(), Receiver('/near', 5 * MBIT)
    robot.controller.on_operators({'/near': 3, '/far': 3}, robot.now)
    robot.drive([near], 6.0)
    while True:                 # until a train found nothing
        before = len(robot.trains)
        robot.drive([near], 0.1)
        if len(robot.trains) > before:
            break
    robot.drive([near], 0.3)
    before = len(robot.trains)
    robot.drive([near], 0.3)
    assert len(robot.trains) == before
    robot.controller.on_operators({'/near': 3}, robot.now)
    robot.drive([near], 0.2)
    assert len(robot.trains) == before + 1


def test_an_operator_that_loses_a_connection_does_not_count_before_it_reports_again() -> None:
    robot, near, far = Robot(), Receiver('/near', 5 * MBIT), Receiver('/far', 4.5 * MBIT)
    robot.controller.on_operators({'/near': 3, '/far': 3}, robot.now)
    robot.drive([near, far], 8.0)
    robot.controller.on_operators({'/near': 3, '/far': 2}, robot.now)
    robot.tick()
    assert robot.state.operator == '/near'
    robot.drive([near, far], 0.5)       # only that stream ended
    assert robot.state.operator == '/far'


def test_the_last_operator_counts_until_there_are_others() -> None:
    robot, near = Robot(), Receiver('/near', 5 * MBIT)
    robot.controller.on_operators({'/near': 1}, robot.now)
    robot.drive([near], 4.0)
    robot.controller.on_operators({}, robot.now)
    robot.drive([], 2.0)
    assert robot.state.operator == '/near' and robot.state.timeout
    robot.controller.on_operators({'/new': 1}, robot.now)       # has not reported yet
    assert robot.state.operator is None and robot.rate == LIMITS.start_rate


def test_a_silent_operator_slows_no_other_one() -> None:
    robot, near, gone = Robot(), Receiver('/near', 5 * MBIT), Receiver('/gone', 5 * MBIT)
    robot.drive([near, gone], 6.0)
    least = math.inf
    for _ in range(40):
        robot.drive([near], 0.1)
        least = min(least, robot.state.capacity)
    assert least > 0.9 * 5 * MBIT and robot.state.operator == '/near'


def test_a_new_operator_begins_slowly_beside_others() -> None:
    robot, near, late = Robot(), Receiver('/near', 5 * MBIT), Receiver('/late', 5 * MBIT)
    robot.controller.on_operators({'/near': 1}, robot.now)
    robot.drive([near], 5.0)
    robot.controller.on_operators({'/near': 1, '/late': 1}, robot.now)
    robot.drive([near, late], 0.09)     # before its first report
    assert late.received * SIZE < 0.2 * LIMITS.start_rate
    before = near.received
    robot.drive([near, late], 1.0)
    assert (near.received - before) * SIZE > 0.8 * 5 * MBIT
    robot.drive([near, late], 5.0)
    assert not robot.state.slower


def test_a_subscriber_that_does_not_report_gets_everything_after_a_while() -> None:
    robot, near, recorder = Robot(), Receiver('/near', 5 * MBIT), Receiver('/recorder', math.inf)
    robot.controller.on_operators({'/near': 1, '/recorder': 1}, robot.now)
    robot.drive([near], 5.0)
    assert robot.controller.conforming('thermal', 100, SIZE, robot.now) == {}
    assert robot.state.operator == '/near' and recorder.received == 0


def test_without_reports_the_rate_falls_to_min_rate() -> None:
    robot = Robot()
    robot.drive([Receiver('/op', 5 * MBIT)], 5.0)
    before = robot.state.capacity
    robot.drive([], 0.8)
    assert robot.state.capacity == before / 2 and robot.rate < 0.6 * before
    robot.drive([], 10.0)
    state = robot.state
    assert robot.rate < 1.2 * LIMITS.min_rate
    assert state.timeout and state.operator == '/op' and 10.5 < state.silence < 11.5


def test_before_the_first_report_nothing_is_known() -> None:
    state = Robot().state
    assert state.operator is None and math.isnan(state.capacity) and math.isnan(state.silence)
    assert state.rate == LIMITS.start_rate and state.wanted == math.inf and not state.timeout


def test_a_fixed_rate_stays_and_the_link_is_measured_all_the_same() -> None:
    robot = Robot(adapt=False)
    assert robot.rate == LIMITS.max_rate
    robot.drive([Receiver('/op', 20 * MBIT)], 1.0)
    assert {plan.rate for plan in robot.plans} == {LIMITS.max_rate} and not robot.state.adaptive
    assert robot.state.capacity > 5 * MBIT


def test_without_max_rate_nothing_is_limited() -> None:
    controller = Controller(Limits(max_rate=math.inf), False, 1472)
    assert controller.rate(0.0) is None
    assert controller.tick(0.0, {'thermal': image()}, 0) == Plan(None, 1472, {}, {'thermal': {}}, 1.0)


def test_forged_reports_are_counted_and_change_nothing() -> None:
    robot = Robot()
    robot.drive([Receiver('/op', 2 * MBIT)], 5.0)
    rate = robot.rate
    assert robot.controller.on_report('/op', IMPOSSIBLE, robot.now, 1) is None
    assert robot.rate == rate and robot.state.refused_reports == {'received more than sent': 1}


def test_a_stranger_that_reports_nothing_that_was_sent_is_no_operator() -> None:
    robot = Robot()
    robot.drive([Receiver('/op', 5 * MBIT)], 5.0)
    rate = robot.rate
    for report in (IMPOSSIBLE, Report(8, 10 ** 6, [], [])):
        robot.controller.on_report('/stranger', report, robot.now)
    robot.tick()
    assert rate > 2 * LIMITS.start_rate and robot.rate >= rate and robot.state.operator == '/op'


def old_as_new(robot: Robot, step: int, source: Any, name: str) -> None:
    """Report a datagram of the past as just arrived, as a path of minutes would; another session each time."""
    report = Report(step + 10, round(1e6 * robot.now), [StreamArrivals('thermal', 50, 1, SIZE)],
                    [ArrivalSample(0, 2 + step % 40, 0)])
    robot.controller.on_report(name, report, robot.now, source)


@pytest.mark.parametrize('name, source, refused', [
    ('/stranger', 2, 'not of an operator'),                 # no stream is sent to it
    ('/op', 2, "under another operator's name"),            # by a connection of its own
    ('/liar', 2, ''),                                       # subscribes to the streams
])
def test_old_datagrams_reported_as_just_arrived_slow_nobody_else(name: str, source: int, refused: str) -> None:
    robot, near, least = Robot(), Receiver('/op', 2 * MBIT), math.inf
    robot.controller.on_operators({'/op': 1, '/liar': 1}, robot.now)
    robot.drive([near], 6.0)
    for step in range(100):
        robot.drive([near], 0.1)
        old_as_new(robot, step, source, name)
        robot.tick()
        least = min(least, robot.state.capacity)
    assert least > 0.8 * 2 * MBIT
    near.received = 0
    robot.drive([near], 2.0)
    assert near.received * SIZE / 2 > 0.8 * 2 * MBIT
    assert not refused or set(robot.state.refused_reports) == {refused}


def test_another_connection_may_report_once_the_first_is_silent() -> None:
    robot, near = Robot(), Receiver('/op', 2 * MBIT)
    robot.drive([near], 3.0)
    assert robot.controller.on_report('/op', near.report(robot.now), robot.now, 5) is None
    robot.now += SOURCE_TIMEOUT + 0.1
    robot.controller.on_report('/op', near.report(robot.now), robot.now, 5)
    assert robot.state.silence == 0.0 and robot.state.refused_reports == {"under another operator's name": 1}


def test_operators_are_bounded_and_make_room_when_they_are_gone() -> None:
    robot = Robot()
    for number in range(MAX_OPERATORS + 5):
        robot.controller.on_report('/stranger%d' % number, Report(number, 10 ** 6, [], []), robot.now)
    robot.drive([Receiver('/op%d' % number, 20 * MBIT) for number in range(MAX_OPERATORS + 1)], 1.0)
    assert set(robot.state.refused_reports) == {'too many operators'}
    robot.now += OPERATOR_TIMEOUT + 1
    robot.drive([Receiver('/late', 2 * MBIT)], 5.0)
    assert robot.state.operator == '/late'


# the division among the streams


def test_a_link_with_room_limits_nothing() -> None:
    plan = settled(2 * 640 * SIZE, {'thermal': image()})
    assert plan.grants == {'thermal': {}} and plan.shares == {'thermal': pytest.approx(640 * SIZE)}


@pytest.mark.parametrize('datagrams', [500, 100, 20, 5])
def test_a_slow_link_is_used_and_not_exceeded(datagrams: int) -> None:
    grant = settled(datagrams * SIZE, {'thermal': image()}).grants['thermal']
    assert grant is not None and grant['rate'] >= 2 or grant['max_subimages'] == 1
    assert 0.8 * datagrams * SIZE <= taken(grant) <= datagrams * SIZE


def test_weights_and_min_bitrates_count() -> None:
    plan = settled(200 * SIZE, {'much': image(weight=3.0), 'little': image(),
                                'minimum': image(weight=0.0, min_bitrate=40 * SIZE)})
    takes = {name: taken(grant) for name, grant in plan.grants.items()}
    assert takes['much'] / takes['little'] == pytest.approx(3, rel=0.5)
    assert 0.5 * 40 * SIZE < takes['minimum'] <= 40 * SIZE and plan.shares['minimum'] == pytest.approx(40 * SIZE)
    assert sum(takes.values()) <= 200 * SIZE


def test_protected_streams_are_measured_and_served_first() -> None:
    controller = Controller(Limits(max_rate=100 * SIZE), False, 1472)
    plan = settled(100 * SIZE, {'thermal': image()}, controller, protected=30 * SIZE)
    assert 0.8 * 70 * SIZE < taken(plan.grants['thermal']) <= 70 * SIZE and set(plan.shares) == {'thermal'}
    assert controller.stats(5.0).wanted == pytest.approx(670 * SIZE, rel=0.001)
    assert plan.decimation == 1.0


def test_protected_streams_that_fill_a_slow_link_are_decimated() -> None:
    plan = settled(10000, {'thermal': image()}, protected=7500)
    assert plan.decimation == 0.5


def test_datagrams_are_short_on_a_slow_link() -> None:
    sizes = [Controller(Limits(max_rate=rate), False, 1472).tick(0.0, {}, 0).datagram_size for rate in (1e6, 40000)]
    assert sizes == [1472, 736]


def test_a_stream_that_cannot_even_have_its_cheapest_point_pauses() -> None:
    controller, first = Controller(Limits(max_rate=1000.0), False, 1472), {'lidar': Demand(rate_points(10.0, 2000))}
    assert controller.tick(0.0, first, 0).grants == {'lidar': None}
    plan = settled(1000.0, {'lidar': Demand(rate_points(10.0, 500), rate=10.0)}, controller)
    assert plan.grants['lidar'] is not None and plan.grants['lidar']['rate'] == pytest.approx(1.49, abs=0.01)


def test_a_stream_without_a_demand_leaves_the_link_to_others() -> None:
    controller = Controller(Limits(max_rate=100 * SIZE), False, 1472)
    settled(100 * SIZE, {'thermal': image(), 'camera': image()}, controller)
    plan = settled(100 * SIZE, {'thermal': image()}, controller)
    assert set(plan.grants) == set(plan.shares) == {'thermal'} and taken(plan.grants['thermal']) > 80 * SIZE


def test_a_focus_switch_applies_at_once() -> None:
    controller = Controller(Limits(max_rate=100 * SIZE), False, 1472)
    before = settled(100 * SIZE, {'thermal': image(weight=9.0), 'camera': image(weight=1.0)}, controller)
    controller.forget()
    after = controller.tick(5.01, {'thermal': image(weight=1.0), 'camera': image(weight=9.0)}, 0)
    assert after.grants == {'thermal': before.grants['camera'], 'camera': before.grants['thermal']}


def test_a_rate_about_as_requested_is_no_limit() -> None:
    points = [OperatingPoint({'max_subimages': count, 'rate': 9.6}, 100.0 * count) for count in (1, 2, 3)]
    plan = settled(250.0, {'thermal': Demand(points, rate=10.0)})
    assert plan.grants == {'thermal': {'max_subimages': 2}}


def test_bandwidth_between_two_points_refines_by_weight() -> None:
    def demand(weight: float) -> Demand:
        return Demand([OperatingPoint({'leaf_size': 1.0}, 100.0), OperatingPoint({'leaf_size': 0.1}, 1000.0)], weight,
                      refine=lambda settings, spare: {'leaf_size': settings['leaf_size'] - spare / 1000})
    plan = settled(500 / PLANNING_SHARE, {'much': demand(2.0), 'little': demand(1.0)})
    assert plan.grants == {'much': {'leaf_size': pytest.approx(0.8)}, 'little': {'leaf_size': pytest.approx(0.9)}}


def test_a_source_rate_that_trembles_changes_no_granted_rate() -> None:
    controller, grants = Controller(Limits(max_rate=100 * SIZE), False, 1472), []
    for step in range(100):
        rate = 10.0 * (1 + 0.4 * GRANT_TOLERANCE * (-1) ** step)
        grants.append(controller.tick(0.1 * step, {'thermal': image(rate=rate)}, 0).grants['thermal'])
    assert len({grant['rate'] for grant in grants[50:]}) == 1
    slower = controller.tick(10.0, {'thermal': image(rate=8.0)}, 0).grants['thermal']
    assert slower['rate'] < 0.9 * grants[-1]['rate']
