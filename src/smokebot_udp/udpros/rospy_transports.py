# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS connections and topics as rospy holds them: extensions of its Transport and topic classes.

ROS messages and their classes have no types, so they are Any here.
"""
import collections
import contextlib
import functools
import threading
import time
import traceback
from dataclasses import dataclass, field
from typing import Any, Callable, DefaultDict, Iterable, Iterator, List, Mapping, Optional, Sequence, Set, Tuple

import numpy as np
import rospy
from rospy.exceptions import TransportTerminated
from rospy.impl.transport import INBOUND, OUTBOUND, Transport
from rospy.topics import _PublisherImpl, _SubscriberImpl, _TopicImpl

from ..arrays import BoolArray, Records
from ..limited_log import logerr
from ..serialised import deserialised, serialised
from .depacketizer import Arrived, BatchCallback
from .endpoints import Address, DatagramReceiver, DatagramSender, PeerGone
from .frame import Frame, first_messages
from .negotiation import PROTOCOL, Fallbacks, Reply, Request
from .packetizer import Limit, Packetizer, no_limit
from .records import LayoutError, lengths_of, record_dtype
from .silence import Renegotiation, Silence
from .subscription import Subscription


@dataclass
class PublisherOptions:
    """What all Publishers of a topic in this process share: those of the first one apply."""
    protocols: Tuple[str, ...]
    """Protocols offered, best first."""
    max_datagram_size: int
    """The longest datagram sent [byte of UDP payload]."""
    limit: Limit = no_limit
    """Limit of the datagram size, as long as the path is known to carry no longer datagrams."""
    tos: int = 0
    """Second byte of the IP headers, see traffic.py."""


@dataclass
class SubscriberOptions:
    """What all Subscribers of a topic in this process share: those of the first one apply."""
    protocols: Tuple[str, ...]
    """Protocols requested, best first."""
    max_datagram_size: int
    """The longest datagram received [byte of UDP payload]."""
    receive_buffer: int
    """Requested from the kernel [byte]."""
    coalesce: float
    """How long to wait for a batch to grow [s]."""
    arrived: Optional[Arrived]
    """Called for new messages."""
    wanted: Callable[[], bool] = lambda: True
    """Whether publishers are connected now; asked again and again until then."""
    headers: Mapping[str, str] = field(default_factory=dict)
    """Further fields of the connection header."""


class UdpTransport(Transport):
    """What both ends of a connection have in common: how rosnode shows them."""
    transport_type = PROTOCOL
    local_endpoint: Address
    remote_endpoint: Address
    done: bool
    _fileno: Optional[int] = None

    def fileno(self) -> Optional[int]:
        """The socket's file descriptor."""
        return self._fileno

    def get_transport_info(self) -> str:
        """The connection in words, in the form of rospy's TCPROS."""
        return '%s connection on port %s to [%s:%s on socket %s]' % (
            self.transport_type, self.local_endpoint[1], *self.remote_endpoint[:2], self._fileno)


class PublisherTransport(UdpTransport):
    """A publisher's connection to one subscriber.

    :param limit: of the datagrams, beside max_datagram_size
    :param tos: f() -> second byte of the IP headers, see traffic.py
    :raises OSError: if the subscriber's host is unknown or unreachable
    :raises UnicodeError: if it is not a host name
    """

    def __init__(self, topic: str, request: Request, connection_id: int, max_datagram_size: int,
                 limit: Limit = no_limit, tos: Callable[[], int] = lambda: 0) -> None:
        super().__init__(OUTBOUND, name=topic)
        self.endpoint_id = request.header['callerid']
        self.connection_id = connection_id
        self.caller_uri: Optional[str] = None
        """URI of the subscriber's XML-RPC server; None: unknown."""
        self.since = time.monotonic()
        """When it was made, by time.monotonic() [s]."""
        self.sender = DatagramSender(request.host, request.port)
        self._tos = tos
        self.packetizer = Packetizer(self.sender, connection_id, max_datagram_size, limit)
        self._fileno = self.sender.socket.fileno()
        self.local_endpoint, self.remote_endpoint = self.sender.local, self.sender.remote
        self._lock = threading.Lock()

    def write_data(self, data: bytes) -> bool:
        """Send one message with its length prefix, as rospy's publishers call it.

        :raises TransportTerminated: if the connection is closed
        """
        with self._sending():
            self.packetizer.send_message(data)
        return True

    def write_frame(self, frame: Frame) -> None:
        """Send a frame's messages, each as one datagram unless that is too long for the connection.

        :raises TransportTerminated: if the connection is closed
        """
        with self._sending():
            self.packetizer.send_frame(frame)

    @contextlib.contextmanager
    def _sending(self) -> Iterator[None]:
        """One caller at a time; closes the connection if the subscriber is gone."""
        with self._lock:
            if self.done:
                raise TransportTerminated('connection closed')
            self.sender.tos = self._tos()
            try:
                yield
                self.stat_num_msg, self.stat_bytes = self.packetizer.messages, self.packetizer.bytes
                return
            except PeerGone as error:
                gone = error
        rospy.loginfo('[%s]: subscriber %s is gone: %s', self.name, self.endpoint_id, gone)
        self.close()
        raise TransportTerminated(str(gone)) from gone

    def close(self) -> None:
        """End the connection and free its socket."""
        if not self.done:
            self.done = True
            super().close()
            with self._lock:
                self.sender.close()


class SubscriberTransport(UdpTransport):
    """A subscriber's connection to one publisher: a Subscription, its thread, and the delivery of its messages.

    :param impl: the topic
    :param receiver: the connection's socket
    :param reply: the publisher's answer
    :param publisher_uri: of the publisher's XML-RPC server
    :param hosts: host names or addresses of the publisher
    """

    def __init__(self, impl: 'UdpSubscriberImpl', receiver: DatagramReceiver, reply: Reply, publisher_uri: str,
                 hosts: Iterable[Optional[str]]) -> None:
        super().__init__(INBOUND, name=impl.resolved_name)
        self.endpoint_id = publisher_uri
        self.header, self.md5sum, self.type = reply.header, reply.header['md5sum'], reply.header['type']
        self.callerid_pub = reply.header.get('callerid', 'unknown')
        self.is_latched = reply.header.get('latching') == '1'
        self.latch: Any = None
        self.local_endpoint, self.remote_endpoint = receiver.address, (reply.host, reply.port)
        self._fileno = receiver.socket.fileno()
        self.orphan = False
        """Whether the master has been restarted and does not list the publisher since."""
        self.refused_before = 0
        """`refused_datagrams` when its publisher was asked last."""
        self.silence = Silence(time.monotonic())
        """When its publisher is asked while others of the topic are heard."""
        self._impl = impl
        self.subscription = Subscription(
            receiver, reply, hosts, self, impl.data_class, impl.queue_size,
            impl.options.coalesce if impl.batch_callbacks else 0.0, impl.options.arrived)
        self._thread = threading.Thread(target=self._run, name='UDPROS ' + impl.resolved_name, daemon=True)

    def start(self) -> None:
        """Begin to receive."""
        self._thread.start()

    def _run(self) -> None:
        try:
            self.subscription.run()
        except Exception:   # a bug of ours must not leave a connection that only looks alive
            logerr('[%s]' % self.name, 'receiving from %s failed: %s' % (self.callerid_pub, traceback.format_exc()))
        finally:
            self.close()

    @property
    def idle(self) -> float:
        """Time since a datagram of the publisher was received last, or since it was made [s]."""
        return time.monotonic() - self.subscription.last_arrival

    @property
    def worked(self) -> bool:
        """Whether anything was ever received through it."""
        return self.subscription.depacketizer.datagrams > 0

    @property
    def refused_datagrams(self) -> int:
        """Datagrams from another address than the publisher's, or of another connection."""
        dropped = self.subscription.depacketizer.inbox.dropped
        return int(dropped['stranger'] + dropped['connection id'])

    @property
    def wants_batches(self) -> bool:
        """See depacketizer.Consumer."""
        return bool(self._impl.batch_callbacks)

    @property
    def wants_messages(self) -> bool:
        """See depacketizer.Consumer."""
        return bool(self._impl.callbacks)

    def take_records(self, records: Records, mask: BoolArray) -> None:
        """Pass messages to the batch callbacks, see depacketizer.Consumer."""
        self._update_counts()
        self._impl.call_batch(records, mask)

    def take_message(self, data: bytes) -> None:
        """Deserialise a message and pass it to the callbacks, see depacketizer.Consumer."""
        self._update_counts()
        try:
            message = deserialised(self._impl.data_class, data)
        except ValueError:
            self.subscription.depacketizer.inbox.dropped['message'] += 1
            return
        message._connection_header = self.header
        if self.is_latched:
            self.latch = message
        self._impl.receive_callback([message], self)

    def _update_counts(self) -> None:
        depacketizer = self.subscription.depacketizer
        self.stat_bytes, self.stat_num_msg = depacketizer.bytes, depacketizer.datagrams

    def close(self) -> None:
        """End the connection; its thread frees the socket."""
        if not self.done:
            self.done = True
            self.subscription.stop()
            super().close()


def udpros_connections(impl: Any) -> List[Any]:
    """A topic's UDPROS connections; those of a plain rospy.Publisher are wrapped in queues."""
    return [c for c in impl.connections if c.transport_type == PROTOCOL]


class _Connections(_TopicImpl):
    """A topic's connections; a new one does not end others of the same peer, except that by TCPROS another one does.

    A peer's name proves nothing: udpros.acceptor decides which of its connections has ended.
    """
    connections: List[Any]

    def add_connection(self, c: Any) -> bool:
        """As rospy's."""
        udp = isinstance(c, PublisherTransport)
        with self.c_lock:
            if self.closed:
                return False
            if not udp:
                for old in self.connections:
                    if old.endpoint_id == c.endpoint_id and not isinstance(old, PublisherTransport):
                        self.remove_connection(old)
            if c.fileno() is not None:
                self.connection_poll.add_fd(c.fileno())
            self.connections = [*self.connections, c]
            previous = c.cleanup_cb
            c.set_cleanup_callback(
                self.remove_connection if previous is None else lambda s: (self.remove_connection(s), previous(s)))
        return True


class UdpPublisherImpl(_PublisherImpl, _Connections):
    """A topic's publishing side, which can send frames, and sends by UDP without a queue or a thread."""

    def __init__(self, name: str, data_class: Any, options: PublisherOptions) -> None:
        super().__init__(name, data_class)
        self.options = options

    def add_connection(self, c: Any) -> bool:
        """As rospy's, but without a queue for UDPROS: a datagram is sent at once or lost.

        c_lock is not held while anything is published or a listener is called: to publish takes publock, and c_lock
        within it when a connection ends.
        """
        if not isinstance(c, PublisherTransport):
            return bool(super().add_connection(c))
        if not _Connections.add_connection(self, c):
            return False
        for listener in list(self.subscriber_listeners or ()):      # None once the topic is closed
            listener.peer_subscribe(self.resolved_name, self.publish, functools.partial(self._publish_to, c))
        self.send_latched(c)
        return True

    def send_latched(self, connection: PublisherTransport) -> None:
        """Send the latched message, if there is one, to one subscriber."""
        if self.is_latch and self.latch is not None:
            self._publish_to(connection, self.latch)

    def _publish_to(self, connection: PublisherTransport, message: Any) -> None:
        """Publish a message to one subscriber."""
        self.acquire()
        try:
            self.publish(message, connection_override=connection)
        finally:
            self.release()

    def publish_frames(self, frames: Sequence[Frame], limits: Mapping[str, int]) -> None:
        """Number the messages of some frames, and send them to all connections; the caller holds publock.

        :param limits: {subscriber: number of the first messages that it gets}; the others get all
        """
        for frame in frames:
            frame.number(self.seq + 1)
            self.seq += len(frame)
            self.message_data_sent += frame.rows.size
        stream: Optional[bytes] = None
        for connection in self.connections:
            try:
                if isinstance(connection, PublisherTransport):
                    for frame in first_messages(frames, limits.get(connection.endpoint_id)):
                        connection.write_frame(frame)
                else:
                    stream = b''.join(frame.stream() for frame in frames) if stream is None else stream
                    connection.write_data(stream)
            except Exception as error:      # as in rospy's publish
                self._end(connection, error)

    def send_to(self, peer: str, frame: Frame) -> None:
        """Send the messages of a frame to one subscriber, numbered as they are; the caller holds publock."""
        self.message_data_sent += frame.rows.size
        for connection in self.connections:
            if connection.endpoint_id != peer or not isinstance(connection, PublisherTransport):
                continue
            try:
                connection.write_frame(frame)
            except Exception as error:
                self._end(connection, error)

    def _end(self, connection: Any, error: Exception) -> None:
        """End a connection that failed; the others go on."""
        rospy.logdebug('[%s]: %s ended: %s', self.resolved_name, connection.endpoint_id, error)
        connection.close()


class UdpSubscriberImpl(_SubscriberImpl):
    """A topic's subscribing side, which can request UDPROS and call batch callbacks."""

    def __init__(self, name: str, data_class: Any, options: SubscriberOptions) -> None:
        super().__init__(name, data_class)
        self.options = options
        self.batch_callbacks: List[BatchCallback] = []
        self.publishers: Tuple[str, ...] = ()
        """URIs of the publishers, as the master last reported them, and of a few that others did."""
        self.connecting: Set[str] = set()
        """URIs of the publishers with which a connection is being negotiated."""
        self.fallbacks = Fallbacks()
        """The publishers that refused UDPROS."""
        self.silence = Silence(time.monotonic())
        """When the master is asked for the publishers."""
        self.renegotiations: DefaultDict[str, Renegotiation] = collections.defaultdict(Renegotiation)
        """{URI of a publisher: when to negotiate with it anew}"""

    def call_batch(self, records: Records, mask: BoolArray) -> None:
        """Call the batch callbacks; rospy logs what they raise."""
        for callback in self.batch_callbacks:
            self._invoke_callback(records, callback, mask)

    def receive_callback(self, msgs: List[Any], connection: Any) -> None:
        """As rospy's; messages received by TCPROS reach the batch callbacks too, as batches of one."""
        super().receive_callback(msgs, connection)
        if self.batch_callbacks and not isinstance(connection, SubscriberTransport):
            for message in msgs:
                with contextlib.suppress(LayoutError):
                    self.call_batch(_as_records(message), np.ones(1, bool))


def _as_records(message: Any) -> Records:
    data = serialised(message)
    records: Records = np.ndarray((1,), record_dtype(type(message), lengths_of(type(message), data)), data)
    return records
