# SPDX-License-Identifier: BSD-3-Clause
from typing import List

import pytest

from smokebot_udp.monitoring.control_status import control_text, operator_control_status, robot_control_status
from smokebot_udp.monitoring.status import ERROR, OK, OPERATOR, ROBOT, WARN


@pytest.mark.parametrize('driver, estop, operators, text', [
    ('', False, [], 'nobody drives'), ('/a', False, ['/a'], '/a drives'),
    ('/a', True, ['/b', '/a'], 'EMERGENCY STOP; /a drives, present: /b'),
    ('', False, ['/a', '/b'], 'nobody drives, present: /a, /b')])
def test_who_drives_in_words(driver: str, estop: bool, operators: List[str], text: str) -> None:
    assert control_text(driver, estop, operators) == text


def test_an_emergency_stop_is_a_warning_that_names_who_engaged_it() -> None:
    status = robot_control_status('/a', '/b', ['/a', '/b'], {'too many operators': 3})
    assert (status.level, status.message) == (WARN, 'emergency stop, engaged by /b')
    assert status.values == {'side': ROBOT, 'control': 'EMERGENCY STOP; /a drives, present: /b', 'driver': '/a',
                             'emergency stop': 'engaged', 'operators': '/a, /b', 'dropped, too many operators': 3}
    fine = robot_control_status('', None, [], {})
    assert (fine.level, fine.message, fine.values['driver']) == (OK, 'fine', 'nobody')


def test_an_operator_without_the_robots_clock_cannot_command() -> None:
    assert operator_control_status('in control', False, 0.002, 0.5)[1:] == (OK, 'fine', {
        'side': OPERATOR, 'control': 'in control', "uncertainty of the robot's clock [ms]": 2.0,
        'loss to the robot [%]': 50.0})
    assert operator_control_status('LOCKED: thermal is 2.0 s old', True, 0.002, None).level == WARN
    unknown = operator_control_status('LOCKED: the robot was not heard yet', True, None, None)
    assert (unknown.level, unknown.message) == (ERROR, 'LOCKED: the robot was not heard yet')
