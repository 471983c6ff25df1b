# SPDX-License-Identifier: BSD-3-Clause
"""Settings of relays that both sides have in common: those of reliable ones (streams/reliable) are among them."""
from typing import Any, Mapping

from ...mission.parameters import Parameter

LOG, DIAGNOSTICS = 'rosgraph_msgs/Log', 'diagnostic_msgs/DiagnosticArray'

LEVELS = 'debug', 'info', 'warn', 'error', 'fatal'
"""Levels of LOG messages, the lowest first."""

LEVEL_VALUES = {level: 1 << index for index, level in enumerate(LEVELS)}
"""{level: its value in LOG messages}"""

TO_OPERATOR, TO_ROBOT = 'to_operator', 'to_robot'
"""Values of `direction`."""

RELAY = {
    'message_type': Parameter(None, '', 'type of both topics, such as nav_msgs/Odometry'),
    'latch': Parameter(False, '', 'keep the last message for late subscribers, on both sides'),
    'reliable': Parameter(False, '', 'send every message, acknowledged, repeated and in order, instead of the newest '
                          'at `rate`: for goals, logs and other small messages'),
    'newest': Parameter(False, '', 'with reliable: of each publisher only the newest message, once the one before has '
                        'arrived: for states that are published again and again; of %s the statuses that are news' %
                        DIAGNOSTICS),
    'direction': Parameter(TO_OPERATOR, '', 'to_robot: operator_topic is sent, and robot_topic is published; only with '
                           'reliable', choices=(TO_OPERATOR, TO_ROBOT)),
    'needs_control': Parameter(False, '', 'with direction to_robot: taken only from the operator who drives, and not '
                               'during an emergency stop: for goals'),
    'max_age': Parameter(10.0, 's', 'with reliable: a message is given up after this time without an acknowledgement; '
                         'a long one also after this and the time that it takes at 16 kB/s',
                         above=0.0, most=3600.0),
    'max_messages': Parameter(1000, '', 'with reliable: messages that may wait to be acknowledged, for each operator; '
                              'then the oldest is given up', least=1, most=100000),
    'max_bytes': Parameter(1 << 20, 'byte', 'with reliable: their size together', least=1024, most=10000000),
    'level': Parameter('', '', 'with reliable, of %s: messages below this level are left out; empty: none' % LOG,
                       choices=('', *LEVELS)),
}
"""Parameters of both sides."""


def check(settings: Mapping[str, Any]) -> None:
    """Check what the tables cannot.

    :param settings: {name: value} of both sides' tables, each checked
    :raises ValueError: where a setting is one of reliable relays
    """
    for setting in ('level', 'newest', 'needs_control'):
        if settings[setting]:
            raise ValueError('%s is %r: it needs reliable: true' % (setting, settings[setting]))
