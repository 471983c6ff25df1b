# SPDX-License-Identifier: BSD-3-Clause
"""The start of a node: while the master restarts, and while it is interrupted."""
import logging
import xmlrpc.client
from typing import Any

import rosgraph
import rospy
import rospy.core

from . import rpc
from .ending import end_by_signals


class _Transport(xmlrpc.client.Transport):
    """Repeats each call until the master answers, as long as `repeats`."""
    repeats = True

    def request(self, *args: Any, **kwargs: Any) -> Any:
        """As xmlrpc.client.Transport's."""
        request = super().request
        if not self.repeats:
            return request(*args, **kwargs)
        # not by rospy.logwarn: it asks the master, through this proxy
        return rpc.repeated(lambda: request(*args, **kwargs), logging.getLogger('rospy.' + __name__).warning)


def init_node(name: str) -> None:
    """Call rospy.init_node so that a restart of the master does not end the node, and a signal always does.

    rospy sets the node's private parameters and asks for /use_sim_time once; neither it nor a second call of
    rospy.init_node could go on where that failed. So its proxy of the master repeats its calls meanwhile.

    :param name: as for rospy.init_node
    :raises Exception: as rospy.init_node
    """
    uri, transport = rosgraph.get_master_uri(), _Transport()
    cache = rospy.core._xmlrpc_cache
    cache[uri] = type(rospy.core.xmlrpcapi(uri))(uri, transport=transport)
    end_by_signals()
    try:
        rospy.init_node(name, disable_signals=True)     # rospy's own handlers
    finally:
        transport.repeats = False       # rospy keeps the proxy
