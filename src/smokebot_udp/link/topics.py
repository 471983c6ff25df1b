# SPDX-License-Identifier: BSD-3-Clause
"""Publishers and subscribers of a link, see smokebot_udp/transport.py for their interface."""
import functools
import threading
import time
import traceback
from types import MappingProxyType
from typing import Any, Callable, Collection, Dict, List, Mapping, NamedTuple, Optional, Sequence, Union

import numpy as np

from ..arrays import BoolArray, IntArray, Records, UInt8Array
from ..budget import Budget
from ..newest import Newest
from ..serialised import deserialised, serialised
from ..transport import always
from ..udpros.datagram import IP_UDP_HEADERS, LENGTH, Buffer
from ..udpros.depacketizer import Arrivals, Arrived, BatchCallback, Depacketizer
from ..udpros.endpoints import BatchSender
from ..udpros.frame import Frame, first_messages
from ..udpros.packetizer import Limit, Packetizer
from ..udpros.records import has_header, record_dtype
from .control import COPY, SECOND, marked, with_mark, without_marks
from .packets import OVERHEAD
from .peer import Peer
from .place import Place, address_of
from .tables import Topic

MAX_MESSAGE_SIZE = 1 << 18
"""A longer message is not received. A peer must not fill the memory [byte]."""

COPIES, COPY_PERIOD = 20, 0.02
"""Messages of a topic that are copied at once, and then one in this time: a Twist fifty times a second takes 8 kB/s of
a second path [1, s]."""

REMEMBERED = 64
"""Messages of a topic that are not delivered again where a copy of them comes: those of a second, which the slower path
may be behind."""


class PeerSender:
    """Seals datagrams for a peer, and sends them to where it is now: the Sender of a Packetizer.

    :param sender: of the link's socket, with counts of its own
    :param copied: whether copies go to the peer's second place, where it has one
    """

    def __init__(self, peer: Peer, sender: BatchSender, copied: bool = False) -> None:
        self.by_second = False
        """Whether what follows goes by the peer's second path, where it has one."""
        self._peer, self._sender = peer, sender
        self._copies = Budget(COPIES if copied else 0, COPY_PERIOD)

    @property
    def failures(self) -> Dict[str, int]:
        """Datagrams that could not be sent, by the name of the error."""
        return dict(self._sender.failures)

    def send_one(self, *parts: Union[Buffer, UInt8Array]) -> int:
        """See packetizer.Sender."""
        return self._send(np.frombuffer(b''.join(map(bytes, parts)), np.uint8)[np.newaxis])

    def send(self, datagrams: Union[Buffer, UInt8Array], size: int, count: int) -> int:
        """See packetizer.Sender."""
        data: UInt8Array = np.frombuffer(datagrams, np.uint8)
        whole = len(data) // size
        sent, rest = self._send(data[:whole * size].reshape(whole, size)), data[whole * size:]
        return sent + self._send(rest[np.newaxis]) if len(rest) else sent

    def _send(self, datagrams: UInt8Array) -> int:
        """Send datagrams of one length, (n, size) uint8."""
        place, second = self._peer.place, self._peer.second
        if self.by_second and second is not None:
            place, datagrams, self._peer.second_used = second, with_mark(datagrams, SECOND), time.monotonic()
        else:
            self._copy(datagrams)
        return self._send_to(place, datagrams)

    def _copy(self, datagrams: UInt8Array) -> None:
        """Send copies by the second path. They are sealed first: the newest packet says where this side is."""
        second = self._peer.second
        if second is not None and self._copies.take(time.monotonic()):
            self._send_to(second, with_mark(datagrams, COPY))

    def _send_to(self, place: Place, datagrams: UInt8Array) -> int:
        sealed = self._peer.seal(datagrams)
        sent = self._sender.send(sealed, sealed.shape[1], len(sealed), to=address_of(place), via=place.via)
        self._peer.count(place, sent * (sealed.shape[1] + IP_UDP_HEADERS))
        return sent


class Outgoing:
    """A publisher's connection to one peer."""

    def __init__(self, peer: Peer, sender: BatchSender, connection_id: int, max_datagram_size: int,
                 limit: Limit, copied: bool = False) -> None:
        self.peer, self._socket = peer, sender
        self._sender = PeerSender(peer, sender, copied)
        self.packetizer = Packetizer(self._sender, connection_id, max_datagram_size, limit)

    def follow(self, max_datagram_size: int, tos: int) -> None:
        """Send like this from now on."""
        self.packetizer.max_datagram_size, self._socket.tos = max_datagram_size, tos

    def send_frame(self, frame: Frame, by_second: bool) -> None:
        """Send all messages of a frame, numbered as they are, by the first path or the second one."""
        self._sender.by_second = by_second
        try:
            self.packetizer.send_frame(frame)
        finally:
            self._sender.by_second = False

    def stats(self) -> Dict[str, Any]:
        """As of udpros.Publisher.connections."""
        packetizer = self.packetizer
        return {'peer': self.peer.name, 'address': self.peer.address, 'connection_id': packetizer.connection_id,
                'max_datagram_size': packetizer.longest, 'datagrams': packetizer.datagrams,
                'bytes': packetizer.bytes, 'failures': self._sender.failures}


class Publisher:
    """Sends a topic to all peers that want it, see transport.Publisher.

    :param listener: whose peer_subscribe is called for each new peer
    :param why_not: f(connection id, peer), see transport.Publisher.why_not
    :param limit: of its datagrams, beside the room of each peer
    :param ended: f(publisher), called by `unregister`
    :param tos: second byte of the IP headers, see traffic.py
    :param copied: whether copies go by a second path, where there is one
    """

    def __init__(self, topic: Topic, message_class: Any, listener: Any, why_not: Callable[[int, str], str],
                 limit: Limit, ended: Callable[['Publisher'], None], tos: int = 0, copied: bool = False) -> None:
        self.topic, self.resolved_name, self.limit, self.tos = topic, topic.name, limit, tos
        self._class, self._listener, self._why_not, self._ended = message_class, listener, why_not, ended
        self.copied = copied
        self._connections: Sequence[Outgoing] = ()      # replaced, not changed: other threads iterate
        self._seq = 0
        self._lock = threading.Lock()       # of the numbers; held while sending

    def publish(self, message: Any) -> None:
        """See transport.Publisher.

        :raises ValueError: if the message is of another type
        """
        self._publish_to(None, message)

    def _publish_to(self, only: Optional[Outgoing], message: Any) -> None:
        """Publish a message to one peer; None: to all."""
        self._check(type(message))
        with self._lock:
            self._seq += 1
            data = headed(message, self._seq)
            for connection in self._connections if only is None else (only,):
                connection.packetizer.send_message(data)

    def publish_frames(self, *frames: Frame, limits: Mapping[str, int] = MappingProxyType({}),
                       second: Collection[str] = ()) -> int:
        """See transport.Publisher."""
        for frame in frames:
            self._check(frame.message_class)
        with self._lock:
            first = self._seq + 1
            for frame in frames:
                frame.number(self._seq + 1)
                self._seq += len(frame)
            for connection in self._connections:
                for frame in first_messages(frames, limits.get(connection.peer.name)):
                    connection.send_frame(frame, connection.peer.name in second)
        return first

    def publish_to(self, peer: str, frame: Frame) -> None:
        """See transport.Publisher."""
        self._check(frame.message_class)
        with self._lock:
            for connection in self._connections:
                if connection.peer.name == peer:
                    connection.packetizer.send_frame(frame)

    def _check(self, message_class: Any) -> None:
        if message_class is not self._class:
            raise ValueError('[%s] publishes %s, not %s' % (
                self.resolved_name, self._class._type, getattr(message_class, '_type', message_class)))

    def connections(self) -> List[Dict[str, Any]]:
        """See transport.Publisher."""
        return [connection.stats() for connection in self._connections]

    def get_num_connections(self) -> int:
        """See transport.Publisher."""
        return len(self._connections)

    def why_not(self, peer: str) -> str:
        """See transport.Publisher."""
        return self._why_not(self.topic.id, peer)

    def unregister(self) -> None:
        """See transport.Publisher."""
        self._ended(self)

    def connection_to(self, peer: Peer) -> Optional[Outgoing]:
        """The connection to a peer, if there is one."""
        return next((one for one in self._connections if one.peer is peer), None)

    def add(self, connection: Outgoing) -> None:
        """Send to a peer from now on; the link's thread."""
        self._connections = (*self._connections, connection)
        if self._listener is not None:
            self._listener.peer_subscribe(self.resolved_name, self.publish,
                                          functools.partial(self._publish_to, connection))

    def remove(self, peer: Optional[Peer]) -> None:
        """Send to a peer no more; None: to nobody."""
        self._connections = [] if peer is None else [one for one in self._connections if one.peer is not peer]


class Callbacks(NamedTuple):
    """What a subscriber calls, see transport.Transport.subscriber."""
    message: Optional[Callable[[Any], None]]
    batch: Optional[BatchCallback]
    arrived: Optional[Arrived]


class Subscriber:
    """Receives a topic from all peers that send it, see transport.Subscriber.

    The arguments without an explanation are those of transport.Transport.subscriber.

    :param report: f(text), called with what a callback raises
    :param ended: f(subscriber), called by `unregister`
    """

    def __init__(self, topic: Topic, message_class: Any, callbacks: Callbacks, queue_size: Optional[int],
                 wanted: Callable[[], bool], report: Callable[[str], None],
                 ended: Callable[['Subscriber'], None]) -> None:
        if callbacks.batch is not None:
            record_dtype(message_class, {})     # raises if the type has no layout
        self.topic, self.message_class = topic, message_class
        self.callback, self.batch_callback = callbacks.message, callbacks.batch
        self._queue_size, self._arrived, self._headers = queue_size, callbacks.arrived, IP_UDP_HEADERS + OVERHEAD
        self._wanted, self._ended, self._report = wanted, ended, report
        self._incoming: Dict[int, Incoming] = {}      # by the peer's number; replaced, not changed

    def wants(self, offered: bool) -> bool:
        """Whether the topic is to be received now.

        :param offered: whether the peer offers it
        """
        if self._wanted is not always and offered and self._wanted():
            self._wanted = always
        return self._wanted is always

    def connect(self, peer: Peer) -> 'Incoming':
        """The connection from a peer; the link's thread."""
        found = self._incoming.get(peer.number)
        if found is None:
            found = Incoming(self, peer)
            self._incoming = {**self._incoming, peer.number: found}
        return found

    def forget(self, peer: Peer) -> None:
        """A peer is no more, or sends the topic no more."""
        self._incoming = {number: one for number, one in self._incoming.items() if number != peer.number}

    def depacketizer(self, consumer: 'Incoming') -> Depacketizer:
        """For a new connection."""
        return Depacketizer(self.topic.id, consumer, self.message_class, self._queue_size, self._arrived,
                            self._headers, MAX_MESSAGE_SIZE)

    def copies(self, consumer: 'Incoming') -> Depacketizer:
        """For the copies of a connection; they are in no report."""
        return Depacketizer(self.topic.id, consumer, self.message_class, self._queue_size,
                            max_message_size=MAX_MESSAGE_SIZE)

    def call(self, function: Callable[..., None], *arguments: Any) -> None:
        """Call a callback; what it raises is reported, as rospy does."""
        try:
            function(*arguments)
        except Exception:
            self._report('[%s]: a callback failed: %s' % (self.topic.name, traceback.format_exc()))

    def connections(self) -> List[Dict[str, Any]]:
        """See transport.Subscriber."""
        return [one.stats() for one in self._incoming.values()]

    def incoming(self) -> List['Incoming']:
        """The connections."""
        return list(self._incoming.values())

    def unregister(self) -> None:
        """See transport.Subscriber."""
        self._ended(self)
        self.callback = self.batch_callback = None


class Incoming:
    """A subscriber's connection from one peer: the Consumer of its Depacketizer. All but `stats`: the link's thread."""

    def __init__(self, subscriber: Subscriber, peer: Peer) -> None:
        self._subscriber, self._peer = subscriber, peer
        topic = subscriber.topic
        self._header = {'callerid': peer.name, 'topic': topic.name, 'type': topic.type, 'md5sum': topic.md5}
        self._begun = time.monotonic()
        self._depacketizer = subscriber.depacketizer(self)
        self._copies: Optional[Depacketizer] = None         # as soon as there are any
        self._delivered: Newest[int, None] = Newest(REMEMBERED)     # hashes of messages
        self._recent = self.kernel_drops = 0

    def recent(self) -> int:
        """The number of datagrams since the last call."""
        recent, self._recent = self._recent, 0
        return recent

    def take(self, datagrams: UInt8Array, lengths: IntArray, arrivals: Arrivals, now: float) -> None:
        """Take datagrams of the topic that arrived together, see Depacketizer.take."""
        self._recent += len(lengths)
        if not marked(datagrams, COPY | SECOND).any():
            take(self._depacketizer, datagrams, lengths, arrivals, now)
            return
        copies, second = marked(datagrams, COPY), marked(datagrams, SECOND)
        datagrams = without_marks(datagrams)
        if copies.any() and self._copies is None:
            self._copies = self._subscriber.copies(self)
        for rows, depacketizer, path in ((copies, self._copies, 0), (~copies & ~second, self._depacketizer, 0),
                                         (~copies & second, self._depacketizer, 1)):
            if depacketizer is not None and rows.any():
                part = arrivals.part(np.flatnonzero(rows))._replace(path=path)
                take(depacketizer, datagrams[rows], lengths[rows], part, now)

    @property
    def wants_batches(self) -> bool:
        """See depacketizer.Consumer."""
        return self._subscriber.batch_callback is not None

    @property
    def wants_messages(self) -> bool:
        """See depacketizer.Consumer."""
        return self._subscriber.callback is not None

    def take_records(self, records: Records, mask: BoolArray) -> None:
        """See depacketizer.Consumer."""
        callback = self._subscriber.batch_callback
        if callback is not None:
            self._subscriber.call(callback, records, mask)

    def take_message(self, data: bytes) -> None:
        """See depacketizer.Consumer."""
        callback = self._subscriber.callback
        if has_header(self._subscriber.message_class):
            key = hash(data)
            if key in self._delivered:
                return
            self._delivered[key] = None
        try:
            message = deserialised(self._subscriber.message_class, data)
        except ValueError:
            self._depacketizer.inbox.dropped['message'] += 1
            return
        message._connection_header = self._header
        if callback is not None:
            self._subscriber.call(callback, message)

    def stats(self) -> Dict[str, Any]:
        """As of udpros.Subscriber.connections; of the kernel's drops its share, as all topics have one socket."""
        last = self._depacketizer.last_arrival
        return {'peer': self._peer.name, 'address': self._peer.address,
                'idle': time.monotonic() - (self._begun if last is None else last), **self._depacketizer.stats(),
                'receive_buffer': None, 'kernel_drops': self.kernel_drops}


def take(depacketizer: Depacketizer, datagrams: UInt8Array, lengths: IntArray, arrivals: Arrivals, now: float) -> None:
    """Hand datagrams of one connection to its depacketizer, and deliver the messages."""
    first = depacketizer.take_singles(datagrams, lengths, lambda row: True, arrivals, now)
    if first < len(lengths):
        depacketizer.take(datagrams[first:], lengths[first:], np.ones(len(lengths) - first, bool),
                          arrivals.part(np.arange(first, len(lengths))), now)
    depacketizer.deliver()


def headed(message: Any, seq: int) -> bytes:
    """A serialised message with its length prefix, numbered in its header if it has one.

    :raises genpy.SerializationError: if a field has a wrong type
    """
    if has_header(type(message)):
        message.header.seq = seq
    data = serialised(message)
    return LENGTH.pack(len(data)) + data
