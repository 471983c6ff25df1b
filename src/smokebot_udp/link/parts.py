# SPDX-License-Identifier: BSD-3-Clause
"""A message that is repeated until it has arrived, part by part: each datagram that arrives counts.

A part is a datagram of its own: number of the message, index of the part, number of parts, and its bytes. The other
side acknowledges the parts that it has; only the others are sent again.
"""
import math
import struct
from typing import Callable, Dict, List, Optional, Tuple

from .packets import Malformed

PART = struct.Struct('<IBB')

MAX_PARTS = 32
"""A bit for each acknowledges it."""

MAX_SIZE = 1024
"""A part is not longer: it passes wherever anything does [byte]."""

FIRST_RETRY, LAST_RETRY, SILENT_RETRY, RETRY_GROWTH = 0.05, 0.15, 1.0, 1.2
"""Time to the first repetition, to the later ones at most, the same while the peer is not heard, and the factor from
one to the next. At 80 % loss 99 of 100 parts have arrived after 3 s [s, s, s, 1]."""


def capacity(size: int) -> int:
    """The length of the longest message.

    :param size: of a part at most, its head included [byte]
    """
    return MAX_PARTS * _room(size)


def _room(size: int) -> int:
    return min(size, MAX_SIZE) - PART.size


class Repeated:
    """The sender's side: the present message, and which of its parts are due."""

    def __init__(self) -> None:
        self.due = math.inf
        """When there is something to send [s]."""
        self._number = 0
        self._parts: List[bytes] = []
        self._left = 0      # a bit for each part that is not acknowledged
        self._interval = FIRST_RETRY

    @property
    def acknowledged(self) -> bool:
        """Whether the peer has the whole message."""
        return bool(self._number) and not self._left

    def put(self, number: int, data: bytes, size: int, now: float) -> None:
        """Replace the message.

        :param number: higher than those before
        :param data: `capacity(size)` bytes at most
        :param size: of a part at most, its head included [byte]
        """
        room = _room(size)
        count = max(1, -(-len(data) // room))
        self._number = number
        self._parts = [PART.pack(number, part, count) + data[part * room:(part + 1) * room] for part in range(count)]
        self._begin(now)

    def _begin(self, now: float) -> None:
        self._left, self._interval, self.due = (1 << len(self._parts)) - 1, FIRST_RETRY, now

    def take(self, alive: bool, now: float) -> List[bytes]:
        """The parts that are sent now.

        :param alive: whether the peer was heard lately
        """
        if now < self.due:
            return []
        self.due = now + self._interval
        self._interval = min(self._interval * RETRY_GROWTH, LAST_RETRY if alive else SILENT_RETRY)
        return [part for index, part in enumerate(self._parts) if self._left >> index & 1]

    def seen(self, number: int, taken: int, now: float) -> None:
        """Which parts of message `number` the peer has taken, a bit for each; 0: it has forgotten all."""
        if not self._number or number > self._number:
            return
        if number == self._number:
            self._left &= ~taken
        elif self._left != (1 << len(self._parts)) - 1:     # it had parts of it
            self._begin(now)
        if not self._left:
            self.due = math.inf

    def forgotten(self) -> None:
        """The peer may have forgotten the message: it is due at once."""
        if self._number:
            self._begin(-math.inf)


class Arriving:
    """The receiver's side: what has come of the newest message."""

    def __init__(self) -> None:
        self.number = 0
        """Number of the newest message that is complete; 0: none is yet."""
        self._number = self._count = 0      # of the newest message, and of its parts
        self._parts: Dict[int, bytes] = {}

    @property
    def taken(self) -> Tuple[int, int]:
        """Number of the newest message, and a bit for each part of it that has come."""
        return self._number, sum(1 << part for part in self._parts)

    def add(self, datagram: bytes, may_end: Callable[[], bool]) -> Optional[bytes]:
        """Take a part; returns the message that it completes.

        :param may_end: f() -> whether the message is taken, if this part completes it; otherwise the part comes again
        :raises Malformed: if it is none
        """
        number, part, count = PART.unpack_from(datagram)
        if not part < count <= MAX_PARTS:
            raise Malformed('part %d of %d' % (part, count))
        if number > self._number:
            self._number, self._count, self._parts = number, count, {}
        if number < self._number or count != self._count or part in self._parts:
            return None
        if len(self._parts) + 1 == count and not may_end():
            return None
        self._parts[part] = datagram[PART.size:]
        if len(self._parts) < count:
            return None
        self.number = number
        return b''.join(self._parts[index] for index in range(count))
