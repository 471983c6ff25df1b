# SPDX-License-Identifier: BSD-3-Clause
"""The binding of UDPROS to rospy's node.

`install` adds a protocol handler to the node and replaces four attributes of this node's own objects, never of rospy's
classes:

* ROSHandler.requestTopic: a topic offers UDPROS, TCPROS or both, as its Publisher specifies (acceptor.py);
* ROSHandler._connect_topic: our Subscribers request UDPROS first, and fall back to TCPROS (connector.py);
* ROSHandler.publisherUpdate and RegManager.publisher_update: a UDP socket does not notice that its publisher ended;
  only the master reports it (watch.py);
* the XML-RPC server's reader: roscpp's base64 puts a NUL into 3 of 54 requests (ros_comm#2160).

Only these modules, rospy_transports.py, tcp_connections.py, topics.py, registration.py and master.py depend on rospy's
internals (1.14, 1.15).
"""
import functools
import threading
import time
import urllib.parse
from typing import Any, Callable, Dict, List

import rospy
import rospy.core
from rospy.impl.registration import RegManager, get_registration_listeners, get_topic_manager
from rospy.impl.transport import ProtocolHandler

from ..budget import Budget
from ..limited_log import logerr, logwarn
from .acceptor import Acceptor
from .connector import ApiResult, Connector
from .master import log_without_master
from .negotiation import OTHER_VERSION_PERIOD, PROTOCOL, Refused, is_other_format
from .rospy_transports import UdpPublisherImpl
from .watch import Watch

LOG_BURST, LOG_PERIOD = 30, 10.0
"""Refusals that are logged at once, and the time until another one is [s]. All are counted, see `refused_requests`."""


class UdprosHandler(ProtocolHandler):
    """Connects the node's topics by UDPROS, as rospy's handler of TCPROS does.

    :param node_handler: rospy's ROSHandler
    :param registration: rospy's RegManager
    """

    def __init__(self, node_handler: Any, registration: Any) -> None:
        self._request_topic = node_handler.requestTopic
        self._log_budget = Budget(LOG_BURST, LOG_PERIOD)
        self.acceptor = Acceptor(lambda: self.watch.settling(), lambda *node: self.watch.moved(*node))
        self.connector = Connector(node_handler._connect_topic)
        self.watch = Watch(self.connector, registration, self.acceptor.review)

    def shutdown(self) -> None:
        """Called by rospy at shutdown."""
        self.connector.stop()
        self.watch.stop()

    def supports(self, protocol: str) -> bool:
        """Called by rospy for each protocol that a subscriber requests."""
        return protocol == PROTOCOL

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
            return 1, 'ready', self.acceptor.accept(topic, protocol).params()
        except Refused as refusal:
            if is_other_format(refusal):        # one line for all topics
                logerr('', refusal, OTHER_VERSION_PERIOD)
            elif self._log_budget.take(time.monotonic()):
                period = OTHER_VERSION_PERIOD if refusal.reason == 'type' else 10
                logwarn('[%s]' % topic, 'a UDPROS subscriber is refused: %s' % refusal, period)
            return 0, str(refusal), []


_install_lock = threading.Lock()
_installed: List[UdprosHandler] = []


def install() -> None:
    """Bind UDPROS to this process's node, once; after rospy.init_node, before any UDPROS topic.

    :raises rospy.exceptions.ROSInitException: before rospy.init_node
    :raises rospy.exceptions.ROSInterruptException: the node is ending already: the master may end it while it starts
    """
    with _install_lock:
        if _installed:
            return
        if not rospy.core.is_initialized():
            raise rospy.exceptions.ROSInitException('call rospy.init_node before using smokebot_udp.udpros')
        registration = next((x for x in get_registration_listeners().listeners if isinstance(x, RegManager)), None)
        if registration is None:    # rospy's shutdown removes it
            raise rospy.exceptions.ROSInterruptException('the node is ending')
        node_handler = registration.handler
        handler = UdprosHandler(node_handler, registration)
        node_handler.protocol_handlers.insert(0, handler)
        node_handler.requestTopic = handler.request_topic
        node_handler._connect_topic = handler.connector.connect_topic
        node_handler.publisherUpdate = functools.partial(
            _publisher_update, node_handler.publisherUpdate, handler.watch)
        registration.publisher_update = handler.watch.publisher_update
        _remove_nuls(node_handler)
        log_without_master()
        handler.watch.start()
        _installed.append(handler)


def refused_requests() -> Dict[str, int]:
    """{reason: requests for a UDPROS connection that this node's publishers refused}"""
    return dict(_installed[0].acceptor.refused) if _installed else {}


def drop_publisher(topic: str, node: str) -> None:
    """End the connection of a rospy.Subscriber to a node, and do not connect to it again.

    :param topic: resolved
    :param node: the publisher's name
    """
    if _installed:
        _installed[0].watch.drop(topic, node)


def _publisher_update(original: Callable[..., ApiResult], watch: Watch, caller_id: str, topic: Any,
                      publishers: Any) -> ApiResult:
    """ROSHandler.publisherUpdate; rospy's own ignores an empty list."""
    if not _are_uris(publishers):
        return original(caller_id, topic, publishers)       # refuses
    result = original(caller_id, topic, [])                 # checks the names only
    if result[0] == 1:
        watch.notified(topic, publishers)
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
