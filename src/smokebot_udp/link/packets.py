# SPDX-License-Identifier: BSD-3-Clause
"""The datagrams of a link: bytes to fields and back. Nothing here decides or keeps anything.

All integers are little-endian. The first byte is the kind. Everything but DATA belongs to the handshake, which the
operator begins:

    operator                                robot
    HELLO   nonce                    -->            keeps nothing
                                     <--    COOKIE  a MAC of the operator's address and nonce
    INIT    cookie, Noise message 1  -->            keeps nothing before both are right
                                     <--    ACCEPT  Noise message 2
    DATA    sealed                   -->            the new keys are confirmed
                                     <--    DATA

    HELLO    kind version 0 0      nonce u64, tag 16, release 20
    COOKIE   kind version 0 suite  nonce u64, cookie 16, tag 16
    INIT     kind version 0 suite  nonce u64, cookie 16, sender index u32, tag 16, Noise message 1
    ACCEPT   kind version 0 suite  receiver index u32, Noise message 2
    REFUSE   kind version 0 reason nonce u64, and to who names its release, release 20
    UNKNOWN  kind version 0 0      receiver index u32
    DATA     kind 0 0 0            receiver index u32, counter u64, body, tag 16

* No answer of the robot is longer than what it answers, so that it amplifies nothing (test_packets).
* HELLO's and REFUSE's fields keep their places in all versions, so that each side can name the other's version. That is
  the number of the wire format, of which this protocol is a part (version.py). A release is ASCII, filled up with
  zeros; zeros are of a side that names none.
* Tags are MACs of the packet's other bytes but the release, under the key of the link (tags.py).
* Bytes named 0 are not looked at.
* ACCEPT, UNKNOWN and DATA name a session by the index that their receiver has chosen, as WireGuard's packets do.
* The body of DATA is a UDPROS datagram (udpros.datagram). The 16 bytes in front keep it aligned.
"""
import enum
import struct
from typing import Any, Dict, NamedTuple, Tuple, Type, Union

import numpy as np

from ..arrays import DType
from ..version import MAX_RELEASE, OURS, printable

VERSION = OURS.wire_format
"""A robot answers a HELLO of another version with its own, and nothing else."""

COOKIE_SIZE = 16
TAG_SIZE = 16
"""Size of the tags of both ciphers and of the handshake [byte]."""

NO_TAG = bytes(TAG_SIZE)

EPHEMERAL_SIZE = 32
"""Size of an X25519 public key [byte]."""

INSTANCE_SIZE = 16
MAX_NAME = 128
"""Maximum length of a name in UTF-8 [byte]."""

MIN_BODY = 8
"""Minimum size of a body: a UDPROS header alone [byte]."""

HELLO = struct.Struct('<BBxxQ16s%ds' % MAX_RELEASE)
FIRST_HELLO = struct.Struct('<BBxxQ20x')
"""Fields of a HELLO that all versions share, with the size of the HELLO of version 1."""

COOKIE = struct.Struct('<BBxBQ16s16s')
INIT = struct.Struct('<BBxBQ16sI16s')
ACCEPT = struct.Struct('<BBxBI')
REFUSE = struct.Struct('<BBxBQ')
LONG_REFUSE = struct.Struct('<BBxBQ%ds' % MAX_RELEASE)
"""With a release."""

UNKNOWN = struct.Struct('<BBxxI')
DATA = struct.Struct('<BxxxIQ')
DATA_DTYPE: DType = np.dtype([('kind', 'u1'), ('zero', 'u1', (3,)), ('index', '<u4'), ('counter', '<u8')])
"""The head of DATA."""

REQUEST = struct.Struct('<16sHB128s')
"""INIT's payload."""

REPLY = struct.Struct('<I16sHB128s')
"""ACCEPT's payload."""


class Kind(enum.IntEnum):
    """A datagram's first byte."""
    HELLO = 1
    COOKIE = 2
    INIT = 3
    ACCEPT = 4
    REFUSE = 5
    UNKNOWN = 6
    DATA = 7


class Suite(enum.IntEnum):
    """The cipher of a link; the robot chooses it."""
    AESGCM = 1
    CHACHAPOLY = 2


class Reason(enum.IntEnum):
    """Why a robot refuses an operator."""
    VERSION = 1
    WRONG_KEY = 2
    FULL = 3


SENTENCES: Dict[Reason, str] = {    # of another version: see version.difference
    Reason.WRONG_KEY: 'the robot has another key: copy its key file to this machine',
    Reason.FULL: 'the robot has as many operators as it takes',
}
"""For the operator's log."""

OVERHEAD = DATA.size + TAG_SIZE
"""Bytes of each DATA that are not its body."""

INIT_SIZE = INIT.size + EPHEMERAL_SIZE + REQUEST.size + TAG_SIZE
ACCEPT_SIZE = ACCEPT.size + EPHEMERAL_SIZE + REPLY.size + TAG_SIZE


class Malformed(ValueError):
    """Bytes from the network that no correct peer sends."""


class Hello(NamedTuple):
    """The operator asks for a cookie."""
    version: int
    nonce: int
    tag: bytes = NO_TAG
    release: str = ''

    def pack(self) -> bytes:
        """The datagram."""
        return HELLO.pack(Kind.HELLO, self.version, self.nonce, self.tag, self.release.encode())

    @classmethod
    def parse(cls, datagram: bytes) -> 'Hello':
        """From a datagram of at least its size: a later version may be longer."""
        _, version, nonce = FIRST_HELLO.unpack_from(datagram)
        if version != VERSION and len(datagram) < HELLO.size:
            return cls(version, nonce)
        tag, release = HELLO.unpack_from(datagram)[-2:]
        return cls(version, nonce, tag if version == VERSION else NO_TAG, _release(release))


class Cookie(NamedTuple):
    """The robot's answer, which only who receives at the sender's address can return."""
    version: int
    suite: int
    nonce: int
    cookie: bytes
    tag: bytes = NO_TAG

    def pack(self) -> bytes:
        """The datagram."""
        return COOKIE.pack(Kind.COOKIE, *self)

    @classmethod
    def parse(cls, datagram: bytes) -> 'Cookie':
        """From a datagram of its size."""
        _, *fields = COOKIE.unpack(datagram)
        return cls(*fields)


class Init(NamedTuple):
    """The operator's half of the handshake."""
    version: int
    suite: int
    nonce: int
    cookie: bytes
    sender: int
    """By which the robot shall name the session."""
    message: bytes
    """Noise message 1."""
    tag: bytes = NO_TAG

    def pack(self) -> bytes:
        """The datagram."""
        return INIT.pack(Kind.INIT, *self[:-2], self.tag) + self.message

    @classmethod
    def parse(cls, datagram: bytes) -> 'Init':
        """From a datagram of at least the head's size."""
        _, version, suite, nonce, cookie, index, tag = INIT.unpack_from(datagram)
        if len(datagram) != INIT_SIZE:
            raise Malformed('an INIT of %d bytes' % len(datagram))
        return cls(version, suite, nonce, cookie, index, datagram[INIT.size:], tag)


class Accept(NamedTuple):
    """The robot's half of the handshake."""
    version: int
    suite: int
    receiver: int
    message: bytes
    """Noise message 2."""

    def pack(self) -> bytes:
        """The datagram."""
        return ACCEPT.pack(Kind.ACCEPT, *self[:-1]) + self.message

    @classmethod
    def parse(cls, datagram: bytes) -> 'Accept':
        """From a datagram of at least the head's size."""
        _, version, suite, index = ACCEPT.unpack_from(datagram)
        if len(datagram) != ACCEPT_SIZE:
            raise Malformed('an ACCEPT of %d bytes' % len(datagram))
        return cls(version, suite, index, datagram[ACCEPT.size:])


class Refuse(NamedTuple):
    """The robot does not take the operator. The version is the robot's own."""
    version: int
    reason: int
    nonce: int
    release: str = ''

    def pack(self) -> bytes:
        """The datagram."""
        if not self.release:
            return REFUSE.pack(Kind.REFUSE, *self[:-1])
        return LONG_REFUSE.pack(Kind.REFUSE, *self[:-1], self.release.encode())

    @classmethod
    def parse(cls, datagram: bytes) -> 'Refuse':
        """From a datagram of one of its sizes."""
        if len(datagram) != LONG_REFUSE.size:
            _, *fields = REFUSE.unpack(datagram)
            return cls(*fields)
        _, version, reason, nonce, release = LONG_REFUSE.unpack(datagram)
        return cls(version, reason, nonce, _release(release))


class Unknown(NamedTuple):
    """The robot does not know the session of a DATA: a hint that it was restarted."""
    version: int
    receiver: int

    def pack(self) -> bytes:
        """The datagram."""
        return UNKNOWN.pack(Kind.UNKNOWN, self.version, self.receiver)

    @classmethod
    def parse(cls, datagram: bytes) -> 'Unknown':
        """From a datagram of its size."""
        _, version, index = UNKNOWN.unpack(datagram)
        return cls(version, index)


Packet = Union[Hello, Cookie, Init, Accept, Refuse, Unknown]
PACKETS: Dict[int, Type[Packet]] = {Kind.HELLO: Hello, Kind.COOKIE: Cookie, Kind.INIT: Init, Kind.ACCEPT: Accept,
                                    Kind.REFUSE: Refuse, Kind.UNKNOWN: Unknown}


def parse(datagram: bytes) -> Packet:
    """What a datagram of the handshake holds.

    :raises Malformed: if it is none
    """
    try:
        return PACKETS[datagram[0]].parse(datagram)
    except (IndexError, KeyError, struct.error) as error:
        raise Malformed('no packet') from error


def prologue(packet: Union[Cookie, Init]) -> bytes:
    """What both sides saw of HELLO and COOKIE; the Noise handshake fails where they saw different bytes."""
    version, suite, nonce, cookie = packet[:4]
    return Hello(version, nonce).pack() + Cookie(version, suite, nonce, cookie).pack()


class Request(NamedTuple):
    """INIT's payload: who asks."""
    instance: bytes
    """Random at the start of the operator's process: the same instance is the same peer."""
    max_datagram_size: int
    """It receives [byte of UDP payload]."""
    name: str

    def pack(self) -> bytes:
        """The payload."""
        name = encode_name(self.name)
        return REQUEST.pack(self.instance, self.max_datagram_size, len(name), name)

    @classmethod
    def parse(cls, payload: bytes) -> 'Request':
        """:raises Malformed: if the payload is none"""
        instance, size, length, name = _unpack(REQUEST, payload)
        return cls(instance, size, decode_name(name, length))


class Reply(NamedTuple):
    """ACCEPT's payload: who answers."""
    sender: int
    """By which the operator shall name the session."""
    instance: bytes
    max_datagram_size: int
    name: str

    def pack(self) -> bytes:
        """The payload."""
        name = encode_name(self.name)
        return REPLY.pack(self.sender, self.instance, self.max_datagram_size, len(name), name)

    @classmethod
    def parse(cls, payload: bytes) -> 'Reply':
        """:raises Malformed: if the payload is none"""
        index, instance, size, length, name = _unpack(REPLY, payload)
        return cls(index, instance, size, decode_name(name, length))


def _release(field: bytes) -> str:
    return printable(field.rstrip(b'\0').decode('latin-1'))


def _unpack(layout: struct.Struct, payload: bytes) -> Tuple[Any, ...]:
    try:
        return layout.unpack(payload)
    except struct.error as error:
        raise Malformed(str(error)) from error


def encode_name(name: str) -> bytes:
    """A name in UTF-8, cut after a whole character to MAX_NAME bytes."""
    return name.encode(errors='replace')[:MAX_NAME].decode(errors='ignore').encode()


def decode_name(field: bytes, length: int) -> str:
    """The name in a field of MAX_NAME bytes.

    :raises Malformed: if it cannot be shown in a log
    """
    try:
        name = field[:length].decode()
    except UnicodeDecodeError as error:
        raise Malformed('a name that is not UTF-8') from error
    if length > MAX_NAME or not name or not name.isprintable():
        raise Malformed('a name that is not printable')
    return name
