# SPDX-License-Identifier: BSD-3-Clause
"""The datagrams of UDPROS: bytes <-> datagrams <-> messages.

A datagram is a header of 8 bytes and a payload. The payloads of a message's blocks, joined, are the
message's length (4 bytes) and the serialised message, exactly what TCPROS writes on its stream:

    connection_id u32 | op u8 | message_id u8 | block u16 | payload ...

* ``DATA0`` begins a message; its block field is the number of blocks.
* ``DATAN`` continues it; its block field is the block's index, 1 .. blocks - 1.
* ``PING`` and ``ERR`` are never sent by roscpp, and dropped here.
* message_id runs 1 .. 255 for each connection, and is never 0.

Source: ros_comm, clients/roscpp, transport_udp.h and transport_udp.cpp (noetic). Nothing here knows
a socket, a clock or rospy: time is an argument.
"""
import enum
import struct

import numpy as np

HEADER = struct.Struct('<IBBH')
HEADER_DTYPE = np.dtype([('connection_id', '<u4'), ('op', 'u1'), ('message_id', 'u1'), ('block', '<u2')])
LENGTH = struct.Struct('<I')
"""The message's length before the serialised message, in the payload of block 0."""

OVERHEAD = HEADER.size + LENGTH.size
"""Bytes of a one-block datagram that are not the serialised message."""

DEFAULT_MAX_DATAGRAM_SIZE = 1472
"""What fills an Ethernet frame: 1500 less IPv4's 20 and UDP's 8 bytes [byte of UDP payload]."""

ROSCPP_MAX_DATAGRAM_SIZE = 1500
"""roscpp receives into a buffer of this size, whatever it asked for: more corrupts its stream."""

MIN_MAX_DATAGRAM_SIZE = 64
"""The smallest max_datagram_size worth a conversation; roscpp crashes when asked for 8."""

UDP_MAX_PAYLOAD = 65507
"""No UDP datagram over IPv4 is longer [byte]."""

MESSAGE_IDS = 255


class Op(enum.IntEnum):
    DATA0 = 0
    DATAN = 1
    PING = 2
    ERR = 3


def message_ids(last, count):
    """The ids of the next `count` messages after id `last` (0 before the first): (count,) uint8 in 1..255."""
    return ((last + np.arange(count)) % MESSAGE_IDS + 1).astype(np.uint8)


def split(message, connection_id, message_id, max_datagram_size):
    """Cut one message into its datagrams.

    :param message: bytes, its length prefix included
    :return: bytes-like, the datagrams one after the other; each is max_datagram_size bytes but the last
    :raises ValueError: where the message needs more than 65535 blocks
    """
    room = max_datagram_size - HEADER.size
    blocks = max(1, -(-len(message) // room))
    if blocks > 0xffff:
        raise ValueError('a message of %d bytes needs %d blocks of %d bytes: UDPROS counts to 65535'
                         % (len(message), blocks, room))
    out = bytearray(len(message) + blocks * HEADER.size)
    for block in range(blocks):
        at = block * max_datagram_size
        op, number = (Op.DATAN, block) if block else (Op.DATA0, blocks)
        HEADER.pack_into(out, at, connection_id, op, message_id, number)
        piece = message[block * room:(block + 1) * room]
        out[at + HEADER.size:at + HEADER.size + len(piece)] = piece
    return out
