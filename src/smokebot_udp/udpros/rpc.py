# SPDX-License-Identifier: BSD-3-Clause
"""XML-RPC to nodes and the master over a bad link.

A TCP connection whose first packet is lost waits a second for the next, then two, then four (RFC 6298). With 20 % of
loss each way that befalls every third, and of the dozen that a node opens at once one or two wait for 3 s. So one that
does not come to be is raced by another soon (as in RFC 8305, "Happy Eyeballs", between addresses).
"""
import contextlib
import errno
import http.client
import math
import os
import selectors
import socket
import time
import xmlrpc.client
from xml.parsers.expat import ExpatError

import rospy.names

from .negotiation import Refused

RPC_TIMEOUT = 5.0
"""How long a publisher or the master may take to answer [s]."""

MAX_ANSWER = 4 << 20
"""More of an answer is not read [byte]."""

RACE_FIRST, RACE_MOST = 0.3, 5.0
"""The second attempt to connect begins so long after the first; each pause is twice the one before, at most so long
[s]."""


TCP_THIN_LINEAR_TIMEOUTS = 16
"""Of Linux' tcp.h: what little is lost again and again is sent again each time as soon, not each time twice as late."""


class Unreachable(Exception):
    """The other side of an XML-RPC call does not answer, or not in XML-RPC."""


def create_connection(address, timeout=None, *_, **__):
    """Stands in for socket.create_connection: that of several attempts which comes first.

    :param address: (host, port)
    :param timeout: for all of them together, and then the socket's own [s]; None or no number: socket's default
    :return: socket.socket
    :raises OSError: where all addresses of the host refuse it; socket.timeout where one does not answer
    """
    if not isinstance(timeout, (int, float)):
        timeout = socket.getdefaulttimeout()
    ways = socket.getaddrinfo(*address, type=socket.SOCK_STREAM)
    now = time.monotonic()
    pause, deadline = RACE_FIRST, now + (math.inf if timeout is None else timeout)
    with contextlib.ExitStack() as attempts, selectors.DefaultSelector() as selector:
        turn = 0
        while True:
            family, kind, protocol, _, place = way = ways[turn % len(ways)]
            attempt = attempts.enter_context(socket.socket(family, kind, protocol))
            attempt.setblocking(False)
            error = attempt.connect_ex(place)
            if error in (0, errno.EINPROGRESS):
                selector.register(attempt, selectors.EVENT_WRITE, way)
            else:
                ways.remove(way)
            until, pause = min(now + pause, deadline), min(2 * pause, RACE_MOST)
            while selector.get_map() and now < until:
                for key, _ in selector.select(until - now):
                    selector.unregister(key.fileobj)
                    error = key.fileobj.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
                    if not error:
                        return _taken(key.fileobj, timeout)
                    if key.data in ways:
                        ways.remove(key.data)
                now = time.monotonic()
            turn += 1
            if not ways:
                raise OSError(error, os.strerror(error))
            if now >= deadline:
                raise socket.timeout('no answer in %g s' % timeout)


def _taken(attempt, timeout):
    """The attempt's connection, which is not closed with all others."""
    connected = socket.socket(fileno=attempt.detach())
    connected.settimeout(timeout)
    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    with contextlib.suppress(OSError):      # not on every kernel
        connected.setsockopt(socket.IPPROTO_TCP, TCP_THIN_LINEAR_TIMEOUTS, 1)
    return connected


def race_all_connections():
    """Let all of this process' XML-RPC, rospy's own too, connect so; for a node's main, before rospy.init_node."""
    socket.create_connection = create_connection


class _Connection(http.client.HTTPConnection):
    def connect(self):
        self.sock = create_connection((self.host, self.port), self.timeout)


class Transport(xmlrpc.client.Transport):
    """XML-RPC's client side that overlooks roscpp's NULs (ros_comm#2160), and neither waits nor reads for ever.

    :param timeout: [s]
    """
    accept_gzip_encoding = False   # parse_response reads what was sent

    def __init__(self, timeout=RPC_TIMEOUT):
        super().__init__()
        self._timeout = timeout

    def make_connection(self, host):
        if not self._connection or self._connection[0] != host:
            self._connection = host, _Connection(host, timeout=self._timeout)
        return self._connection[1]

    def parse_response(self, response):
        parser, unmarshaller = self.getparser()
        parser.feed(response.read(MAX_ANSWER).replace(b'\0', b''))
        parser.close()
        return unmarshaller.close()


class MasterTransport(Transport):
    """For long lists: the master, which is Python's, takes and gives gzip, so that they are one packet and not ten."""
    accept_gzip_encoding = True
    encode_threshold = 1000     # [byte]
    parse_response = xmlrpc.client.Transport.parse_response


def call(uri, method, *args):
    """Call a node's or the master's API; returns the value. Raises Unreachable, or Refused where it says no."""
    try:
        with xmlrpc.client.ServerProxy(uri, transport=Transport()) as proxy:
            code, message, value = getattr(proxy, method)(rospy.names.get_caller_id(), *args)
    except (OSError, http.client.HTTPException, xmlrpc.client.Error, ExpatError, TypeError, ValueError) as error:
        raise Unreachable('%s: %s' % (method, error)) from error
    if code != 1:
        raise Refused('%s: %s' % (method, message))
    return value
