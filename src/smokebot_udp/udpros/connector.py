# SPDX-License-Identifier: BSD-3-Clause
"""The subscriber's side of negotiation: connects to publishers, by UDPROS or else by TCPROS.

A publisher of another type, or of another version of it, is not asked for TCPROS: it would refuse that, too, and rospy
would try it again and again. One error names both versions. Nor is one of another wire format, which one error names
for all topics.
"""
import contextlib
import itertools
import threading
import time
import urllib.parse
from typing import Any, Callable, Dict, Iterable, List, Optional, Sequence, Tuple

import rosgraph.network
import rospy
import rospy.core
import rospy.names
from rospy.impl.registration import get_topic_manager
from rospy.impl.tcpros import get_tcpros_handler

from ..backoff import Backoff
from ..limited_log import WARNING_PERIOD, logerr, logwarn
from . import rpc
from .endpoints import SHORT_BUFFER, DatagramReceiver, addresses_of
from .gathered_calls import GatheredCalls
from .loss_emulation import open_receiver
from .negotiation import (
    OTHER_VERSION_PERIOD,
    PROTOCOL,
    Refused,
    Reply,
    Request,
    check_formats,
    has_unregistered,
    is_other_format,
    is_other_version,
    other_type,
)
from .rospy_transports import SubscriberTransport, UdpSubscriberImpl

TCPROS = 'TCPROS'

GONE_AFTER = 10.0
"""A publisher's node that has ended is not asked for longer than this; the watch asks the master again [s]."""

TRANSIENT = 3
"""An attempt may fail on this machine, for lack of sockets, for example. It is logged after this many in a row."""

MAX_DRAINED = 64
"""Batches of old datagrams that are dropped before another attempt; a stranger may send more and more."""

IPV4 = {'::': '0.0.0.0', '::1': '127.0.0.1'}
"""What datagrams are bound to, as they cross by IPv4, where rospy binds to IPv6 addresses (ROS_IPV6)."""

ApiResult = Tuple[int, str, Any]
"""Status code (1: success), status message and value of a method of the ROS slave API."""


class Connector:
    """Connects the Subscribers of a node; any thread.

    :param connect_plain: rospy's ROSHandler._connect_topic
    """

    def __init__(self, connect_plain: Callable[[str, str], ApiResult]) -> None:
        self._connect_plain = connect_plain
        self._lock = threading.Lock()
        self._calls = GatheredCalls()
        self._ended = threading.Event()

    def stop(self) -> None:
        """End all attempts."""
        self._ended.set()

    def connect_topic(self, topic: str, uri: str) -> ApiResult:
        """ROSHandler._connect_topic: connect to one publisher, unless already connected."""
        impl = get_topic_manager().get_subscriber_impl(topic)
        if not isinstance(impl, UdpSubscriberImpl) or PROTOCOL not in impl.options.protocols:
            return self._connect_plain(topic, uri)
        with self._lock:
            if uri in impl.connecting:
                return 1, 'already connecting to %s' % uri, 0
            impl.connecting.add(uri)
        try:
            return self._connect(impl, uri)
        finally:
            with self._lock:
                impl.connecting.discard(uri)

    def connect_all(self, topic: str, uris: Iterable[str]) -> None:
        """Connect to some publishers of a topic, each in a thread of its own."""
        for uri in uris:
            threading.Thread(target=self.connect_topic, args=(topic, uri), daemon=True).start()

    def connect_tcp(self, topic: str, uri: str) -> None:
        """Connect a rospy.Subscriber to one publisher, unless already connected, by one attempt: rospy's own goes on
        for ever where the publisher does not answer.

        :raises Refused: if the publisher refuses
        :raises rpc.Unreachable: if it does not answer
        """
        params = _checked(rpc.call(uri, 'requestTopic', topic, [[TCPROS]]))
        impl = get_topic_manager().get_subscriber_impl(topic)
        if impl is not None and not impl.has_connection(uri):
            get_tcpros_handler().create_transport(topic, uri, params)

    def renew(self, connection: SubscriberTransport) -> None:
        """Replace a connection."""
        connection.close()
        self.connect_all(connection.name, [connection.endpoint_id])

    def _connect(self, impl: UdpSubscriberImpl, uri: str) -> ApiResult:
        """Negotiate with one publisher, once it is wanted, until it answers, publishes no longer, or has ended."""
        for connection in impl.connections:
            if connection.endpoint_id == uri:
                return 1, 'already connected to %s' % uri, 0
        with contextlib.closing(_Negotiation(impl, uri, impl.options.protocols, self._calls)) as negotiation:
            return self._persist(impl, uri, negotiation)

    def _persist(self, impl: UdpSubscriberImpl, uri: str, negotiation: '_Negotiation') -> ApiResult:
        """Attempt until the publisher answers, publishes no longer, or has ended."""
        pauses, begun, failures = Backoff(rpc.RETRY_PERIOD, rpc.MAX_RETRY_PERIOD), time.monotonic(), 0
        while uri in impl.publishers and not impl.closed and not self._ended.is_set():
            if not impl.options.wanted():       # that is known here: the period does not grow
                self._ended.wait(rpc.RETRY_PERIOD)
                continue
            try:
                return negotiation.attempt()
            except Refused as refusal:
                if is_other_format(refusal):        # one line for all topics, whichever side refuses
                    logerr('', str(refusal).split('requestTopic: ')[-1], OTHER_VERSION_PERIOD)
                elif not has_unregistered(refusal):
                    logerr('[%s]' % impl.resolved_name, '%s refuses: %s' % (uri, refusal),
                           OTHER_VERSION_PERIOD if is_other_version(refusal) else 10)
                return 0, str(refusal), 0
            except OSError as error:    # such as EMFILE, here
                failures += 1
                if failures > TRANSIENT:
                    logerr('[%s]: no connection to %s, retrying' % (impl.resolved_name, uri), error, WARNING_PERIOD)
            except rpc.Unreachable as error:
                failures = 0
                rospy.logdebug('[%s]: no connection to %s, retrying: %s', impl.resolved_name, uri, error)
                if isinstance(error, rpc.Gone) and time.monotonic() > begun + GONE_AFTER:
                    return 0, '%s has ended' % uri, 0
            self._ended.wait(pauses.take())
        return 0, '%s is no longer a publisher' % uri, 0

    def upgrade(self, impls: Iterable[UdpSubscriberImpl], now: float) -> None:
        """Ask the publishers for UDPROS that refused it before, and are connected by TCPROS."""
        for impl, uri in itertools.chain.from_iterable(
                ((impl, uri) for uri in impl.fallbacks.due(now)) for impl in impls):
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
            with contextlib.closing(_Negotiation(impl, uri, (PROTOCOL,), self._calls)) as negotiation:
                negotiation.attempt()
            impl.fallbacks.forget(uri)
            rospy.loginfo('[%s]: %s is connected by UDPROS now', impl.resolved_name, uri)
        except (Refused, rpc.Unreachable, OSError) as error:
            rospy.logdebug('[%s]: %s stays connected by TCPROS: %s', impl.resolved_name, uri, error)
        finally:
            with self._lock:
                impl.connecting.discard(uri)


class _Negotiation:
    """Connects to one publisher by the first protocol on which both sides agree.

    All attempts name the same port: by it a publisher recognises a request whose answer was lost.

    :param protocols: to request, best first
    """

    def __init__(self, impl: UdpSubscriberImpl, uri: str, protocols: Sequence[str], calls: GatheredCalls) -> None:
        self._impl, self._uri, self._protocols, self._calls = impl, uri, protocols, calls
        self._receiver: Optional[DatagramReceiver] = None

    def attempt(self) -> ApiResult:
        """Request the topic, and connect.

        :raises Refused: if the publisher refuses, or answers with something else
        :raises rpc.Unreachable: if it does not answer, or has an unknown host; then it may be asked again
        :raises OSError: if there is no socket
        """
        impl, uri, receiver = self._impl, self._uri, self._open()
        params = self._request(receiver)
        if params[0] == TCPROS:
            result: ApiResult = get_tcpros_handler().create_transport(impl.resolved_name, uri, params)
            return result
        reply = Reply.parse(params)
        if impl.data_class._md5sum not in ('*', reply.header['md5sum']):
            raise other_type(impl.resolved_name, reply.header['type'], reply.header['md5sum'], impl.data_class._md5sum)
        check_formats(reply.header, self._header())
        hosts = {reply.host, urllib.parse.urlparse(uri).hostname}
        if not any(map(addresses_of, hosts)):
            raise rpc.Unreachable('nobody knows the addresses of %s' % ', '.join(map(str, hosts)))
        connection = SubscriberTransport(impl, receiver, reply, uri, hosts)
        if not impl.add_connection(connection):
            return 0, '[%s] has been unregistered' % impl.resolved_name, 0
        self._receiver = None       # it is the connection's
        connection.start()
        return 1, 'connected to %s by UDPROS' % uri, 1

    def close(self) -> None:
        """Free the socket, unless there is a connection."""
        if self._receiver is not None:
            self._receiver.close()
            self._receiver = None

    def _open(self) -> DatagramReceiver:
        if self._receiver is None:
            self._receiver = _receiver(self._impl)
        else:       # what came after the attempt before is old
            _drain(self._receiver)
        return self._receiver

    def _header(self) -> Dict[str, str]:
        """The subscriber's connection header."""
        impl = self._impl
        return {**impl.options.headers, 'topic': impl.resolved_name, 'type': impl.data_class._type,
                'md5sum': impl.data_class._md5sum, 'callerid': rospy.names.get_caller_id()}

    def _request(self, receiver: DatagramReceiver) -> List[Any]:
        """Request the topic; a publisher that fails at UDPROS is asked again for TCPROS alone."""
        impl, uri = self._impl, self._uri
        request = Request(rosgraph.network.get_host_name(), receiver.address[1], self._header(),
                          impl.options.max_datagram_size)
        offers = [request.params() if protocol == PROTOCOL else [protocol] for protocol in self._protocols]
        try:
            return _checked(self._calls.call(uri, 'requestTopic', impl.resolved_name, offers))
        except Refused as refusal:
            if offers[-1] != [TCPROS] or len(offers) == 1 or is_other_version(refusal):
                raise
            params = _checked(self._calls.call(uri, 'requestTopic', impl.resolved_name, offers[-1:]))
            if impl.fallbacks.refused(uri, time.monotonic()):
                rospy.logwarn('[%s]: %s is connected by TCPROS for now, as it refuses UDPROS: %s',
                              impl.resolved_name, uri, refusal)
            return params


def _receiver(impl: UdpSubscriberImpl) -> DatagramReceiver:
    options = impl.options
    address = rosgraph.network.get_bind_address()
    receiver = open_receiver(impl.resolved_name, IPV4.get(address, address), options.max_datagram_size,
                             options.receive_buffer)
    shortage = receiver.shortage(options.receive_buffer)
    if shortage is not None:
        logwarn(SHORT_BUFFER, shortage)
    return receiver


def _drain(receiver: DatagramReceiver) -> None:
    for _ in range(MAX_DRAINED):
        if receiver.receive() < receiver.batch:
            return


def _checked(params: Any) -> List[Any]:
    if not isinstance(params, list) or not params or params[0] not in (PROTOCOL, TCPROS):
        raise Refused('the answer does not name a known protocol: %.100r' % (params,))
    return params
