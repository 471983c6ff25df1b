# SPDX-License-Identifier: BSD-3-Clause
"""Topics of a node of another master on this machine, for subscribers of this one's."""
from typing import Container

from ..udpros import rpc
from ..udpros.master import Registration, ask_together


def register_publishers(master: str, node: str, topics: Container[str]) -> None:
    """Register what a node publishes with this process's master, too. Subscribers then connect to the node.

    :param master: URI of the node's own master
    :param node: its resolved name
    :param topics: their resolved names; others are not registered
    :raises rpc.Unreachable, rpc.Refused: if the other master does not answer, or does not know the node yet
    """
    uri = rpc.call(master, 'lookupNode', node)
    ask_together([Registration(topic, type_, 'pub') for topic, type_ in rpc.call(uri, 'getPublications')
                  if topic in topics], node, uri)
