# SPDX-License-Identifier: BSD-3-Clause
"""Settings of an action stream: an action server of the robot to which operators send goals over the link."""
from typing import Any, Mapping

from ...mission.parameters import Parameter
from ..message_types import action_types

COMMON = {
    'action_type': Parameter(None, '', 'type of the action, such as move_base_msgs/MoveBaseAction'),
    'max_age': Parameter(5.0, 's', 'goals and cancellations that did not arrive within this time are given up',
                         above=0.0, most=3600.0),
}
ROBOT = {
    'robot_action': Parameter(None, '', 'name of the action server on the robot'),
    **COMMON,
    'feedback_rate': Parameter(10.0, 'Hz', 'maximum rate of feedback and of the status; the newest is sent', above=0.0,
                               most=1000.0),
}
OPERATOR = {
    'operator_action': Parameter(None, '', "name under which the operator's action clients find it, in the operator's "
                                 'namespace'),
    **COMMON,
}


def check(settings: Mapping[str, Any]) -> None:
    """Check what the tables cannot.

    :param settings: {name: value} of both tables, each checked
    :raises ValueError: where the action type is unknown
    """
    action_types(settings['action_type'])
