# SPDX-License-Identifier: BSD-3-Clause
"""Runs the reliable channels of a node over its transport: what reliable/peers.py decides, on one pair of topics."""
import math
import random
import time
from typing import Any, Callable, Counter, Dict, List, Optional, Set, Tuple

import numpy as np
import rospy

from ..congestion.allocation import datagram_size
from ..monitoring.stats import ConnectionStats
from ..msg import ReliableSegment
from ..newest import Newest
from ..reliable.events import Unknown
from ..reliable.pace import MAX_RATE
from ..reliable.peers import Peers, Work
from ..reliable.segment import Segment
from ..streams.relay.parameters import TO_OPERATOR, TO_ROBOT
from ..streams.segments import room
from ..traffic import EXPEDITED, SENSORS
from ..transport import Transport
from ..udpros.datagram import IP_UDP_HEADERS
from ..udpros.frame import Frame
from .channel import NO_LISTENER, Channel, ChannelKind, ChannelListener
from .logging import log_error
from .opened import Part
from .outbox import Outbox
from .worker import DeadlineWorker, PeriodicWorker

TOPIC = '/smokebot_udp/reliable/'
"""The wire topics are this and the direction."""

SIDES = {'robot': TO_OPERATOR, 'operator': TO_ROBOT}
"""{side: the direction in which it sends}"""

CHECK_PERIOD = 0.5
"""How often the transport is asked for its connections [s]."""

LINK_SHARE, MIN_LIMIT = 0.25, 48e3
"""Share of the link's rate for all reliable channels, 0..1, and the rate that they may take at least, since an idle
link's rate is low [byte/s]."""

MOST_SHARE = 0.5
"""Maximum share of the link's rate that MIN_LIMIT may take, 0..1."""

BURST_DURATION = 0.012
"""Maximum time for which data that leaves at once occupies the link, unless it is a single datagram [s]."""

OPERATOR_RATE = 48e3
"""Maximum rate of an operator's reliable channels: an operator does not know the link's rate [byte/s]."""

MAX_TOLD = 1000
"""Maximum number of differences between the channels of both sides that are reported. Each is reported once."""

UNKNOWN_FOR, UNKNOWN_GAP = 1.5, 3.0
"""A channel is reported which the other side has not had for this long; an answer after a longer gap begins anew. Who
starts or ends has for a moment not all of its channels. A peer is asked each REFUSED_PERIOD [s]."""

FIELDS = ('kind', 'channel', 'number', 'first', 'part', 'parts', 'next', 'echo', 'arrived', 'session', 'peer')
"""Names of the fields that are copied unchanged between ReliableSegment and Segment."""


class ReliableLink(Part, rospy.SubscribeListener):
    """The reliable channels of one side; lives as long as its node. What waits at its end is not sent.

    Listeners of channels are called in one thread of its own.

    :param side: robot or operator
    :param outbox: what is sent is charged there; None: nobody counts it
    :param report: f(text), called with what somebody has to see to
    """

    def __init__(self, transport: Transport, side: str, outbox: Optional[Outbox] = None,
                 report: Callable[[str], None] = rospy.logwarn) -> None:
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
        self._told: Set[Tuple[str, str]] = set()    # (peer, channel) that it does not have
        self._unknown: Newest[Tuple[str, str], Tuple[float, float]] = Newest(MAX_TOLD)  # first, last told so [s]
        self._publisher: Any = None
        self._subscriber: Any = None
        self._log_error = log_error('reliable messages')
        self._worker: DeadlineWorker[Work] = DeadlineWorker(
            'reliable', self._peers.poll, self._peers.deadline, self._work, self._log_error)
        self._checks = PeriodicWorker('reliable peers', self._check_connections, self._log_error, CHECK_PERIOD)

    def start(self) -> None:
        """Begin to exchange messages. Channels that are made later are refused by the other side for a moment."""
        self._opened.started(self._worker)
        self._publisher = self._opened.topic(self._transport.publisher(
            TOPIC + self._direction, ReliableSegment, subscriber_listener=self,
            tos=EXPEDITED if self._direction == TO_ROBOT else SENSORS,      # goals and calls, or logs
            copied=self._direction == TO_ROBOT))
        self._subscriber = self._opened.topic(self._transport.subscriber(TOPIC + self._other, ReliableSegment,
                                                                         self._receive))
        self._opened.started(self._checks)

    def channel(self, kind: ChannelKind, listener: ChannelListener = NO_LISTENER) -> Channel:
        """Begin a channel.

        :raises ValueError: where there is such a channel, or no such direction
        """
        definition = kind.definition(self._direction)
        channel = Channel(kind.name, definition, listener, self._peers, self._worker)
        with self._worker.changing():
            self._peers.add(definition)
            self._channels = {**self._channels, definition.number: channel}
        return channel

    # -- any thread -----------------------------------------------------------------------------------

    def peers(self) -> Tuple[str, ...]:
        """The names of the nodes of the other side with which messages are exchanged now."""
        with self._worker.lock:
            return self._peers.agreed

    @property
    def room(self) -> int:
        """Space for data in a datagram now [byte]."""
        return self._peers.room

    def part_of_rate(self, share: float) -> float:
        """A part of the link's rate [byte/s]; infinite: unlimited, or unknown."""
        return share * self._rate

    @property
    def _rate(self) -> float:
        """The rate of the link [byte/s]; infinite: unlimited, or unknown."""
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
            if channel is None or channel.closed:
                continue
            try:
                if isinstance(event, Unknown):
                    self._tell_unknown(event.peer, channel.name)
                channel.take(event)
            except Exception as error:      # a fault of one channel must not stop the others
                self._log_error(error)

    def _tell_unknown(self, peer: str, name: str) -> None:
        """Report a channel that the other side does not have, once for each peer."""
        now = time.monotonic()
        first, last = self._unknown.get((peer, name), (now, now))
        first = now if now - last > UNKNOWN_GAP else first
        self._unknown[peer, name] = first, now
        if now - first >= UNKNOWN_FOR and (peer, name) not in self._told and len(self._told) < MAX_TOLD:
            self._told.add((peer, name))
            self._report("%s does not take '%s': its streams.yaml is another one, or it refuses the stream, or its "
                         'messages are of another version' % (peer, name))

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
