# SPDX-License-Identifier: BSD-3-Clause
"""Settings of reliable relays. In streams.yaml they are relays with `reliable: true`, and may have all of a relay's."""
from typing import Any, Mapping

from ..message_types import message_class
from ..relay.assembler import RelayAssembler
from ..relay.encoder import RelayEncoder
from ..relay.parameters import LOG, TO_ROBOT

UNUSED = frozenset({'rate', 'weight', 'min_bitrate', 'repeat_rate', 'max_share'})
"""Settings of relays that reliable ones do not have."""

ROBOT = {name: parameter for name, parameter in RelayEncoder.PARAMETERS.items() if name not in UNUSED}
OPERATOR = RelayAssembler.PARAMETERS


def check(settings: Mapping[str, Any]) -> None:
    """Check what the tables cannot.

    :param settings: {name: value} of both sides' tables of relays, each checked
    :raises ValueError: where settings contradict each other, or the type is unknown
    """
    if not settings['reliable']:
        raise ValueError('direction: to_robot needs reliable: true; what the robot obeys only while it is new, '
                         'such as cmd_vel, is of type: command')
    if settings['newest'] and settings['latch']:
        raise ValueError('newest and latch are both true: latch keeps one message, newest one of each publisher')
    if settings['needs_control'] and settings['direction'] != TO_ROBOT:
        raise ValueError('needs_control is true: it needs direction: to_robot')
    message_class(settings['message_type'])
    if settings['level'] and settings['message_type'] != LOG:
        raise ValueError('level is %r: message_type must be %s, not %s' % (
            settings['level'], LOG, settings['message_type']))
