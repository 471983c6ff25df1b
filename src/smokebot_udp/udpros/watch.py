# SPDX-License-Identifier: BSD-3-Clause
"""The supervision of a node's topics: a restarted master, publishers that are gone, silent connections.

A notification may be lost with the link, and anybody can send one. So it only makes the master be asked, whose answer
counts. Questions are asked together: of the master one for all topics, of another node one for all connections to it.
"""
import threading
import time
import traceback
from typing import Any, Callable, Dict, List, Optional, Sequence, Set, Tuple

import rosgraph
import rospy
import rospy.core
import rospy.names
from rospy.impl.registration import get_topic_manager

from ..backoff import Backoff
from ..limited_log import logerr
from . import rpc
from .bus_info import OUTBOUND, BusEntry, udpros_entries
from .connector import Connector
from .endpoints import is_own
from .master import MasterWatch, Registration, register_node
from .negotiation import Refused
from .rospy_transports import SubscriberTransport, UdpSubscriberImpl
from .silence import SILENCE_TIMEOUT, FormerAddress, NewestAddresses
from .tcp_connections import TcpConnections

PERIOD = 1.0
"""How often the master's connection is checked, and topics are checked for silence [s]."""

ADDRESS_PERIOD = 0.2
"""How often this machine's own address is checked, without a packet [s]."""

MIN_QUESTION_PERIOD, MAX_QUESTION_PERIOD = 0.2, 8.0
"""Time from one question about notifications to the next: it doubles up to the maximum while they are wrong [s]."""

SETTLING_TIME = 60.0
"""Time after the registration with a restarted master during which it may not know all nodes [s]."""

MAX_UNCONFIRMED = 2
"""Publishers of one topic to connect to before the master has confirmed them."""


class Watch:
    """Supervises the topics of a node, in a thread of its own.

    :param registration: rospy's RegManager
    :param chores: f(), called once a period as well
    """

    def __init__(self, connector: Connector, registration: Any, chores: Callable[[], None]) -> None:
        self._connector, self._registration, self._chores = connector, registration, chores
        self._update_plain = registration.publisher_update
        self._master = MasterWatch(rosgraph.get_master_uri(), registration.uri)
        self._registered_at = -float('inf')
        self._lock = threading.Lock()
        self._confirmed: Dict[str, Tuple[str, ...]] = {}    # {topic: publishers, as the master last said}
        self._doubtful: Set[str] = set()                    # topics with notifications that differ
        self._asked_at, self._questions = -float('inf'), Backoff(MIN_QUESTION_PERIOD, MAX_QUESTION_PERIOD)
        self._reviewing: Set[str] = set()                   # URIs of the nodes that are being asked
        self._lost_address: Optional[str] = None            # the one towards the master, once it is not ours any more
        self._moved: Set[str] = set()                       # URIs of nodes that have another address now
        self._dropped: Set[Tuple[str, str]] = set()         # (topic, URI), see `drop`
        self._addresses = NewestAddresses()
        self._former: FormerAddress[SubscriberTransport] = FormerAddress()
        self._tcp = TcpConnections(connector.connect_tcp)
        self._wake, self._ended = threading.Event(), threading.Event()

    def start(self) -> None:
        """Begin to supervise."""
        threading.Thread(target=self._run, name='UDPROS watch', daemon=True).start()

    def stop(self) -> None:
        """End the thread."""
        self._ended.set()
        self._wake.set()

    def settling(self) -> bool:
        """Whether the master has been restarted, and may not know all nodes yet."""
        return time.monotonic() - self._registered_at < SETTLING_TIME

    def notified(self, topic: str, uris: Sequence[str]) -> None:
        """ROSHandler.publisherUpdate: somebody says which publishers a topic has.

        New ones are connected at once, as long as they are few. The master is asked whether it is true.
        """
        impl, new = get_topic_manager().get_subscriber_impl(topic), []
        with self._lock:
            confirmed = self._confirmed.get(topic, ())
            if impl is None or set(uris) == set(confirmed):
                return
            if isinstance(impl, UdpSubscriberImpl):
                room = MAX_UNCONFIRMED - len(set(impl.publishers) - set(confirmed))
                new = [uri for uri in dict.fromkeys(uris) if uri not in impl.publishers][:max(0, room)]
                impl.publishers = (*impl.publishers, *new)
            self._doubtful.add(topic)
        self._connector.connect_all(topic, new)
        self._wake.set()

    def publisher_update(self, topic: str, uris: Sequence[str]) -> None:
        """RegManager.publisher_update: the topic's publishers that the master knows.

        Connections to others end; but a restarted master does not know those of nodes that register once.
        """
        impl = get_topic_manager().get_subscriber_impl(topic)
        with self._lock:
            changed = set(uris) != set(self._confirmed.get(topic, ()))
            self._confirmed[topic] = tuple(uris)
            self._dropped = {(name, uri) for name, uri in self._dropped if name != topic or uri in uris}
        if changed:
            self._questions.reset()
        if not isinstance(impl, UdpSubscriberImpl):
            self._update_plain(topic, self._kept(topic, uris))
            return
        if changed:
            impl.silence.hurry()
        ended = []
        for connection in _connections(impl):
            connection.orphan &= connection.endpoint_id not in uris
            if connection.endpoint_id not in uris and not connection.orphan:
                ended.append(connection)
        orphans = [c.endpoint_id for c in _connections(impl) if c.orphan]
        impl.publishers = tuple(dict.fromkeys((*uris, *orphans)))
        for connection in ended:
            connection.close()
        self._connector.connect_all(topic, [uri for uri in uris if not impl.has_connection(uri)])

    def drop(self, topic: str, node: str) -> None:
        """End the connection of a rospy.Subscriber to a node, and do not connect to it again.

        :param node: its name
        """
        impl = get_topic_manager().get_subscriber_impl(topic)
        found = [connection for connection in (impl.connections if impl is not None else ())
                 if connection.callerid_pub == node]
        with self._lock:
            self._dropped |= {(topic, connection.endpoint_id) for connection in found}
        for connection in found:
            connection.close()

    def _kept(self, topic: str, uris: Sequence[str]) -> List[str]:
        """The publishers to which a rospy.Subscriber is connected."""
        return [uri for uri in uris if (topic, uri) not in self._dropped]

    def moved(self, uri: str, address: str) -> None:
        """A node has asked from another address than before: what it publishes may have been sent from the former one.

        It asks for each of its topics; connections made after the first request are from the new address.
        """
        with self._lock:
            if not self._addresses.is_new(uri, address):
                return
            self._moved.add(uri)
        self._wake.set()

    # -- the thread --------------------------------------------------------------------------------

    def _run(self) -> None:
        while not self._ended.is_set() and not rospy.core.is_shutdown_requested():
            try:
                self._step(time.monotonic())
            except (rpc.Unreachable, Refused) as error:
                rospy.logdebug('the master does not answer: %s', error)
            except Exception:   # a bug of ours must not end the watch
                logerr('watching the topics failed', traceback.format_exc(), 60.0)
            hurry = self._doubtful or self._former or self._lost_address is not None
            self._pause(MIN_QUESTION_PERIOD if hurry else PERIOD)
            self._wake.clear()

    def _pause(self, period: float) -> None:
        """Wait for a period [s], until something is to be done, or until this machine loses its address."""
        end = time.monotonic() + period
        while not self._wake.wait(max(0.0, min(ADDRESS_PERIOD, end - time.monotonic()))):
            address = self._master.own_address
            known, self._lost_address = self._lost_address, None if address is None or is_own(address) else address
            if self._lost_address not in (None, known) or time.monotonic() >= end:
                return

    def _step(self, now: float) -> None:
        self._chores()
        self._connector.upgrade(_subscribed(), now)
        self._renew(now)
        silent = _silent(now)
        try:
            connections, address = self._master.connections, self._master.own_address
            if self._master.is_new() and self._register():
                self._master.registered()
            if self._master.connections != connections:     # the link was down, or the master
                self._reconnected(address not in (None, self._master.own_address))
            self._ask_master([impl.resolved_name for impl in silent])
            self._ask_doubtful(now)
        finally:
            self._review(silent, now)

    def _reconnected(self, moved: bool) -> None:
        """The connection to the master was replaced: others may be broken, too.

        :param moved: whether this machine has another address now, to which nobody sends yet
        """
        for impl in _subscribed():
            impl.silence.hurry()
        if moved:
            self._former.lost([c for impl in _subscribed() for c in _connections(impl)], time.monotonic())
            self._renew(time.monotonic())

    def _renew(self, now: float) -> None:
        """Make connections anew that were made to an address of this machine, or from one of another, that it no longer
        has; those of TCPROS also after an outage of the link."""
        impls = _all_subscribed()
        with self._lock:
            moved, self._moved = self._moved, set()
            publishers = {topic: self._kept(topic, uris) for topic, uris in self._confirmed.items()}
        if moved:
            self._former.lost([c for impl in _subscribed() for c in _connections(impl) if c.endpoint_id in moved],
                              time.monotonic())
        for connection in self._former.broken(time.monotonic()):
            self._connector.renew(connection)
        self._tcp.close_former(impls, moved)
        self._tcp.restore(impls, publishers, now)

    def _register(self) -> bool:
        """Register the node with a new master; whether this succeeded."""
        self._registered_at = time.monotonic()
        for impl in _subscribed():
            for connection in _connections(impl):
                connection.orphan = True
        registered = register_node(self._registration)
        if registered:
            rospy.loginfo('registered again: the master has been restarted')
        return registered

    def _ask_doubtful(self, now: float) -> None:
        """Ask the master whether notifications are true, unless it was asked a moment ago."""
        if now - self._asked_at > 2 * MAX_QUESTION_PERIOD:
            self._questions.reset()
        if not self._doubtful or now - self._asked_at < self._questions.interval:
            return
        with self._lock:
            topics, self._doubtful = self._doubtful, set()
        self._asked_at = now
        self._questions.take()
        try:
            self._ask_master(list(topics))
        except rpc.Unreachable:
            with self._lock:
                self._doubtful |= topics
            raise

    def _ask_master(self, topics: Sequence[str]) -> None:
        """Ask the master for the publishers of some topics.

        :raises Unreachable: if it does not answer
        """
        manager = get_topic_manager()
        impls = [impl for impl in map(manager.get_subscriber_impl, dict.fromkeys(topics)) if impl is not None]
        if not impls:
            return
        asked = [Registration(impl.resolved_name, impl.type, 'sub') for impl in impls]
        for impl, one, uris in zip(impls, asked, self._master.register(asked)):
            if impl.closed:
                self._registration.reg_removed(*one)
            elif isinstance(uris, list):
                self.publisher_update(one.name, uris)

    # -- silent connections ------------------------------------------------------------------------

    def _review(self, silent: Sequence[UdpSubscriberImpl], now: float) -> None:
        """Ask the publishers of silent connections, in the background, whether they still send to us.

        :param silent: the topics that are asked for now; in those that are heard each connection has its own time
        """
        of_node: Dict[str, List[Tuple[UdpSubscriberImpl, SubscriberTransport]]] = {}
        for impl in _subscribed():
            heard = now - _last_heard(impl, now)[0] < SILENCE_TIMEOUT
            for connection in _connections(impl):
                if connection.idle >= SILENCE_TIMEOUT and (impl in silent or (heard and connection.silence.due(
                        now - connection.idle, now, message=connection.worked))):
                    connection.silence.asked(now)
                    of_node.setdefault(connection.endpoint_id, []).append((impl, connection))
        for uri, found in of_node.items():
            if uri not in self._reviewing:
                self._reviewing.add(uri)
                threading.Thread(target=self._ask_node, args=(uri, found), daemon=True).start()

    def _ask_node(self, uri: str, found: Sequence[Tuple[UdpSubscriberImpl, SubscriberTransport]]) -> None:
        try:
            entries = udpros_entries(rpc.call(uri, 'getBusInfo'))
        except (rpc.Unreachable, Refused) as error:
            rospy.logdebug('%s does not answer: %s', uri, error)
            for impl, connection in found:
                impl.silence.unanswered()
                ended = connection.orphan or isinstance(error, rpc.Gone)
                if ended and connection.idle >= SILENCE_TIMEOUT:
                    with self._lock:    # new ones may be notified of meanwhile
                        impl.publishers = tuple(other for other in impl.publishers if other != uri)
                    connection.close()
        else:
            for impl, connection in found:
                if not connection.done and connection.idle >= SILENCE_TIMEOUT and _is_broken(impl, connection, entries):
                    rospy.logdebug('[%s]: connecting to %s again', impl.resolved_name, uri)
                    self._connector.renew(connection)
        finally:
            self._reviewing.discard(uri)


def _all_subscribed() -> List[Any]:
    """The topics with a Subscriber, rospy's or ours."""
    return [impl for impl in list(get_topic_manager().subs.values()) if not impl.closed]


def _subscribed() -> List[UdpSubscriberImpl]:
    """The topics with our Subscribers."""
    return [impl for impl in _all_subscribed() if isinstance(impl, UdpSubscriberImpl)]


def _connections(impl: UdpSubscriberImpl) -> List[SubscriberTransport]:
    """A topic's UDPROS connections."""
    return [connection for connection in impl.connections if isinstance(connection, SubscriberTransport)]


def _silent(now: float) -> List[UdpSubscriberImpl]:
    """The topics to ask for now: all that are silent, as soon as one is due."""
    heard = {impl: _last_heard(impl, now) for impl in _subscribed()}
    if not any(impl.silence.due(when, now, message=message) for impl, (when, message) in heard.items()):
        return []
    silent = [impl for impl, (when, message) in heard.items() if impl.silence.due(when, now, 0.5, message)]
    for impl in silent:
        impl.silence.asked(now)
    return silent


def _last_heard(impl: UdpSubscriberImpl, now: float) -> Tuple[float, bool]:
    """When a topic was heard last [s], and whether by a message; a TCP connection notices itself when it ends."""
    return max(((now - connection.idle, connection.worked) if isinstance(connection, SubscriberTransport)
                else (now, True) for connection in impl.connections), default=(-float('inf'), False))


def _is_broken(impl: UdpSubscriberImpl, connection: SubscriberTransport, entries: Sequence[BusEntry]) -> bool:
    """Whether a silent connection has to be negotiated anew.

    :param entries: of its publisher's getBusInfo
    """
    if not any(_is_ours(entry, connection) for entry in entries):
        return True
    refused, connection.refused_before = connection.refused_before, connection.refused_datagrams
    if connection.refused_datagrams > refused:      # from another address of the publisher, or another connection
        return True
    return not (connection.worked and connection.is_latched) and impl.renegotiations[connection.endpoint_id].due(
        connection.idle, connection.worked)


def _is_ours(entry: BusEntry, connection: SubscriberTransport) -> bool:
    """Whether a publisher's connection leads to the socket of ours."""
    return ((entry.peer, entry.direction, entry.topic) == (rospy.names.get_caller_id(), OUTBOUND, connection.name)
            and entry.remote_port in (None, connection.local_endpoint[1])
            and (entry.remote_host is None or is_own(entry.remote_host)))
