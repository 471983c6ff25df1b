# SPDX-License-Identifier: BSD-3-Clause
"""A link of two masters as the nodes' transport, see smokebot_udp/transport.py.

RobotTransport listens on one UDP port, OperatorTransport speaks first. Everything that decides is in the core and in
tables.py; the endpoint's thread runs it, and calls all callbacks of subscribers.
"""
import collections
import os
import socket
import threading
import time
from typing import Any, Callable, Counter, Dict, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

import numpy as np
import rospy

from .. import traffic
from ..budget import Budget
from ..newest import Newest
from ..paths import PathUse
from ..transport import BESIDE, COPIES, UNUSED, PathStats, PeerStats, TransportStats, always, nothing
from ..udpros.datagram import DEFAULT_MAX_DATAGRAM_SIZE
from ..udpros.depacketizer import Arrivals, Arrived, BatchCallback
from ..udpros.endpoints import SHORT_BUFFER
from ..udpros.loss_emulation import open_receiver
from ..udpros.packetizer import no_limit
from ..udpros.records import has_header
from .core import CLOSED, LinkCore
from .endpoint import Endpoint
from .interfaces import Interfaces
from .operator_core import NO_ANSWER, OperatorCore
from .packets import OVERHEAD, encode_name
from .peer import Carried, Delivery, Event, Joined, Left, Moved, Peer, Quiet, Refused
from .peer_topics import KINDS, PeerTopics
from .place import Address, address_of, interface_of, path_of, place_at
from .resolver import Resolver
from .robot_core import RobotCore
from .robot_paths import SHARED_FOR
from .tables import Local, Role, Topic
from .topics import Callbacks, Publisher, Subscriber

PERIOD = 0.1
"""How often the topics of this side are looked at for changes [s]."""

PROBLEM_AFTER = 2.0
"""A problem that has lasted for this long is reported [s]."""

REPORTED, REPORT_PERIOD = 50, 1.0
"""Differences of topics are reported so often at once, and then once in this time, in turns of the peers [1, s]."""

MAX_FORMER = 32
"""Peers that have left whose bytes are remembered."""

LOGGED, LOG_PERIOD = 50, 1.0
"""What happens to peers is logged so often at once, and then once in this time: a peer may join and leave again
and again [1, s]."""

Report = Callable[[str], None]
Renewed = Callable[[float], Optional[bytes]]


def never(now: float) -> Optional[bytes]:
    """There is no other key."""
    return None


class Datagrams(NamedTuple):
    """Those of a link."""
    max_size: int = DEFAULT_MAX_DATAGRAM_SIZE
    """The longest to send and to receive, the link's overhead included [byte of UDP payload]."""
    receive_buffer: int = 4 << 20
    """Requested from the kernel [byte]."""
    tos_mask: int = 0
    """The bits that are used of the second byte of IP headers, see traffic.mask."""


DEFAULT_DATAGRAMS = Datagrams()


class LinkTransport:
    """What both sides have in common: a transport.Transport, and the Handler of its endpoint.

    :param core: of this side
    :param port: to bind; 0: any
    :param renewed: f(now [s]) -> a key that replaces the present one, if there is one
    :param report: f(text), called with what somebody has to see to
    :param log: f(text), called with what happens
    :param remarks: see TransportStats; a short receive buffer is added
    :raises OSError: if the port is in use
    """
    own_masters = True
    overhead = OVERHEAD

    def __init__(self, core: LinkCore, port: int, datagrams: Datagrams, renewed: Renewed, report: Report, log: Report,
                 remarks: Sequence[str] = ()) -> None:
        self.name = encode_name(core.name).decode()     # as the other side has it
        self.max_datagram_size = self.room = core.max_datagram_size - OVERHEAD
        self._core, self._renewed, self._report, self._log = core, renewed, report, log
        self._log_budget = Budget(LOGGED, LOG_PERIOD)
        self._local, self._lock = Local(), threading.Lock()     # the lock: of changes of these three
        self._publishers: Dict[int, Publisher] = {}             # by connection id; replaced, not changed, as are these
        self._subscribers: Dict[int, Subscriber] = {}
        self._peers: Dict[int, PeerTopics] = {}                 # by the peer's number
        self._former: Newest[str, Carried] = Newest(MAX_FORMER)     # {name: carried} of peers that left
        self._told: Set[Tuple[int, str]] = set()    # (peer's number, topic)
        self._differences: List[str] = []           # the first one to each peer
        self._report_budget = Budget(REPORTED, REPORT_PERIOD)
        self._unknown = self._unasked = 0           # datagrams of no topic, and of one that was not asked for
        self._handshakes = 0                        # of peers that have left
        self._changed, self._seen, self._looked, self._due, self._drops_at = True, 0, 0.0, 0.0, 0.0
        receiver = open_receiver('link', '', core.max_datagram_size, datagrams.receive_buffer, port)
        self.port = receiver.address[1]
        shortage = receiver.shortage(datagrams.receive_buffer)
        self.remarks = remarks if shortage is None else [*remarks, '%s: %s' % (SHORT_BUFFER, shortage)]
        self._kernel_drops = 0                      # that connections were told of
        self._endpoint = Endpoint(core, receiver, self, report)
        self._endpoint.sender.tos = traffic.EXPEDITED & datagrams.tos_mask
        self.tos_mask = datagrams.tos_mask
        self.on_moved: Callable[[], None] = nothing

    # -- transport.Transport --------------------------------------------------------------------------

    def limit(self, room: int) -> None:
        """See transport.Transport."""
        self.room = min(room, self.max_datagram_size)

    def publisher(self, topic: str, message_class: Any, *, queue_size: int = 10, subscriber_listener: Any = None,
                  carries: str = '', whole: bool = False, tos: int = 0, copied: bool = False) -> Publisher:
        """See transport.Transport; nothing waits for a peer here, so there is no queue.

        :raises ValueError: if the topic is published already, or its name is too long
        """
        publisher = Publisher(Topic(topic, message_class._type, message_class._md5sum, carries), message_class,
                              subscriber_listener, self._why_not, no_limit if whole else lambda: self.room,
                              self._end_publisher, tos & self.tos_mask, copied and has_header(message_class))
        with self._lock:
            self._local.add(Role.SENDS, publisher.topic)
            self._publishers = {**self._publishers, publisher.topic.id: publisher}
        return publisher

    def subscriber(self, topic: str, message_class: Any, callback: Optional[Callable[[Any], None]] = None, *,
                   queue_size: Optional[int] = None, batch_callback: Optional[BatchCallback] = None,
                   arrived: Optional[Arrived] = None, wanted: Callable[[], bool] = always,
                   carries: str = '') -> Subscriber:
        """See transport.Transport.

        :raises ValueError: if the topic is subscribed already, or its name is too long
        """
        subscriber = Subscriber(Topic(topic, message_class._type, message_class._md5sum, carries), message_class,
                                Callbacks(callback, batch_callback, arrived), queue_size, wanted, self._report,
                                self._end_subscriber)
        with self._lock:
            self._local.add(Role.RECEIVES, subscriber.topic)
            self._subscribers = {**self._subscribers, subscriber.topic.id: subscriber}
        return subscriber

    def _why_not(self, number: int, peer: str) -> str:
        """See Publisher.why_not."""
        found = (topics.exchange.why_not(number) for topics in self._peers.values() if topics.peer.name == peer)
        return next(found, 'is not connected')

    def _end_publisher(self, publisher: Publisher) -> None:
        with self._lock:
            if self._publishers.get(publisher.topic.id) is publisher:
                self._local.remove(Role.SENDS, publisher.topic)
                self._publishers = without(self._publishers, publisher.topic.id)
        publisher.remove(None)

    def _end_subscriber(self, subscriber: Subscriber) -> None:
        with self._lock:
            if self._subscribers.get(subscriber.topic.id) is subscriber:
                self._local.remove(Role.RECEIVES, subscriber.topic)
                self._subscribers = without(self._subscribers, subscriber.topic.id)

    def dropped(self) -> Counter[str]:
        """See transport.Transport."""
        dropped = self._endpoint.dropped()
        dropped.update({reason: count for reason, count in (
            ('unknown topic', self._unknown), ('not asked for', self._unasked)) if count})
        for topics in self._peers.values():
            dropped.update(topics.dropped())
        return dropped

    def problem(self) -> Optional[str]:
        """See transport.Transport: a difference to each peer."""
        return '; '.join(self._differences) or None

    def paths(self, now: float) -> Mapping[str, Sequence[PathUse]]:
        """See transport.Transport."""
        found: Dict[str, Sequence[PathUse]] = {}
        for topics in self._peers.values():
            peer = topics.peer
            first = PathUse(path_of(peer.place), host=peer.address[0], is_quiet=peer.is_quiet,
                            interface=interface_of(peer.place))
            found[peer.name] = [first]
            if peer.second is not None:
                key = peer.second if path_of(peer.second) == first.key else path_of(peer.second)
                found[peer.name] = [first, PathUse(key, now - peer.second_heard, address_of(peer.second)[0],
                                                   interface=interface_of(peer.second))]
        return found

    def stats(self, now: float) -> Optional[TransportStats]:
        """See transport.Transport."""
        peers = [topics.peer for topics in self._peers.values()]
        return TransportStats(
            [PeerStats(peer.name, peer.address, now - peer.heard, peer.round_trip, interface_of(peer.place),
                       self._others(peer, now), self._carried_to(peer))
             for peer in peers],
            self._handshakes + sum(peer.handshakes for peer in peers), self.dropped(), self.problem(), self.remarks)

    def _carried_to(self, peer: Peer) -> Carried:
        """The bytes to a peer until now, and to former ones of its name."""
        carried = collections.Counter(self._former.get(peer.name, {}))
        carried.update(peer.carried)
        return carried

    def _others(self, peer: Peer, now: float) -> Sequence[PathStats]:
        """The paths to a peer but the first one [s]."""
        if peer.second is None:
            return ()
        use = BESIDE if now - peer.second_used < SHARED_FOR else COPIES
        return [PathStats(address_of(peer.second), interface_of(peer.second), use, now - peer.second_heard, None)]

    def close(self) -> None:
        """Leave all peers, end the thread, and free the socket."""
        for publisher in self._publishers.values():
            publisher.remove(None)
        self._publishers = {}
        self._endpoint.close()

    # -- endpoint.Handler -----------------------------------------------------------------------------

    def on_event(self, event: Event) -> None:
        """See endpoint.Handler."""
        self._changed = True
        if isinstance(event, Refused):
            self._on_refused(event)
        elif isinstance(event, Joined):
            peer = event.peer
            self._peers = {**self._peers, peer.number: PeerTopics(peer, self._local, self._endpoint.sender)}
            self._tell('%s has joined from %s:%d' % (peer.name, *peer.address))
        elif isinstance(event, Moved):
            topics = self._peers.get(event.peer.number)
            if topics is not None:
                topics.update_room(self._core.max_datagram_size, time.monotonic(), moved=True)
            self.on_moved()
            self._tell('%s has moved to %s:%d' % (event.peer.name, *event.address))
        elif isinstance(event, Quiet):
            self.on_moved()
        elif isinstance(event, Left):
            self._forget(event.peer)
            self._tell('%s has left: %s' % (event.peer.name, event.reason))

    def _tell(self, text: str) -> None:
        """Log what has happened to a peer."""
        if self._log_budget.take(time.monotonic()):
            self._log(text)

    def _on_refused(self, event: Refused) -> None:
        """The robot tells at once whom it refuses; the operator's core makes its problem of it."""

    def _forget(self, peer: Peer) -> None:
        self._peers = without(self._peers, peer.number)
        self._former[peer.name] = self._carried_to(peer)
        self._handshakes += peer.handshakes
        self._told = {(number, topic) for number, topic in self._told if number != peer.number}
        for publisher in self._publishers.values():
            publisher.remove(peer)
        for subscriber in self._subscribers.values():
            subscriber.forget(peer)

    def on_delivery(self, delivery: Delivery, arrivals: Arrivals, now: float) -> None:
        """See endpoint.Handler."""
        topics = self._peers.get(delivery.peer.number)
        if topics is None:
            return      # it left within the batch
        numbers = delivery.datagrams[:, :4].copy().view('<u4')[:, 0]
        first = int(numbers[0])
        if (numbers == first).all():
            self._take(topics, first, delivery, slice(None), arrivals, now)
            return
        for number in np.unique(numbers).tolist():
            rows = np.flatnonzero(numbers == number)
            self._take(topics, number, delivery, rows, arrivals.part(rows), now)

    def _take(self, topics: PeerTopics, number: int, delivery: Delivery, rows: Any, arrivals: Arrivals,
              now: float) -> None:
        """Hand on the datagrams of one connection id.

        :param rows: of the delivery; `arrivals` counts within them
        """
        datagrams, lengths = delivery.datagrams[rows], delivery.lengths[rows]
        if number in KINDS:
            self._changed |= topics.take(number, datagrams, lengths, now)
            self._due = min(self._due, topics.exchange.deadline())
            return
        subscriber = self._subscribers.get(number)
        if subscriber is None:
            self._unknown += len(lengths)
        elif number not in topics.asked:
            self._unasked += len(lengths)
        else:
            subscriber.connect(topics.peer).take(datagrams, lengths, arrivals, now)

    def _share_drops(self, now: float) -> None:
        """Tell the connections of what the kernel dropped meanwhile: all have one socket, and nobody knows of whom it
        was, so in proportion to what came of each."""
        if now < self._drops_at + PERIOD:
            return
        self._drops_at = now
        incoming = [one for subscriber in self._subscribers.values() for one in subscriber.incoming()]
        counts, drops = [one.recent() for one in incoming], self._endpoint.receiver.kernel_drops() or 0
        if drops > self._kernel_drops and any(counts):
            for one, share in zip(incoming, shares(drops - self._kernel_drops, counts)):
                one.kernel_drops += share
            self._kernel_drops = drops

    def poll(self, now: float) -> float:
        """See endpoint.Handler."""
        self._share_drops(now)
        key = self._renewed(now)
        if key is not None:
            self._core.set_key(key, now)
            self._log('the key was replaced: all operators and robots that have the former one have left')
        number = self._local.number
        if self._changed or number != self._seen or now >= self._looked + PERIOD:
            self._changed, self._seen, self._looked = False, number, now
            for topics in self._peers.values():
                topics.update_room(self._core.max_datagram_size, now)
                topics.ask(self._subscribers)
                topics.serve(self._publishers)
            self._tell_differences(now)
            self._due = now
        if now >= self._due:
            self._due = self._looked + PERIOD
            for topics in self._peers.values():
                topics.send(now)
                self._due = min(self._due, topics.exchange.deadline())
        return self._due

    def _tell_differences(self, now: float) -> None:
        """Report what was not reported yet, at most one difference of each peer: each has its turn, no more."""
        found = {topics.peer.number: topics.exchange.differences(topics.peer.name) for topics in self._peers.values()}
        self._differences = [next(iter(sentences.values())) for sentences in found.values() if sentences]
        for number, sentences in found.items():
            untold = next((topic for topic in sentences if (number, topic) not in self._told), None)
            if untold is not None and self._report_budget.take(now):
                self._told.add((number, untold))
                self._report(sentences[untold])


def shares(total: int, weights: Sequence[int]) -> List[int]:
    """A number of things in proportion to weights of which one is above 0; the shares add up to it."""
    found, before, left = [], total, sum(weights)
    for weight in weights:
        share = round(before * weight / left) if left else 0
        found.append(share)
        before, left = before - share, left - weight
    return found


class RobotTransport(LinkTransport):
    """The robot's side.

    :param port: UDP port to listen on, on all interfaces; 0: any free one, see `port`
    :param key: of the link, 32 bytes
    :param name: under which operators know it; None: the node's and the machine's
    :param renewed: f(now [s]) -> a key that replaces the present one, if there is one
    :param report: f(text), called with what somebody has to see to
    :param log: f(text), called with what happens
    :raises OSError: if the port is in use
    """

    def __init__(self, port: int, key: bytes, *, datagrams: Datagrams = DEFAULT_DATAGRAMS, name: Optional[str] = None,
                 renewed: Renewed = never, report: Report = rospy.logerr, log: Report = rospy.loginfo) -> None:
        core = RobotCore(key, os.urandom, datagrams.max_size, own_name() if name is None else name)
        super().__init__(core, port, datagrams, renewed, report, log)
        self._endpoint.start()

    def _on_refused(self, event: Refused) -> None:
        self._report(event.sentence)


class OperatorTransport(LinkTransport):
    """The operator's side.

    :param addresses: the robot's, in order of preference: hosts, which are names or IPv4 addresses, and ports. A name
        is looked up again while the robot does not answer. A host may end with % and the interface of this machine by
        which it is asked; otherwise the kernel's routes decide
    :param key: the robot's

    The other arguments are RobotTransport's.
    """

    def __init__(self, addresses: Sequence[Address], key: bytes, *, datagrams: Datagrams = DEFAULT_DATAGRAMS,
                 name: Optional[str] = None, renewed: Renewed = never, report: Report = rospy.logerr,
                 log: Report = rospy.loginfo, remarks: Sequence[str] = ()) -> None:
        self._operator = OperatorCore(key, os.urandom, datagrams.max_size, own_name() if name is None else name)
        parts = [(*host.partition('%')[::2], port) for host, port in addresses]
        self._resolvers = [(Resolver(host), port, interface) for host, interface, port in parts]
        self._interfaces = Interfaces([interface for _, interface, _ in parts], report)
        self._troubled: Optional[float] = None      # since when there is a problem
        self._last_problem: Optional[str] = None    # that was reported
        self._has_left = False      # and has said so
        super().__init__(self._operator, 0, datagrams, renewed, report, log, remarks)
        self._endpoint.start()

    def problem(self) -> Optional[str]:
        """See transport.Transport."""
        return self._connection_problem() or super().problem()

    def _connection_problem(self) -> Optional[str]:
        """Why there is no robot; None: there is one. A name that does not resolve explains the rest."""
        problem = self._operator.problem
        if problem is None:
            return None
        return next((resolver.problem for resolver, *_ in self._resolvers if resolver.problem),
                    self._interfaces.problem or problem)

    def _others(self, peer: Peer, now: float) -> Sequence[PathStats]:
        """See LinkTransport."""
        return [PathStats(address_of(path.place), interface_of(path.place),
                          BESIDE if path.is_shared(now) else COPIES if path.place == peer.second else UNUSED,
                          now - path.answered, path.round_trip)
                for path in self._operator.paths if path.place != peer.place]

    def poll(self, now: float) -> float:
        """See endpoint.Handler."""
        for resolver, *_ in self._resolvers:
            resolver.poll(self._operator.problem is not None or resolver.address is None, now)
        self._interfaces.poll(now)
        indices = [self._interfaces.index(interface) for *_, interface in self._resolvers]
        places = [place_at((resolver.address, port), index) for (resolver, port, _), index
                  in zip(self._resolvers, indices) if resolver.address is not None and index is not None]
        if places:
            self._operator.set_places(places, now)
        self.report_problem(now)
        return super().poll(now)

    def on_event(self, event: Event) -> None:
        """See endpoint.Handler."""
        if isinstance(event, (Joined, Left)):
            self._has_left = isinstance(event, Left) and event.reason == CLOSED
        super().on_event(event)

    def report_problem(self, now: float) -> None:
        """Report each problem that lasts, once until there is another one or none. That a robot which has said that it
        leaves does not answer is none to report."""
        problem = self._connection_problem()
        if problem is None or self._has_left and problem.startswith(NO_ANSWER):
            self._troubled = self._last_problem = None
            return
        if self._troubled is None:
            self._troubled = now
        if problem != self._last_problem and now - self._troubled >= PROBLEM_AFTER:
            self._last_problem = problem
            self._report(problem)


def own_name() -> str:
    """The name of this node for the other side: two operators on two machines may have the same node names."""
    return '%s@%s' % (rospy.get_name(), socket.gethostname())


def without(items: Mapping[int, Any], key: int) -> Dict[int, Any]:
    """A copy that lacks one key."""
    return {other: value for other, value in items.items() if other != key}
