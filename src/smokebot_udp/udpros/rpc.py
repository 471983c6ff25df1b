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
import select
import selectors
import socket
import time
import xmlrpc.client
import zlib
from typing import Any, Callable, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple, TypeVar
from xml.parsers.expat import ExpatError

import rospy
import rospy.names

from ..backoff import Backoff
from .endpoints import Address, is_own
from .negotiation import Refused

RPC_TIMEOUT = 4.0
"""How long a publisher or the master may take to answer [s]."""

MAX_ANSWER = 4 << 20
"""Bytes of an answer that are read at most."""

RACE_DELAY, MAX_RACE_DELAY = 0.3, 5.0
"""Time from the first to the second attempt to connect; it doubles from one attempt to the next, up to the maximum
[s]."""

KEEPALIVE_IDLE, KEEPALIVE_PERIOD, KEEPALIVE_COUNT = 2, 1, 30
"""The kernel probes an idle connection that is kept open, with a packet of 52 bytes: after this time, then at this
interval [s], and gives it up after so many without an answer. A machine that has been restarted answers that it does
not know the connection."""

MAX_SEGMENT = 1160
"""In both directions: packets of 1200 bytes pass nearly everywhere. Where a path drops longer ones without a word, a
call with a long answer would never end [byte]."""

TCP_THIN_LINEAR_TIMEOUTS = 16
"""linux/tcp.h: with little data in flight, retransmission timeouts do not double."""


class Unreachable(Exception):
    """The other side of an XML-RPC call does not answer, or not in XML-RPC."""


class Gone(Unreachable):
    """Its machine says that nobody listens: a node keeps its port as long as it lives, so it has ended."""


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
        attempt.setsockopt(socket.IPPROTO_TCP, socket.TCP_MAXSEG, MAX_SEGMENT)
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
        now, delays = time.monotonic(), Backoff(RACE_DELAY, MAX_RACE_DELAY)
        deadline = now + (math.inf if timeout is None else timeout)
        while race.addresses and now < deadline:
            race.attempt()
            connected = race.wait(min(now + delays.take(), deadline))
            if connected is not None:
                connected.settimeout(timeout)
                connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with contextlib.suppress(OSError):      # not on every kernel
                    connected.setsockopt(socket.IPPROTO_TCP, TCP_THIN_LINEAR_TIMEOUTS, 1)
                return connected
            now = time.monotonic()
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

    roscpp's base64 puts NUL bytes into some answers (ros_comm#2160), which are removed. Servers written in Python
    compress long answers: one packet instead of ten.

    :param timeout: to connect and for each read [s]
    """
    accept_gzip_encoding = True

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
        data = response.read(MAX_ANSWER)
        if response.getheader('Content-Encoding', '') == 'gzip':
            data = zlib.decompressobj(16 + zlib.MAX_WBITS).decompress(data, MAX_ANSWER)
        parser.feed(data.replace(b'\0', b''))
        parser.close()
        return unmarshaller.close()


class MasterTransport(Transport):
    """For the master, which is written in Python: long requests are compressed, too."""
    encode_threshold = 1000     # [byte]


RETRY_PERIOD, MAX_RETRY_PERIOD = 0.2, 2.0
"""Shortest and longest time from one attempt to the next, until a call is answered [s]."""

Value = TypeVar('Value')

FAILURES = (OSError, http.client.HTTPException, xmlrpc.client.Error, ExpatError, TypeError, ValueError, zlib.error)
"""What a call raises that gets no correct answer."""

TRANSIENT = (OSError, http.client.HTTPException, ExpatError, xmlrpc.client.ProtocolError)
"""What rospy's own calls of the master raise when it is away, or ends, or the link does."""


class Session:
    """Calls of the master, or another server in Python, over a TCP connection that is kept open, from one thread.

    :param uri: of the XML-RPC server
    :param timeout: to connect and for each read [s]
    """

    def __init__(self, uri: str, timeout: float = RPC_TIMEOUT) -> None:
        self.connections = 0
        """How many connections have been made until now."""
        self.own_address: Optional[str] = None
        """This machine's address towards the server, by the newest connection; None: there was none yet."""
        self._transport = MasterTransport(timeout)
        self._proxy = xmlrpc.client.ServerProxy(uri, transport=self._transport)
        self._socket: Any = None

    @property
    def alive(self) -> bool:
        """Whether the connection is open, as far as the kernel knows; nothing is sent."""
        if self._socket is None:
            return False
        try:    # its end can be read; without our address nothing comes any more
            return not select.select([self._socket], [], [], 0)[0] and is_own(self._socket.getsockname()[0])
        except (OSError, ValueError):       # ValueError: it is closed
            return False

    def call(self, method: str, *args: Any) -> Tuple[int, str, Any]:
        """The answer of the API of a node or the master: status code (1: success), message and value.

        :param args: the method's, without the caller's name
        :raises Unreachable: if there is no correct answer
        """
        code, message, value = self._request(method, rospy.names.get_caller_id(), *args)
        return code, message, value

    def call_all(self, calls: Sequence[Dict[str, Any]]) -> List[Any]:
        """The value that each of some calls returns, None where it fails; all are made in one.

        :param calls: {methodName, params} each
        :raises Unreachable: if there is no correct answer
        """
        answers = self._request('system.multicall', calls)
        if not isinstance(answers, list) or len(answers) != len(calls):
            raise Unreachable('system.multicall: not %d answers' % len(calls))
        try:    # an answer is in a list of one; a fault is a dictionary
            return [answer[0][2] if isinstance(answer, list) and answer[0][0] == 1 else None for answer in answers]
        except (TypeError, IndexError, KeyError) as error:
            raise Unreachable('system.multicall: %s' % error) from error

    def _request(self, method: str, *args: Any) -> Any:
        try:
            answer: Any = getattr(self._proxy, method)(*args)
        except FAILURES as error:
            self.close()
            raise Unreachable('%s: %s' % (method, error)) from error
        connection: Any = self._transport._connection[1]
        if connection.sock is None or connection.sock is not self._socket:
            self._socket = connection.sock
            self.connections += 1
            if self._socket is not None:
                _keep_alive(self._socket)
                self.own_address = self._socket.getsockname()[0]
        return answer

    def close(self) -> None:
        """End the connection; the next call makes another one."""
        self._transport.close()
        self._socket = None


def _keep_alive(connected: socket.socket) -> None:
    """Let the kernel find out whether the other machine still knows a connection."""
    connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in ((socket.TCP_KEEPIDLE, KEEPALIVE_IDLE), (socket.TCP_KEEPINTVL, KEEPALIVE_PERIOD),
                          (socket.TCP_KEEPCNT, KEEPALIVE_COUNT)):
        connected.setsockopt(socket.IPPROTO_TCP, option, value)


Call = Tuple[str, Tuple[Any, ...]]
"""A method, and its arguments without the caller's name."""


def call(uri: str, method: str, *args: Any, timeout: float = RPC_TIMEOUT) -> Any:
    """Call the API of a node or the master; returns the value.

    :param uri: of the XML-RPC server
    :param args: the method's, without the caller's name
    :param timeout: to connect and for each read [s]
    :raises Unreachable: if there is no correct answer; Gone: if the node has ended
    :raises Refused: if the answer is an error
    """
    with _failures(method), _proxy(uri, timeout) as proxy:
        answer = getattr(proxy, method)(rospy.names.get_caller_id(), *args)
    return _value(method, answer)


def call_together(uri: str, calls: Sequence[Call], timeout: float = RPC_TIMEOUT) -> List[Any]:
    """Make some calls of a node's API in one (system.multicall), or one by one where it does not know that.

    :param timeout: to connect and for each read [s]
    :return: for each its value, or what `call` would raise
    :raises Unreachable: if there is no correct answer; Gone: if the node has ended
    """
    if len(calls) == 1:
        return [_outcome(uri, calls[0], timeout)]
    caller = rospy.names.get_caller_id()
    try:
        with _failures('system.multicall', but=xmlrpc.client.Fault), _proxy(uri, timeout) as proxy:
            answers: Any = proxy.system.multicall([
                {'methodName': method, 'params': [caller, *args]} for method, args in calls])
    except xmlrpc.client.Fault:
        return [_outcome(uri, one, timeout) for one in calls]
    if not isinstance(answers, list) or len(answers) != len(calls):
        raise Unreachable('system.multicall: not %d answers' % len(calls))
    return [_of_many(method, answer) for (method, _), answer in zip(calls, answers)]


@contextlib.contextmanager
def _failures(method: str, but: Any = ()) -> Iterator[None]:
    """Raise what is no correct answer as Unreachable or Gone.

    :param but: exceptions that are left as they are
    """
    try:
        yield
    except but:
        raise
    except ConnectionRefusedError as error:
        raise Gone('%s: %s' % (method, error)) from error
    except FAILURES as error:
        raise Unreachable('%s: %s' % (method, error)) from error


def _proxy(uri: str, timeout: float) -> xmlrpc.client.ServerProxy:
    return xmlrpc.client.ServerProxy(uri, transport=Transport(timeout))


def _value(method: str, answer: Any) -> Any:
    """The value in an answer of the API."""
    if not isinstance(answer, (list, tuple)) or len(answer) != 3:
        raise Unreachable('%s: the answer is not of three elements' % method)
    code, message, value = answer
    if code != 1:
        raise Refused('%s: %s' % (method, message))
    return value


def _outcome(uri: str, one: Call, timeout: float) -> Any:
    """The value of a call, or what it raises."""
    method, args = one
    try:
        return call(uri, method, *args, timeout=timeout)
    except (Unreachable, Refused) as error:
        return error


def _of_many(method: str, answer: Any) -> Any:
    """The value of an answer to one of many calls, or what `call` would raise: it is in a list of one; a fault is a
    dictionary."""
    try:
        if not isinstance(answer, list) or len(answer) != 1:
            raise Unreachable('%s: %.100r' % (method, answer))
        return _value(method, answer[0])
    except (Unreachable, Refused) as error:
        return error


def call_all(uri: str, calls: Sequence[Dict[str, Any]], timeout: float) -> List[Any]:
    """As Session.call_all, over a connection of its own.

    :raises Unreachable: if there is no correct answer
    """
    session = Session(uri, timeout)
    try:
        return session.call_all(calls)
    finally:
        session.close()


def repeated(call: Callable[[], Value], warn: Callable[..., None] = rospy.logwarn) -> Value:
    """The result of a call that rospy makes of the master, repeated until the master answers.

    :param call: f()
    :param warn: called with a text and its arguments, once
    :raises Exception: what it raises otherwise, or while the node is shutting down
    """
    pauses = Backoff(RETRY_PERIOD, MAX_RETRY_PERIOD)
    while True:
        try:
            return call()
        except TRANSIENT as error:
            if rospy.core.is_shutdown_requested():      # rospy.is_shutdown is false until the node has unregistered
                raise
            if pauses.interval == RETRY_PERIOD:
                warn('the master does not answer, it is asked again: %r', error)
        time.sleep(pauses.take())
