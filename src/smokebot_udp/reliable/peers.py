# SPDX-License-Identifier: BSD-3-Clause
"""The reliable channels of a node with all nodes of the other side: everything that decides, without I/O.

All peers share one token bucket. Acknowledgements and greetings do not wait for it, nor do expedited channels, which
have one of their own, of the same rate; but they count.
"""
import collections
import math
from typing import Callable, Counter, Dict, Iterable, List, NamedTuple, Optional, Tuple

from .conversation import Conversation, Definition
from .events import Event
from .pace import EXPEDITED_BURST, Pace
from .segment import Segment

FORGET_AFTER = 60.0
"""A peer that is not connected is forgotten after this time [s]. One that comes back later has to agree anew."""

MAX_PEERS = 16
"""Peers beyond these are not served."""

MAX_BATCH = 32
"""Segments that `poll` returns at once."""


class Work(NamedTuple):
    """What is to be done now."""
    events: List[Event]
    segments: List[Tuple[str, Segment]]
    """(peer, segment) to be sent."""


class Peers:
    """Times are by a steady clock [s].

    :param random: f() -> a random number of 32 bits other than 0
    :param room: for data in a segment [byte]
    :param headers: of a segment on the air, besides its data [byte]
    """

    def __init__(self, random: Callable[[], int], room: int, headers: int) -> None:
        self.pace, self._express = Pace(), Pace(burst=EXPEDITED_BURST)
        self.dropped: Counter[str] = collections.Counter()
        """{reason: segments} of nobody, and of peers that were forgotten."""
        self._random, self._room, self._headers = random, room, headers
        self._conversations: Dict[str, Conversation] = {}
        self._definitions: Dict[int, Definition] = {}
        self._events: List[Event] = []

    @property
    def room(self) -> int:
        """For data in a segment [byte]."""
        return self._room

    @property
    def agreed(self) -> Tuple[str, ...]:
        """The peers that are connected, with agreed sessions."""
        return tuple(name for name, one in self._conversations.items() if one.sends)

    def set_room(self, room: int) -> None:
        """Change the room for data in a segment of later messages [byte]."""
        self._room = room
        for conversation in self._conversations.values():
            conversation.set_room(room)

    def add(self, definition: Definition) -> None:
        """Begin a channel.

        :raises ValueError: where there is one of this number
        """
        if definition.number in self._definitions:
            raise ValueError('there is such a channel already')
        self._definitions[definition.number] = definition
        for conversation in self._conversations.values():
            conversation.add(definition)

    def remove(self, channel: int) -> None:
        """End a channel; what waits is given up."""
        self._definitions.pop(channel, None)
        for conversation in self._conversations.values():
            conversation.remove(channel)

    def connect(self, names: Iterable[str], now: float) -> None:
        """Take the peers that are connected now; some that are not are remembered."""
        connected = set(names)
        for name in sorted(connected):
            conversation = self._conversations.get(name)
            if conversation is None:
                self._begin(name, now)
            elif not conversation.connected:
                conversation.connected = True
                conversation.greeting.restart(now)
        for name, conversation in list(self._conversations.items()):
            if name in connected:
                conversation.seen = now
            else:
                conversation.connected = False
                if now - conversation.seen >= FORGET_AFTER:
                    self._forget(name)

    def _begin(self, name: str, now: float) -> None:
        """A new peer."""
        if len(self._conversations) >= MAX_PEERS:
            absent = [name for name, one in self._conversations.items() if not one.connected]
            if not absent:
                self.dropped['too many peers'] += 1
                return
            self._forget(min(absent, key=lambda name: self._conversations[name].seen))
        conversation = self._conversations[name] = Conversation(name, self._random, self._room, self.pace, now)
        for definition in self._definitions.values():
            conversation.add(definition)

    def _forget(self, name: str) -> None:
        conversation = self._conversations.pop(name)
        conversation.close('left')
        self._events += conversation.events
        self.dropped.update(conversation.counts())

    def counts(self) -> Counter[str]:
        """{reason: segments that were dropped} until now; 'repeated' are copies that were not needed."""
        found = collections.Counter(self.dropped)
        for conversation in self._conversations.values():
            found.update(conversation.counts())
        return found

    def send(self, channel: int, data: bytes, peer: Optional[str], now: float, first: bool = False) -> int:
        """Send a message; returns the number of peers that it is for, none after the end of the channel.

        :param peer: None: all
        :param first: only to peers for which it is the first one in their present session
        :raises ValueError: where it is too long
        """
        if channel not in self._definitions:
            return 0
        found = [one for name, one in self._conversations.items()
                 if peer in (None, name) and not (first and not one.senders[channel].unused)]
        for conversation in found:
            conversation.send(channel, data, now)
        return len(found)

    def waiting(self, channel: int, peer: Optional[str] = None) -> int:
        """Messages of a channel that were neither acknowledged nor given up.

        :param peer: that they are for; None: all
        """
        return sum(one.senders[channel].waiting for name, one in self._conversations.items()
                   if channel in one.senders and peer in (None, name))

    def take(self, peer: str, segment: Segment, now: float) -> None:
        """Take a segment of a peer."""
        conversation = self._conversations.get(peer)
        if conversation is None:
            self.dropped['unknown peer'] += 1
        else:
            conversation.take(segment, now)

    def poll(self, now: float) -> Optional[Work]:
        """What is to be done now; None: nothing."""
        segments: List[Tuple[str, Segment]] = []
        self._express.limit = self.pace.rate
        for name, conversation in self._conversations.items():
            segments += [(name, self._charged(segment, now)) for segment in conversation.poll(now)]
        for expedited, pace in ((True, self._express), (False, self.pace)):
            for name, conversation in self._turns():
                while len(segments) < MAX_BATCH and pace.free(now):
                    segment = conversation.take_data(expedited, now)
                    if segment is None:
                        break
                    segments.append((name, self._charged(segment, now, expedited)))
        events = self._drain()
        return Work(events, segments) if events or segments else None

    def _turns(self) -> List[Tuple[str, Conversation]]:
        """The peers in the order in which their data is sent; another one is the first each time."""
        names = list(self._conversations)
        if len(names) > 1:
            self._conversations[names[0]] = self._conversations.pop(names[0])
        return list(self._conversations.items())

    def _charged(self, segment: Segment, now: float, expedited: bool = False) -> Segment:
        size = self._headers + len(segment.data) + len(segment.received)
        self.pace.charge(size, now)
        if expedited:
            self._express.charge(size, now)
        return segment

    def _drain(self) -> List[Event]:
        """The events since the last call."""
        events, self._events = self._events, []
        for conversation in self._conversations.values():
            events += conversation.events
            conversation.events = []
        return events

    def deadline(self) -> float:
        """When `poll` has something to do next [s]; infinite: never."""
        if self._events or any(one.events for one in self._conversations.values()):
            return -math.inf
        return min((min(one.deadline(), max(one.data_due(True), self._express.free_at),
                        max(one.data_due(False), self.pace.free_at))
                    for one in self._conversations.values()), default=math.inf)
