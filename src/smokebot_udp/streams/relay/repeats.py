# SPDX-License-Identifier: BSD-3-Clause
"""Short messages against losses: each datagram of a stream repeats the message before; the operator takes each once.

With a loss p one of two datagrams arrives with a probability of 1 - p^2, and the message is at most a period late. It
costs little, because a message resembles the one before: only what differs is sent (packed.pack_beside). Where much is
lost, a copy of the datagram between two messages makes it 1 - p^3 within the same period.
"""
from typing import Any, Counter, List, NamedTuple, Optional

from ...msg import RelaySegment
from ...packed import pack, pack_beside, unpack_beside
from ...serialised import serialised
from ...udpros.frame import Frame
from ..encoder import LinkView
from ..segments import room
from .parts import SEQ_MODULUS, packed_frame

COPIED_LOSS = 0.1
"""Packet-loss ratio from which on datagrams are copied: below it one repetition lets 99 % arrive."""

COPIED_AFTER = 0.5
"""Part of the period after which a datagram is copied: as far from the datagram as from the next one, as losses come in
bursts."""

MAX_REORDERING = 1024
"""A message whose number is lower by less than this was overtaken, or has come already. One that is lower by more is of
a sender that began anew, at a random number. No link overtakes by this many messages."""


class _Message(NamedTuple):
    """A message that takes one datagram."""
    number: int
    md5sum: str
    data: bytes
    """Serialised."""
    packed: bytes


class RepeatedMessages:
    """The frames of a stream's messages.

    :param number: of the first message
    """

    def __init__(self, number: int = 0) -> None:
        self._number = number
        self._before: Optional[_Message] = None
        self._copied: List[_Message] = []

    @property
    def pending(self) -> bool:
        """Whether there is anything to copy."""
        return bool(self._copied)

    def frames(self, messages: List[Any], link: LinkView, repeat: bool) -> List[Frame]:
        """The frames of new messages, in order.

        :param repeat: whether messages are repeated
        :raises ValueError: where one is too long
        """
        self._copied = []
        return [self._frame(message, link, repeat) for message in messages]

    def copies(self, link: LinkView) -> List[Frame]:
        """The frames of the last messages once more, as far as that can be afforded; they are copied once."""
        copied, self._copied = self._copied, []
        frames = [packed_frame(one.md5sum, one.packed, link.datagram_size, one.number) for one in copied]
        return [frame for frame in frames if len(frame) == 1 and link.afford(frame.datagram_size, True)]

    def _frame(self, message: Any, link: LinkView, repeat: bool) -> Frame:
        data, number = serialised(message), self._number
        self._number = (number + 1) % SEQ_MODULUS
        packed = pack(data)
        left = room(RelaySegment, link.datagram_size) - len(packed)
        before, self._before = self._before, None
        repeated = b''
        if repeat and left >= 0:
            if before is not None:
                repeated = pack_beside(before.data, data)
                if len(repeated) > left or not link.afford(len(repeated), False):
                    repeated = b''
            self._before = _Message(number, message._md5sum, data, packed)
            self._copied.append(self._before)
        return packed_frame(message._md5sum, packed, link.datagram_size, number, repeated)


class MessageOrder:
    """Which of the messages that arrive are news: each once, in order.

    :param dropped: segments that say nothing new are added as `not needed`; what cannot be read as `repetition`
    """

    def __init__(self, dropped: Counter[str]) -> None:
        self._dropped = dropped
        self._last: Optional[int] = None    # number of the last message that was news

    def add(self, number: int, data: bytes, before: bytes) -> List[bytes]:
        """What a segment that completes a message brings: serialised messages.

        :param data: the message, serialised
        :param before: the one before, from pack_beside; empty: it is not repeated
        """
        found: List[bytes] = []
        if before and self._is_news((number - 1) % SEQ_MODULUS):
            try:
                found.append(unpack_beside(before, data))
            except ValueError:
                self._dropped['repetition'] += 1
        if not self._is_news(number):
            self._dropped['not needed'] += 1
            return []
        self._last = number
        return [*found, data]

    def _is_news(self, number: int) -> bool:
        """By serial arithmetic, as in RFC 1982."""
        return self._last is None or not 0 <= (self._last - number) % SEQ_MODULUS < MAX_REORDERING
