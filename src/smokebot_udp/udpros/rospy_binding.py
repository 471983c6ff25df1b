# SPDX-License-Identifier: BSD-3-Clause
"""How UDPROS hangs in rospy's node: negotiation, reconnection, and the care for silent topics.

`install` adds a protocol handler to the node and replaces four attributes of this node's own objects,
never of rospy's classes:

* ROSHandler.requestTopic: a topic takes UDPROS, TCPROS or both, as its Publisher said;
* ROSHandler._connect_topic: our Subscribers ask for UDPROS first, and fall back;
* ROSHandler.publisherUpdate and RegManager.publisher_update: a UDP socket does not tell that its
  publisher ended; only the master does;
* the XML-RPC server's reader: roscpp's base64 leaves a NUL in 3 of 54 requests (ros_comm#2160).

rospy_transports.py, registration.py and this file are the only ones that know rospy's insides (1.14, 1.15).
"""
import functools
import itertools
import threading
import time
import urllib.parse

import rosgraph.network
import rospy
import rospy.core
import rospy.names
from rospy.impl.registration import RegManager, get_registration_listeners, get_topic_manager
from rospy.impl.tcpros import get_tcpros_handler
from rospy.impl.transport import ProtocolHandler

from . import rpc
from .datagram import MIN_MAX_DATAGRAM_SIZE, ROSCPP_MAX_DATAGRAM_SIZE
from .endpoints import DatagramReceiver, path_payload
from .negotiation import PROTOCOL, Refused, Reply, Request
from .rospy_transports import PublisherTransport, SubscriberTransport, UdpPublisherImpl, UdpSubscriberImpl

TCPROS = 'TCPROS'

RETRY_FIRST, RETRY_MOST = 0.2, 2.0
"""Pauses between attempts to reach a publisher that the master names [s]."""

SILENCE = 5.0
"""A topic silent for so long is asked after: at the master, and at its publishers [s]."""


class UdprosHandler(ProtocolHandler):
    """Answers subscribers' requests, and makes those of our own Subscribers."""

    def __init__(self, node_handler, registration):
        self._connection_ids = itertools.count(1)
        self._request_topic = node_handler.requestTopic
        self._connect_topic = node_handler._connect_topic
        self._publisher_update = registration.publisher_update
        self._node_handler = node_handler
        self._lock = threading.Lock()
        self._ended = threading.Event()
        threading.Thread(target=self._watch, name='UDPROS watch', daemon=True).start()

    def shutdown(self):
        self._ended.set()

    def supports(self, protocol):
        return protocol == PROTOCOL

    # -- as a publisher ----------------------------------------------------------------------------

    def request_topic(self, caller_id, topic, protocols):
        """ROSHandler.requestTopic, offered only the protocols that the topic takes."""
        impl = get_topic_manager().get_publisher_impl(topic)
        if isinstance(protocols, list):
            protocols = [p for p in protocols if isinstance(p, list) and p]
            if isinstance(impl, UdpPublisherImpl):
                protocols = [p for p in protocols if p[0] in impl.options.protocols]
                if not protocols:
                    return 0, '[%s] is published by %s only' % (topic, ' and '.join(impl.options.protocols)), []
        return self._request_topic(caller_id, topic, protocols)

    def init_publisher(self, topic, protocol):
        try:
            return 1, 'ready', self._accept(topic, protocol).params()
        except Refused as refusal:
            rospy.logwarn_throttle_identical(10, '[%s]: a UDPROS subscriber is refused: %s' % (topic, refusal))
            return 0, str(refusal), []

    def _accept(self, topic, protocol):
        impl = get_topic_manager().get_publisher_impl(topic)
        if impl is None or impl.closed:
            raise Refused('not a publisher of [%s]' % topic)
        request = Request.parse(protocol)
        md5sum = impl.data_class._md5sum
        if request.header['md5sum'] not in ('*', md5sum):
            raise Refused('[%s] is of type %s with md5sum %s, not %s' % (
                topic, impl.data_class._type, md5sum, request.header['md5sum']))
        ours = impl.options.max_datagram_size if isinstance(impl, UdpPublisherImpl) else ROSCPP_MAX_DATAGRAM_SIZE
        try:
            size = min(request.max_datagram_size, ours, path_payload(request.host, request.port))
            if size < MIN_MAX_DATAGRAM_SIZE:
                raise Refused('the way to %s takes datagrams of %d bytes only' % (request.host, size))
            connection = PublisherTransport(topic, request, next(self._connection_ids), size)
        except (OSError, UnicodeError) as error:
            raise Refused('no way to %s:%d: %s' % (request.host, request.port, error)) from error
        header = {'topic': impl.resolved_name, 'type': impl.data_class._type, 'md5sum': md5sum,
                  'message_definition': impl.data_class._full_text, 'callerid': rospy.names.get_caller_id(),
                  'latching': '1' if impl.is_latch else '0'}
        header.update(impl.headers or {})
        impl.add_connection(connection)
        return Reply(connection.local_endpoint[0], connection.local_endpoint[1], connection.connection_id, size,
                     header)

    # -- as a subscriber ---------------------------------------------------------------------------

    def connect_topic(self, topic, uri):
        """ROSHandler._connect_topic: connect to one publisher, unless it is connected already."""
        impl = get_topic_manager().get_subscriber_impl(topic)
        if not isinstance(impl, UdpSubscriberImpl) or PROTOCOL not in impl.options.protocols:
            return self._connect_topic(topic, uri)
        with self._lock:
            if uri in impl.connecting:
                return 1, 'already being connected to %s' % uri, 0
            impl.connecting.add(uri)
        try:
            return self._connect(impl, uri)
        finally:
            with self._lock:
                impl.connecting.discard(uri)

    def _connect(self, impl, uri):
        for connection in impl.connections:
            if connection.endpoint_id == uri:
                if not isinstance(connection, SubscriberTransport) or _still_serves(connection):
                    return 1, 'already connected to %s' % uri, 0
                connection.close()
        pause = RETRY_FIRST
        while uri in impl.publishers and not impl.closed and not self._ended.is_set():
            try:
                return self._negotiate(impl, uri)
            except Refused as refusal:
                rospy.logerr_throttle_identical(10, '[%s]: %s refuses: %s' % (impl.resolved_name, uri, refusal))
                return 0, str(refusal), 0
            except rpc.Unreachable as error:
                rospy.logdebug('[%s]: %s does not answer, asking again: %s', impl.resolved_name, uri, error)
            self._ended.wait(pause)
            pause = min(2 * pause, RETRY_MOST)
        return 0, '%s publishes no more' % uri, 0

    def _negotiate(self, impl, uri):
        options, topic = impl.options, impl.resolved_name
        receiver = DatagramReceiver(rosgraph.network.get_bind_address(), options.max_datagram_size,
                                    options.receive_buffer)
        if receiver.receive_buffer < 2 * options.receive_buffer:   # the kernel counts its own overhead: double
            rospy.logwarn_throttle_identical(60, (
                'the kernel grants a receive buffer of %d bytes only, so bursts may be lost here: '
                'sudo sysctl -w net.core.rmem_max=%d') % (receiver.receive_buffer // 2, options.receive_buffer))
        kept = False
        try:
            request = Request(rosgraph.network.get_host_name(), receiver.address[1],
                              {'topic': topic, 'type': impl.data_class._type, 'md5sum': impl.data_class._md5sum,
                               'callerid': rospy.names.get_caller_id()}, options.max_datagram_size)
            offers = {PROTOCOL: request.params(), TCPROS: [TCPROS]}
            params = _request(uri, topic, [offers[protocol] for protocol in options.protocols])
            if params[0] == TCPROS:
                return get_tcpros_handler().create_transport(topic, uri, params)
            reply = Reply.parse(params)
            if impl.data_class._md5sum not in ('*', reply.header['md5sum']):
                raise Refused('it publishes %s with md5sum %s, wanted is %s' % (
                    reply.header['type'], reply.header['md5sum'], impl.data_class._md5sum))
            hosts = {reply.host, urllib.parse.urlparse(uri).hostname}
            connection = SubscriberTransport(impl, receiver, reply, uri, hosts)
            kept = impl.add_connection(connection)
        finally:
            if not kept:
                receiver.close()
        connection.start()
        return 1, 'connected to %s by UDPROS' % uri, 1

    def publisher_update(self, topic, uris):
        """RegManager.publisher_update: who publishes the topic now; the others' connections end."""
        impl = get_topic_manager().get_subscriber_impl(topic)
        if isinstance(impl, UdpSubscriberImpl):
            impl.publishers = tuple(uris)
            for connection in impl.connections:
                if isinstance(connection, SubscriberTransport) and connection.endpoint_id not in uris:
                    connection.close()
        self._publisher_update(topic, uris)

    # -- silent topics -----------------------------------------------------------------------------

    def _watch(self):
        """The master's word may be lost with the link: ask again for topics on which nothing comes."""
        while not self._ended.wait(1.0):
            for impl in list(get_topic_manager().subs.values()):
                if isinstance(impl, UdpSubscriberImpl) and _silent(impl, time.monotonic()):
                    impl.last_asked = time.monotonic()
                    try:
                        uris = rpc.call(rosgraph.get_master_uri(), 'registerSubscriber', impl.resolved_name, impl.type,
                                    rospy.core.get_node_uri())
                    except (rpc.Unreachable, Refused) as error:
                        rospy.logdebug('the master does not answer: %s', error)
                        break
                    if not impl.closed:
                        self.publisher_update(impl.resolved_name, uris)


def _silent(impl, now):
    live = any(not isinstance(c, SubscriberTransport) or c.idle < SILENCE for c in impl.connections)
    return not live and not impl.closed and now - impl.last_asked > SILENCE


def _request(uri, topic, offers):
    """Ask a publisher for one of the offers; a publisher that stumbles over UDPROS is asked for TCPROS alone."""
    try:
        return _checked(rpc.call(uri, 'requestTopic', topic, offers))
    except Refused:
        if offers[-1] != [TCPROS] or len(offers) == 1:
            raise
        return _checked(rpc.call(uri, 'requestTopic', topic, offers[-1:]))


def _checked(params):
    if not isinstance(params, list) or not params or params[0] not in (PROTOCOL, TCPROS):
        raise Refused('it answers with no known protocol: %.100r' % (params,))
    return params


def _still_serves(connection):
    """Whether the publisher is the process that we connected to, and still knows of the connection.

    One that does not answer may be behind a link that is down just now: it keeps its connection.
    """
    try:
        pid = rpc.call(connection.endpoint_id, 'getPid')
        if connection.publisher_pid not in (None, pid):
            return False
        connection.publisher_pid = pid
        bus = rpc.call(connection.endpoint_id, 'getBusInfo')
        return any(entry[1:5] == [rospy.names.get_caller_id(), 'o', PROTOCOL, connection.name] for entry in bus)
    except (rpc.Unreachable, Refused):
        return True


_installed = threading.Lock(), []


def install():
    """Bring UDPROS into this process's node; after rospy.init_node, before any udpros topic. Idempotent."""
    lock, done = _installed
    with lock:
        if done:
            return
        if not rospy.core.is_initialized():
            raise rospy.exceptions.ROSInitException('call rospy.init_node before using smokebot_udp.udpros')
        registration = next(x for x in get_registration_listeners().listeners if isinstance(x, RegManager))
        node_handler = registration.handler
        handler = UdprosHandler(node_handler, registration)
        node_handler.protocol_handlers.insert(0, handler)
        node_handler.requestTopic = handler.request_topic
        node_handler._connect_topic = handler.connect_topic
        node_handler.publisherUpdate = functools.partial(_publisher_update, node_handler.publisherUpdate, handler)
        registration.publisher_update = handler.publisher_update
        _overlook_nuls(node_handler)
        done.append(handler)


def _publisher_update(original, handler, caller_id, topic, publishers):
    if publishers == [] and isinstance(topic, str):   # which rospy's own passes over
        handler.publisher_update(topic, [])
    return original(caller_id, topic, publishers)


def _overlook_nuls(node_handler):
    """Take the NULs out of what the node's XML-RPC server reads, before its parser sees them."""
    for hook in rospy.core._shutdown_hooks:
        node = getattr(hook, '__self__', None)
        if getattr(node, 'handler', None) is node_handler:
            node.server._marshaled_dispatch = functools.partial(_dispatch, node.server._marshaled_dispatch)
            return
    rospy.logwarn('this rospy keeps its XML-RPC server elsewhere: 3 of 54 roscpp subscribers may not connect')


def _dispatch(original, data, *args, **kwargs):
    return original(data.replace(b'\0', b''), *args, **kwargs)
