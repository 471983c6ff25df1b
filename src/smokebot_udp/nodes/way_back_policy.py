# SPDX-License-Identifier: BSD-3-Clause
"""Which streams a node refuses because anybody could use them: what operators send the robot over a link without a key.

On a shared master nothing is refused: there anybody can publish the robot's own topics, and call its services.
"""
from typing import Any, Dict, Mapping

from ..mission.parameters import EXCHANGES
from ..streams.relay.parameters import TO_ROBOT
from ..transport import Transport


def goes_to_robot(settings: Mapping[str, Any]) -> bool:
    """Whether operators send the robot something by a stream.

    :param settings: of the stream
    """
    return settings['type'] in EXCHANGES or settings.get('direction') == TO_ROBOT


def is_open(transport: Transport, allowed: bool) -> bool:
    """Whether anybody could command the robot, and nobody has said that this is all right.

    :param allowed: the node's parameter allow_unsealed_commands
    """
    return not (allowed or transport.sealed or not transport.own_masters)


def refused(definitions: Mapping[str, Mapping[str, Any]], transport: Transport, allowed: bool) -> Dict[str, str]:
    """{name: why, in one sentence} of the streams that this node must not start.

    :param definitions: {name: settings} of all streams
    :param allowed: the node's parameter allow_unsealed_commands
    """
    if not is_open(transport, allowed):
        return {}
    return {name: "stream '%s' (%s) is refused: the link has no key, so anybody on the network could use it; give both "
                  'sides a key_file, or set allow_unsealed_commands on both' % (name, settings['type'])
            for name, settings in definitions.items() if goes_to_robot(settings)}
