# SPDX-License-Identifier: BSD-3-Clause
"""All that a node has with one node of the other side: their sessions, and a sender or a receiver for each channel."""
import collections
import math
from typing import Callable, Counter, Dict, List, NamedTuple, Optional

from ..newest import Newest
from .bounds import Bounds
from .events import Event, GivenUp, Joined, Left, Received, Unknown
from .greeting import Greeting
from .loss import EXPEDITED, ORDINARY, LossMeter
from .pace import Pace
from .receiver import ReliableReceiver
from .round_trip import RoundTrip
from .segment import WINDOW, Kind, Segment
from .sender import ReliableSender

REMEMBERED = 1024
"""Segments whose departure is remembered, to measure the round trip."""

OVERHEAD = 100
"""What a segment takes besides its data, for the shares of channels [byte]."""

MAX_UNKNOWN = 16
"""Channels that this side does not have, and that wait for an answer."""


class Definition(NamedTuple):
    """A channel as one side has it."""
    number: int
    sends: bool
    """Whether this side sends."""
    ordered: bool
    expedited: bool
    """Whether copies are sent before a timeout, as many as the loss takes."""
    bounds: Bounds


class Conversation:
    """The sessions and channels with one peer. Times are by a steady clock [s].

    :param peer: its name
    :param random: f() -> a random number of 32 bits other than 0
    :param room: for data in a segment [byte]
    :param pace: shared by all peers
    """

    def __init__(self, peer: str, random: Callable[[], int], room: int, pace: Pace, now: float) -> None:
        self.peer = peer
        self.connected, self.seen = True, now
        """Whether the transport has a connection to it; when it had one last [s]."""
        self.dropped: Counter[str] = collections.Counter()
        """{reason: segments}"""
        self.events: List[Event] = []
        self.greeting = Greeting(random, now)
        self.round_trip, self.loss = RoundTrip(), LossMeter()
        self.senders: Dict[int, ReliableSender] = {}
        self.receivers: Dict[int, ReliableReceiver] = {}
        self._definitions: Dict[int, Definition] = {}
        self._room, self._pace = room, pace
        self._seq = self._arrived = 0
        self._departures: Newest[int, float] = Newest(REMEMBERED)
        self._acknowledgements: Dict[int, int] = {}     # {channel: seq of what caused it}
        self._unknown: Dict[int, int] = {}              # likewise
        self._virtual = 0.0     # start-time fair queueing of channels, as in congestion/packet_scheduler.py [byte]
        self._starts: Dict[int, float] = {}
        self._joined = False    # whether there was a session
        self._heard = now       # or when something was sent to a peer that owed no answer

    def add(self, definition: Definition) -> None:
        """Begin a channel."""
        self._definitions[definition.number] = definition
        if definition.sends:
            self.senders[definition.number] = ReliableSender(definition.number, definition.bounds, self._room)
            self._starts[definition.number] = self._virtual
        else:
            self.receivers[definition.number] = ReliableReceiver(definition.ordered, definition.bounds.bytes)
        if self.greeting.remote:
            self.events.append(Joined(self.peer, definition.number))

    def set_room(self, room: int) -> None:
        """Change the room for data in a segment of later messages [byte]."""
        self._room = room
        for sender in self.senders.values():
            sender.room = room

    def remove(self, channel: int) -> None:
        """End a channel."""
        self._definitions.pop(channel, None)
        self.senders.pop(channel, None)
        self.receivers.pop(channel, None)
        self._acknowledgements.pop(channel, None)
        self._starts.pop(channel, None)

    def send(self, channel: int, data: bytes, now: float) -> None:
        """Send a message, see ReliableSender.send."""
        self.senders[channel].send(data, now)
        self._collect(channel)

    def close(self, reason: str) -> None:
        """The peer is forgotten."""
        for channel, sender in self.senders.items():
            sender.close(reason)
            self._collect(channel)
        if self.greeting.remote:
            self._tell_all(lambda channel: Left(self.peer, channel, reason))

    # -- what the peer sends --------------------------------------------------------------------------

    def take(self, segment: Segment, now: float) -> None:
        """Take a segment of the peer. One that is refused is counted."""
        try:
            if segment.kind == Kind.GREETING:
                if self.greeting.take(segment, now):
                    self._renew(now)
                return
            if not self.greeting.remote or (segment.session, segment.peer) != (
                    self.greeting.remote, self.greeting.local):
                if segment.session:
                    self.greeting.stranger(segment.session, 0, now)
                raise ValueError('session')
            self._heard = max(self._heard, now)
            self._arrived += 1
            self._take_part(segment, now)
        except ValueError as error:
            self.dropped[str(error)] += 1

    def _take_part(self, segment: Segment, now: float) -> None:
        """Take a segment of a channel.

        :raises ValueError: where it is refused, with the reason
        """
        channel, sends = segment.channel, segment.kind in (Kind.ACKNOWLEDGEMENT, Kind.UNKNOWN)
        if segment.kind not in (Kind.DATA, Kind.ADVANCE) and not sends:
            raise ValueError('kind')
        if sends:
            sender = self.senders.get(channel)
            if sender is None:
                raise ValueError('answer on an unknown channel')
            self._take_answer(sender, segment, now)
        elif channel in self.receivers:
            self._take_data(self.receivers[channel], segment)
        else:
            if len(self._unknown) < MAX_UNKNOWN:
                self._unknown[channel] = segment.seq
            raise ValueError('unknown channel')

    def _take_answer(self, sender: ReliableSender, segment: Segment, now: float) -> None:
        if segment.kind == Kind.UNKNOWN:
            sender.refused(now)
            self.events.append(Unknown(self.peer, segment.channel))
            return
        if len(segment.received) > WINDOW // 8:
            raise ValueError('malformed')
        sender.acknowledge(segment.next, segment.received, now)
        departed = self._departures.pop(segment.echo, None)
        if departed is not None:
            self.round_trip.add(now - departed)
            self.loss.add(segment.echo, segment.arrived)
            self._pace.observe(now - departed, self.round_trip.least, self.loss.loss, now)

    def _take_data(self, receiver: ReliableReceiver, segment: Segment) -> None:
        if segment.kind == Kind.DATA:
            done = receiver.take(segment)
            if done is None:
                return      # it is counted there
        else:
            done = receiver.advance(segment.first)
        self._acknowledgements[segment.channel] = segment.seq
        self.events += [Received(self.peer, segment.channel, data) for data in done]

    def _renew(self, now: float) -> None:
        """The peer has another session than before, or the first one."""
        if self.greeting.round_trip is not None:
            self.round_trip.add(self.greeting.round_trip)
        self._arrived, self._heard = 0, now
        self.loss.renew()
        self._departures.clear()
        self._acknowledgements.clear()
        self._unknown.clear()
        for channel, sender in self.senders.items():
            sender.renew()
            self._collect(channel)
        for receiver in self.receivers.values():
            receiver.renew()
        if self._joined:
            self._tell_all(lambda channel: Left(self.peer, channel, 'restart'))
        self._joined = True
        self._tell_all(lambda channel: Joined(self.peer, channel))

    # -- what is sent ---------------------------------------------------------------------------------

    def poll(self, now: float) -> List[Segment]:
        """Greetings and acknowledgements to send now; what is too old is given up."""
        for channel, sender in self.senders.items():
            sender.expire(now)
            self._collect(channel)
        if not self.connected:
            return []
        greeting = self.greeting.poll(now)
        found = [] if greeting is None else [greeting]
        for channel, echo in self._unknown.items():
            found.append(self._addressed(Segment(Kind.UNKNOWN, channel, echo=echo)))
        for channel, echo in self._acknowledgements.items():
            receiver = self.receivers[channel]
            found.append(self._addressed(Segment(
                Kind.ACKNOWLEDGEMENT, channel, next=receiver.next, received=receiver.received, echo=echo,
                arrived=self._arrived)))
        self._unknown.clear()
        self._acknowledgements.clear()
        return [self._numbered(segment) for segment in found]

    def take_data(self, expedited: bool, now: float) -> Optional[Segment]:
        """The segment of a message to send now; None: there is none.

        :param expedited: whether of the channels that are, or of the others
        """
        if not self.sends:
            return None
        if not any(sender.expects_answer for sender in self.senders.values()):
            self._heard = now
        interval = self.round_trip.interval(now - self._heard)
        copies = self.loss.copies(EXPEDITED if expedited else ORDINARY)
        new = expedited or not self._full
        for channel in sorted(self.senders, key=self._turn):
            if self._definitions[channel].expedited != expedited:
                continue
            segment = self.senders[channel].take(now, interval, copies, new)
            if segment is not None:
                self._virtual = max(self._virtual, self._starts[channel])
                self._starts[channel] = self._virtual + OVERHEAD + len(segment.data)
                return self._numbered(self._addressed(segment), now)
        return None

    def _turn(self, channel: int) -> float:
        """Channels share what there is, in bytes."""
        return self._starts[channel]

    @property
    def sends(self) -> bool:
        """Whether messages can be sent now."""
        return self.connected and bool(self.greeting.remote)

    @property
    def _full(self) -> bool:
        """Whether nothing more may be on its way, expedited channels excepted."""
        flying = sum(sender.flying for channel, sender in self.senders.items()
                     if not self._definitions[channel].expedited)
        return flying >= self._pace.window(self.round_trip.least)

    def data_due(self, expedited: bool) -> float:
        """When `take_data` has a segment next [s]; infinite: never."""
        if not self.sends:
            return math.inf
        new = expedited or not self._full
        return min((sender.due(new) for channel, sender in self.senders.items()
                    if self._definitions[channel].expedited == expedited), default=math.inf)

    def deadline(self) -> float:
        """When `poll` has something to do next [s]; infinite: never."""
        expires = min((sender.expires() for sender in self.senders.values()), default=math.inf)
        if not self.connected:
            return expires
        if self._acknowledgements or self._unknown:
            return -math.inf
        return min(expires, self.greeting.deadline())

    def _addressed(self, segment: Segment) -> Segment:
        return segment._replace(session=self.greeting.local, peer=self.greeting.remote)

    def _numbered(self, segment: Segment, departs: Optional[float] = None) -> Segment:
        self._seq += 1
        if departs is not None:
            self._departures[self._seq] = departs
        return segment._replace(seq=self._seq)

    # -- events ---------------------------------------------------------------------------------------

    def _collect(self, channel: int) -> None:
        """Make events of what a sender gave up."""
        given_up = self.senders[channel].given_up
        self.events += [GivenUp(self.peer, channel, count, reason) for reason, count in given_up.items()]
        given_up.clear()

    def _tell_all(self, event: Callable[[int], Event]) -> None:
        self.events += [event(channel) for channel in self._definitions]

    def counts(self) -> Counter[str]:
        """{reason: segments that were dropped}"""
        found = collections.Counter(self.dropped)
        for receiver in self.receivers.values():
            found.update(receiver.dropped)
        return found
