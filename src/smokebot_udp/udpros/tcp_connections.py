# SPDX-License-Identifier: BSD-3-Clause
"""The TCPROS connections of a node's subscribers, of rospy's own and of ours that fell back.

rospy notices only after 150 s, by the kernel's keep-alive, that one of the machines has another address; until then a
thread waits. And it connects again only when the master notifies the node of a topic's publishers: after such an end,
or a long outage of the link, a subscription of rospy's stays silent for good. So connections with a former address are
closed at once, and what has ended without the publisher's doing is connected again.
"""
import threading
from typing import Any, Callable, Collection, Dict, Iterable, List, Mapping, Set, Tuple

import rospy

from ..backoff import Backoff
from . import rpc
from .callers import is_home
from .endpoints import is_own, number_of
from .negotiation import Refused
from .rospy_transports import SubscriberTransport, UdpSubscriberImpl

RETRY_PERIOD, MAX_RETRY_PERIOD = 1.0, 30.0
"""Shortest and longest time from one attempt to connect again to the next [s]."""

Link = Tuple[str, str]
"""A topic, and the URI of its publisher."""


class TcpConnections:
    """Closes connections that lead nowhere, and makes ended ones anew.

    :param connect: f(topic, URI), connects a rospy.Subscriber once; raises rpc.Unreachable or Refused
    """

    def __init__(self, connect: Callable[[str, str], None]) -> None:
        self._connect = connect
        self._connected: Set[Link] = set()
        self._lost: Dict[Link, _Retry] = {}
        self._attempting: Set[Link] = set()

    def close_former(self, impls: Iterable[Any], moved: Collection[str] = ()) -> None:
        """Close connections from an address that this machine no longer has, or to one that a publisher no longer has.

        :param impls: topics that are subscribed
        :param moved: URIs of the nodes that have another address now
        """
        found = [(connection, *ends) for impl in impls for connection in _connections(impl)
                 for ends in _addresses(connection)]
        gone = {local for local in {local for _, local, _ in found} if not is_own(local)}
        for connection, local, remote in found:
            uri = connection.endpoint_id
            if local in gone or (uri in moved and not is_home(number_of(remote), uri)):
                rospy.logdebug('[%s]: the connection to %s had a former address', connection.name, uri)
                connection.close()

    def restore(self, impls: Iterable[Any], publishers: Mapping[str, Collection[str]], now: float) -> None:
        """Connect rospy's Subscribers again that have lost a publisher; ours do it themselves.

        :param impls: topics that are subscribed
        :param publishers: {topic: URIs}, as the master knows them
        :param now: by a steady clock [s]
        """
        connected = {(impl.resolved_name, connection.endpoint_id) for impl in impls
                     if not isinstance(impl, UdpSubscriberImpl) for connection in _connections(impl)}
        for link in self._connected - connected:
            self._lost[link] = _Retry(now)
        self._connected = connected
        for link, retry in list(self._lost.items()):
            if link in connected or link[1] not in publishers.get(link[0], ()):
                self._lost.pop(link, None)
            elif link not in self._attempting and retry.due(now):
                self._attempting.add(link)
                threading.Thread(target=self._attempt, args=(link,), name='TCPROS ' + link[0], daemon=True).start()

    def _attempt(self, link: Link) -> None:
        try:
            self._connect(*link)
        except (rpc.Gone, Refused) as error:
            rospy.logdebug('[%s]: %s publishes no longer: %s', *link, error)
            self._lost.pop(link, None)
        except (rpc.Unreachable, OSError) as error:
            rospy.logdebug('[%s]: no connection to %s, retrying: %s', *link, error)
        finally:
            self._attempting.discard(link)


class _Retry:
    """When to connect again.

    :param now: when the connection was lost [s]
    """

    def __init__(self, now: float) -> None:
        self._next, self._pauses = now, Backoff(RETRY_PERIOD, MAX_RETRY_PERIOD)

    def due(self, now: float) -> bool:
        """Whether to connect now; then again after a longer time."""
        if now < self._next:
            return False
        self._next = now + self._pauses.take()
        return True


def _connections(impl: Any) -> List[Any]:
    """A topic's TCPROS connections."""
    return [connection for connection in impl.connections if not isinstance(connection, SubscriberTransport)]


def _addresses(connection: Any) -> List[Tuple[str, str]]:
    """[(local address, remote one)] of a connection; empty until it is made, and once it has ended."""
    try:
        return [(connection.socket.getsockname()[0], connection.socket.getpeername()[0])]
    except (AttributeError, OSError):       # AttributeError: rospy has not made the socket yet, or has ended it
        return []
