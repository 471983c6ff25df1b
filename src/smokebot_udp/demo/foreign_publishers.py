# SPDX-License-Identifier: BSD-3-Clause
"""Topics across two masters on this machine: of a node of the other one for subscribers here, and the reverse."""
import contextlib
from typing import Container, Iterator, Mapping

import rospy

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


@contextlib.contextmanager
def published_at(master: str, topics: Mapping[str, str]) -> Iterator[None]:
    """A context in which another master knows what this process publishes: its subscribers connect to this process.

    :param master: URI of the other master
    :param topics: {resolved name: type}
    :raises rpc.Unreachable, rpc.Refused: if the other master does not answer
    """
    uri = rospy.get_node_uri()
    try:
        for topic, type_ in topics.items():
            rpc.call(master, 'registerPublisher', topic, type_, uri)
        yield
    finally:
        with contextlib.suppress(rpc.Unreachable, rpc.Refused):
            for topic in topics:
                rpc.call(master, 'unregisterPublisher', topic, uri)
