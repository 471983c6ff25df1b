# SPDX-License-Identifier: BSD-3-Clause
"""From a topic's messages to the datagrams of one connection, whatever sends them."""
from typing import Callable, Protocol, Union

from ..arrays import UInt8Array
from .datagram import HEADER, MESSAGE_IDS, UDP_MAX_PAYLOAD, Buffer, Op, message_ids, split
from .frame import Frame


class Sender(Protocol):
    """What a Packetizer sends with, such as an endpoints.DatagramSender."""

    def send_one(self, *parts: Union[Buffer, UInt8Array]) -> int:
        """Send one datagram, given in parts; returns how many were sent, 1 or 0."""

    def send(self, datagrams: Union[Buffer, UInt8Array], size: int, count: int) -> int:
        """Send datagrams of `size` bytes, the last one may be shorter; returns how many were sent."""


Limit = Callable[[], int]
"""f() -> the longest datagram that passes now [byte]; any thread."""


def no_limit() -> int:
    """As long as a datagram can be [byte]."""
    return UDP_MAX_PAYLOAD


class Packetizer:
    """Numbers, cuts and sends the messages of one connection, and counts them.

    :param connection_id: of its datagrams
    :param max_datagram_size: longest datagram [byte]; may be changed
    :param limit: of it
    """

    def __init__(self, sender: Sender, connection_id: int, max_datagram_size: int, limit: Limit = no_limit) -> None:
        self.connection_id, self.max_datagram_size = connection_id, max_datagram_size
        self.messages = self.datagrams = self.bytes = 0
        """Messages, the datagrams of them that were sent, and the messages' length prefixes and data [byte]."""
        self._sender, self._limit = sender, limit
        self._last_id = 0

    @property
    def longest(self) -> int:
        """The longest datagram that is sent now [byte]."""
        return min(self.max_datagram_size, self._limit())

    def send_message(self, data: Buffer) -> None:
        """Send one message.

        :param data: the message with its length prefix
        :raises ValueError: if it needs more than 65535 datagrams
        """
        size, message_id = self.longest, self._last_id % MESSAGE_IDS + 1
        if len(data) <= size - HEADER.size:
            sent = self._sender.send_one(HEADER.pack(self.connection_id, Op.DATA0, message_id, 1), data)
        else:
            blocks = split(data, self.connection_id, message_id, size)
            sent = self._sender.send(blocks, size, -(-len(blocks) // size))
        self._last_id = message_id
        self._count(1, sent, len(data))

    def send_frame(self, frame: Frame) -> None:
        """Send a frame's messages, each as one datagram unless that is too long for the connection."""
        if frame.datagram_size > self.longest:
            for row in frame.rows:
                self.send_message(row[HEADER.size:].tobytes())
            return
        ids = message_ids(self._last_id, len(frame))
        self._last_id = int(ids[-1])
        frame.header['connection_id'], frame.header['message_id'] = self.connection_id, ids
        sent = self._sender.send(frame.rows, frame.datagram_size, len(frame))
        self._count(len(frame), sent, frame.rows.size)

    def _count(self, messages: int, datagrams: int, size: int) -> None:
        self.messages += messages
        self.datagrams += datagrams
        self.bytes += size
