# SPDX-License-Identifier: BSD-3-Clause
"""The link controller and reports that are forged, repeated, or of too many operators."""
import math
from typing import Any

import pytest
from controlled_robot import LIMITS, SIZE, Receiver, Robot

from smokebot_udp.congestion.controller import MAX_OPERATORS, OPERATOR_TIMEOUT, SOURCE_TIMEOUT
from smokebot_udp.congestion.feedback import ArrivalSample, Report, StreamArrivals
from smokebot_udp.units import MBIT

IMPOSSIBLE = Report(7, 10 ** 12, [StreamArrivals('thermal', 10 ** 6, 10 ** 6, 10 ** 9)], [])


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
