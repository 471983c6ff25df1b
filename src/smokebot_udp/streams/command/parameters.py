# SPDX-License-Identifier: BSD-3-Clause
"""Settings of a command stream: an operator's commands, such as a Twist, which the robot obeys only while they are new.
"""
from dataclasses import dataclass
from typing import Any, Mapping, Optional

from genpy.message import MessageException, SerializationError, fill_message_args

from ...mission.parameters import Parameter
from ...serialised import serialised
from ..message_types import message_class

STOP, NOTHING = 'stop', 'nothing'
"""Values of on_timeout."""


@dataclass(frozen=True)
class OnTimeout(Parameter):
    """STOP, NOTHING, or the fields of a message: a mapping, which `check` of this module compares with its type."""

    def check(self, value: Any) -> Any:
        return value if isinstance(value, dict) else super().check(value)

    @property
    def allowed(self) -> str:
        return super().allowed + ', or the fields of a message, such as {linear: {x: 0.0}}'


COMMON = {
    'message_type': Parameter(None, '', 'type of both topics, such as geometry_msgs/Twist'),
}
ROBOT = {
    'robot_topic': Parameter(None, '', 'topic on the robot on which accepted commands are published'),
    **COMMON,
    'enabled': Parameter(True, '', 'whether commands are accepted', live=True),
    'max_age': Parameter(0.3, 's', 'a command that is older is discarded on the robot', above=0.0, most=10.0,
                         live=True),
    'timeout': Parameter(0.5, 's', 'time without an accepted command after which on_timeout is published', above=0.0,
                         most=10.0, live=True),
    'on_timeout': OnTimeout(STOP, '', "stop: the type's zero value; nothing; or the fields of a message, such as "
                            '{linear: {x: 0.0}}: those that are missing are zero', choices=(STOP, NOTHING)),
    'rate': Parameter(20.0, 'Hz', 'rate at which on_timeout is published', above=0.0, most=1000.0, live=True),
    'hold': Parameter(2.0, 's', 'time for which on_timeout is published; then the stream is silent until the next '
                      'command', above=0.0, most=3600.0, live=True),
}
OPERATOR = {
    'operator_topic': Parameter(None, '', "topic on the operator's side with the commands, in the operator's "
                                'namespace'),
    **COMMON,
    'require_fresh': Parameter('', '', 'name of a stream of type image, cloud, scan or virtual_scan: no command leaves '
                               'while what the operator sees of it is older than max_view_age; empty: none'),
    'max_view_age': Parameter(1.0, 's', 'with require_fresh', above=0.0, most=60.0, live=True),
}


def check(settings: Mapping[str, Any]) -> None:
    """Check what the tables cannot.

    :param settings: {name: value} of both tables, each checked
    :raises ValueError: where the message type is unknown, or on_timeout is no message of this type
    """
    timeout_message(settings)


def timeout_message(settings: Mapping[str, Any]) -> Optional[Any]:
    """The message that on_timeout stands for, as it arrives; None: nothing. Stamps are zero.

    :raises ValueError: as of `check`
    """
    message, value = message_class(settings['message_type'])(), settings['on_timeout']
    if value == NOTHING:
        return None
    try:
        fill_message_args(message, [{} if value == STOP else value])
        crossed = message_class(settings['message_type'])().deserialize(serialised(message))
    except (MessageException, SerializationError, ValueError, TypeError, AttributeError) as error:
        raise ValueError('on_timeout is %r, must be stop, nothing, or fields of a %s: %s' % (
            value, settings['message_type'], error)) from None
    return crossed
