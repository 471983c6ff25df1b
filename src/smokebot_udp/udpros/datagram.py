# SPDX-License-Identifier: BSD-3-Clause
"""The datagrams of UDPROS: messages to bytes.

A datagram is a header of 8 bytes and a payload. A message is cut into blocks, one per datagram. The joined payloads of
its blocks are the length of the serialised message (4 bytes) and the serialised message, as TCPROS writes them:

    connection_id u32 | op u8 | message_id u8 | block u16 | payload ...

* ``DATA0`` is a message's first block; its block field is the number of blocks.
* ``DATAN`` is a later block; its block field is the block's index, 1 .. blocks - 1.
* ``PING`` and ``ERR`` are never sent by roscpp, and are dropped here.
* message_id counts the messages of a connection: 1 .. 255, then 1 again, never 0.

Source: ros_comm, clients/roscpp, transport_udp.h and transport_udp.cpp (noetic).
"""
import enum
import struct
from typing import Union

import numpy as np

from ..arrays import DType, UInt8Array

Buffer = Union[bytes, bytearray, memoryview]

HEADER = struct.Struct('<IBBH')
HEADER_DTYPE: DType = np.dtype([('connection_id', '<u4'), ('op', 'u1'), ('message_id', 'u1'), ('block', '<u2')])
LENGTH = struct.Struct('<I')
"""The length of the serialised message, at the beginning of block 0's payload."""

OVERHEAD = HEADER.size + LENGTH.size
"""Bytes in front of the serialised message in a datagram that holds a whole message."""

IP_UDP_HEADERS = 28
"""The headers of IPv4 (20) and UDP (8) [byte]."""

DEFAULT_MAX_DATAGRAM_SIZE = 1472
"""Fills an Ethernet frame: 1500 less IP_UDP_HEADERS [byte of UDP payload]."""

ROSCPP_MAX_DATAGRAM_SIZE = 1500
"""Size of the buffer into which roscpp receives, whatever size it negotiates. Longer datagrams corrupt its stream."""

MIN_MAX_DATAGRAM_SIZE = 64
"""A smaller max_datagram_size is refused; roscpp crashes when asked for 8."""

UDP_MAX_PAYLOAD = 65507
"""The longest UDP payload over IPv4 [byte]."""

MESSAGE_IDS = 255

MAX_BLOCKS = 0xffff


class Op(enum.IntEnum):
    """What a datagram is."""
    DATA0 = 0
    DATAN = 1
    PING = 2
    ERR = 3


def message_ids(last: int, count: int) -> UInt8Array:
    """The ids of the next `count` messages after id `last` (0 before the first): (count,) uint8 in 1..255."""
    return ((last + np.arange(count)) % MESSAGE_IDS + 1).astype(np.uint8)


def split(message: Buffer, connection_id: int, message_id: int, max_datagram_size: int) -> bytearray:
    """Cut one message into its datagrams.

    :param message: the serialised message and its length prefix
    :return: the datagrams, concatenated; each is max_datagram_size bytes long, the last one may be shorter
    :raises ValueError: if the message needs more than 65535 blocks
    """
    room = max_datagram_size - HEADER.size
    blocks = max(1, -(-len(message) // room))
    if blocks > MAX_BLOCKS:
        raise ValueError('a message of %d bytes needs %d blocks of %d bytes: UDPROS counts to %d'
                         % (len(message), blocks, room, MAX_BLOCKS))
    out = bytearray(len(message) + blocks * HEADER.size)
    for block in range(blocks):
        at = block * max_datagram_size
        op, number = (Op.DATAN, block) if block else (Op.DATA0, blocks)
        HEADER.pack_into(out, at, connection_id, op, message_id, number)
        piece = message[block * room:(block + 1) * room]
        out[at + HEADER.size:at + HEADER.size + len(piece)] = piece
    return out
