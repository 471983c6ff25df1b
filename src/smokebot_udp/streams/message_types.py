# SPDX-License-Identifier: BSD-3-Clause
"""The classes of messages, services and actions that streams.yaml names."""
from typing import Any, Callable, NamedTuple

from genpy.message import get_message_class, get_service_class


class ActionTypes(NamedTuple):
    """The message classes of an action's topics."""
    goal: Any
    cancel: Any
    status: Any
    feedback: Any
    result: Any


def message_class(name: str) -> Any:
    """The class of a message type.

    :param name: package/Type
    :raises ValueError: where it does not exist or is not installed
    """
    return _found(get_message_class, name, 'message_type %r is no message type')


def service_class(name: str) -> Any:
    """The class of a service type.

    :param name: package/Type
    :raises ValueError: where it does not exist or is not installed
    """
    return _found(get_service_class, name, 'service_type %r is no service type')


def action_types(name: str) -> ActionTypes:
    """The message classes of an action type.

    :param name: package/TypeAction
    :raises ValueError: where it does not exist or is not installed
    """
    problem = 'action_type %r is no action type'
    action = _found(get_message_class, name, problem)
    types = dict(zip(action.__slots__, action._slot_types))
    if set(types) != {'action_goal', 'action_result', 'action_feedback'}:
        raise ValueError('%s, such as move_base_msgs/MoveBaseAction' % (problem % name))
    goal, result, feedback = (_found(get_message_class, types['action_' + part], problem)
                              for part in ('goal', 'result', 'feedback'))
    return ActionTypes(goal, message_class('actionlib_msgs/GoalID'), message_class('actionlib_msgs/GoalStatusArray'),
                       feedback, result)


def _found(find: Callable[[str], Any], name: str, problem: str) -> Any:
    """find(name).

    :raises ValueError: where it finds nothing
    """
    try:
        found = find(name)
    except ValueError:
        found = None
    if found is None:
        raise ValueError('%s that is installed here' % (problem % name))
    return found
