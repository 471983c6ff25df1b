# SPDX-License-Identifier: BSD-3-Clause
"""The status of the control of the robot: who drives, and whether the emergency stop is engaged."""
from typing import Mapping, Optional, Sequence

from .status import ERROR, OK, OPERATOR, ROBOT, WARN, Status, by_reason, scaled


def control_text(driver: str, estop: bool, operators: Sequence[str]) -> str:
    """Who drives, in words.

    :param driver: name; empty: nobody
    :param operators: names of all that are present
    """
    others = [name for name in operators if name != driver]
    return '%s%s%s' % ('EMERGENCY STOP; ' if estop else '', '%s drives' % driver if driver else 'nobody drives',
                       ', present: ' + ', '.join(others) if others else '')


def robot_control_status(driver: str, estop_by: Optional[str], operators: Sequence[str],
                         dropped: Mapping[str, int]) -> Status:
    """The status on the robot's side.

    :param estop_by: who engaged the emergency stop; None: it is not engaged
    :param dropped: {reason: requests that were refused}
    """
    estop = estop_by is not None
    return Status('control', WARN if estop else OK, 'emergency stop, engaged by %s' % estop_by if estop else 'fine', {
        'side': ROBOT, 'control': control_text(driver, estop, operators), 'driver': driver or 'nobody',
        'emergency stop': 'engaged' if estop else 'released', 'operators': ', '.join(operators) or 'none',
        **by_reason('dropped', dict(dropped))})


def operator_control_status(state: str, locked: bool, uncertainty: Optional[float], loss: Optional[float]) -> Status:
    """The status on the operator's side.

    :param state: in words, see OperatorControl
    :param locked: whether no command would leave now
    :param uncertainty: of the robot's clock [s]; None: it is unknown
    :param loss: ratio of this node's datagrams that do not reach the robot, 0..1; None: unknown
    """
    level = ERROR if uncertainty is None else WARN if locked else OK
    return Status('control', level, state if level else 'fine', {
        'side': OPERATOR, 'control': state, 'uncertainty of the robot\'s clock [ms]': scaled(uncertainty, 1e3),
        'loss to the robot [%]': scaled(loss, 100)})
