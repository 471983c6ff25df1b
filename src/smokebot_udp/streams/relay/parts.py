# SPDX-License-Identifier: BSD-3-Clause
"""Relayed messages as segments: any message is cut into datagrams that are numbered, and joined again."""
import collections
from typing import Any, Counter, Dict, Optional, OrderedDict, Tuple

import numpy as np

from ...checksum import typed_checksum
from ...msg import RelaySegment
from ...packed import UNPACKED, unpack
from ...udpros.frame import Frame
from ..segments import room

MAX_MESSAGE_SIZE = 16 << 20
"""A longer message is neither sent nor collected [byte]."""

MAX_PACKED_SIZE = MAX_MESSAGE_SIZE + UNPACKED
"""Maximum size of a packed message, which may not have been worth compressing [byte]."""

MAX_PARTS = 1 << 16
"""Segments of a message, as their numbers have 16 bits."""

MAX_PARTIALS = 2
"""Messages that are collected at the same time; a newer one replaces the oldest."""

SEQ_MODULUS = 1 << 32


def carried(message_class: Any) -> str:
    """Type and md5 sum of the messages of a relay, as transports compare them."""
    return '%s %s' % (message_class._type, message_class._md5sum)


def packed_frame(md5sum: str, packed: bytes, max_datagram_size: int, number: int = 0, before: bytes = b'') -> Frame:
    """The segments that carry a packed ROS message.

    :param md5sum: of its type
    :param max_datagram_size: [byte of UDP payload]
    :param number: of the message
    :param before: repeats the one before, where both fit in one segment
    :raises ValueError: where it is longer than MAX_MESSAGE_SIZE, or than MAX_PARTS segments
    """
    size = len(packed)
    length = size - UNPACKED
    parts = max(1, -(-size // room(RelaySegment, max_datagram_size)))
    if length > MAX_MESSAGE_SIZE or parts > MAX_PARTS:
        raise ValueError('it has %d bytes, which take %d datagrams; must be %d bytes and %d datagrams at most' % (
            length, parts, MAX_MESSAGE_SIZE, MAX_PARTS))
    each = -(-size // parts)
    frame = Frame(RelaySegment, parts, {'data': each, 'before': len(before)})
    frame.records['number'], frame.records['packed_size'] = number, size
    frame.records['checksum'] = typed_checksum(md5sum, packed + before)
    frame.records['before'] = np.frombuffer(before, np.uint8)
    frame.records['part'] = np.arange(parts)
    frame.records['data'] = np.frombuffer(packed.ljust(parts * each, b'\0'), np.uint8).reshape(parts, each)
    return frame


class PartJoiner:
    """Joins the messages of one type from segments that arrive in any order, or never.

    Segments come from the network: a message holds MAX_MESSAGE_SIZE bytes at most, and MAX_PARTIALS are held.

    :param message_class: of the messages
    """

    def __init__(self, message_class: Any) -> None:
        self.dropped: Counter[str] = collections.Counter()
        """Segments that did not become part of a message, by reason: part (impossible number or size), checksum,
        packing, incomplete."""
        self._message_class = message_class
        # {what the segments of a message have in common: {part: its data}}, oldest first
        self._partials: OrderedDict[Tuple[int, ...], Dict[int, bytes]] = collections.OrderedDict()

    def add(self, segment: RelaySegment) -> Optional[bytes]:
        """Take a segment; returns the serialised message that it completes, else None."""
        size, length, part = segment.packed_size, len(segment.data), segment.part
        parts = -(-size // length) if length else 1
        if part >= parts or size > MAX_PACKED_SIZE or (size and not length) or (parts == 1 and size != length):
            self.dropped['part'] += 1
            return None
        key = (segment.header.seq - part) % SEQ_MODULUS, segment.checksum, size, length
        partial = self._partials.setdefault(key, {})
        partial[part] = segment.data
        if len(partial) < parts:
            if len(self._partials) > MAX_PARTIALS:
                self.dropped['incomplete'] += len(self._partials.popitem(last=False)[1])
            return None
        del self._partials[key]
        packed = b''.join(partial[index] for index in range(parts))[:size]
        if typed_checksum(self._message_class._md5sum, packed + segment.before) != segment.checksum:
            self.dropped['checksum'] += parts
            return None
        try:
            return unpack(packed, MAX_MESSAGE_SIZE)
        except ValueError:
            self.dropped['packing'] += parts
            return None
