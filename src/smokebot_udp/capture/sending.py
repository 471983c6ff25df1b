# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of one transfer: pieces are sent in their order, and those that were lost again, until all are held.

Each piece that leaves has the next `order`. The operator reports all pieces that it holds, and the highest order that
came: what left before that and is not held is lost (as by the packet numbers of QUIC, RFC 9002, section 6.1), so it is
sent again at once, however long the queues are. Only where nothing newer came, a timeout decides (RFC 6298). While an
operator is silent, nothing is sent to it.
"""
import collections
import math
from typing import Deque, NamedTuple, Optional

import numpy as np

from ..arrays import BoolArray
from ..reliable.round_trip import RoundTrip

MAX_SIZE = 1 << 24
"""Maximum size of a transfer [byte]."""

MAX_PIECES, MIN_LENGTH = 8192, 64
"""Maximum number of pieces of a transfer, as a report names each of them; and minimum length of a piece, unless there
is only one [byte]."""

REORDERING = 3
"""A piece may come after as many that left later (kPacketThreshold of RFC 9002)."""

PAUSE_AFTER = 1.0
"""Nothing is sent to an operator that was not heard for this long [s]."""

FIRST_TIMEOUT = 0.5
"""Until the round trip is known [s]."""


class Piece(NamedTuple):
    """What a CapturePiece holds."""
    size: int
    order: int
    number: int
    length: int
    data: bytes


def piece_length(size: int, room: int, most: int) -> int:
    """The length of a transfer's pieces [byte].

    :param size: of the whole [byte]
    :param room: for a piece in a datagram of the usual size [byte]
    :param most: in the longest one [byte]
    :raises ValueError: it would be too many pieces
    """
    if not 0 < size <= min(MAX_SIZE, MAX_PIECES * most):
        raise ValueError('it takes %.1f MB, and at most %.1f MB can cross: ask for a region' % (
            size / 1e6, min(MAX_SIZE, MAX_PIECES * most) / 1e6))
    return min(most, max(room, MIN_LENGTH, -(-size // MAX_PIECES)))


class Sending:
    """Sends one transfer to one operator. Times are by a steady clock [s].

    :param data: the whole
    :param length: of its pieces [byte]
    """

    def __init__(self, data: bytes, length: int, now: float) -> None:
        self._data, self.length, self.heard = data, length, now
        count = -(-len(data) // length)
        self._held: BoolArray = np.zeros(count, bool)
        self._orders = np.zeros(count, np.int64)        # of the last time that each piece was sent; 0: never, or lost
        self._times = np.zeros(count)                   # when that was
        self._waiting: Deque[int] = collections.deque(range(count))
        self._order = 0
        self._round_trip = RoundTrip()

    @property
    def whole(self) -> bool:
        """Whether the operator holds all."""
        return bool(self._held.all())

    @property
    def left(self) -> int:
        """What the operator does not hold [byte]."""
        return int(np.count_nonzero(~self._held)) * self.length

    def acknowledge(self, received: bytes, order: int, now: float) -> None:
        """Take a report, see msg/CaptureRequest.

        :raises ValueError: it is of pieces that were never sent
        """
        count = len(self._held)
        bits: BoolArray = np.unpackbits(np.frombuffer(received, np.uint8), bitorder='little').astype(bool)
        if order > self._order or bits[count:].any():
            raise ValueError('a report of pieces that were never sent')
        self.heard = now
        held = np.zeros(count, bool)
        held[:min(count, len(bits))] = bits[:count]
        newest = np.flatnonzero(self._orders == order) if order else np.zeros(0, int)
        if len(newest) and not self._held[newest[0]]:
            self._round_trip.add(now - float(self._times[newest[0]]))
        self._held |= held
        self._lose(np.asarray((self._orders > 0) & (self._orders <= order - REORDERING) & ~self._held))

    def take(self, now: float) -> Optional[Piece]:
        """The piece that leaves now; None: there is none."""
        if now - self.heard > PAUSE_AFTER:
            return None
        if not self._waiting:
            self._lose(np.asarray(self._flying() & (self._times <= now - self._interval(now))))
        while self._waiting:
            number = self._waiting.popleft()
            if not self._held[number]:
                self._order += 1
                self._orders[number], self._times[number] = self._order, now
                return Piece(len(self._data), self._order, number, self.length,
                             self._data[number * self.length:(number + 1) * self.length])
        return None

    def due(self, now: float) -> float:
        """When `take` has a piece next, unless a report comes before [s]; infinite: never."""
        if now - self.heard > PAUSE_AFTER:
            return math.inf
        if any(not self._held[number] for number in self._waiting):
            return -math.inf
        flying = self._flying()
        return float(self._times[flying].min()) + self._interval(now) if flying.any() else math.inf

    def _flying(self) -> BoolArray:
        return np.asarray((self._orders > 0) & ~self._held)

    def _interval(self, now: float) -> float:
        least = FIRST_TIMEOUT if self._round_trip.smoothed is None else 0.0
        return max(self._round_trip.interval(now - self.heard), least)

    def _lose(self, lost: BoolArray) -> None:
        """These pieces wait to be sent again."""
        self._orders[lost] = 0
        self._waiting.extend(np.flatnonzero(lost).tolist())
