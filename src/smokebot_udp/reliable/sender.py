# SPDX-License-Identifier: BSD-3-Clause
"""The sending side of one channel to one peer: messages are cut into segments, sent, and sent again until acknowledged.

Segments are numbered when they are sent first. At most WINDOW of them are on their way. What exceeds the bounds is
given up, the oldest first; `first` in each segment says so, and ADVANCE where there is no segment to say it.
"""
import collections
import heapq
import math
from typing import Counter, Deque, Dict, List, Optional, Tuple

from .bounds import Bounds
from .pace import MIN_RATE
from .segment import WINDOW, Kind, Segment

COPY_SPACING = 0.008
"""Between copies that do not wait for a timeout: a short burst of losses takes few of them [s]."""

REFUSED_PERIOD = 1.0
"""How often a peer that does not have the channel is asked again [s]."""


class _Message:
    """One that was not acknowledged yet."""
    __slots__ = ('data', 'made', 'moved', 'room', 'start', 'parts', 'taken', 'left')

    def __init__(self, data: bytes, made: float, room: int) -> None:
        self.data, self.made, self.room = data, made, room
        self.moved = made               # when it was made, or a segment of it was acknowledged last
        self.start = 0                  # number of its first segment, 0: none was sent
        self.parts = self.left = max(1, -(-len(data) // room))      # segments: all; that were not acknowledged
        self.taken = 0                  # segments that were sent

    def part(self, number: int) -> bytes:
        return self.data[number * self.room:(number + 1) * self.room]


class _Flight:
    """A segment that was sent, and not acknowledged."""
    __slots__ = ('message', 'part', 'size', 'tries', 'begun', 'due')

    def __init__(self, message: _Message, part: int) -> None:
        self.message, self.part = message, part
        self.size = min(message.room, len(message.data))
        self.tries, self.begun, self.due = 0, 0.0, 0.0      # begun: when the first of the present copies was sent


class ReliableSender:
    """Sends messages, each until it is acknowledged or given up. Times are by a steady clock [s].

    :param channel: its number
    :param room: for data in a segment of later messages; may be set at any time [byte]
    """

    def __init__(self, channel: int, bounds: Bounds, room: int) -> None:
        self.bounds, self.room = bounds, room
        self.given_up: Counter[str] = collections.Counter()
        """{reason: messages that may not have arrived}: age, count, bytes, restart."""
        self.acknowledged = 0
        """Messages."""
        self._channel = channel
        self._pause = -math.inf     # nothing is sent before this time
        self._messages: Deque[_Message] = collections.deque()       # the oldest first; those sent before those not
        self._unsent: Deque[_Message] = collections.deque()         # of which segments were not sent
        self._count = self._bytes = 0
        self._renumber()

    def _renumber(self) -> None:
        self._frontier, self._peer_next = 1, 1      # next number; what the peer waits for
        self._flights: Dict[int, _Flight] = {}
        self.flying = 0
        """Data of the segments that were sent, and not acknowledged [byte]."""
        self._dues: List[Tuple[float, int]] = []    # a heap of (when, number), some out of date
        self._advance_due = -math.inf

    @property
    def waiting(self) -> int:
        """Messages that were neither acknowledged nor given up."""
        return self._count

    @property
    def unused(self) -> bool:
        """Whether the peer has got nothing in its present session, and nothing waits for it."""
        return self._frontier == 1 and not self._messages

    @property
    def expects_answer(self) -> bool:
        """Whether something was sent that the peer has to acknowledge."""
        return bool(self._flights) or (self.first > self._peer_next and self._advance_due > -math.inf)

    def send(self, data: bytes, now: float) -> None:
        """Send a message; older ones are given up where there are too many.

        :raises ValueError: where it is longer than the bounds allow
        """
        if len(data) > self.bounds.bytes:
            raise ValueError('it has %d bytes, must be at most %d' % (len(data), self.bounds.bytes))
        message = _Message(data, now, self.room)
        self._messages.append(message)
        self._unsent.append(message)
        self._count += 1
        self._bytes += len(data)
        while self._count > self.bounds.messages:
            self._give_up('count')
        while self._bytes > self.bounds.bytes:
            self._give_up('bytes')

    def expire(self, now: float) -> None:
        """Give up what is too old."""
        while now >= self.expires():
            self._give_up('age')

    def renew(self) -> None:
        """The peer has a new session. What was sent may have reached the old one, so it must not be sent again."""
        while self._messages and (self._messages[0].start or self.bounds.one_session):
            self._give_up('restart')
        self._pause = -math.inf
        self._renumber()

    def close(self, reason: str) -> None:
        """Give up everything."""
        while self._messages:
            self._give_up(reason)

    def refused(self, now: float) -> None:
        """The peer does not have the channel, maybe not yet."""
        self._pause, self._advance_due = now + REFUSED_PERIOD, math.inf

    def acknowledge(self, next_: int, received: bytes, now: float) -> None:
        """Take an acknowledgement, see msg/ReliableSegment.

        :raises ValueError: where it is of segments that were never sent
        """
        bits = int.from_bytes(received, 'little')
        if not 1 <= next_ <= self._frontier or bits >> max(0, self._frontier - next_ - 1):
            raise ValueError('acknowledgement of what was never sent')
        if not self._flights:
            self._peer_next = max(self._peer_next, next_)
            return
        for number in [number for number in self._flights
                       if number < next_ or (number > next_ and bits >> (number - next_ - 1) & 1)]:
            self._arrived(self._land(number).message, now)
        self._peer_next = max(self._peer_next, next_)

    def _land(self, number: int) -> _Flight:
        """A segment is not sent any more."""
        flight = self._flights.pop(number)
        self.flying -= flight.size
        return flight

    def _arrived(self, message: _Message, now: float) -> None:
        """A segment of a message was acknowledged."""
        message.left -= 1
        if message.left:
            message.moved = now
            return
        self.acknowledged += 1
        self._forget(message)
        while self._messages and not self._messages[0].left:
            self._messages.popleft()

    def _forget(self, message: _Message) -> None:
        self._count -= 1
        self._bytes -= len(message.data)
        message.data = b''

    def _give_up(self, reason: str) -> None:
        """Give up the oldest message; those that were acknowledged behind it are done with."""
        message = self._messages.popleft()
        self.given_up[reason] += 1
        self._forget(message)
        for number in range(message.start, message.start + message.taken):
            if number in self._flights:
                self._land(number)
        if message.start and message.taken < message.parts:
            self._frontier = message.start + message.parts      # its other numbers are never used
        if self._unsent and self._unsent[0] is message:
            self._unsent.popleft()
        while self._messages and not self._messages[0].left:
            self._messages.popleft()
        self._advance_due = -math.inf

    @property
    def first(self) -> int:
        """The first segment of the oldest message that is still sent."""
        return (self._messages[0].start if self._messages else 0) or self._frontier

    def take(self, now: float, interval: float, copies: int = 1, new: bool = True) -> Optional[Segment]:
        """The segment to send now; None: there is none.

        :param interval: time until it is sent again [s]
        :param copies: how often it is sent before that
        :param new: whether also one that was not sent yet
        """
        if now < self._pause:
            return None
        due = self._next_due()
        if due is not None and due <= now:
            return self._data(heapq.heappop(self._dues)[1], now, interval, copies)
        if new and self._may_begin():
            return self._data(self._begin(), now, interval, copies)
        if self._advance_at() <= now:
            self._advance_due = now + interval
            return Segment(Kind.ADVANCE, self._channel, first=self.first)
        return None

    def due(self, new: bool = True) -> float:
        """When `take` has a segment next [s]; infinite: never."""
        due = self._next_due()
        when = -math.inf if new and self._may_begin() else min(math.inf if due is None else due, self._advance_at())
        return max(when, self._pause)

    def expires(self) -> float:
        """When `expire` has something to give up next [s]; infinite: never."""
        if len(self._messages) <= self.bounds.keeps_last:
            return math.inf
        oldest = self._messages[0]
        return self.bounds.age + min(oldest.moved, oldest.made + len(oldest.data) / MIN_RATE)

    def _next_due(self) -> Optional[float]:
        """When a segment is sent again next."""
        while self._dues:
            due, number = self._dues[0]
            flight = self._flights.get(number)
            if flight is not None and flight.due == due:
                return due
            heapq.heappop(self._dues)
        return None

    def _may_begin(self) -> bool:
        """Whether there is a segment that was not sent, and room for it in the window."""
        return bool(self._unsent) and self._frontier < max(self.first, self._peer_next) + WINDOW

    def _begin(self) -> int:
        """Number the next segment."""
        message, number = self._unsent[0], self._frontier
        if not message.start:
            message.start = number
        self._flights[number] = _Flight(message, message.taken)
        self.flying += self._flights[number].size
        message.taken += 1
        self._frontier += 1
        if message.taken == message.parts:
            self._unsent.popleft()
        return number

    def _advance_at(self) -> float:
        """When ADVANCE is sent next: only where no segment is on its way that says the same."""
        return math.inf if self._flights or self.first <= self._peer_next else self._advance_due

    def _data(self, number: int, now: float, interval: float, copies: int) -> Segment:
        flight = self._flights[number]
        if flight.tries % copies == 0:
            flight.begun = now
        flight.tries += 1
        flight.due = now + COPY_SPACING if flight.tries % copies else max(flight.begun + interval, now + COPY_SPACING)
        heapq.heappush(self._dues, (flight.due, number))
        message = flight.message
        return Segment(Kind.DATA, self._channel, number, self.first, flight.part, message.parts,
                       data=message.part(flight.part))
