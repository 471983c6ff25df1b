# SPDX-License-Identifier: BSD-3-Clause
"""Publisher and Subscriber that speak UDPROS: rospy's own, with transport options."""
from dataclasses import dataclass
from typing import Callable, Optional, Tuple

import rospy
from rospy.impl.registration import Registration, get_topic_manager
from rospy.topics import DEFAULT_BUFF_SIZE

from .datagram import DEFAULT_MAX_DATAGRAM_SIZE, MIN_MAX_DATAGRAM_SIZE, UDP_MAX_PAYLOAD
from .pacer import Pacer
from .records import record_dtype
from .rospy_binding import install
from .rospy_transports import PublisherTransport, SubscriberTransport, UdpPublisherImpl, UdpSubscriberImpl

PROTOCOLS = {'prefer_udp': ('UDPROS', 'TCPROS'), 'udp': ('UDPROS',), 'tcp': ('TCPROS',)}
"""What `transport` may be, and what it offers or takes, best first."""


@dataclass
class _Options:
    """What a topic's Publishers or Subscribers in this process have in common: the first one decides."""
    protocols: Tuple[str, ...]
    max_datagram_size: int
    pacer: Optional[Pacer] = None
    receive_buffer: int = 0
    coalesce: float = 0.0
    drop: Optional[Callable] = None
    arrived: Optional[Callable] = None


def _options(transport, max_datagram_size, **others):
    if transport not in PROTOCOLS:
        raise ValueError('transport is one of %s, not %r' % (', '.join(PROTOCOLS), transport))
    if not MIN_MAX_DATAGRAM_SIZE <= max_datagram_size <= UDP_MAX_PAYLOAD:
        raise ValueError('max_datagram_size is from %d to %d, not %r' % (
            MIN_MAX_DATAGRAM_SIZE, UDP_MAX_PAYLOAD, max_datagram_size))
    return _Options(PROTOCOLS[transport], max_datagram_size, **others)


def _ensure_impl(name, data_class, registration, impl_class, options, prepare=lambda impl: None):
    """Make the topic's implementation ours before rospy makes its own, and `prepare` it before it connects."""
    install()
    manager, resolved = get_topic_manager(), rospy.names.resolve_name(name)
    with manager.lock:
        topics = manager.pubs if registration == Registration.PUB else manager.subs
        if resolved not in topics:
            impl = impl_class(resolved, data_class, options)
            prepare(impl)
            manager._add(impl, topics, registration)
        elif isinstance(topics[resolved], impl_class):
            prepare(topics[resolved])
        else:
            raise rospy.ROSException('[%s] has a plain rospy %s in this process already' % (
                resolved, 'Publisher' if registration == Registration.PUB else 'Subscriber'))


class Publisher(rospy.Publisher):
    """rospy.Publisher whose subscribers may come by UDPROS.

    :param transport: 'prefer_udp' (each subscriber as it asks), 'udp' or 'tcp'
    :param max_datagram_size: clamped to the subscriber's and the path's [byte of UDP payload]
    :param pacer: a Pacer that spreads what is sent by UDP, or None; may be shared between publishers
    :raises ValueError: on an unknown transport or an impossible size
    """

    def __init__(self, name, data_class, subscriber_listener=None, tcp_nodelay=False, latch=False, headers=None,
                 queue_size=10, transport='prefer_udp', max_datagram_size=DEFAULT_MAX_DATAGRAM_SIZE, pacer=None):
        options = _options(transport, max_datagram_size, pacer=pacer)
        _ensure_impl(name, data_class, Registration.PUB, UdpPublisherImpl, options)
        super().__init__(name, data_class, subscriber_listener, tcp_nodelay, latch, headers, queue_size)

    def publish_frames(self, *frames):
        """Send all messages of some Frames; much cheaper than `publish` for each. Blocks while the pacer does.

        :return: the first message's sequence number; the others' follow it
        :raises ValueError: where a frame is of another type than the topic
        """
        if self.impl is None:
            raise rospy.ROSException('publish_frames() to an unregistered() handle')
        for frame in frames:
            if frame.message_class is not self.data_class:
                raise ValueError('[%s] publishes %s, not %s' % (
                    self.resolved_name, self.data_class._type, frame.message_class._type))
        with self.impl.publock:
            first = self.impl.seq + 1
            self.impl.publish_frames(frames)
        return first

    def connections(self):
        """What `rosnode info` does not tell: [{peer, address, datagrams, bytes, failures, ...}] by UDPROS."""
        return [{'peer': c.endpoint_id, 'address': c.remote_endpoint, 'connection_id': c.connection_id,
                 'max_datagram_size': c.max_datagram_size, 'datagrams': c.stat_num_datagram, 'bytes': c.stat_bytes,
                 'failures': dict(c.sender.failures)}
                for c in self.impl.connections if isinstance(c, PublisherTransport)]


class Subscriber(rospy.Subscriber):
    """rospy.Subscriber that asks its publishers for UDPROS.

    :param transport: 'prefer_udp' (TCPROS from publishers that cannot), 'udp' or 'tcp'
    :param batch_callback: f(records, mask), called with what came together: records is an (n,) structured
        array, the serialised messages in place (see udpros.records), of which only those in the (n,) bool
        mask are good. Both are valid during the call only
    :param max_datagram_size: the longest datagram taken [byte of UDP payload]
    :param receive_buffer: asked of the kernel [byte]; `connections` tells what it granted
    :param coalesce: with a batch_callback, how long to wait for a batch to grow [s]
    :param drop: None, or f(n) giving (n,) bool of datagrams to lose, to demonstrate a bad link
    :param arrived: None, or f(number, seq, size, count, when), told by the transport what came: see Subscription
    :raises ValueError: on an unknown transport, an impossible size, or a batch_callback for a type whose
        messages have no record layout
    """

    def __init__(self, name, data_class, callback=None, callback_args=None, queue_size=None,
                 buff_size=DEFAULT_BUFF_SIZE, tcp_nodelay=False, transport='prefer_udp', batch_callback=None,
                 max_datagram_size=DEFAULT_MAX_DATAGRAM_SIZE, receive_buffer=4 << 20, coalesce=2e-3, drop=None,
                 arrived=None):
        options = _options(transport, max_datagram_size, receive_buffer=receive_buffer, coalesce=coalesce, drop=drop,
                           arrived=arrived)
        if batch_callback is not None:
            record_dtype(data_class, {})    # raises where the type has no layout
        self._batch_callback = batch_callback

        def prepare(impl):
            if batch_callback is not None:
                impl.batch_callbacks.append(batch_callback)
            impl.set_queue_size(queue_size)

        _ensure_impl(name, data_class, Registration.SUB, UdpSubscriberImpl, options, prepare)
        super().__init__(name, data_class, callback, callback_args, queue_size, buff_size, tcp_nodelay)

    def unregister(self):
        if self.impl and self._batch_callback is not None:
            self.impl.batch_callbacks.remove(self._batch_callback)
            self._batch_callback = None
        super().unregister()

    def connections(self):
        """What `rosnode info` does not tell: [{peer, address, datagrams, lost, dropped, ...}] by UDPROS."""
        return [_describe(c) for c in self.impl.connections if isinstance(c, SubscriberTransport)]


def _describe(connection):
    subscription = connection.subscription
    sequence = subscription.sequence
    return {'peer': connection.callerid_pub, 'address': connection.remote_endpoint,
            'datagrams': subscription.datagrams, 'bytes': subscription.bytes, 'idle': connection.idle,
            'received': sequence and sequence.received, 'lost': sequence and sequence.lost,
            'dropped': dict(subscription.inbox.dropped), 'receive_buffer': subscription.receiver.receive_buffer,
            'kernel_drops': subscription.receiver.kernel_drops()}
