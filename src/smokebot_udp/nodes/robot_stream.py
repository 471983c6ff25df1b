# SPDX-License-Identifier: BSD-3-Clause
"""The runner of the robot's streams: subscribes a topic, has its messages encoded, and sends the frames.

A part of a stream is a topic on the wire. It is advertised when the encoder needs it first, and stays.

One thread per stream encodes the newest message when its rate allows, and repeats the last one when that is due. The
encoder (streams/encoder.py) decides how messages are encoded, the outbox (outbox.py) when datagrams leave. Relays and
scans that are derived of clouds have runners of their own (relay_stream.py, derived_stream.py).
"""
import functools
import threading
import time
from dataclasses import dataclass
from typing import Any, Callable, ClassVar, Dict, List, Mapping, NamedTuple, Optional, Sequence, Set

import rospy
from rospy import AnyMsg

from .. import traffic
from ..capture.history import Histories
from ..congestion.controller import Demand
from ..congestion.operating_points import OperatingPoint
from ..frame_names import frame_name
from ..limited_log import logerr, logwarn
from ..mission.parameters import live
from ..mission.settings import Settings, SettingsStore
from ..monitoring import stages
from ..monitoring.sources import TOPIC, Source
from ..monitoring.stats import PAUSED, ConnectionStats, StreamStats
from ..monitoring.windows import Rate
from ..newest import Newest
from ..streams.encoder import Encoded, Encoder, LinkView
from ..streams.held import Holding
from ..streams.outlook import Outlook
from ..streams.repetition_budget import RepetitionBudget
from ..streams.schedule import Schedule
from ..streams.segments import ARRIVAL, MAX_SOURCES, reported_name, wire_topic
from ..streams.source_clock import SourceClock
from ..transport import Publisher, Transport
from ..udpros.datagram import IP_UDP_HEADERS
from ..udpros.frame import Frame
from ..units import KBIT
from .any_type import class_of, read
from .outbox import MAX_BACKLOG, Outbox
from .trace import TRACE
from .worker import DeadlineWorker

SOURCE_RATE_OVER = 2.0
"""The rate of a source is measured over this time [s]."""

READ_SIZE = 1 << 18
"""What rospy reads at once from a source; for each read, however short, it allocates this much [byte]."""


class _Waiting(NamedTuple):
    """What waits to be encoded."""
    message: Any
    """From `merge`."""
    arrival: int = 0
    """That crosses with it, see streams.source_clock [ns]."""


@dataclass
class RobotLink:
    """Shared by the streams of a node."""
    transport: Transport
    outbox: Outbox
    subscribed: Callable[[], None] = lambda: None
    """Called when a stream has a new subscriber."""
    histories: Optional[Histories] = None
    """Where originals are kept, of streams that have the setting `history`."""

    def __post_init__(self) -> None:
        self.repetitions, self._repeating = RepetitionBudget(), threading.Lock()
        self.datagram_size = self.transport.max_datagram_size
        """Size of the datagrams of new frames, as the transport counts it. It is shorter on slow links [byte]."""

    def afford(self, size: int, datagram: bool) -> bool:
        """As LinkView.afford; any thread."""
        size += IP_UDP_HEADERS + self.transport.overhead if datagram else 0
        with self._repeating:
            return self.repetitions.take(size, time.monotonic(), datagram)

    def follow(self, rate: Optional[float], sent: float) -> None:
        """The link's rate has changed, or what is sent over it; None: it is unlimited [byte/s]."""
        with self._repeating:
            self.repetitions.set_rate(rate, sent, time.monotonic())

    @property
    def expansion(self) -> float:
        """What the transport makes of a byte on the air: encoders do not count its overhead. At least 1."""
        return 1 + self.transport.overhead / (self.datagram_size + IP_UDP_HEADERS)


class RobotStream(rospy.SubscribeListener):
    """Sends the newest messages of a topic.

    :param name: of the stream
    :param settings: {name: value} of streams.yaml, each checked
    :param encoder: made with these settings
    :param subscriber: makes the subscriber of the source, as rospy.Subscriber
    :raises ValueError: where settings contradict each other
    """
    WHOLE: ClassVar[bool] = False
    """Whether a message is useless without all its datagrams, so that a newer one must not replace what is left of it.
    """
    REPLACES: ClassVar[bool] = True
    """Whether a newer message waits a little before it replaces what is left of the one before."""

    def __init__(self, name: str, settings: Mapping[str, Any], encoder: Encoder[Any], link: RobotLink,
                 subscriber: Callable[..., Any] = rospy.Subscriber) -> None:
        super().__init__()
        self.name, self.topic = name, rospy.resolve_name(settings['robot_topic'])
        self.encoder, self.link = encoder, link
        self.settings = SettingsStore(live(encoder.PARAMETERS), settings, encoder.check)
        self.received, self.sent = 0, 0
        """Messages of the source; messages handed to the outbox."""
        self._busy = 0.0        # the encoder, so far [s]
        self._make_subscriber = subscriber
        self._publishers: Dict[str, Publisher] = {}   # of the parts advertised
        self._part_of = {class_: part for part, class_ in encoder.SEGMENTS.items()}
        self._encoded = Encoded()       # the last message, without its frames
        self._inputs: List[Any] = []    # subscribers, made by start()
        self._invalid = 0
        self._stamp: Any = None         # of the last message encoded
        self._source_clocks: Newest[str, SourceClock] = Newest(MAX_SOURCES)     # by the names of frames
        self._last: Optional[_Waiting] = None   # the last message, where the encoder encodes it again
        self._source, self._source_rate = Rate(SOURCE_RATE_OVER), None  # type: Rate, Optional[float]
        self.outlook = Outlook()
        """What it may expect of the link."""
        self._loss = 0.0
        current = self.settings.current
        self._schedule: Schedule[_Waiting] = Schedule(
            self._encoding_rate(current), encoder.repeat_period(current, self._view), encoder.traits.steady)
        self._worker: DeadlineWorker[Callable[[], None]] = DeadlineWorker(
            name, self._next_job, self._schedule.deadline, self._work, self._report)
        self.settings.subscribe(self._apply)

    def start(self) -> None:
        """Begin to send; a stream can be made without ROS, but not started."""
        self._advertise(self.settings.current)
        self._worker.start()
        further = {rospy.resolve_name(topic): class_
                   for topic, class_ in self.encoder.sources(self.settings.current.requested).items()}
        # a subscriber of any type follows a source that changes its own
        own = AnyMsg if self.encoder.ACCEPTED else self.encoder.MESSAGE
        self._inputs = [self._make_subscriber(
            topic, class_, functools.partial(self._receive, topic, self._accepted if class_ is AnyMsg else [class_]),
            queue_size=self.encoder.traits.queue_size, buff_size=READ_SIZE, tcp_nodelay=True)
            for topic, class_ in {**further, self.topic: own}.items()]

    def close(self) -> None:
        """End the thread and all topics."""
        for one in self._inputs:
            one.unregister()
        self._worker.close()
        self.link.outbox.drop(self.name)
        for publisher in self._publishers.values():
            publisher.unregister()

    def _advertise(self, settings: Settings) -> None:
        """Advertise the parts that these settings need."""
        for part in self.encoder.parts(settings):
            if part not in self._publishers:
                publisher = self.link.transport.publisher(
                    wire_topic(self.name, part), self.encoder.SEGMENTS[part], subscriber_listener=self,
                    carries=self.encoder.CARRIES, tos=self._tos)
                self._publishers = {**self._publishers, part: publisher}    # other threads iterate

    # -- state, for any thread ----------------------------------------------------------------------

    @property
    def source(self) -> Source:
        """Where its messages come from."""
        return Source(TOPIC, self.topic, ' or '.join(class_._type for class_ in self._accepted))

    @property
    def _accepted(self) -> Sequence[Any]:
        return self.encoder.ACCEPTED or [self.encoder.MESSAGE]

    @property
    def heard(self) -> bool:
        """Whether the segments have a subscriber."""
        return any(publisher.get_num_connections() > 0 for publisher in self._publishers.values())

    @property
    def subscribers(self) -> Set[str]:
        """Names of the nodes that the segments are sent to as datagrams."""
        return {name for part in self._publishers for name in self._subscribers_of(part)}

    def _subscribers_of(self, part: str) -> Set[str]:
        publisher = self._publishers.get(part)
        return set() if publisher is None else {connection['peer'] for connection in publisher.connections()}

    def _why_not(self, part: str, operator: str) -> str:
        publisher = self._publishers.get(part)
        return 'is not offered it' if publisher is None else publisher.why_not(operator)

    def _complete(self, part: str) -> bool:
        """Whether a part has subscribers now, all of those that other parts are sent to as datagrams among them."""
        publisher = self._publishers.get(part)
        return (publisher is not None and publisher.get_num_connections() > 0
                and self._subscribers_of(part) >= self.subscribers)

    @property
    def wanted(self) -> bool:
        """Whether segments are to be sent now."""
        settings = self.settings.current
        return settings['enabled'] and not settings.paused and self.heard

    @property
    def _view(self) -> LinkView:
        """The link as the encoder sees it now."""
        return LinkView(self._datagram_size, self.link.transport.room, self.outlook, source_rate=self._source_rate,
                        loss=self._loss, afford=self.link.afford, heard=self._complete,
                        operators=self._subscribers_of, why_not=self._why_not)

    def follow(self, loss: float, outlook: Callable[[], Outlook]) -> None:
        """The link has changed.

        :param loss: packet-loss ratio as reported, 0..1
        :param outlook: f() -> what the stream may expect
        """
        self._loss = loss
        if self.encoder.traits.foresees:
            self.outlook = outlook()

    def limits(self, granted: Optional[Dict[str, Any]], decimation: float, capacity: float
               ) -> Optional[Dict[str, Any]]:
        """The settings that limit it now; None: it pauses.

        :param granted: likewise, by the plan
        :param decimation: as in a Plan
        :param capacity: of the link; 0: unknown and unlimited [byte/s]
        """
        return granted

    def demand(self, now: float) -> Optional[Demand]:
        """What it would send; None where it has nothing to send, or where it has no share of the link.

        To be called regularly, because it measures the rate of the source.

        :param now: by a steady clock [s]
        """
        self._source.read(self.received, now)
        sources = self._schedule.active(now)
        self._source_rate = (self._source.per_second or 0.0) / sources or None
        settings = self.settings.current
        requested = settings.requested
        if not requested['enabled'] or not self.heard:
            return None
        rate = min(requested['rate'], self._source_rate or requested['rate'])
        points, expansion = self.encoder.operating_points(rate, settings), sources * self.link.expansion
        return Demand([OperatingPoint(point.settings, expansion * point.cost) for point in points],
                      requested['weight'], requested['min_bitrate'] * KBIT, rate,
                      lambda point, spare: self.encoder.refine(point, spare / expansion),
                      self.WHOLE, self.encoder.traits.traffic == traffic.IMAGES,
                      expansion * self._encoded.wished) if points else None

    def stats(self) -> StreamStats:
        """What the stream does and did, for diagnostics."""
        settings = self.settings.current
        connections = [ConnectionStats(name=reported_name(self.name, part), **found)
                       for part, publisher in self._publishers.items() for found in publisher.connections()]
        return StreamStats(
            self.received, self.sent, settings['enabled'], settings['rate'], self.encoder.traits.steady,
            {'replaced': self._schedule.replaced, 'invalid': self._invalid,
             'datagrams of replaced messages': self.link.outbox.dropped(self.name)},
            connections=connections,
            problem=PAUSED if settings.paused else self.encoder.problem, busy=self._busy)

    # -- input: rospy's threads, and those that change settings ------------------------------------

    def receive(self, message: Any) -> None:
        """A message of the source arrived."""
        self._receive(self.topic, self._accepted, message)

    def _receive(self, topic: str, classes: Sequence[Any], message: Any) -> None:
        """A message arrived. It may be of another type, where this node subscribes the topic with another type as well.

        :param classes: that it may have
        """
        try:
            message = read(message, class_of(message, classes))
            if self.encoder.takes(message):
                return
            self.received += 1
            if TRACE.on and self.encoder.traits.stamped:
                TRACE.mark(self.name, message.header.stamp.to_nsec(), stages.RECEIVED)
            if topic == self.topic:
                self._keep(message)
            if self._encodes:
                self._put(message)
        except ValueError as error:
            self._report(error, topic)

    @property
    def _encodes(self) -> bool:
        """Whether messages are to be encoded now."""
        return self.encoder.traits.keeps or self.wanted

    def _keep(self, message: Any) -> None:
        """Keep an original, for captures."""
        period = self.settings.current.requested.get('history')
        if period is not None and self.link.histories is not None:
            stamp = message.header.stamp.to_nsec() or rospy.Time.now().to_nsec()
            self.link.histories.add(self.name, message, stamp, period, time.monotonic())

    def _put(self, message: Any) -> None:
        """:raises ValueError: saying what is wrong with the message"""
        encoder, name, arrival = self.encoder, '', 0
        with self._worker.adding():
            if encoder.traits.stamped:
                name = frame_name(message.header.frame_id)
                arrival = self._identify(name, message.header)
            before = self._schedule.waiting(name)
            merged = encoder.merge(None if before is None else before.message, message)
            if merged is None:
                return
            waiting = before if before is not None and merged is before.message else _Waiting(merged, arrival)
            if encoder.traits.reencodes:
                self._last = waiting
            self._schedule.put(waiting, time.monotonic(), name)

    def _identify(self, name: str, header: Any) -> int:
        """The arrival that crosses with a message, see SourceClock.take. One without a stamp gets the time of now.

        :param name: of its frame
        """
        now = rospy.Time.now()
        if header.stamp.is_zero():
            header.stamp = now
        warnings: List[str] = []
        try:
            return self._source_clocks.of(name, SourceClock).take(header.stamp.to_nsec(), now.to_nsec(), warnings)
        finally:
            self.encoder.warnings.extend('frame %r: %s' % (name, warning) for warning in warnings)     # logged soon

    def held(self, operator: str, holding: Holding) -> bool:
        """An operator reported what it holds.

        :return: whether the stream is sent to an operator of this name
        """
        if operator not in self.subscribers:
            return False
        self.encoder.held(operator, holding)
        self._follow_repeats()
        return True

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        """A new subscriber gets at once what is repeated."""
        self.link.subscribed()
        self.encoder.joined()
        with self._worker.changing():
            self._schedule.wake()

    def _apply(self, settings: Settings, changed: Mapping[str, Any]) -> None:
        """Settings changed, see SettingsStore.subscribe."""
        with self._worker.changing():
            self._schedule.set_rate(self._encoding_rate(settings))
            self._schedule.repeat_period = self.encoder.repeat_period(settings, self._view)
            if changed and self._last is not None:
                self._schedule.put(self._last, time.monotonic())
        if not settings['enabled']:
            self.link.outbox.drop(self.name)

    def _encoding_rate(self, settings: Settings) -> float:
        """At which messages of a source are encoded, at most [Hz]."""
        rate: float = settings['rate']
        return rate

    # -- the worker's thread -----------------------------------------------------------------------

    def _next_job(self, now: float) -> Optional[Callable[[], None]]:
        waiting = self._schedule.take(now)
        if waiting is not None:
            return functools.partial(self._encode, waiting)
        return self._repeat if self._schedule.take_repeat(now) else None

    def _work(self, job: Callable[[], None]) -> None:
        try:
            job()
        finally:
            while self.encoder.warnings:
                logwarn("stream '%s', %s" % (self.name, self.topic), self.encoder.warnings.popleft())

    def _encode(self, waiting: _Waiting) -> None:
        settings = self.settings.current
        self._advertise(settings)
        if self.encoder.traits.stamped:
            self._stamp = waiting.message.header.stamp
        self._send_message(waiting.message, waiting.arrival, settings)

    def _send_message(self, message: Any, arrival: int, settings: Settings) -> None:
        """Encode and send a message.

        :param arrival: that crosses with it [ns]
        """
        encoded = self._noted(self._made(message, settings))
        self._follow_repeats()
        if not encoded.frames:
            return
        self._await_rest()
        with self._worker.adding():
            self._schedule.sent(time.monotonic())
        if self.wanted:
            self._send_at_once(encoded.beside)
            self.sent += self._send(_with_arrival(encoded.frames, arrival))

    def _made(self, message: Any, settings: Settings) -> Encoded:
        """What is to be sent of a message; its making is traced."""
        encoder, link = self.encoder, self._view
        if encoder.traits.foresees:
            outbox = self.link.outbox
            link = link._replace(waiting=outbox.takes(self.name) / self._dip,
                                 unsent=self.REPLACES and not self._is_mixed and outbox.unsent(self.name))
        began = time.monotonic()
        encoded = encoder.encode(message, settings, link)
        self._busy += time.monotonic() - began
        if TRACE.on and encoder.traits.stamped:
            TRACE.mark(self.name, self._stamp.to_nsec(), stages.STARTED, began)
            TRACE.mark(self.name, self._stamp.to_nsec(), stages.ENCODED)
        if encoded.sizing is not None and encoded.frames:
            rospy.logdebug("stream '%s': %s, %.0f bytes granted, %d used, bound: %s, rms error %.2f", self.name,
                           *encoded.sizing)
            TRACE.write(stages.Sized(self.name, self._stamp.to_nsec(), time.monotonic(), *encoded.sizing))
        return encoded

    def _noted(self, encoded: Encoded) -> Encoded:
        self._encoded = encoded._replace(frames=(), beside=())     # they take memory until they have left, no longer
        return encoded

    def _await_rest(self) -> None:
        """Wait until a new message may take the place of what is left of the one before: part of that has left while
        the new one was encoded."""
        whole = self._is_mixed
        if whole or self.REPLACES:
            backlog = MAX_BACKLOG if self._encoded.backlog is None else self._encoded.backlog
            self.link.outbox.await_rest(self.name, whole, self._dip * backlog)

    @property
    def _is_mixed(self) -> bool:
        """Whether it has several sources: a message of another one is no newer version, so that each leaves as a whole.
        """
        return self._schedule.active(time.monotonic()) > 1

    def drop_rest(self) -> None:
        """The link carries less from now on: what is left of a message would delay the newer one that replaces it."""
        if self.REPLACES and not self.encoder.traits.keeps:
            self.link.outbox.drop(self.name)

    @property
    def _dip(self) -> float:
        """By what the present rate is below what the stream may use: that soon passes, as after a pause. At least 1."""
        rate = self.link.outbox.rate
        return 1.0 if rate is None or not self.encoder.traits.foresees else max(self.outlook.room / rate, 1.0)

    def _repeat(self) -> None:
        if self._encoded.backlog is not None:
            self.link.outbox.await_rest(self.name, False, self._encoded.backlog)
        if self.wanted and not self.link.outbox.sending(self.name):
            encoded = self._noted(self.encoder.repeat(self.settings.current, self._view))
            if encoded.frames:
                sent = self._send(encoded.frames)
                self.sent += sent if self.encoder.protected and self.encoder.traits.keeps else 0    # no mere copies
        self._follow_repeats()

    def _follow_repeats(self) -> None:
        """What was sent or reported may change when the next repeat is due."""
        period = self.encoder.repeat_period(self.settings.current, self._view)
        if period != self._schedule.repeat_period:
            with self._worker.changing():
                self._schedule.repeat_period = period

    @property
    def _datagram_size(self) -> int:
        return self.link.datagram_size

    def _send(self, frames: Sequence[Frame]) -> int:
        """Hand over the frames that carry one message; how many messages they are."""
        part = self._part_of[frames[0].message_class]
        publisher = self._publishers[part]
        publisher.tos = self._tos & self.link.transport.tos_mask     # it may have changed
        self.link.outbox.put(reported_name(self.name, part), publisher, frames,
                             self._stamp.to_nsec() if self._stamp else 0, base=self._encoded.base)
        return 1

    @property
    def _tos(self) -> int:
        """Second byte of the IP headers, see traffic.py."""
        return self.encoder.traits.traffic | traffic.ECT

    def _send_at_once(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            part = self._part_of[frame.message_class]
            self.link.outbox.publish(reported_name(self.name, part), self._publishers[part], frame)

    def _report(self, error: Exception, topic: Optional[str] = None) -> None:
        self._invalid += 1
        logerr("stream '%s'" % self.name, 'a message of %s is not sent: %s' % (topic or self.topic, error))


def _with_arrival(frames: Sequence[Frame], arrival: int) -> Sequence[Frame]:
    """The frames of a message, with the arrival that crosses with it [ns]."""
    for frame in frames if arrival else ():
        frame.records[ARRIVAL]['secs'], frame.records[ARRIVAL]['nsecs'] = divmod(arrival, 10 ** 9)
    return frames
