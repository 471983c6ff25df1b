# SPDX-License-Identifier: BSD-3-Clause
"""What subscriber and publisher say to each other over XML-RPC before the first datagram.

The subscriber calls ``requestTopic`` with one element a protocol; UDPROS's is
``['UDPROS', header, host, port, max_datagram_size]``, where host and port are the subscriber's own. The
publisher answers ``['UDPROS', host, port, connection_id, max_datagram_size, header]``. Headers are TCPROS's
connection headers without their overall length, as XML-RPC base64 (bytes, or xmlrpc.client.Binary).

Source: ros_comm, clients/roscpp, subscription.cpp (negotiateConnection) and topic_manager.cpp
(requestTopic). Whatever comes from the other side is checked here: `Refused` tells what is wrong.
"""
import reprlib
from dataclasses import dataclass, field
from typing import Dict

from .datagram import DEFAULT_MAX_DATAGRAM_SIZE, LENGTH, MIN_MAX_DATAGRAM_SIZE, UDP_MAX_PAYLOAD

PROTOCOL = 'UDPROS'
MAX_HEADER_SIZE = 1 << 20
"""A longer connection header is refused; the longest message definitions take some 10 kB [byte]."""

MAX_NAME_SIZE = 253
"""No host's name is longer (RFC 1035)."""


class Refused(ValueError):
    """The peer's request or answer cannot be taken; the text is fit for the peer's eyes."""


def encode_header(fields):
    """``{str: str}`` to bytes: for each pair u32 length and ``key=value``, keys sorted."""
    lines = [('%s=%s' % pair).encode() for pair in sorted(fields.items())]
    return b''.join(LENGTH.pack(len(line)) + line for line in lines)


def decode_header(data):
    """The inverse of `encode_header`; raises Refused."""
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
    port: int
    header: Dict[str, str]
    """topic, md5sum, callerid and type; md5sum '*' takes any type."""
    max_datagram_size: int = DEFAULT_MAX_DATAGRAM_SIZE
    """The longest datagram the subscriber takes, its 8 bytes of header included [byte of UDP payload]."""

    def params(self):
        return [PROTOCOL, encode_header(self.header), self.host, self.port, self.max_datagram_size]

    @classmethod
    def parse(cls, params):
        """Check a request as it came over XML-RPC; raises Refused."""
        _, header, host, port, size = _elements(params, 5, 'request')
        header = _header(header, ('topic', 'md5sum', 'callerid'))
        return cls(_text(host, 'host'), _whole(port, 'port', 1, 65535), header, _datagram_size(size))


@dataclass
class Reply:
    """A publisher's answer: from now on the topic comes in datagrams of this connection id."""
    host: str
    port: int
    connection_id: int
    max_datagram_size: int
    header: Dict[str, str] = field(default_factory=dict)
    """md5sum and type at least."""

    def params(self):
        return [PROTOCOL, self.host, self.port, self.connection_id, self.max_datagram_size,
                encode_header(self.header)]

    @classmethod
    def parse(cls, params):
        """Check an answer as it came over XML-RPC; raises Refused."""
        _, host, port, connection_id, size, header = _elements(params, 6, 'answer')
        header = decode_header(header) if _is_header(header) else None
        if header is None or 'error' in header:
            raise Refused('the publisher answers: %.500s' % (header or {'error': 'no connection header'})['error'])
        header = _require(header, ('md5sum', 'type'))
        return cls(_text(host, 'host'), _whole(port, 'port', 0, 65535),
                   _whole(connection_id, 'connection id', 0, 0x7fffffff), _datagram_size(size), header)


def _elements(params, count, what):
    if not isinstance(params, (list, tuple)) or len(params) != count or params[0] != PROTOCOL:
        raise Refused('a UDPROS %s has %d elements and begins with "UDPROS", not %s' % (
            what, count, reprlib.repr(params)))
    return params


def _is_header(value):
    return isinstance(value, (bytes, bytearray, str)) or isinstance(getattr(value, 'data', None), (bytes, bytearray))


def _header(value, required):
    if not _is_header(value):
        raise Refused('the connection header is no base64 but %s' % reprlib.repr(value))
    return _require(decode_header(value), required)


def _require(header, names):
    for name in names:
        if not header.get(name):
            raise Refused('the connection header lacks "%s"' % name)
    return header


def _text(value, name):
    if not isinstance(value, str) or not 0 < len(value) <= MAX_NAME_SIZE or not value.isprintable():
        raise Refused('%s is %s, no name' % (name, reprlib.repr(value)))
    return value


def _whole(value, name, least, most):
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        raise Refused('%s is %s, not a whole number from %d to %d' % (name, reprlib.repr(value), least, most))
    return value


def _datagram_size(value):
    return _whole(value, 'max_datagram_size', MIN_MAX_DATAGRAM_SIZE, UDP_MAX_PAYLOAD)
