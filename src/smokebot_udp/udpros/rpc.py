# SPDX-License-Identifier: BSD-3-Clause
"""XML-RPC to nodes and to the master over a bad link.

If the first packet of a TCP connection is lost, TCP retries after 1 s, then 2 s, then 4 s (RFC 6298). With 20 % loss in
each direction this happens to every third connection; of the dozen that a node opens at start-up one or two wait for
3 s. Therefore an attempt to connect that gets no answer is soon raced by another (as in RFC 8305, "Happy Eyeballs",
between addresses).
"""
import collections
import contextlib
import errno
import http.client
import math
import os
import selectors
import socket
import time
import xmlrpc.client
from typing import Any, Iterable, Optional, Tuple
from xml.parsers.expat import ExpatError

import rospy.names

from .endpoints import Address
from .negotiation import Refused

RPC_TIMEOUT = 5.0
"""How long a publisher or the master may take to answer [s]."""

MAX_ANSWER = 4 << 20
"""Bytes of an answer that are read at most."""

RACE_DELAY, MAX_RACE_DELAY = 0.3, 5.0
"""Time from the first to the second attempt to connect; it doubles from one attempt to the next, up to the maximum
[s]."""

TCP_THIN_LINEAR_TIMEOUTS = 16
"""linux/tcp.h: with little data in flight, retransmission timeouts do not double."""


class Unreachable(Exception):
    """The other side of an XML-RPC call does not answer, or not in XML-RPC."""


class _Race(contextlib.ExitStack):
    """Attempts to connect to one of several addresses; leaving the context closes all of them but the winner.

    :param addresses: as socket.getaddrinfo returns them
    """

    def __init__(self, addresses: Iterable[Tuple[Any, ...]]) -> None:
        super().__init__()
        self.addresses = collections.deque(addresses)
        """Those that have not refused."""
        self.error = 0
        """The error number of the last attempt that failed."""
        self._selector = self.enter_context(selectors.DefaultSelector())

    def attempt(self) -> None:
        """Begin to connect to the next address in turn."""
        address = self.addresses[0]
        self.addresses.rotate(-1)
        family, kind, protocol, _, place = address
        attempt = self.enter_context(socket.socket(family, kind, protocol))
        attempt.setblocking(False)
        error = attempt.connect_ex(place)
        if error in (0, errno.EINPROGRESS):
            self._selector.register(attempt, selectors.EVENT_WRITE, address)
        else:
            self._fail(address, error)

    def wait(self, until: float) -> Optional[socket.socket]:
        """The first socket that connects; None if none does until a time.monotonic(), or all attempts have failed."""
        now = time.monotonic()
        while self._selector.get_map() and now < until:
            for key, _ in self._selector.select(until - now):
                attempt: Any = key.fileobj
                self._selector.unregister(attempt)
                error = attempt.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
                if not error:
                    return socket.socket(fileno=attempt.detach())
                self._fail(key.data, error)
            now = time.monotonic()
        return None

    def _fail(self, address: Tuple[Any, ...], error: int) -> None:
        self.error = error
        if address in self.addresses:
            self.addresses.remove(address)


def create_connection(address: Address, timeout: Any = None, *_: Any, **__: Any) -> socket.socket:
    """A replacement of socket.create_connection: makes several attempts and returns the first that succeeds.

    :param address: host and port
    :param timeout: for all attempts together, and then the socket's own [s]; None or not a number: socket's default
    :raises OSError: if all addresses of the host refuse the connection; socket.timeout if one does not answer
    """
    if not isinstance(timeout, (int, float)):
        timeout = socket.getdefaulttimeout()
    with _Race(socket.getaddrinfo(*address, type=socket.SOCK_STREAM)) as race:
        now, delay = time.monotonic(), RACE_DELAY
        deadline = now + (math.inf if timeout is None else timeout)
        while race.addresses and now < deadline:
            race.attempt()
            connected = race.wait(min(now + delay, deadline))
            if connected is not None:
                connected.settimeout(timeout)
                connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with contextlib.suppress(OSError):      # not on every kernel
                    connected.setsockopt(socket.IPPROTO_TCP, TCP_THIN_LINEAR_TIMEOUTS, 1)
                return connected
            now, delay = time.monotonic(), min(2 * delay, MAX_RACE_DELAY)
        if race.addresses:
            raise socket.timeout('no answer in %g s' % timeout)
        raise OSError(race.error, os.strerror(race.error))


def race_all_connections() -> None:
    """Make all XML-RPC of this process, including rospy's own, connect by `create_connection`.

    For a node's main, before rospy.init_node.
    """
    socket.create_connection = create_connection  # type: ignore[assignment]


class _Connection(http.client.HTTPConnection):
    def connect(self) -> None:
        self.sock = create_connection((self.host, self.port), self.timeout)


class Transport(xmlrpc.client.Transport):
    """The client side of XML-RPC, with a timeout and a limit of the answer's size, tolerant of roscpp's NULs.

    roscpp's base64 puts NUL bytes into some answers (ros_comm#2160), which are removed.

    :param timeout: to connect and for each read [s]
    """
    accept_gzip_encoding = False   # parse_response reads the answer as it is

    def __init__(self, timeout: float = RPC_TIMEOUT) -> None:
        super().__init__()
        self._timeout = timeout

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        """As xmlrpc.client.Transport's."""
        if not self._connection or self._connection[0] != host:
            self._connection = host, _Connection(host, timeout=self._timeout)
        connection = self._connection[1]
        assert connection is not None
        return connection

    def parse_response(self, response: http.client.HTTPResponse) -> Any:
        """As xmlrpc.client.Transport's."""
        parser, unmarshaller = self.getparser()
        parser.feed(response.read(MAX_ANSWER).replace(b'\0', b''))
        parser.close()
        return unmarshaller.close()


class MasterTransport(Transport):
    """For long lists to and from the master, which is written in Python and supports gzip: one packet instead of ten.
    """
    accept_gzip_encoding = True
    encode_threshold = 1000     # [byte]
    parse_response = xmlrpc.client.Transport.parse_response


FAILURES = (OSError, http.client.HTTPException, xmlrpc.client.Error, ExpatError, TypeError, ValueError)
"""What a call raises that gets no correct answer."""


class Session:
    """Calls of one server over a TCP connection that is kept open, from one thread.

    :param uri: of the XML-RPC server
    """

    def __init__(self, uri: str) -> None:
        self.connections = 0
        """How many connections have been made until now."""
        self._transport = Transport()
        self._proxy = xmlrpc.client.ServerProxy(uri, transport=self._transport)
        self._socket: Any = None

    def call(self, method: str, *args: Any) -> Tuple[int, str, Any]:
        """The answer of the API of a node or the master: status code (1: success), message and value.

        :param args: the method's, without the caller's name
        :raises Unreachable: if there is no correct answer
        """
        try:
            answer: Any = getattr(self._proxy, method)(rospy.names.get_caller_id(), *args)
            code, message, value = answer
        except FAILURES as error:
            self._transport.close()
            raise Unreachable('%s: %s' % (method, error)) from error
        connection: Any = self._transport._connection[1]
        if connection.sock is None or connection.sock is not self._socket:
            self._socket = connection.sock
            self.connections += 1
        return code, message, value


def call(uri: str, method: str, *args: Any) -> Any:
    """Call the API of a node or the master; returns the value.

    :param uri: of the XML-RPC server
    :param args: the method's, without the caller's name
    :raises Unreachable: if there is no correct answer
    :raises Refused: if the answer is an error
    """
    try:
        with xmlrpc.client.ServerProxy(uri, transport=Transport()) as proxy:
            code, message, value = getattr(proxy, method)(rospy.names.get_caller_id(), *args)
    except FAILURES as error:
        raise Unreachable('%s: %s' % (method, error)) from error
    if code != 1:
        raise Refused('%s: %s' % (method, message))
    return value
