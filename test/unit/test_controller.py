# SPDX-License-Identifier: BSD-3-Clause
"""The link controller as robot_sender uses it: several operators and their reports."""
import math
from typing import List

import pytest
from controlled_robot import LIMITS, SIZE, Receiver, Robot, image

from smokebot_udp.congestion.controller import NEAR, OPERATOR_TIMEOUT, PLANNING_SHARE, Controller, Plan
from smokebot_udp.congestion.estimator import Limits
from smokebot_udp.congestion.pause import DIP
from smokebot_udp.paths import STRAIGHT, PathUse
from smokebot_udp.units import MBIT


def test_the_rate_follows_what_arrives() -> None:
    robot = Robot()
    assert robot.rate == LIMITS.start_rate
    robot.drive([Receiver('/op', 2 * MBIT)], 8.0)
    assert 0.8 * 2 * MBIT < robot.rate < 1.2 * 2 * MBIT
    state = robot.state
    assert state.operator == '/op' and not state.timeout and state.refused_reports == {}
    assert state.capacity == pytest.approx(2 * MBIT, rel=0.15) and state.round_trip > 0
    assert state.sent == pytest.approx(2 * MBIT, rel=0.2) and state.wanted == pytest.approx(30 * 64 * SIZE)


def test_the_rate_falls_where_an_operator_never_reports() -> None:
    robot = Robot()
    robot.controller.on_operators({'/op': 3}, robot.now)
    robot.drive([], 0.4)
    assert robot.rate == LIMITS.start_rate
    robot.drive([], 0.4)
    assert robot.rate == pytest.approx(LIMITS.start_rate / 2, rel=0.11)
    robot.drive([], 2.0)
    assert robot.rate == pytest.approx(LIMITS.min_rate, rel=0.11)
    robot.drive([Receiver('/op', 5 * MBIT)], 4.0)
    assert robot.rate > 0.8 * 5 * MBIT


def test_a_report_may_ask_for_a_train() -> None:
    robot, fixed = Robot(), Robot(adapt=False)
    robot.drive([Receiver('/op', 5 * MBIT)], 2.0)
    assert robot.trains and robot.trains[0].rate > LIMITS.start_rate
    fixed.drive([Receiver('/op', 20 * MBIT)], 2.0)
    assert fixed.trains == []


def test_streams_plan_with_the_capacity_while_the_rate_dips() -> None:
    robot = Robot()
    robot.drive([Receiver('/op', 5 * MBIT)], 20.0)
    dips = [plan for plan in robot.plans[50:] if plan.rate is not None and plan.rate < 1.1 * DIP.gain * 5 * MBIT]
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


def test_each_path_to_an_operator_has_an_estimate_of_its_own() -> None:
    robot, operator = Robot(), Receiver('/op', 5 * MBIT)
    robot.drive([operator], 6.0)
    robot.controller.on_paths({'/op': [PathUse('wifi')], '/stranger': [PathUse('lte')]}, robot.now)
    wifi = robot.rate
    assert wifi > 0.8 * 5 * MBIT
    operator.rate, operator.delay = 1 * MBIT, 0.08
    robot.controller.on_paths({'/op': [PathUse('lte')]}, robot.now)
    assert robot.rate == LIMITS.start_rate
    robot.drive([operator], 4.0)
    assert robot.state.capacity == pytest.approx(1 * MBIT, rel=0.15) and robot.state.queue_delay < 0.05
    operator.rate, operator.delay = 5 * MBIT, 0.02
    robot.controller.on_paths({'/op': [PathUse('wifi')]}, robot.now)
    assert robot.rate == pytest.approx(wifi, rel=0.5)
    operator.received = 0
    robot.drive([operator], 1.0)
    assert operator.received * SIZE > 0.7 * 5 * MBIT and robot.state.loss == 0.0


def test_what_was_lost_on_the_path_before_is_no_loss_of_the_next_one() -> None:
    robot, operator = Robot(), Receiver('/op', 5 * MBIT)
    robot.controller.on_paths({'/op': [PathUse('wifi')]}, robot.now)
    robot.drive([operator], 4.0)
    robot.controller.on_paths({'/op': [PathUse('wifi')]}, robot.now)
    robot.drive([], 0.3)                                # the Wi-Fi is cut
    robot.controller.on_paths({'/op': [PathUse('lte')]}, robot.now)
    lost: List[int] = []        # of the streams, which are protected accordingly
    robot.controller.on_arrivals = lambda operator, stream, expected, received, now: lost.append(expected - received)
    robot.drive([operator], 3.0)
    assert robot.state.loss < 0.01 and robot.rate > 3 * LIMITS.start_rate
    assert lost and not sum(lost)


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


@pytest.mark.parametrize('away', [2.0, 20.0])
def test_an_operator_that_comes_back_has_not_been_silent(away: float) -> None:
    robot, near = Robot(), Receiver('/near', 5 * MBIT)
    robot.controller.on_operators({'/near': 1}, robot.now)
    robot.drive([near], 4.0)
    robot.drive([], 0.5)                                        # it was restarted, which the robot does not know yet
    robot.controller.on_operators({}, robot.now)
    robot.drive([], away)
    assert robot.rate < LIMITS.start_rate / 2
    robot.controller.on_operators({'/near': 1}, robot.now)
    assert robot.rate == pytest.approx(LIMITS.start_rate, rel=0.11) and not robot.state.timeout
    robot.drive([], 0.4)                                        # its first reports are lost
    assert robot.rate == pytest.approx(LIMITS.start_rate, rel=0.11)
    robot.drive([], 4.0)
    assert robot.rate < LIMITS.start_rate / 2 and robot.state.timeout


def test_an_operator_that_comes_back_to_a_slow_link_gets_no_more_than_it_carried() -> None:
    slow = LIMITS.start_rate / 2
    robot, far = Robot(), Receiver('/far', slow)
    robot.controller.on_operators({'/far': 1}, robot.now)
    robot.drive([far], 8.0)
    robot.controller.on_operators({}, robot.now)
    robot.drive([], 4.0)
    robot.controller.on_operators({'/far': 1}, robot.now)
    assert robot.rate < 1.2 * slow


def test_a_silent_operator_slows_no_other_one() -> None:
    robot, near, gone = Robot(), Receiver('/near', 5 * MBIT), Receiver('/gone', 5 * MBIT)
    robot.drive([near, gone], 6.0)
    least = math.inf
    for _ in range(40):
        robot.drive([near], 0.1)
        least = min(least, robot.state.capacity)
    assert least > 0.9 * 5 * MBIT and robot.state.operator == '/near'


def idle(robot: Robot, receivers: List[Receiver], seconds: float) -> None:
    """Nothing is sent, and they report."""
    for _ in range(round(10 * seconds)):
        robot.now += 0.1
        for receiver in receivers:
            robot.controller.on_report(receiver.name, receiver.report(robot.now), robot.now, 1)
        robot.tick()


def test_a_silent_operator_no_longer_counts_though_nothing_is_sent() -> None:
    robot, slow, gone = Robot(), Receiver('/slow', 1 * MBIT), Receiver('/gone', 5 * MBIT)
    robot.controller.on_operators({'/slow': 1, '/gone': 1}, robot.now)
    robot.drive([gone], 6.0)
    robot.drive([slow, gone], 2.0)
    assert robot.state.operator == '/gone'
    idle(robot, [slow], OPERATOR_TIMEOUT + 0.1)
    assert robot.state.operator == '/slow' and not robot.state.timeout
    idle(robot, [], OPERATOR_TIMEOUT + 0.1)
    assert robot.state.timeout


def test_what_begins_in_a_silence_is_sent_slowly() -> None:
    robot, receiver = Robot(), Receiver('/op', 5 * MBIT)
    robot.drive([receiver], 6.0)
    idle(robot, [receiver], 1.5)
    idle(robot, [], 30.0)
    assert robot.rate > 4 * MBIT
    robot.drive([], 0.3)
    assert robot.rate < 1.2 * LIMITS.min_rate


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
    assert robot.controller.route('thermal', 100, SIZE, robot.now) == STRAIGHT
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
