# SPDX-License-Identifier: BSD-3-Clause
"""The classes rospy.Publisher and rospy.Subscriber with UDPROS and options for the transport."""
from types import MappingProxyType
from typing import Any, Callable, Collection, Dict, List, Mapping, Optional

import rospy
from rospy.impl.registration import Registration, get_topic_manager
from rospy.topics import DEFAULT_BUFF_SIZE

from .datagram import DEFAULT_MAX_DATAGRAM_SIZE, MIN_MAX_DATAGRAM_SIZE, UDP_MAX_PAYLOAD
from .depacketizer import Arrived, BatchCallback
from .frame import Frame
from .packetizer import Limit, no_limit
from .records import record_dtype
from .rospy_binding import install
from .rospy_transports import (
    PublisherOptions,
    PublisherTransport,
    SubscriberOptions,
    SubscriberTransport,
    UdpPublisherImpl,
    UdpSubscriberImpl,
)

PROTOCOLS = {'prefer_udp': ('UDPROS', 'TCPROS'), 'udp': ('UDPROS',), 'tcp': ('TCPROS',)}
"""{value of `transport`: protocols offered or requested, best first}"""


def _check(transport: str, max_datagram_size: int) -> None:
    if transport not in PROTOCOLS:
        raise ValueError('transport is one of %s, not %r' % (', '.join(PROTOCOLS), transport))
    if not MIN_MAX_DATAGRAM_SIZE <= max_datagram_size <= UDP_MAX_PAYLOAD:
        raise ValueError('max_datagram_size is from %d to %d, not %r' % (
            MIN_MAX_DATAGRAM_SIZE, UDP_MAX_PAYLOAD, max_datagram_size))


def _ensure_impl(name: str, registration: str, impl_class: Any, make: Callable[[str], Any],
                 prepare: Callable[[Any], None] = lambda impl: None) -> None:
    """Make the topic's implementation before rospy makes its own.

    :param make: f(resolved name) -> the implementation, of impl_class
    :param prepare: called with the implementation, new or not, before it connects
    """
    install()
    manager, resolved = get_topic_manager(), rospy.names.resolve_name(name)
    with manager.lock:
        topics = manager.pubs if registration == Registration.PUB else manager.subs
        if resolved not in topics:
            impl = make(resolved)
            prepare(impl)
            manager._add(impl, topics, registration)
        elif isinstance(topics[resolved], impl_class):
            prepare(topics[resolved])
        else:
            raise rospy.ROSException('[%s] already has a plain rospy %s in this process' % (
                resolved, 'Publisher' if registration == Registration.PUB else 'Subscriber'))


class Publisher(rospy.Publisher):
    """A rospy.Publisher to which subscribers can connect by UDPROS.

    The further parameters are rospy.Publisher's. The transport options of a topic's first Publisher in a process apply
    to all of them.

    :param transport: 'prefer_udp' (whatever the subscriber requests), 'udp' or 'tcp'
    :param max_datagram_size: longest datagram to send, also limited by the subscriber's and the path's
        [byte of UDP payload]
    :param limit: f() -> the longest datagram that passes now, as far as is known [byte of UDP payload]
    :param tos: second byte of the datagrams' IP headers: DSCP and ECN
    :raises ValueError: if the transport is unknown or the size is out of range
    :raises rospy.ROSException: if the topic already has a plain rospy.Publisher in this process
    """

    def __init__(self, name: str, data_class: Any, subscriber_listener: Any = None, tcp_nodelay: bool = False,
                 latch: bool = False, headers: Optional[Dict[str, str]] = None, queue_size: Optional[int] = 10,
                 transport: str = 'prefer_udp', max_datagram_size: int = DEFAULT_MAX_DATAGRAM_SIZE,
                 limit: Limit = no_limit, tos: int = 0) -> None:
        _check(transport, max_datagram_size)
        options = PublisherOptions(PROTOCOLS[transport], max_datagram_size, limit, tos)
        _ensure_impl(name, Registration.PUB, UdpPublisherImpl,
                     lambda resolved: UdpPublisherImpl(resolved, data_class, options),
                     lambda impl: impl.add_headers(headers or {}))
        super().__init__(name, data_class, subscriber_listener, tcp_nodelay, latch, headers, queue_size)

    @property
    def tos(self) -> int:
        """Second byte of the datagrams' IP headers: DSCP and ECN; it may be changed."""
        return self.impl.options.tos if self.impl else 0

    @tos.setter
    def tos(self, value: int) -> None:
        if self.impl:
            self.impl.options.tos = value

    def publish_frames(self, *frames: Frame, limits: Mapping[str, int] = MappingProxyType({}),
                       second: Collection[str] = ()) -> int:
        """Send all messages of some Frames at once; much cheaper than `publish` for each message.

        :param limits: {node name of a UDPROS subscriber: it gets only this number of the first messages}
        :param second: nobody has a second path
        :return: the first message's sequence number; those of the others follow
        :raises ValueError: if a frame is of another type than the topic
        :raises rospy.ROSException: if the publisher has been unregistered
        """
        self._check_frames('publish_frames()', *frames)
        with self.impl.publock:
            first: int = self.impl.seq + 1
            self.impl.publish_frames(frames, limits)
        return first

    def publish_to(self, peer: str, frame: Frame) -> None:
        """Send all messages of a Frame to one subscriber by UDPROS, numbered as they are.

        :param peer: its node name; without effect where it is not connected
        :raises ValueError: if the frame is of another type than the topic
        :raises rospy.ROSException: if the publisher has been unregistered
        """
        self._check_frames('publish_to()', frame)
        with self.impl.publock:
            self.impl.send_to(peer, frame)

    def _check_frames(self, call: str, *frames: Frame) -> None:
        if self.impl is None:
            raise rospy.ROSException('%s to an unregistered() handle' % call)
        for frame in frames:
            if frame.message_class is not self.data_class:
                raise ValueError('[%s] publishes %s, not %s' % (
                    self.resolved_name, self.data_class._type, frame.message_class._type))

    def why_not(self, peer: str) -> str:
        """Why it does not send to a node, in words: the master does not say more."""
        return 'is not connected: its log says what it lacks, if anything'

    def connections(self) -> List[Dict[str, Any]]:
        """Statistics of the UDPROS connections, one dictionary each; after `unregister` there are none.

        * peer (str): the subscriber's node name
        * address (str, int): the subscriber's host and UDP port
        * connection_id (int)
        * max_datagram_size (int): the longest that is sent now [byte of UDP payload]
        * datagrams, bytes (int): sent [datagrams, byte of messages]
        * failures ({str: int}): datagrams that could not be sent, by the name of the error
        """
        impl = self.impl        # once: another thread may unregister
        return [{'peer': c.endpoint_id, 'address': c.remote_endpoint, 'connection_id': c.connection_id,
                 'max_datagram_size': c.packetizer.longest, 'datagrams': c.packetizer.datagrams,
                 'bytes': c.packetizer.bytes, 'failures': dict(c.sender.failures)}
                for c in (impl.connections if impl else ()) if isinstance(c, PublisherTransport)]


class Subscriber(rospy.Subscriber):
    """A rospy.Subscriber that requests UDPROS.

    The further parameters are rospy.Subscriber's. The transport options of a topic's first Subscriber in a process
    apply to all of them.

    :param transport: 'prefer_udp' (TCPROS if the publisher cannot do UDPROS), 'udp' or 'tcp'
    :param batch_callback: f(records, mask), called for messages that arrived together. records is an (n,) structured
        array of serialised messages (see udpros.records), mask is (n,) bool, those that are valid. Both are valid
        during the call only
    :param max_datagram_size: longest datagram to receive [byte of UDP payload]
    :param receive_buffer: requested from the kernel, see `connections` for what it granted [byte]
    :param coalesce: with a batch_callback, how long to wait for a batch to grow [s]
    :param arrived: f(connection, seq, size, count, when, marked), called for new messages, see
        udpros.depacketizer.Arrived; None: nothing is called
    :param wanted: f() -> bool, called when the topic has a publisher, and again until it is True: no publisher is
        connected before, by UDPROS or TCPROS
    :param headers: further fields of the connection header of UDPROS, as of rospy.Publisher
    :raises ValueError: if the transport is unknown, the size is out of range, or a batch_callback is given for a type
        without record layout
    :raises rospy.ROSException: if the topic already has a plain rospy.Subscriber in this process
    """

    def __init__(self, name: str, data_class: Any, callback: Optional[Callable[..., None]] = None,
                 callback_args: Any = None, queue_size: Optional[int] = None, buff_size: int = DEFAULT_BUFF_SIZE,
                 tcp_nodelay: bool = False, transport: str = 'prefer_udp',
                 batch_callback: Optional[BatchCallback] = None,
                 max_datagram_size: int = DEFAULT_MAX_DATAGRAM_SIZE, receive_buffer: int = 4 << 20,
                 coalesce: float = 2e-3, arrived: Optional[Arrived] = None,
                 wanted: Callable[[], bool] = lambda: True, headers: Mapping[str, str] = MappingProxyType({})) -> None:
        _check(transport, max_datagram_size)
        options = SubscriberOptions(PROTOCOLS[transport], max_datagram_size, receive_buffer, coalesce, arrived, wanted,
                                    headers)
        if batch_callback is not None:
            record_dtype(data_class, {})    # raises if the type has no layout
        self._batch_callback = batch_callback

        def prepare(impl: UdpSubscriberImpl) -> None:
            if batch_callback is not None:
                impl.batch_callbacks.append(batch_callback)
            impl.set_queue_size(queue_size)

        _ensure_impl(name, Registration.SUB, UdpSubscriberImpl,
                     lambda resolved: UdpSubscriberImpl(resolved, data_class, options), prepare)
        super().__init__(name, data_class, callback, callback_args, queue_size, buff_size, tcp_nodelay)

    def unregister(self) -> None:
        """As rospy.Subscriber's."""
        if self.impl and self._batch_callback is not None:
            self.impl.batch_callbacks.remove(self._batch_callback)
            self._batch_callback = None
        super().unregister()

    def connections(self) -> List[Dict[str, Any]]:
        """Statistics of the UDPROS connections, one dictionary each; after `unregister` there are none.

        * peer (str): the publisher's node name
        * address (str, int): the host and UDP port in the publisher's answer
        * datagrams, bytes (int): received from the publisher [datagrams, byte of UDP payload]
        * idle (float): time since the last one [s]
        * received, lost (int): messages, by their sequence numbers; None if they have no header
        * dropped ({str: int}): datagrams by the reason to drop them, see udpros.reassembly.Inbox; 'message': not a
          message of the topic's type
        * receive_buffer (int): as granted by the kernel [byte]
        * kernel_drops (int): datagrams that the kernel dropped because this was full; None if unknown
        """
        impl = self.impl        # once: another thread may unregister
        return [_describe(c) for c in (impl.connections if impl else ()) if isinstance(c, SubscriberTransport)]


def _describe(connection: SubscriberTransport) -> Dict[str, Any]:
    receiver = connection.subscription.receiver
    return {'peer': connection.callerid_pub, 'address': connection.remote_endpoint, 'idle': connection.idle,
            **connection.subscription.depacketizer.stats(), 'receive_buffer': receiver.receive_buffer,
            'kernel_drops': receiver.kernel_drops()}
