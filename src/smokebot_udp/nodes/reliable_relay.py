# SPDX-License-Identifier: BSD-3-Clause
"""Relays with `reliable`: every message of a topic of one side is published on the other one, once and in order.

The side that sends has a source, the other one a sink; the direction decides which is which. With `latch`, the last
message goes to each node of the other side that joins, and its subscribers get it whenever they come.
"""
import threading
import time
from typing import Any, Callable, Dict, Mapping, Optional

import rospy

from .. import udpros
from ..limited_log import ERROR_PERIOD, logerr, logwarn
from ..monitoring import sources
from ..monitoring.stats import StreamStats
from ..packed import pack, unpack
from ..reliable.bounds import Bounds
from ..serialised import deserialised, serialised
from ..streams import live_tables
from ..streams.message_types import message_class
from ..streams.relay.contents import QUEUE, Contents, Turns, kept_together, publisher_of
from ..streams.relay.parameters import LEVEL_VALUES, LOG, TO_OPERATOR, TO_ROBOT
from .channel import Channel, ChannelKind, ChannelListener
from .reliable_link import ReliableLink
from .way import WayBackStream
from .worker import PeriodicWorker

RECENT = 10.0
"""Time for which what was given up is a problem in diagnostics [s]."""

STATES_SHARE = 0.03
"""Share of the link's rate for the states of one relay with `newest`, to each peer."""

TURN_PERIOD = 0.05
"""Interval at which a relay with `newest` checks whether a peer has received the last message [s]."""

Rewrite = Callable[[Any], Any]
"""f(message) -> the message that is sent, or published"""

REASONS = {'age': 'not acknowledged in time', 'count': 'more than max_messages waited',
           'bytes': 'more than max_bytes waited', 'restart': 'the other side was restarted',
           'left': 'the other side has left'}


class ReliableRelay(WayBackStream):
    """One relay on one side.

    :param name: of the stream in streams.yaml
    :param settings: {name: value}, checked
    :param sends: whether this side sends
    :param topic: of this side, resolved
    :raises ValueError: where the settings are impossible
    """

    def __init__(self, name: str, settings: Mapping[str, Any], link: ReliableLink, sends: bool, topic: str) -> None:
        self._on_robot = sends == (settings['direction'] == TO_OPERATOR)
        super().__init__(name, topic, settings, live_tables(settings).robot if self._on_robot else {})
        self._link, self._sends, self._direction = link, sends, settings['direction']
        self._class, self._latch = message_class(settings['message_type']), settings['latch']
        # a message to the robot expires also where it is latched
        self._bounds = Bounds(settings['max_messages'], settings['max_bytes'], settings['max_age'],
                              keeps_last=self._latch and self._direction == TO_OPERATOR)
        self._channel: Optional[Channel] = None     # made by start()

    @property
    def _off(self) -> bool:
        """Whether the robot's side relays nothing."""
        return self._on_robot and not self.settings.current['enabled']

    def _open_channel(self, listener: ChannelListener) -> None:
        self._channel = self._opened.add(self._link.channel(ChannelKind(
            'relay ' + self.name, self._direction, self._class._type, self._class._md5sum, bounds=self._bounds),
            listener))

    def _stats(self, received: int, sent: int, dropped: Dict[str, int], problem: Optional[str]) -> StreamStats:
        return StreamStats(
            received, sent, enabled=not self._off, steady=False,
            dropped={reason: count for reason, count in dropped.items() if count},
            connections=self._link.connections(self._sends), to_robot=self._direction == TO_ROBOT, problem=problem)


class Source(ReliableRelay):
    """The side that sends: subscribes the topic.

    Transforms, for one, that are latched come from many publishers: they are merged, so that the last message has them
    all.

    :param rewrite: see Rewrite
    """

    def __init__(self, name: str, settings: Mapping[str, Any], link: ReliableLink, topic: str,
                 rewrite: Rewrite = lambda message: message) -> None:
        super().__init__(name, settings, link, True, topic)
        self.source = sources.Source(sources.TOPIC, topic, self._class._type)
        self._rewrite = rewrite
        self._is_log = settings['message_type'] == LOG
        self._level = LEVEL_VALUES.get(settings['level'], 0)
        self._together = self._latch and kept_together(self._class)
        self._kept: Optional[Contents] = None       # what was latched until now, with _together
        self._latched: Optional[bytes] = None
        self._latched_at = 0.0
        self._received = self._invalid = self._nobody = 0
        self._lock = threading.Lock()       # of what is latched: rospy calls from several threads
        self._lost_at: Optional[float] = None
        self._problem = ''

    def start(self) -> None:
        """See WayBackStream."""
        self._open_channel(ChannelListener(given_up=self._given_up, joined=self._joined))
        self._opened.topic(rospy.Subscriber(self.topic, self._class, self._receive, queue_size=QUEUE,
                                            tcp_nodelay=True))

    def stats(self) -> StreamStats:
        """See WayBackStream."""
        channel = self._channel.stats() if self._channel is not None else None
        given_up = {} if channel is None else {'given up: ' + REASONS.get(reason, reason): count
                                               for reason, count in channel.given_up.items()}
        recent = self._lost_at is not None and time.monotonic() - self._lost_at < RECENT
        return self._stats(self._received, 0 if channel is None else channel.delivered,
                           {'invalid': self._invalid, 'nobody there': self._nobody, **given_up},
                           self._problem if recent else None)

    def _receive(self, message: Any) -> None:
        """A message of the topic; rospy's threads. It may be of another type, see RobotStream."""
        if message._type != self._class._type:
            self._report('it is %s, must be %s' % (message._type, self._class._type))
            return
        publisher = publisher_of(message)
        source = message.name if self._is_log else publisher
        if not self._wanted(source):
            if source == publisher:     # what it publishes crosses the link by TCP for nothing
                udpros.drop_publisher(self.topic, publisher)
            return
        if self._off or (self._level and message.level < self._level):
            return
        self._received += 1
        try:
            self._send(self._rewrite(message), source)
        except ValueError as error:
            self._report(error)

    def _wanted(self, source: str) -> bool:
        """Whether the messages of a node are relayed.

        Where both sides share a master, an operator's own log is not relayed back to it: its warnings of a bad link
        would load that link.
        """
        return not self._is_log or source not in self._link.peers()

    def _send(self, message: Any, source: str) -> None:
        """Send a message.

        :param source: the node that has published it
        :raises ValueError: where it is too long
        """
        channel = self._channel
        assert channel is not None
        with self._lock:
            data = self._packed_with_kept(message) if self._together else self._packed(message)
            if self._latch:
                self._latched, self._latched_at = data, time.monotonic()
            if not channel.send(data):
                self._nobody += not self._latch

    def _check(self, message: Any) -> bytes:
        """A message, serialised.

        :raises ValueError: where it is too long
        """
        data = serialised(message)
        if len(data) > self._bounds.bytes:
            raise ValueError('it has %d bytes, max_bytes is %d' % (len(data), self._bounds.bytes))
        return data

    def _packed(self, message: Any) -> bytes:
        """:raises ValueError: where it is too long"""
        return pack(self._check(message))

    def _packed_with_kept(self, message: Any) -> bytes:
        """All content until now. What makes it too long is not kept, so that it does not keep out what comes later.

        :raises ValueError: where it is too long
        """
        contents = Contents(self._class)
        if self._kept is not None:
            contents.update(self._kept)
        problem = contents.add(message)
        data = self._packed(contents.merged())
        self._kept = contents
        if problem:
            self._report(problem)
        return data

    def _joined(self, peer: str) -> None:
        """A new node of the other side gets what is latched, the robot only if it is not old; the link's thread."""
        assert self._channel is not None
        with self._lock:
            fresh = self._bounds.keeps_last or time.monotonic() - self._latched_at < self._bounds.age
            if self._latched is not None and fresh and not self._off:
                self._channel.send(self._latched, peer, first=True)

    def _given_up(self, peer: str, count: int, reason: str) -> None:
        """Messages may not have arrived: said once, until all has arrived for a while."""
        now = time.monotonic()
        # a warning may be relayed, and given up, too: it must not cause the next one
        quiet = self._lost_at is None or now - self._lost_at >= RECENT + self._bounds.age
        self._lost_at = now
        self._problem = 'messages to %s are given up: %s' % (peer, REASONS.get(reason, reason))
        if quiet:
            logwarn("stream '%s'" % self.name, self._problem, ERROR_PERIOD)

    def _report(self, problem: Any) -> None:
        self._invalid += 1
        logerr("stream '%s'" % self.name, 'a message of %s is not sent: %s' % (self.topic, problem))


class TurnsSource(Source):
    """With `newest`: contents take turns, as a small part of the link has room for them. Subclasses say which do.

    Where both sides share a master, an operator's own messages are not sent back to it.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._turns = PeriodicWorker(self.name, self._take_turns, self._report, TURN_PERIOD)

    def start(self) -> None:
        """See WayBackStream."""
        super().start()
        self._opened.started(self._turns)

    def _wanted(self, source: str) -> bool:
        return source not in self._link.peers()

    def _take_turns(self) -> None:
        """Send what is due."""
        raise NotImplementedError


class NewestSource(TurnsSource):
    """Sends the newest content of each name, once the one before has arrived."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._states: Dict[str, Turns] = {}     # {peer: what waits for it}

    def _send(self, message: Any, source: str) -> None:
        self._check(message)
        peers = self._link.peers()
        with self._lock:
            self._states = {peer: self._states.get(peer) or Turns(self._class) for peer in peers}
            problems = [states.add(message, source) for states in self._states.values()]
        self._nobody += not peers
        self._turns.wake()
        if any(problems):
            self._report(max(problems))

    def _take_turns(self) -> None:
        """See TurnsSource; to each peer that has got the message before."""
        channel = self._channel
        assert channel is not None
        rate, now = self._link.part_of_rate(STATES_SHARE), time.monotonic()
        with self._lock:
            due = [(peer, states.due(self._packed, rate, now)) for peer, states in self._states.items()
                   if not channel.waiting(peer)]
        for peer, data in due:
            if data is not None:
                channel.send(data, peer)


class Sink(ReliableRelay):
    """The side that receives: publishes the topic.

    :param rewrite: see Rewrite
    :param refusal: f(peer) -> why its messages are not published now, None: they are
    """

    def __init__(self, name: str, settings: Mapping[str, Any], link: ReliableLink, topic: str,
                 rewrite: Rewrite = lambda message: message,
                 refusal: Callable[[str], Optional[str]] = lambda peer: None) -> None:
        super().__init__(name, settings, link, False, topic)
        self._rewrite, self._refusal = rewrite, refusal
        if self._on_robot and not self._latch:      # who subscribes later gets what is latched
            self.source = sources.Source(sources.LISTENER, topic, self._class._type)
        self._topic: Any = None     # made by start()
        self._received = self._published = self._invalid = self._disabled = self._refused = 0

    def start(self) -> None:
        """See WayBackStream."""
        self._topic = self._opened.topic(rospy.Publisher(self.topic, self._class, queue_size=QUEUE, latch=self._latch,
                                                         tcp_nodelay=True))
        self._open_channel(ChannelListener(received=self._publish, left=self._left))

    @property
    def heard(self) -> bool:
        """See WayBackStream."""
        return self._topic is not None and bool(self._topic.get_num_connections())

    def stats(self) -> StreamStats:
        """See WayBackStream."""
        return self._stats(self._received, self._published,
                           {'message': self._invalid, 'disabled': self._disabled, 'refused': self._refused}, None)

    def _publish(self, peer: str, data: bytes) -> None:
        """A message came; the link's thread."""
        self._received += 1
        if self._off:
            self._disabled += 1
            return
        refusal = self._refusal(peer)
        if refusal is not None:
            self._refused += 1
            logwarn("stream '%s'" % self.name, 'a message of %s is refused: %s' % (peer, refusal), ERROR_PERIOD)
            return
        try:
            message = deserialised(self._class, unpack(data, self._bounds.bytes))
        except ValueError:
            self._invalid += 1
            logerr("stream '%s'" % self.name, 'what %s sent is no %s' % (peer, self._class._type))
            return
        self._show(message)
        self._published += 1

    def _show(self, message: Any) -> None:
        """Publish a message."""
        self._topic.publish(self._rewrite(message))

    def _left(self, peer: str, reason: str) -> None:
        """A node of the other side has left, or was restarted."""
