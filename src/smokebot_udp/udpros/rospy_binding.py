# SPDX-License-Identifier: BSD-3-Clause
"""The binding of UDPROS to rospy's node: negotiation, reconnection, and supervision of silent topics.

`install` adds a protocol handler to the node and replaces four attributes of this node's own objects, never of rospy's
classes:

* ROSHandler.requestTopic: a topic offers UDPROS, TCPROS or both, as its Publisher specifies;
* ROSHandler._connect_topic: our Subscribers request UDPROS first, and fall back to TCPROS;
* ROSHandler.publisherUpdate and RegManager.publisher_update: a UDP socket does not notice that its publisher ended;
  only the master reports it;
* the XML-RPC server's reader: roscpp's base64 puts a NUL into 3 of 54 requests (ros_comm#2160).

Only rospy_transports.py, topics.py, registration.py, master.py and this file depend on rospy's internals (1.14, 1.15).
"""
import functools
import itertools
import math
import threading
import time
import traceback
import urllib.parse
from typing import Any, Callable, List, Sequence, Tuple

import rosgraph.network
import rospy
import rospy.core
import rospy.names
from rospy.impl.registration import RegManager, get_registration_listeners, get_topic_manager
from rospy.impl.tcpros import get_tcpros_handler
from rospy.impl.transport import ProtocolHandler

from . import rpc
from .datagram import MIN_MAX_DATAGRAM_SIZE, ROSCPP_MAX_DATAGRAM_SIZE
from .endpoints import DatagramReceiver, addresses_of, path_payload
from .loss_emulation import open_receiver
from .master import MasterWatch, log_without_master, register_node
from .negotiation import PROTOCOL, Refused, Reply, Request
from .rospy_transports import PublisherTransport, SubscriberTransport, UdpPublisherImpl, UdpSubscriberImpl

TCPROS = 'TCPROS'

MASTER = '/master'
"""The caller's name in the master's own calls."""

RETRY_PERIOD, MAX_RETRY_PERIOD = 0.2, 2.0
"""Time between the first two attempts to reach a publisher that the master names; it doubles up to the maximum [s]."""

WATCH_PERIOD = 1.0
"""How often the master is asked whether it is still the same, and topics are checked for silence [s]."""

SILENCE_TIMEOUT = 5.0
"""After this time without a message of a topic, the master and its publishers are asked for it [s]."""

SETTLING_TIME = 60.0
"""Time after the registration with a restarted master during which its lists of publishers may be incomplete [s]."""

ApiResult = Tuple[int, str, Any]
"""Status code (1: success), status message and value of a method of the ROS slave API."""


class UdprosHandler(ProtocolHandler):
    """Answers the requests of subscribers, and makes those of our own Subscribers.

    :param node_handler: rospy's ROSHandler
    :param registration: rospy's RegManager
    """

    def __init__(self, node_handler: Any, registration: Any) -> None:
        self._connection_ids = itertools.count(1)
        self._request_topic = node_handler.requestTopic
        self._connect_topic = node_handler._connect_topic
        self._publisher_update = registration.publisher_update
        self._registration = registration
        self._registered_at = -math.inf
        self._lock = threading.Lock()
        self._ended = threading.Event()
        threading.Thread(target=self._watch, name='UDPROS watch', daemon=True).start()

    def shutdown(self) -> None:
        """Called by rospy at shutdown."""
        self._ended.set()

    def supports(self, protocol: str) -> bool:
        """Called by rospy for each protocol that a subscriber requests."""
        return protocol == PROTOCOL

    # -- as a publisher ----------------------------------------------------------------------------

    def request_topic(self, caller_id: str, topic: str, protocols: Any) -> ApiResult:
        """ROSHandler.requestTopic, restricted to the protocols that the topic offers."""
        impl = get_topic_manager().get_publisher_impl(topic)
        if isinstance(protocols, list):
            protocols = [p for p in protocols if isinstance(p, list) and p]
            if isinstance(impl, UdpPublisherImpl):
                protocols = [p for p in protocols if p[0] in impl.options.protocols]
                if not protocols:
                    return 0, '[%s] is published by %s only' % (topic, ' and '.join(impl.options.protocols)), []
        result: ApiResult = self._request_topic(caller_id, topic, protocols)
        return result

    def init_publisher(self, topic: str, protocol: List[Any]) -> ApiResult:
        """Called by rospy when a subscriber requests UDPROS."""
        try:
            return 1, 'ready', self._accept(topic, protocol).params()
        except Refused as refusal:
            rospy.logwarn_throttle_identical(10, '[%s]: a UDPROS subscriber is refused: %s' % (topic, refusal))
            return 0, str(refusal), []

    def _accept(self, topic: str, protocol: List[Any]) -> Reply:
        """Connect to the subscriber that makes a request."""
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
                raise Refused('the path to %s is limited to datagrams of %d bytes' % (request.host, size))
            connection = PublisherTransport(topic, request, next(self._connection_ids), size)
        except (OSError, UnicodeError) as error:
            raise Refused('no route to %s:%d: %s' % (request.host, request.port, error)) from error
        header = {'topic': impl.resolved_name, 'type': impl.data_class._type, 'md5sum': md5sum,
                  'message_definition': impl.data_class._full_text, 'callerid': rospy.names.get_caller_id(),
                  'latching': '1' if impl.is_latch else '0'}
        header.update(impl.headers or {})
        if not impl.add_connection(connection):
            connection.close()
            raise Refused('[%s] is no longer published' % topic)
        return Reply(*connection.local_endpoint, connection.connection_id, size, header)

    # -- as a subscriber ---------------------------------------------------------------------------

    def connect_topic(self, topic: str, uri: str) -> ApiResult:
        """ROSHandler._connect_topic: connect to one publisher, unless already connected."""
        impl = get_topic_manager().get_subscriber_impl(topic)
        if not isinstance(impl, UdpSubscriberImpl) or PROTOCOL not in impl.options.protocols:
            result: ApiResult = self._connect_topic(topic, uri)
            return result
        with self._lock:
            if uri in impl.connecting:
                return 1, 'already connecting to %s' % uri, 0
            impl.connecting.add(uri)
        try:
            return self._connect(impl, uri)
        finally:
            with self._lock:
                impl.connecting.discard(uri)

    def _connect(self, impl: UdpSubscriberImpl, uri: str) -> ApiResult:
        """Negotiate with one publisher until it answers, or publishes no longer."""
        for connection in impl.connections:
            if connection.endpoint_id == uri:
                if not isinstance(connection, SubscriberTransport) or _still_serves(connection):
                    return 1, 'already connected to %s' % uri, 0
                connection.close()
        period = RETRY_PERIOD
        while uri in impl.publishers and not impl.closed and not self._ended.is_set():
            try:
                return _negotiate(impl, uri, impl.options.protocols)
            except Refused as refusal:
                rospy.logerr_throttle_identical(10, '[%s]: %s refuses: %s' % (impl.resolved_name, uri, refusal))
                return 0, str(refusal), 0
            except (rpc.Unreachable, OSError) as error:     # OSError: such as EMFILE, here
                rospy.logdebug('[%s]: no connection to %s, retrying: %s', impl.resolved_name, uri, error)
            self._ended.wait(period)
            period = min(2 * period, MAX_RETRY_PERIOD)
        return 0, '%s is no longer a publisher' % uri, 0

    def notified(self, caller_id: str, topic: str, uris: Sequence[str]) -> None:
        """ROSHandler.publisherUpdate: the master's notification of a topic's publishers, or a publisher's of itself.

        A publisher does not know of all others (see `udpros.master`), so its notification ends no connection.
        """
        if caller_id != MASTER:
            self._add_publishers(topic, uris)
            return
        if time.monotonic() - self._registered_at < SETTLING_TIME:
            self.publisher_update(topic, uris)
            return
        impl = get_topic_manager().get_subscriber_impl(topic)
        if isinstance(impl, UdpSubscriberImpl):
            with self._lock:
                impl.publishers = tuple(uris)
            for connection in _unlisted(impl, uris):
                connection.close()
        self._publisher_update(topic, uris)

    def _add_publishers(self, topic: str, uris: Sequence[str]) -> None:
        """Connect to further publishers; rospy's queue of updates would forget what the master reported before."""
        impl = get_topic_manager().get_subscriber_impl(topic)
        if isinstance(impl, UdpSubscriberImpl):
            with self._lock:
                impl.publishers = tuple(dict.fromkeys((*impl.publishers, *uris)))
        for uri in uris:
            threading.Thread(target=self._registration._connect_topic_thread, args=(topic, uri), daemon=True).start()

    def publisher_update(self, topic: str, uris: Sequence[str]) -> None:
        """RegManager.publisher_update: those of the topic's publishers that a master knows.

        A restarted master knows few of them at first, or, of nodes that register once, none for ever. So a connection
        to one that is not listed ends only if it is silent and its publisher does not answer.
        """
        impl = get_topic_manager().get_subscriber_impl(topic)
        if isinstance(impl, UdpSubscriberImpl):
            unlisted = _unlisted(impl, uris)
            with self._lock:
                impl.publishers = (*uris, *(connection.endpoint_id for connection in unlisted))
            for connection in unlisted:
                if connection.idle >= SILENCE_TIMEOUT:
                    threading.Thread(target=self._review, args=(impl, connection), daemon=True).start()
        self._publisher_update(topic, uris)

    def _review(self, impl: UdpSubscriberImpl, connection: SubscriberTransport) -> None:
        """Connect again to a silent publisher that the master does not list, or end the connection to it."""
        uri = connection.endpoint_id
        try:
            rpc.call(uri, 'getPid')
        except (rpc.Unreachable, Refused):
            if connection.idle < SILENCE_TIMEOUT:
                return
            with self._lock:
                impl.publishers = tuple(listed for listed in impl.publishers if listed != uri)
            connection.close()
        else:
            self.connect_topic(impl.resolved_name, uri)

    # -- a restarted master, and silent topics ------------------------------------------------------

    def _watch(self) -> None:
        """Register with a restarted master, and ask it for the publishers of silent topics."""
        master = MasterWatch(rosgraph.get_master_uri(), self._registration.uri)
        while not self._ended.is_set() and not rospy.core.is_shutdown_requested():
            self._upgrade()
            try:
                if master.is_new() and self._register():
                    master.registered()
                self._ask_for_silent()
            except (rpc.Unreachable, Refused) as error:
                rospy.logdebug('the master does not answer: %s', error)
            except Exception:   # a bug of ours must not end the watch
                rospy.logerr_throttle(60, 'watching the master failed: %s' % traceback.format_exc())
            self._ended.wait(WATCH_PERIOD)

    def _upgrade(self) -> None:
        """Ask the publishers for UDPROS that refused it before, and are connected by TCPROS."""
        now = time.monotonic()
        for impl in list(get_topic_manager().subs.values()):
            for uri in impl.fallbacks.due(now) if isinstance(impl, UdpSubscriberImpl) else ():
                if any(c.endpoint_id == uri and not isinstance(c, SubscriberTransport) for c in impl.connections):
                    impl.fallbacks.refused(uri, now)    # until it agrees
                    threading.Thread(target=self._ask_for_udp, args=(impl, uri), daemon=True).start()
                else:
                    impl.fallbacks.forget(uri)

    def _ask_for_udp(self, impl: UdpSubscriberImpl, uri: str) -> None:
        """Replace a TCPROS connection by UDPROS, if the publisher agrees now."""
        with self._lock:
            if uri in impl.connecting:
                return
            impl.connecting.add(uri)
        try:
            _negotiate(impl, uri, (PROTOCOL,))
            impl.fallbacks.forget(uri)
            rospy.loginfo('[%s]: %s is connected by UDPROS now', impl.resolved_name, uri)
        except (Refused, rpc.Unreachable, OSError) as error:
            rospy.logdebug('[%s]: %s stays connected by TCPROS: %s', impl.resolved_name, uri, error)
        finally:
            with self._lock:
                impl.connecting.discard(uri)

    def _register(self) -> bool:
        """Register the node with a new master; whether this succeeded."""
        self._registered_at = time.monotonic()
        registered = register_node(self._registration)
        if registered:
            rospy.loginfo('registered again: the master has been restarted')
        return registered

    def _ask_for_silent(self) -> None:
        """Ask the master for the publishers of silent topics: its notification may have been lost with the link."""
        for impl in list(get_topic_manager().subs.values()):
            if not isinstance(impl, UdpSubscriberImpl) or not _silent(impl, time.monotonic()):
                continue
            impl.last_asked = time.monotonic()
            uris = rpc.call(rosgraph.get_master_uri(), 'registerSubscriber', impl.resolved_name, impl.type,
                            rospy.core.get_node_uri())
            if not impl.closed:
                self.publisher_update(impl.resolved_name, uris)


def _unlisted(impl: UdpSubscriberImpl, uris: Sequence[str]) -> List[SubscriberTransport]:
    """The UDPROS connections to other publishers than those listed."""
    return [connection for connection in impl.connections
            if isinstance(connection, SubscriberTransport) and connection.endpoint_id not in uris]


def _silent(impl: UdpSubscriberImpl, now: float) -> bool:
    """Whether a topic's publishers have to be asked for."""
    live = any(not isinstance(c, SubscriberTransport) or c.idle < SILENCE_TIMEOUT for c in impl.connections)
    return not live and not impl.closed and now - impl.last_asked > SILENCE_TIMEOUT


def _negotiate(impl: UdpSubscriberImpl, uri: str, protocols: Sequence[str]) -> ApiResult:
    """Connect to one publisher by the first protocol on which both sides agree.

    :param protocols: to request, best first
    :raises Refused: if it refuses, or answers with something else
    :raises rpc.Unreachable: if it does not answer, or has an unknown host
    :raises OSError: if there is no socket
    """
    options = impl.options
    receiver = open_receiver(impl.resolved_name, rosgraph.network.get_bind_address(), options.max_datagram_size,
                             options.receive_buffer)
    if receiver.receive_buffer < 2 * options.receive_buffer:   # the kernel adds its own overhead: twice the size
        rospy.logwarn_throttle_identical(60, (
            'the kernel grants a receive buffer of %d bytes only, so bursts may be lost here: '
            'sudo sysctl -w net.core.rmem_max=%d') % (receiver.receive_buffer // 2, options.receive_buffer))
    kept = False
    try:
        params = _request(uri, impl, receiver, protocols)
        if params[0] == TCPROS:
            result: ApiResult = get_tcpros_handler().create_transport(impl.resolved_name, uri, params)
            return result
        reply = Reply.parse(params)
        if impl.data_class._md5sum not in ('*', reply.header['md5sum']):
            raise Refused('it publishes %s with md5sum %s, not %s' % (
                reply.header['type'], reply.header['md5sum'], impl.data_class._md5sum))
        hosts = {reply.host, urllib.parse.urlparse(uri).hostname}
        if not any(map(addresses_of, hosts)):
            raise rpc.Unreachable('nobody knows the addresses of %s' % ', '.join(map(str, hosts)))
        connection = SubscriberTransport(impl, receiver, reply, uri, hosts)
        kept = impl.add_connection(connection)
    finally:
        if not kept:
            receiver.close()
    if not kept:
        return 0, '[%s] has been unregistered' % impl.resolved_name, 0
    connection.start()
    return 1, 'connected to %s by UDPROS' % uri, 1


def _request(uri: str, impl: UdpSubscriberImpl, receiver: DatagramReceiver, protocols: Sequence[str]) -> List[Any]:
    """Request a topic from a publisher; one that fails at UDPROS is asked again for TCPROS alone."""
    header = {'topic': impl.resolved_name, 'type': impl.data_class._type, 'md5sum': impl.data_class._md5sum,
              'callerid': rospy.names.get_caller_id()}
    request = Request(rosgraph.network.get_host_name(), receiver.address[1], header, impl.options.max_datagram_size)
    offers = [request.params() if protocol == PROTOCOL else [protocol] for protocol in protocols]
    try:
        return _checked(rpc.call(uri, 'requestTopic', impl.resolved_name, offers))
    except Refused as refusal:
        if offers[-1] != [TCPROS] or len(offers) == 1:
            raise
        params = _checked(rpc.call(uri, 'requestTopic', impl.resolved_name, offers[-1:]))
        if impl.fallbacks.refused(uri, time.monotonic()):
            rospy.logwarn('[%s]: %s is connected by TCPROS for now, as it refuses UDPROS: %s',
                          impl.resolved_name, uri, refusal)
        return params


def _checked(params: Any) -> List[Any]:
    if not isinstance(params, list) or not params or params[0] not in (PROTOCOL, TCPROS):
        raise Refused('the answer does not name a known protocol: %.100r' % (params,))
    return params


def _still_serves(connection: SubscriberTransport) -> bool:
    """Whether the publisher is still the process that we connected to, and knows of the connection.

    If it does not answer, the link may be down for a moment, and the connection is kept.
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


_install_lock = threading.Lock()
_installed: List[UdprosHandler] = []


def install() -> None:
    """Bind UDPROS to this process's node, once; after rospy.init_node, before any UDPROS topic.

    :raises rospy.exceptions.ROSInitException: before rospy.init_node
    """
    with _install_lock:
        if _installed:
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
        _remove_nuls(node_handler)
        log_without_master()
        _installed.append(handler)


def _publisher_update(original: Callable[..., ApiResult], handler: UdprosHandler, caller_id: str, topic: Any,
                      publishers: Any) -> ApiResult:
    """ROSHandler.publisherUpdate; rospy's own ignores an empty list."""
    if not _are_uris(publishers):
        return original(caller_id, topic, publishers)       # refuses
    result = original(caller_id, topic, [])                 # checks the names only
    if result[0] == 1:
        handler.notified(caller_id, topic, publishers)
    return result


def _are_uris(values: Any) -> bool:
    """As rospy.impl.masterslave checks them."""
    return isinstance(values, list) and all(
        isinstance(value, str) and all(urllib.parse.urlparse(value)[:2]) for value in values)


def _remove_nuls(node_handler: Any) -> None:
    """Remove the NULs from the requests to the node's XML-RPC server before its parser reads them."""
    for hook in rospy.core._shutdown_hooks:
        node = getattr(hook, '__self__', None)
        if node is not None and getattr(node, 'handler', None) is node_handler:
            node.server._marshaled_dispatch = functools.partial(_dispatch, node.server._marshaled_dispatch)
            return
    rospy.logwarn('the XML-RPC server of this rospy is not found: 3 of 54 roscpp subscribers may not connect')


def _dispatch(original: Callable[..., Any], data: bytes, *args: Any, **kwargs: Any) -> Any:
    return original(data.replace(b'\0', b''), *args, **kwargs)
