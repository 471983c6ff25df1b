# SPDX-License-Identifier: BSD-3-Clause
"""The negotiation of a UDPROS connection over XML-RPC, before the first datagram.

The subscriber calls ``requestTopic`` with one list per protocol it offers. UDPROS's is
``['UDPROS', header, host, port, max_datagram_size]``, with the subscriber's own host and port. The publisher answers
``['UDPROS', host, port, connection_id, max_datagram_size, header]``. Headers are TCPROS's connection headers without
their overall length, as XML-RPC base64 (bytes, or xmlrpc.client.Binary).

Source: ros_comm, clients/roscpp, subscription.cpp (negotiateConnection) and topic_manager.cpp (requestTopic). All that
the peer sends is checked here; `Refused` says what is wrong.
"""
import reprlib
from dataclasses import dataclass, field
from typing import Any, Dict, List, Mapping, Sequence, Tuple

from ..backoff import Backoff
from ..version import CANNOT_TALK, FORMAT_FIELD, Software, difference, from_headers
from .datagram import DEFAULT_MAX_DATAGRAM_SIZE, LENGTH, MIN_MAX_DATAGRAM_SIZE, UDP_MAX_PAYLOAD

PROTOCOL = 'UDPROS'
MAX_HEADER_SIZE = 1 << 20
"""A longer connection header is refused; the longest message definitions take about 10 kB [byte]."""

MAX_NAME_SIZE = 253
"""The longest host name (RFC 1035)."""


FALLBACK_PERIOD, MAX_FALLBACK_PERIOD = 3.0, 60.0
"""Time until a publisher that refused UDPROS is asked for it again; it doubles up to the maximum [s]."""


OTHER_TYPE = ' with md5sum '
"""By which a subscriber recognises the refusal in the publisher's text."""

NO_PUBLISHER = 'not a publisher of ['
"""By which a subscriber recognises the refusal of a node which has unregistered the topic; in lower case."""

OTHER_VERSION_PERIOD = 3600
"""A refusal of another type or wire format is logged again only after this time: it lasts until somebody updates a
machine [s]."""

UNNAMED = Software(2)
"""What publishers run that name no wire format: releases before it had a field."""


class Refused(ValueError):
    """The peer's request or answer is not acceptable; the text is sent to the peer.

    :param reason: in a few words, by which refusals are counted
    """

    def __init__(self, text: str, reason: str = 'malformed') -> None:
        super().__init__(text)
        self.reason = reason


def other_type(topic: str, type_: str, md5sum: str, wanted: str) -> Refused:
    """The refusal where publisher and subscriber have different types, or versions of one.

    :param type_, md5sum: of the publisher
    :param wanted: md5sum of the subscriber
    """
    return Refused('[%s] is of type %s%s%s, not %s' % (topic, type_, OTHER_TYPE, md5sum, wanted), 'type')


def is_other_version(refusal: Exception) -> bool:
    """Whether a peer's refusal is one of `other_type` or of another wire format: no other transport would do."""
    return OTHER_TYPE in str(refusal) or is_other_format(refusal)


def is_other_format(refusal: Exception) -> bool:
    """Whether a refusal is one of `check_formats`: it is the same for all topics of the two nodes."""
    return CANNOT_TALK in str(refusal)


def has_unregistered(refusal: Exception) -> bool:
    """Whether a publisher, of this package or of rospy, refuses since it no longer is one, as a node that ends. The
    master says so next."""
    return NO_PUBLISHER in str(refusal).lower()


def check_formats(publisher: Mapping[str, str], subscriber: Mapping[str, str]) -> None:
    """Check that both nodes mean the same by the same bytes, where both are of this package.

    A publisher that names no wire format is of a release before it had a field, if the subscriber names one. A
    subscriber that names none may be any program, such as rostopic.

    :param publisher, subscriber: connection headers
    :raises Refused: they do not
    """
    if FORMAT_FIELD not in subscriber:
        return
    sends = from_headers(publisher) if FORMAT_FIELD in publisher else UNNAMED
    receives = from_headers(subscriber)
    if sends.wire_format != receives.wire_format:
        names = (header.get('callerid', 'a node')[:MAX_NAME_SIZE] for header in (publisher, subscriber))
        raise Refused(difference(next(names), sends, next(names), receives), 'wire format')


class Fallbacks:
    """When to ask the publishers again for UDPROS that refused it, and are connected by TCPROS instead.

    The reason may have been transient: a name that was not resolved, no free file descriptor, no route for a moment.
    """

    def __init__(self) -> None:
        self._due: Dict[str, Tuple[float, Backoff]] = {}    # {publisher: (when [s], the further pauses)}

    def refused(self, publisher: str, now: float) -> bool:
        """Note a refusal; returns whether it is the first one."""
        first = publisher not in self._due
        pauses = Backoff(FALLBACK_PERIOD, MAX_FALLBACK_PERIOD) if first else self._due[publisher][1]
        self._due[publisher] = now + pauses.take(), pauses
        return first

    def forget(self, publisher: str) -> None:
        """The publisher is connected by UDPROS, or no longer at all."""
        self._due.pop(publisher, None)

    def due(self, now: float) -> List[str]:
        """The publishers to ask now."""
        return [publisher for publisher, (when, _) in list(self._due.items()) if now >= when]


def encode_header(fields: Mapping[str, str]) -> bytes:
    """For each field, sorted by key, a u32 length and ``key=value``."""
    lines = [('%s=%s' % pair).encode() for pair in sorted(fields.items())]
    return b''.join(LENGTH.pack(len(line)) + line for line in lines)


def decode_header(data: Any) -> Dict[str, str]:
    """The inverse of `encode_header`.

    :param data: bytes-like, xmlrpc.client.Binary, or str, which is taken as latin-1
    :raises Refused: if the header is malformed or longer than MAX_HEADER_SIZE
    """
    data = bytes(getattr(data, 'data', data)) if not isinstance(data, str) else data.encode('latin-1', 'replace')
    if len(data) > MAX_HEADER_SIZE:
        raise Refused('a connection header of %d bytes is too long' % len(data))
    fields, at = {}, 0
    while at < len(data):
        if at + LENGTH.size > len(data):
            raise Refused('the connection header ends within a length')
        start, at = at + LENGTH.size, at + LENGTH.size + LENGTH.unpack_from(data, at)[0]
        if at > len(data):
            raise Refused('the connection header ends within a field')
        key, equals, value = data[start:at].decode('utf-8', 'replace').partition('=')
        if not equals:
            raise Refused('the connection header has a field without "=": %.40r' % key)
        fields[key.strip()] = value
    return fields


@dataclass
class Request:
    """A subscriber's offer to receive one topic by UDPROS."""
    host: str
    """The subscriber's host name or address."""
    port: int
    """The subscriber's UDP port."""
    header: Dict[str, str]
    """Fields topic, md5sum, callerid and type. The md5sum '*' accepts any type."""
    max_datagram_size: int = DEFAULT_MAX_DATAGRAM_SIZE
    """The longest datagram that the subscriber accepts, including its header of 8 bytes [byte of UDP payload]."""

    def params(self) -> List[Any]:
        """The request as XML-RPC carries it."""
        return [PROTOCOL, encode_header(self.header), self.host, self.port, self.max_datagram_size]

    @classmethod
    def parse(cls, params: Any) -> 'Request':
        """Check a request as received over XML-RPC.

        :raises Refused: if it is not a correct one
        """
        _, header, host, port, size = _elements(params, 5, 'request')
        if not _is_header(header):
            raise Refused('the connection header is not base64 but %s' % reprlib.repr(header))
        fields = _require(decode_header(header), ('topic', 'md5sum', 'callerid'))
        return cls(_host(host), _whole(port, 'port', 1, 65535), fields, _datagram_size(size))


@dataclass
class Reply:
    """A publisher's answer: it sends the topic in datagrams of this connection id."""
    host: str
    """The publisher's host name or address."""
    port: int
    """The UDP port that it sends from; roscpp names another one."""
    connection_id: int
    """Unique per publisher, 0 .. 2^31 - 1."""
    max_datagram_size: int
    """The longest datagram that it sends [byte of UDP payload]."""
    header: Dict[str, str] = field(default_factory=dict)
    """md5sum and type at least."""

    def params(self) -> List[Any]:
        """The answer as XML-RPC carries it."""
        return [PROTOCOL, self.host, self.port, self.connection_id, self.max_datagram_size,
                encode_header(self.header)]

    @classmethod
    def parse(cls, params: Any) -> 'Reply':
        """Check an answer as received over XML-RPC.

        :raises Refused: if it is not a correct one, or its header holds an error
        """
        _, host, port, connection_id, size, header = _elements(params, 6, 'answer')
        fields = decode_header(header) if _is_header(header) else {'error': 'no connection header'}
        if 'error' in fields:
            raise Refused('the publisher answers: %.500s' % fields['error'])
        _require(fields, ('md5sum', 'type'))
        return cls(_host(host), _whole(port, 'port', 0, 65535),
                   _whole(connection_id, 'connection id', 0, 0x7fffffff), _datagram_size(size), fields)


def _elements(params: Any, count: int, what: str) -> Sequence[Any]:
    if not isinstance(params, (list, tuple)) or len(params) != count or params[0] != PROTOCOL:
        raise Refused('a UDPROS %s has %d elements and begins with "UDPROS", not %s' % (
            what, count, reprlib.repr(params)))
    return params


def _is_header(value: Any) -> bool:
    return isinstance(value, (bytes, bytearray, str)) or isinstance(getattr(value, 'data', None), (bytes, bytearray))


def _require(header: Dict[str, str], names: Sequence[str]) -> Dict[str, str]:
    for name in names:
        if not header.get(name):
            raise Refused('the connection header lacks "%s"' % name)
    return header


def _host(value: Any) -> str:
    if not isinstance(value, str) or not 0 < len(value) <= MAX_NAME_SIZE or not value.isprintable():
        raise Refused('host is %s, not a name' % reprlib.repr(value))
    return value


def _whole(value: Any, name: str, minimum: int, maximum: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not minimum <= value <= maximum:
        raise Refused('%s is %s, not a whole number from %d to %d' % (name, reprlib.repr(value), minimum, maximum))
    return value


def _datagram_size(value: Any) -> int:
    return _whole(value, 'max_datagram_size', MIN_MAX_DATAGRAM_SIZE, UDP_MAX_PAYLOAD)
