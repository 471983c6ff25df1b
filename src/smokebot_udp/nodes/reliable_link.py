# SPDX-License-Identifier: BSD-3-Clause
"""Runs the reliable channels of a node over its transport: what reliable/peers.py decides, on one pair of topics."""
import math
import random
import threading
import time
import zlib
from dataclasses import dataclass, field
from typing import Any, Callable, Counter, Dict, List, Optional, Set, Tuple

import numpy as np
import rospy

from ..congestion.allocation import datagram_size
from ..monitoring.stats import ConnectionStats
from ..msg import ReliableSegment
from ..reliable.bounds import USUAL, Bounds
from ..reliable.conversation import Definition
from ..reliable.events import Event, GivenUp, Joined, Left, Received, Unknown
from ..reliable.pace import MAX_RATE
from ..reliable.peers import Peers, Work
from ..reliable.segment import Segment
from ..streams.segments import room
from ..traffic import EXPEDITED, SENSORS
from ..transport import Transport
from ..udpros.datagram import IP_UDP_HEADERS
from ..udpros.frame import Frame
from .logging import log_error
from .outbox import Outbox
from .worker import DeadlineWorker, PeriodicWorker

TO_ROBOT, TO_OPERATOR = 'to_robot', 'to_operator'
TOPIC = '/smokebot_udp/reliable/'
"""The wire topics are this and the direction."""

SIDES = {'robot': TO_OPERATOR, 'operator': TO_ROBOT}
"""{side: the direction in which it sends}"""

CHECK_PERIOD = 0.5
"""How often the transport is asked for its connections [s]."""

LINK_SHARE, MIN_LIMIT = 0.25, 48e3
"""Of the link's rate, for all that is reliable, 0..1; but at least this, since an idle link's rate is low [byte/s],"""

MOST_SHARE = 0.5
"""up to this part of it."""

BURST_DURATION = 0.012
"""What leaves at once occupies the link for this long, as a datagram does, unless it is one [s]."""

OPERATOR_RATE = 48e3
"""An operator does not know the link's rate [byte/s]."""

MAX_TOLD = 1000
"""Differences of channels that are reported, each once."""

FIELDS = ('kind', 'channel', 'number', 'first', 'part', 'parts', 'next', 'echo', 'arrived', 'session', 'peer')
"""Of ReliableSegment and of Segment."""

Report = Callable[[str], None]
OnMessage = Callable[[str, bytes], None]
OnGivenUp = Callable[[str, int, str], None]
OnJoined = Callable[[str], None]
OnLeft = Callable[[str, str], None]


@dataclass
class ChannelStats:
    """What a channel did until now."""
    sent: int = 0
    """Messages to send, once for each peer that they were for."""
    received: int = 0
    given_up: Dict[str, int] = field(default_factory=dict)
    """{reason: messages that may not have arrived}"""
    waiting: int = 0
    """Messages that were neither acknowledged nor given up now."""

    @property
    def delivered(self) -> int:
        """Messages that were acknowledged."""
        return self.sent - self.waiting - sum(self.given_up.values())


class Channel:
    """One kind of messages, in one direction; made by ReliableLink.channel."""

    def __init__(self, link: 'ReliableLink', definition: Definition, name: str, on_message: Optional[OnMessage],
                 on_given_up: Optional[OnGivenUp], on_joined: Optional[OnJoined], on_left: Optional[OnLeft],
                 on_unknown: Optional[OnJoined]) -> None:
        self.definition, self.name = definition, name
        self._link, self._on_message, self._on_given_up = link, on_message, on_given_up
        self._on_joined, self._on_left, self._on_unknown = on_joined, on_left, on_unknown
        self._stats = ChannelStats()

    def send(self, data: bytes, peer: Optional[str] = None, first: bool = False) -> int:
        """Send a message; any thread.

        :param peer: None: all
        :param first: only to peers for which it is the first one in their present session: what is latched
        :return: the number of peers that it is for; 0: nobody is there, and it is not kept
        :raises ValueError: where it is too long, or this side does not send on the channel
        """
        if not self.definition.sends:
            raise ValueError('this side only receives %s' % self.name)
        count = self._link.send(self, data, peer, first)
        self._stats.sent += count
        return count

    def waiting(self, peer: str) -> int:
        """Messages for a peer that were neither acknowledged nor given up."""
        return self._link.waiting(self, peer)

    def stats(self) -> ChannelStats:
        """What it did until now."""
        self._stats.waiting = self._link.waiting(self)
        return self._stats

    def close(self) -> None:
        """End it; what waits is not sent."""
        self._link.remove(self)

    def take(self, event: Event) -> None:
        """Call the callback for an event; the link's thread."""
        if isinstance(event, Received):
            self._stats.received += 1
            if self._on_message is not None:
                self._on_message(event.peer, event.data)
        elif isinstance(event, GivenUp):
            given_up = self._stats.given_up
            given_up[event.reason] = given_up.get(event.reason, 0) + event.number
            if self._on_given_up is not None:
                self._on_given_up(event.peer, event.number, event.reason)
        elif isinstance(event, Joined) and self._on_joined is not None:
            self._on_joined(event.peer)
        elif isinstance(event, Left) and self._on_left is not None:
            self._on_left(event.peer, event.reason)
        elif isinstance(event, Unknown) and self._on_unknown is not None:
            self._on_unknown(event.peer)


class ReliableLink(rospy.SubscribeListener):
    """The reliable channels of one side; lives as long as its node.

    Callbacks of channels are called in one thread of its own, and have to be short.

    :param side: robot or operator
    :param outbox: what is sent is charged there; None: nobody counts it
    :param report: f(text), called with what somebody has to see to
    """

    def __init__(self, transport: Transport, side: str, outbox: Optional[Outbox] = None,
                 report: Report = rospy.logwarn) -> None:
        super().__init__()
        self._transport, self._outbox, self._report = transport, outbox, report
        self._direction = SIDES[side]
        self._other = TO_ROBOT if self._direction == TO_OPERATOR else TO_OPERATOR
        size = transport.room
        self._headers = size - room(ReliableSegment, size) + transport.overhead + IP_UDP_HEADERS
        self._peers = Peers(lambda: random.SystemRandom().randint(1, 2 ** 32 - 1), room(ReliableSegment, size),
                            self._headers)
        self._peers.pace.limit = OPERATOR_RATE if outbox is None else MAX_RATE
        self._channels: Dict[int, Channel] = {}     # replaced, not changed
        self._told: Set[Tuple[str, int]] = set()    # (peer, channel) that it does not have
        self._lock = threading.Lock()               # of _channels
        self._publisher: Any = None
        self._subscriber: Any = None
        self._log_error = log_error('reliable messages')
        self._worker: DeadlineWorker[Work] = DeadlineWorker(
            'reliable', self._peers.poll, self._peers.deadline, self._work, self._log_error)
        self._checks = PeriodicWorker('reliable peers', self._check_connections, self._log_error, CHECK_PERIOD)

    def start(self) -> None:
        """Begin to exchange messages. Channels that are made later are refused by the other side for a moment."""
        self._worker.start()
        self._publisher = self._transport.publisher(
            TOPIC + self._direction, ReliableSegment, subscriber_listener=self,
            tos=EXPEDITED if self._direction == TO_ROBOT else SENSORS)      # goals and calls, or logs
        self._subscriber = self._transport.subscriber(TOPIC + self._other, ReliableSegment, self._receive)
        self._checks.start()

    def close(self) -> None:
        """End the topics and threads; what waits is not sent."""
        self._checks.stop()
        for topic in (self._subscriber, self._publisher):
            if topic is not None:
                topic.unregister()
        self._worker.close()

    def channel(self, name: str, direction: str, type_name: str, md5: str, *, ordered: bool = True,
                expedited: bool = False, bounds: Bounds = USUAL, on_message: Optional[OnMessage] = None,
                on_given_up: Optional[OnGivenUp] = None, on_joined: Optional[OnJoined] = None,
                on_left: Optional[OnLeft] = None, on_unknown: Optional[OnJoined] = None) -> Channel:
        """Begin a channel. Both sides have to give the same name, direction, type and md5 sum.

        :param direction: TO_ROBOT or TO_OPERATOR
        :param ordered: whether messages are delivered as they were sent; otherwise, as they come
        :param expedited: whether copies are sent before a timeout, as many as the loss takes: for calls
        :param on_message: f(peer, data), called for each message, once
        :param on_given_up: f(peer, count, reason), called for messages that may not have arrived: age, count, bytes,
            restart, left
        :param on_joined: f(peer), called when a session with a node of the other side begins, also after its restart
        :param on_left: f(peer, reason), called when it is over: what was in flight in either direction is lost
        :param on_unknown: f(peer), called when the node of the other side does not have the channel, and again while
            something waits for it
        :raises ValueError: where there is such a channel, or no such direction
        """
        if direction not in (TO_ROBOT, TO_OPERATOR):
            raise ValueError('direction is %r, must be %s or %s' % (direction, TO_ROBOT, TO_OPERATOR))
        number = zlib.crc32('\0'.join((name, direction, type_name, md5)).encode())
        definition = Definition(number, direction == self._direction, ordered, expedited, bounds)
        channel = Channel(self, definition, name, on_message, on_given_up, on_joined, on_left, on_unknown)
        with self._worker.changing():
            self._peers.add(definition)
            with self._lock:
                self._channels = {**self._channels, number: channel}
        return channel

    # -- any thread -----------------------------------------------------------------------------------

    def peers(self) -> Tuple[str, ...]:
        """The names of the nodes of the other side with which messages are exchanged now."""
        with self._worker.lock:
            return self._peers.agreed

    @property
    def room(self) -> int:
        """For data in a datagram now [byte]."""
        return self._peers.room

    def part_of_rate(self, share: float) -> float:
        """A part of the link's rate [byte/s]; infinite: unlimited, or unknown."""
        return share * self._rate

    @property
    def _rate(self) -> float:
        """Of the link [byte/s]; infinite: unlimited, or unknown."""
        rate = None if self._outbox is None else self._outbox.rate
        return math.inf if rate is None else rate

    def stats(self) -> Counter[str]:
        """{reason: segments that were dropped} until now."""
        with self._worker.lock:
            return self._peers.counts()

    def connections(self, sending: bool) -> List[ConnectionStats]:
        """The connections by which all channels of a direction are exchanged.

        :param sending: whether of those on which this side sends
        """
        topic = self._publisher if sending else self._subscriber
        return [] if topic is None else [ConnectionStats(**found) for found in topic.connections()]

    def send(self, channel: Channel, data: bytes, peer: Optional[str], first: bool) -> int:
        """See Channel.send."""
        with self._worker.changing():
            return self._peers.send(channel.definition.number, data, peer, time.monotonic(), first)

    def waiting(self, channel: Channel, peer: Optional[str] = None) -> int:
        """Messages of a channel that were neither acknowledged nor given up.

        :param peer: that they are for; None: all
        """
        with self._worker.lock:
            return self._peers.waiting(channel.definition.number, peer)

    def remove(self, channel: Channel) -> None:
        """See Channel.close."""
        number = channel.definition.number
        with self._worker.changing():
            self._peers.remove(number)
            with self._lock:
                self._channels = {other: one for other, one in self._channels.items() if other != number}

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        """There is a new peer."""
        self._checks.wake()

    # -- the transport's threads ----------------------------------------------------------------------

    def _receive(self, message: Any) -> None:
        values = {name: getattr(message, name) for name in FIELDS}
        segment = Segment(received=bytes(message.received), data=bytes(message.data), seq=message.header.seq, **values)
        with self._worker.changing():
            self._peers.take(message._connection_header['callerid'], segment, time.monotonic())

    # -- its own threads ------------------------------------------------------------------------------

    def _check_connections(self) -> None:
        names = {connection['peer'] for connection in self._publisher.connections()}
        with self._worker.changing():
            self._peers.connect(names, time.monotonic())
            if self._outbox is not None:
                self._follow(self._rate)

    def _follow(self, rate: float) -> None:
        """Adapt to the link's rate [byte/s]: short datagrams, and few at once, for those that wait behind."""
        pace, longest = self._peers.pace, self._transport.room
        pace.limit = min(MAX_RATE, max(LINK_SHARE * rate, min(MIN_LIMIT, MOST_SHARE * rate)))
        pace.most_burst = BURST_DURATION * rate
        self._peers.set_room(room(ReliableSegment, datagram_size(rate, longest)))

    def _work(self, work: Work) -> None:
        for peer, segment in work.segments:
            try:
                self._send(peer, segment)
            except Exception as error:      # the others go on
                self._log_error(error)
        for event in work.events:
            channel = self._channels.get(event.channel)
            if channel is None:
                continue
            try:
                self._tell_unknown(event)
                channel.take(event)
            except Exception as error:      # a fault of one channel must not stop the others
                self._log_error(error)

    def _tell_unknown(self, event: Event) -> None:
        """Report a channel that the other side does not have, once for each peer."""
        key = event.peer, event.channel
        if not isinstance(event, Unknown):
            return
        if key not in self._told and len(self._told) < MAX_TOLD:
            self._told.add(key)
            self._report("%s does not take '%s': its streams.yaml is another one, or it refuses the stream, or its "
                         "messages are of another version" % (event.peer, self._channels[event.channel].name))

    def _send(self, peer: str, segment: Segment) -> None:
        frame = as_frame(segment)
        self._publisher.publish_to(peer, frame)
        if self._outbox is not None:
            self._outbox.charge(1, frame.datagram_size)


def as_frame(segment: Segment) -> Frame:
    """A segment as a datagram."""
    frame = Frame(ReliableSegment, 1, {'received': len(segment.received), 'data': len(segment.data)})
    record = frame.records[0]
    record['header']['seq'] = segment.seq
    for name in FIELDS:
        record[name] = getattr(segment, name)
    for name in ('received', 'data'):
        record[name] = np.frombuffer(getattr(segment, name), np.uint8)
    return frame
