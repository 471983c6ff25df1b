# SPDX-License-Identifier: BSD-3-Clause
"""Only one node can have a name: the master ends a running node where another registers with its name.

If both are respawned, they end each other for ever. So a node that would end a living one waits instead, and starts
when that one has ended.
"""
import sys
import time
import urllib.parse
from typing import Optional, Tuple

import rosgraph
import rospy

from ..udpros import rpc

SECOND_OPERATOR = 'A further operator needs another name: roslaunch smokebot_udp operator.launch name:=desk2'
"""What the user can do where an operator's node has a namesake."""

PERIOD = 2.0
"""How often a living namesake is asked whether it still lives [s]."""


def resolved(node: str) -> str:
    """The full name that rospy.init_node gives to a node, before it is called."""
    name = rospy.names.get_mappings().get('__name', node)
    return str(rosgraph.names.resolve_name(name, rospy.names.get_caller_id()))


def living(name: str) -> Optional[Tuple[str, int]]:
    """The host and pid of the node that has this name; None where there is no such node, or it does not answer.

    :param name: resolved
    """
    try:
        uri = rpc.call(rosgraph.get_master_uri(), 'lookupNode', name)
        return str(urllib.parse.urlparse(uri).hostname), int(rpc.call(uri, 'getPid'))
    except (rpc.Unreachable, rpc.Refused, ValueError):
        return None


def wait_until_free(node: str, remedy: str) -> None:
    """Wait as long as a living node has the name that this one is about to take.

    :param node: name as for rospy.init_node, which is called afterwards
    :param remedy: what the user can do; the error ends with it
    """
    name, logged = resolved(node), None
    while True:
        found = living(name)
        if found is None:
            return
        if found != logged:
            rospy.logerr('%s already runs on %s (pid %d), and only one node can have this name: this one waits until '
                         'that one has ended. %s', name, *found, remedy)
            logged = found
        try:
            time.sleep(PERIOD)
        except KeyboardInterrupt:
            sys.exit(130)
