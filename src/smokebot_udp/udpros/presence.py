# SPDX-License-Identifier: BSD-3-Clause
"""When a publisher's node asks the nodes of its subscribers whether they still have their connections.

By UDP a publisher learns of an ended subscriber only when it sends (ICMP port unreachable), and not at all where ICMP
is dropped. So each subscriber's node is asked now and then, for all topics together.
"""
from typing import Dict, List, Mapping, NamedTuple, Optional, Set

PERIOD = 120.0
"""Time from one question to a node to the next; each costs a TCP connection [s]."""

HURRIED_PERIOD = 10.0
"""The same to the first question, after a request for a connection came from the node's host, as something was
restarted there, and after a connection to the node has ended, as silent ones may have ended with it [s]."""

SETTLED = 10.0
"""Age of a connection from which on its node surely lists it, even if the answer to its request was slow [s]."""

MAX_UNANSWERED = 3600.0
"""A node that has not answered for this long has ended, as far as anybody can tell [s]. Longer than an outage of the
link: a roscpp subscriber does not ask again for a connection that its publisher ended."""


class Node(NamedTuple):
    """A subscriber's node, which a restart makes another one."""
    address: str
    """Address to which its datagrams are sent."""
    name: str
    uri: Optional[str]
    """URI of its XML-RPC server; None: unknown, the master did not answer."""


class Presence:
    """Decides which nodes are asked now, and which have been silent for too long."""

    def __init__(self) -> None:
        self._asked: Dict[Node, float] = {}
        # not asked yet, so that they may have ended before they were seen; or with fewer connections than before
        self._doubtful: Set[Node] = set()
        self._connections: Mapping[Node, int] = {}
        self._answered: Dict[Node, float] = {}
        self._requests: Dict[str, float] = {}      # {address: when a request came from it [s]}

    def requested(self, address: str, now: float) -> None:
        """A request for a connection came from a node on this host; any thread."""
        self._requests[address] = now

    def due(self, nodes: Mapping[Node, int], now: float) -> List[Node]:
        """The nodes to ask now.

        :param nodes: {node: number of its connections}, of all that have any; the others are forgotten
        :param now: by a steady clock [s]
        """
        addresses = {node.address for node in nodes}
        self._requests = {address: at for address, at in list(self._requests.items()) if address in addresses}
        self._doubtful = {node for node, number in nodes.items() if node in self._doubtful or node not in self._asked
                          or number < self._connections[node]}
        self._connections = dict(nodes)
        self._asked = {node: self._asked.get(node, now) for node in nodes}
        self._answered = {node: self._answered.get(node, now) for node in nodes}
        found = [node for node, asked in self._asked.items()
                 if now - asked >= (HURRIED_PERIOD if node in self._doubtful or
                                    self._requests.get(node.address, asked) > asked else PERIOD)]
        self._doubtful -= set(found)
        self._asked.update(dict.fromkeys(found, now))
        return found

    def answered(self, node: Node, now: float) -> None:
        """A node has answered."""
        self._answered[node] = now

    def is_lost(self, node: Node, now: float) -> bool:
        """Whether a node that does not answer has not done so for too long."""
        return now - self._answered.get(node, now) >= MAX_UNANSWERED
