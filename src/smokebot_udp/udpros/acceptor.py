# SPDX-License-Identifier: BSD-3-Clause
"""The publisher's side of negotiation: grants subscribers' requests, or refuses them with a reason."""
import collections
import itertools
import socket
import threading
import time
from typing import Any, Callable, Collection, Counter, Dict, List, Optional, Tuple

import rospy
import rospy.core
import rospy.names
from rospy.impl.registration import get_topic_manager

from ..version import FORMAT_FIELD
from . import admission, rpc
from .admission import Claim
from .bus_info import receiving_ports
from .callers import MAX_AGE, Bus, Callers, is_home
from .datagram import MIN_MAX_DATAGRAM_SIZE, ROSCPP_MAX_DATAGRAM_SIZE
from .endpoints import is_own, number_of, path_payload
from .negotiation import Refused, Reply, Request, check_formats, other_type
from .packetizer import no_limit
from .presence import SETTLED, Node, Presence
from .rospy_transports import PublisherTransport, UdpPublisherImpl, udpros_connections

REVIEW_PERIOD = 2.0
"""How often a caller with several connections of one topic is asked which of them it has [s]."""


class Acceptor:
    """Grants the UDPROS connections of a node's publishers; any thread.

    :param incomplete: f() -> whether the master, which has been restarted, may not know all nodes yet
    :param moved: f(URI, address), called when a node with a connection requests one from another address
    """

    def __init__(self, incomplete: Callable[[], bool], moved: Callable[[str, str], None]) -> None:
        self.refused: Counter[str] = collections.Counter()
        """{reason: requests}"""
        self._incomplete, self._moved = incomplete, moved
        self._callers = Callers()
        self._presence = Presence()
        self._ids = itertools.count(1)
        self._growing: List[Tuple[str, str]] = []       # (topic, address) of those that are being made
        self._lock = threading.Lock()
        self._review: Optional[threading.Thread] = None
        self._next_review = 0.0

    def accept(self, topic: str, protocol: List[Any]) -> Reply:
        """Connect to the subscriber that makes a request.

        :raises Refused: if it is not acceptable
        """
        try:
            return self._accept(topic, protocol)
        except Refused as refusal:
            self.refused[refusal.reason] += 1
            raise

    def _accept(self, topic: str, protocol: List[Any]) -> Reply:
        impl = get_topic_manager().get_publisher_impl(topic)
        if impl is None or impl.closed:
            raise Refused('not a publisher of [%s]' % topic, 'topic')
        request = Request.parse(protocol)
        md5sum = impl.data_class._md5sum
        if request.header['md5sum'] not in ('*', md5sum):
            raise other_type(topic, impl.data_class._type, md5sum, request.header['md5sum'])
        if FORMAT_FIELD in (impl.headers or {}):
            check_formats(_header(impl), request.header)
        try:
            request.host = socket.gethostbyname(request.host)       # from now on one address
            admission.check_address(request.host)
            size = _datagram_size(impl, request)
            connection = self._connection_of(impl, request, size) or self._connect(impl, request, size)
        except (OSError, UnicodeError) as error:
            raise Refused('no route to %s:%d: %s' % (request.host, request.port, error), 'no route') from error
        host, port = connection.local_endpoint
        return Reply(host, port, connection.connection_id, size, _header(impl))

    def _connection_of(self, impl: Any, request: Request, size: int) -> Optional[Any]:
        """The connection that a request has made before: its answer may have been lost."""
        for connection in udpros_connections(impl):
            if (connection.endpoint_id, connection.remote_endpoint, connection.packetizer.max_datagram_size) == (
                    request.header['callerid'], (request.host, request.port), size):
                if isinstance(impl, UdpPublisherImpl):
                    impl.send_latched(connection)
                return connection
        return None

    def _connect(self, impl: Any, request: Request, size: int) -> PublisherTransport:
        """Make a connection, in the place of those that the caller no longer has."""
        before = {c.remote_endpoint[0] for c in _by_caller(impl).get(request.header['callerid'], [])}
        uri = self._identify(impl, request)
        if uri is not None and before - {request.host}:
            self._moved(uri, request.host)
        self._presence.requested(request.host, time.monotonic())
        place = impl.resolved_name, request.host
        with self._lock:
            others = [(c.name, c.remote_endpoint[0]) for c in _connections()] + self._growing
            admission.check_room(place, others)
            self._growing.append(place)
        try:
            limit = impl.options.limit if isinstance(impl, UdpPublisherImpl) else no_limit
            connection = PublisherTransport(impl.resolved_name, request, next(self._ids), size, limit,
                                            lambda: _tos(impl))
            connection.caller_uri = uri
            added = _add(impl, connection)
        finally:
            with self._lock:
                self._growing.remove(place)
        if not added:
            connection.close()
            raise Refused('[%s] is no longer published' % impl.resolved_name, 'topic')
        return connection

    def _identify(self, impl: Any, request: Request) -> Optional[str]:
        """Check that a request is of the node that it names, and end the connections that this node no longer has.

        Without an answer of the master or the node, a request is believed, but it does not end a connection.

        :return: the node's URI; None: unknown
        :raises Refused: if another one is connected by this name, or the master does not know it
        """
        name = request.header['callerid']
        try:
            uri = self._callers.uri(name)
        except rpc.Unreachable as error:
            rospy.logdebug('the master does not say who %s is: %s', name, error)
            uri = None
        else:
            if uri is None and not self._incomplete():
                raise Refused('the master does not know a node %s' % name, 'unknown node')
        if uri is not None and not is_home(number_of(request.host), uri):
            raise Refused('%s is not the host of %s' % (request.host, name), 'address')
        mine = _by_caller(impl).get(name, [])
        if mine and uri is not None:
            self._settle(impl, name, uri, mine)
        if sum(not c.done for c in mine) >= admission.MAX_PER_CALLER:
            raise Refused('%s has %d connections already' % (name, len(mine)), 'connected already')
        return uri

    def _settle(self, impl: Any, name: str, uri: str, mine: List[Any]) -> None:
        """End a caller's connections that it does not have.

        :param mine: its connections
        :raises Refused: if it has one
        """
        bus = self._callers.bus(uri, MAX_AGE)
        if any(admission.is_living(claim, _ports(bus, impl)) for claim in _claims(mine, uri, bus)):
            bus = self._callers.bus(uri)        # the answer may be older than the request
        _close_ended(impl, mine, uri, bus)
        for claim in _claims(mine, uri, bus):
            if admission.is_living(claim, _ports(bus, impl)):
                raise Refused('%s is connected already, at port %d' % (name, claim.port), 'connected already')

    # -- connections that have ended -----------------------------------------------------------------

    def review(self) -> None:
        """End connections that this machine can no longer send from, and find out, in the background, which of several
        connections of one caller it has, and which callers have ended; called periodically."""
        _close_stale()
        now = time.monotonic()
        if self._review is not None and self._review.is_alive():
            return
        doubles = _doubles() if now >= self._next_review else []
        nodes = self._presence.due(collections.Counter(map(_node, _connections())), now)
        if doubles:
            self._next_review = now + REVIEW_PERIOD
        if doubles or nodes:
            self._review = threading.Thread(target=self._ask, args=(doubles, nodes), daemon=True)
            self._review.start()

    def _ask(self, doubles: List[Any], nodes: List[Node]) -> None:
        self._resolve(doubles)
        for node in nodes:
            self._check(node)

    def _resolve(self, doubles: List[Any]) -> None:
        for impl, name, mine in doubles:
            uri = self._uri(name)
            bus = None if uri is None else self._callers.bus(uri, MAX_AGE)
            newest = max(mine, key=lambda c: c.since)
            if uri is not None and _ports(bus, impl) is not None:
                _close_ended(impl, mine, uri, bus)
            elif time.monotonic() - newest.since > admission.UNPROVEN:
                for connection in mine:
                    if connection is not newest:
                        connection.close()

    def _check(self, node: Node) -> None:
        """Ask a node which of its connections it has, and end the others."""
        asked = time.monotonic()
        mine = [c for c in _connections() if _node(c) == node and asked - c.since >= SETTLED]
        uri = node.uri or self._uri(node.name)
        bus = None if uri is None else self._callers.bus(uri)
        now = time.monotonic()
        if bus is not None:
            self._presence.answered(node, now)
        lost = self._presence.is_lost(node, now)
        for connection in mine:
            ports = receiving_ports(None if bus is None else bus.entries, connection.name)
            if lost or (ports is not None and connection.remote_endpoint[1] not in ports):
                rospy.loginfo('[%s]: a connection to %s has ended', connection.name, node.name)
                connection.close()

    def _uri(self, name: str) -> Optional[str]:
        """The URI of a node; None: unknown."""
        try:
            return self._callers.uri(name)
        except (rpc.Unreachable, Refused) as error:
            rospy.logdebug('the master does not say who %s is: %s', name, error)
            return None


def _connections() -> List[Any]:
    """The UDPROS connections of the node's publishers."""
    return [c for impl in list(get_topic_manager().pubs.values()) for c in udpros_connections(impl)]


def _node(connection: Any) -> Node:
    return Node(connection.remote_endpoint[0], connection.endpoint_id, connection.caller_uri)


def _doubles() -> List[Any]:
    """[(topic, caller, its connections), ...] of the callers with several connections of one topic."""
    return [(impl, name, mine) for impl in list(get_topic_manager().pubs.values())
            for name, mine in _by_caller(impl).items() if len(mine) > 1]


def _close_stale() -> None:
    """End connections from an address that this machine no longer has; their subscribers ask for them again."""
    connections = _connections()
    stale = {address for address in {c.local_endpoint[0] for c in connections} if not is_own(address)}
    for connection in connections:
        if connection.local_endpoint[0] in stale:
            connection.close()


def _ports(bus: Optional[Bus], impl: Any) -> Optional[Collection[int]]:
    """The ports on which a node receives a topic, by its own word; None: unknown."""
    return receiving_ports(None if bus is None else bus.entries, impl.resolved_name)


def _close_ended(impl: Any, mine: List[Any], uri: str, bus: Optional[Bus]) -> None:
    ports = _ports(bus, impl)
    for connection, claim in zip(mine, _claims(mine, uri, bus)):
        if admission.has_ended(claim, ports):
            connection.close()


def _add(impl: Any, connection: PublisherTransport) -> bool:
    """Add a connection to a topic; whether that is still open.

    A plain rospy.Publisher would end the others of the same name, which proves nothing.
    """
    if isinstance(impl, UdpPublisherImpl):
        return impl.add_connection(connection)
    name, connection.endpoint_id = connection.endpoint_id, '%s by UDPROS' % connection.endpoint_id
    added = bool(impl.add_connection(connection))
    connection.endpoint_id = name
    return added


def _claims(mine: List[Any], uri: str, bus: Optional[Bus]) -> List[Claim]:
    """A caller's connections, at the time at which it was asked for them."""
    asked = time.monotonic() if bus is None else bus.asked
    return [Claim(c.remote_endpoint[1], is_home(number_of(c.remote_endpoint[0]), uri), asked - c.since) for c in mine]


def _by_caller(impl: Any) -> Dict[str, List[Any]]:
    found: Dict[str, List[Any]] = {}
    for connection in udpros_connections(impl):
        found.setdefault(connection.endpoint_id, []).append(connection)
    return found


def _datagram_size(impl: Any, request: Request) -> int:
    """The longest datagram that both sides and the path allow.

    :raises Refused: if it is too short
    :raises OSError: if the host is unreachable
    """
    ours = impl.options.max_datagram_size if isinstance(impl, UdpPublisherImpl) else ROSCPP_MAX_DATAGRAM_SIZE
    admission.check_size(request.max_datagram_size, ours)
    size = min(request.max_datagram_size, ours, path_payload(request.host, request.port))
    if size < MIN_MAX_DATAGRAM_SIZE:
        raise Refused('the path to %s is limited to datagrams of %d bytes' % (request.host, size), 'datagram size')
    return size


def _tos(impl: Any) -> int:
    """Second byte of the IP headers of a publisher's datagrams."""
    return impl.options.tos if isinstance(impl, UdpPublisherImpl) else 0


def _header(impl: Any) -> Dict[str, str]:
    """A publisher's connection header."""
    header = {'topic': impl.resolved_name, 'type': impl.data_class._type, 'md5sum': impl.data_class._md5sum,
              'message_definition': impl.data_class._full_text, 'callerid': rospy.names.get_caller_id(),
              'latching': '1' if impl.is_latch else '0'}
    header.update(impl.headers or {})
    return header
