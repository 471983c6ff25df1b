# SPDX-License-Identifier: BSD-3-Clause
"""The receiving side of one channel from one peer: segments are joined to messages, and each is delivered once.

What comes from the network is bounded: WINDOW segments, and one message that began before them. Each number is taken
once, and belongs to one message, so whatever the parts claim, no segment is delivered twice, and none is kept for ever.
"""
import collections
from typing import Counter, Dict, List, Optional, Set

from .segment import MAX_NUMBER, WINDOW, Segment

LAST = MAX_NUMBER - WINDOW
"""Higher numbers are refused, which no sender reaches in years."""

MIN_PART = 16
"""Data of a part of a longer message, but for the last part: shorter ones only take memory [byte]."""


class _Partial:
    """A message of which segments have come."""
    __slots__ = ('parts', 'came', 'data', 'size', 'too_long')

    def __init__(self, parts: int) -> None:
        self.parts, self.came, self.size, self.too_long = parts, 0, 0, False
        self.data: Dict[int, bytes] = {}

    @property
    def complete(self) -> bool:
        return self.came == self.parts

    @property
    def joined(self) -> List[bytes]:
        """What is delivered of it once it is complete: nothing of one that is too long."""
        return [] if self.too_long else [b''.join(self.data[part] for part in range(self.parts))]


class ReliableReceiver:
    """Receives messages, each once.

    :param ordered: whether they are delivered as they were sent; otherwise, as they come
    :param max_bytes: of a message [byte]; a longer one is not delivered
    """

    def __init__(self, ordered: bool, max_bytes: int) -> None:
        self.dropped: Counter[str] = collections.Counter()
        """{reason: segments}: malformed, far ahead, inconsistent, too long; and repeated, which is no fault."""
        self._ordered, self._max_bytes = ordered, max_bytes
        self.renew()

    def renew(self) -> None:
        """The peer numbers its segments anew."""
        self.next = 1
        """All segments before this one have come, or are not waited for."""
        self._ahead: Set[int] = set()       # that have come, beyond `next`
        self._partials: Dict[int, _Partial] = {}    # by the number of the first segment
        self._at = 1        # ordered: first segment of the next message

    @property
    def received(self) -> bytes:
        """The segments that have come, as in an acknowledgement."""
        bits = 0
        for number in self._ahead:
            bits |= 1 << (number - self.next - 1)
        return bits.to_bytes((bits.bit_length() + 7) // 8, 'little')

    @property
    def held(self) -> int:
        """What it holds [byte]."""
        return sum(len(data) for partial in self._partials.values() for data in partial.data.values())

    def take(self, segment: Segment) -> Optional[List[bytes]]:
        """Take a segment of DATA: the messages that are to be delivered now; None: it is refused."""
        reason = self._refused(segment)
        if reason is not None:
            self.dropped[reason] += 1
            return None
        done = self.advance(segment.first)
        number = segment.number
        if number < self.next or number in self._ahead:
            self.dropped['repeated'] += 1
            return done
        start = number - segment.part
        partial = self._partials.get(start)
        if self._contradicts(start, segment.parts) if partial is None else partial.parts != segment.parts:
            self.dropped['inconsistent'] += 1
            return done
        self._keep(self._partials.setdefault(start, _Partial(segment.parts)), segment)
        self._mark(number)
        return done + self._deliver(start)

    def _contradicts(self, start: int, parts: int) -> bool:
        """Whether a message of which nothing has come has numbers of others: it could never be complete."""
        end = start + parts
        return (start < self.next or any(start <= number < end for number in self._ahead)
                or any(other < end and start < other + partial.parts for other, partial in self._partials.items()))

    def _refused(self, segment: Segment) -> Optional[str]:
        """Why a segment of DATA is refused; None: it is not."""
        number, first, part, parts = segment.number, segment.first, segment.part, segment.parts
        if not (part < parts and 1 <= first <= number - part and number <= LAST):
            return 'malformed'
        if (part < parts - 1 and len(segment.data) < MIN_PART) or MIN_PART * (parts - 1) > self._max_bytes:
            return 'malformed'
        return 'far ahead' if number >= max(self.next, first) + WINDOW else None

    def _keep(self, partial: _Partial, segment: Segment) -> None:
        """Keep the data of a segment, but not those of a message that is too long."""
        partial.came += 1
        partial.size += len(segment.data)
        if partial.size > self._max_bytes:
            partial.too_long = True
            partial.data.clear()
            self.dropped['too long'] += 1
        else:
            partial.data[segment.part] = segment.data

    def _mark(self, number: int) -> None:
        """Note that a segment has come."""
        self._ahead.add(number)
        self._close_up()

    def _close_up(self) -> None:
        while self.next in self._ahead:
            self._ahead.remove(self.next)
            self.next += 1

    def advance(self, first: int) -> List[bytes]:
        """Nothing before a number is sent any more: the messages that are to be delivered now."""
        if first > LAST:
            self.dropped['malformed'] += 1
        if first > LAST or (first <= self.next and first <= self._at):
            return []
        done: List[bytes] = []
        for start in sorted(start for start in self._partials if start < first):
            partial = self._partials.pop(start)
            if partial.complete:
                done += partial.joined
        if first > self.next:
            self._ahead = {number for number in self._ahead if number >= first}
            self.next = first
            self._close_up()
        self._at = max(self._at, first)
        return done + (self._in_order() if self._ordered else [])

    def _deliver(self, start: int) -> List[bytes]:
        """The messages that can be delivered after a segment of one has come."""
        if self._ordered:
            return self._in_order()
        if not self._partials[start].complete:
            return []
        return self._partials.pop(start).joined

    def _in_order(self) -> List[bytes]:
        done: List[bytes] = []
        while self._at in self._partials and self._partials[self._at].complete:
            partial = self._partials.pop(self._at)
            self._at += partial.parts
            done += partial.joined
        return done
