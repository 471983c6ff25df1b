# SPDX-License-Identifier: BSD-3-Clause
"""The link's own messages inside a session. They are UDPROS datagrams, with connection ids that no topic has.

* KEEP_ALIVE says nothing but that its sender is there.
* PATH_CHALLENGE asks who is at an address to return its 8 bytes in a PATH_RESPONSE, there (as in RFC 9000, 8.2).
* CLOSE ends the session at once.

All have the same length, so that the answer to one is never longer than what caused it.

A datagram of a topic whose op has the bit COPY is a copy of one that goes by another path. One with the bit SECOND goes
by the receiver's second path, while others go by its first one. Both say nothing about where their sender wants to be
reached.
"""
import enum

from ..arrays import BoolArray, UInt8Array
from ..udpros.datagram import HEADER, Op

FIRST_TABLE_ID = 4
"""The connection ids from here to FIRST_TOPIC_ID are for the tables of topics; the core hands them on."""

FIRST_TOPIC_ID = 16

CHALLENGE_SIZE = 8
"""Size of the body of each of the core's own messages [byte]."""

SIZE = HEADER.size + CHALLENGE_SIZE
"""Size of the datagram of each of the core's own messages [byte]."""


COPY, SECOND = 0x80, 0x40
"""Bits of the op, which ROS does not use."""

_OP = 4
"""Where the op is in a datagram."""


class Control(enum.IntEnum):
    """The connection ids of the core's own messages."""
    KEEP_ALIVE = 0
    PATH_CHALLENGE = 1
    PATH_RESPONSE = 2
    CLOSE = 3


def message(kind: Control, body: bytes = bytes(CHALLENGE_SIZE)) -> bytes:
    """The datagram of a message, SIZE bytes.

    :param body: CHALLENGE_SIZE bytes
    """
    return HEADER.pack(kind, Op.DATA0, 0, 1) + body


def marked(datagrams: UInt8Array, bits: int) -> BoolArray:
    """Which datagrams have one of some bits: (n,) bool for (n, slot) uint8."""
    found: BoolArray = datagrams[:, _OP] & bits != 0
    return found


def with_mark(datagrams: UInt8Array, bit: int) -> UInt8Array:
    """Datagrams with a bit, (n, size) uint8."""
    made = datagrams.copy()
    made[:, _OP] |= bit
    return made


def without_marks(datagrams: UInt8Array) -> UInt8Array:
    """Datagrams without the bits, (n, size) uint8."""
    made = datagrams.copy()
    made[:, _OP] &= ~(COPY | SECOND) & 0xff
    return made
