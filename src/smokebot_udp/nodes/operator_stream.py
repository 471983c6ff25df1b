# SPDX-License-Identifier: BSD-3-Clause
"""Runs the operator's side of one stream: from its segments' topic to the operator's topic."""
import collections
import functools
import math
import statistics
import threading
import time
from dataclasses import dataclass, field
from typing import Any, Callable, Deque, Dict, List, Mapping, Optional

import rospy

from ..arrays import BoolArray, Records
from ..limited_log import logerr, logwarn
from ..mission.parameters import live
from ..mission.settings import Settings, SettingsStore
from ..monitoring import stages
from ..monitoring.stats import ConnectionStats, Shown, StreamStats
from ..optional import found
from ..streams import assembler_class
from ..streams.assembler import Assembled, Assembler, Work
from ..streams.blank import blank, has_blank
from ..streams.frame_assembler import Frame
from ..streams.frame_prefix import add_prefix
from ..streams.held import Holding
from ..streams.image.camera_info import CAMERA_INFO
from ..streams.relay.contents import QUEUE
from ..streams.segments import INFO, reported_name, wire_topic
from ..streams.source_clock import Epoch
from ..transport import Subscriber, Transport
from .common import operator_topic
from .compiled_codec import CompiledCodec
from .notice import Notice
from .trace import TRACE
from .video_decoder import VideoDecoder
from .worker import DeadlineWorker

INTERVALS = 5
"""`interval` is the median of the last intervals, of this number."""

MISSING_DECODER = ('the robot can send it as video, which is not decoded here: PyAV is missing. Install python3-av '
                   '(sudo apt install python3-av) and restart this node. Until then images are layered')

CLEARING, CLEAR_PERIOD = 5.0, 1.0
"""How long blank messages follow at each call, and then between two of them. rviz shows what waits for its transform
even minutes later, as soon as a robot that was restarted sends transforms again [s]."""

MAX_SHOWN = 512
"""What is known of this number of messages is kept until `stats` is called."""


@dataclass
class OperatorLink:
    """Shared by the operator's streams of one node."""
    transport: Transport
    is_still: Callable[[], bool] = lambda: False
    """Whether the robot stands still."""
    images_compared: Callable[[Optional[float]], None] = lambda changed: None
    """Receives the share of the cells that differ between two images of a stream, 0..1; None: not comparable."""
    arrived: Callable[..., None] = lambda *_: None
    """f(name, number, seq, size, count, when), see segments.reported_name and Transport.subscriber."""
    clock_offset: Callable[[], float] = lambda: 0.0
    """The robot's clock minus the operator's [s]."""
    codec: Optional[CompiledCodec] = None
    """Needed for parts that are compiled; None: they are received at once."""
    video_decoder: Optional[Callable[[str], VideoDecoder]] = None
    """f(name), makes the decoder of a stream with parts that need one; None: such parts are not received."""
    received: Callable[[str, Callable[[], Optional[Holding]], float], None] = lambda *_: None
    """f(name, holding, interval), see HeldReporter: segments of a stream were received of which it holds something."""
    frame_prefix: str = ''
    """Goes before the frames of all messages that are published, see streams.frame_prefix."""
    notice: Notice = field(default_factory=Notice)
    """That all views show."""


class OperatorStream:
    """Publishes the messages that an Assembler makes of the received segments.

    :param name: of the stream in streams.yaml
    :param settings: {name: value}, checked; `type` is the kind
    :param link: OperatorLink
    :raises ValueError: the settings are impossible for this kind
    """

    def __init__(self, name: str, settings: Mapping[str, Any], link: OperatorLink) -> None:
        self.name, self.topic = name, operator_topic(settings['operator_topic'])
        class_ = assembler_class(settings['type'])
        self._decoder = link.video_decoder(name) if class_.DECODED and link.video_decoder is not None else None
        shared: Dict[str, Any] = {} if self._decoder is None else {'decoder': self._decoder}
        self.assembler: Assembler[Any, Any] = class_(settings, time.monotonic, **shared)
        self.settings = SettingsStore(live(class_.PARAMETERS), settings)
        self.received, self.published = 0, 0
        self._busy = 0.0        # the worker, so far [s]
        self.last_shown: Optional[float] = None
        """When a message was published last, by time.monotonic() [s]."""
        self._intervals: Deque[float] = collections.deque(maxlen=INTERVALS)     # between the last messages shown [s]
        self.last_stamp: Optional[int] = None
        """Stamp of the message that was published last [ns]."""
        self._last_age: Optional[float] = None      # its age then, but for the offset of the robot's clock [s]
        self._publishing = threading.Lock()
        self._last: Any = None      # the message published last, while blank ones can take its place
        self._cleared: Optional[float] = None   # when the first one did [s]
        self._clear_at = -math.inf              # when the next one may [s]
        self._link = link
        self._epoch = Epoch()       # of relayed messages
        self._shown: Deque[Shown] = collections.deque(maxlen=MAX_SHOWN)
        self._publisher: Any = None     # made by start(), as are these
        self._subscribers: Dict[str, Subscriber] = {}   # by part
        self._needs_codec = False       # whether the robot may send a part that needs it
        self._misses_decoder = False    # likewise, where there is none
        self._outputs: List[Any] = []
        self._renew: Optional[Callable[[], None]] = None    # publishes calibrations that came after their images
        self._worker: DeadlineWorker[Callable[[], None]] = DeadlineWorker(
            name, self._next_job, self.assembler.deadline, self._work, self._report)
        self.settings.subscribe(self._configure)

    def start(self) -> None:
        """Begin to receive."""
        self._publisher = self._make_publisher()
        self._outputs = list(self._make_outputs())
        if not self.assembler.FORWARDS:
            self._worker.start()
        if self.assembler.COMPILED and self._link.codec is not None:
            self._link.codec.ready()    # loading takes a second: it begins before the robot offers such a part
        # all parts from the start: the robot may use another one at any time
        self._subscribers = {part: self._subscribe(part) for part in self.assembler.subscribed()}

    def _make_publisher(self) -> Any:
        if self.settings.current.get('publish_updates'):
            from .map_publisher import MapPublisher  # imports map_msgs, for maps only
            return MapPublisher(self.topic, self.assembler.MESSAGE)
        return rospy.Publisher(self.topic, self.assembler.MESSAGE, latch=self.assembler.LATCH,
                               queue_size=self.assembler.QUEUE_SIZE, tcp_nodelay=True)

    def _subscribe(self, part: str) -> Subscriber:
        options: Dict[str, Any]
        if self.assembler.FORWARDS:
            options = {'callback': self._forward, 'queue_size': QUEUE}
        else:
            options = {'batch_callback': functools.partial(self._receive, part)}
        if part in self.assembler.COMPILED:
            options['wanted'] = self._codec_ready
        if part in self.assembler.DECODED:
            options['wanted'] = self._decoder_ready
        return self._link.transport.subscriber(
            wire_topic(self.name, part), self.assembler.SEGMENTS[part], carries=self.assembler.CARRIES,
            arrived=functools.partial(self._link.arrived, reported_name(self.name, part)), **options)

    def _codec_ready(self) -> bool:
        """Whether parts that need the codec can be received, asked when the robot advertises one.

        The robot sends the other parts until this one is connected.
        """
        self._needs_codec = True
        return self._link.codec is None or self._link.codec.ready()

    def _decoder_ready(self) -> bool:
        """Likewise, of parts that need the decoder of video; their parity pieces need the codec."""
        if self._decoder is not None and found('av'):
            return self._codec_ready()
        if self._decoder is not None and not self._misses_decoder:
            rospy.logwarn("stream '%s': %s", self.name, MISSING_DECODER)
            self._misses_decoder = True
        return False

    def stats(self) -> StreamStats:
        """What the stream does and did, for diagnostics; `shown` since the last call."""
        shown = [self._shown.popleft() for _ in range(len(self._shown))]
        connections = [ConnectionStats(name=reported_name(self.name, part), **found)
                       for part, subscriber in self._subscribers.items()
                       for found in subscriber.connections()]
        return StreamStats(
            self.received, self.published, steady=self.assembler.STEADY, dropped=self._dropped(),
            shown=shown, connections=connections,
            problem=self._problem() or self.assembler.problem(self.settings.current, time.monotonic()),
            busy=self._busy)

    def _dropped(self) -> Dict[str, int]:
        return {**self.assembler.dropped, **(self._decoder.dropped if self._decoder is not None else {})}

    def age(self, clock_offset: Optional[float], now: float) -> Optional[float]:
        """How old what was published last is by now [s]; None: nothing was, or its age is unknown. Any thread.

        :param clock_offset: the robot's clock minus this machine's [s]; None: unknown
        :param now: by time.monotonic() [s]
        """
        shown = self.last_shown     # before the age: with another message's it is too old, not too fresh
        age = self._last_age
        return None if shown is None or age is None or clock_offset is None else age + clock_offset + now - shown

    def clear(self, shown: float, now: float) -> None:
        """Publish a blank message in place of a cloud or scan that is no longer true, see streams.blank. Any thread.

        It is repeated at each call for CLEARING, and then each CLEAR_PERIOD: a display shows messages that wait for
        their transforms after it.

        :param shown: `last_shown` of that message: if another one is shown by now, nothing is published
        :param now: by time.monotonic() [s]
        """
        with self._publishing:
            if self._last is None or self.last_shown != shown or now < self._clear_at or rospy.is_shutdown():
                return
            self._publisher.publish(blank(self._last))
            self._cleared = now if self._cleared is None else self._cleared
            self._clear_at = now + CLEAR_PERIOD if now - self._cleared >= CLEARING else now

    def close(self) -> None:
        """End all threads and topics."""
        if self._decoder is not None:
            self._decoder.close()       # first: the worker may be waiting for it
        self._worker.close()
        for subscriber in self._subscribers.values():
            subscriber.unregister()
        for output in self._outputs:
            output.close()
        if self._publisher is not None:
            self._publisher.unregister()

    def _make_outputs(self) -> Any:
        settings = self.settings.current
        if settings.get('publish_age'):
            from .age_output import AgeOutput
            yield AgeOutput(self.topic, self.assembler.MESSAGE, self._ages)
        if 'publish_mask' not in settings:
            return
        from .image_outputs import OUTPUTS  # imports OpenCV, for images only
        for setting, output in OUTPUTS.items():
            if settings.get(setting):
                made = output(self.topic, self.settings, self._link.clock_offset, self._link.notice)
                if setting == CAMERA_INFO:
                    self._renew = made.renew
                yield made

    def _configure(self, settings: Settings, changed: Mapping[str, Any]) -> None:
        with self._worker.changing():
            self.assembler.configure(settings, changed)

    def _receive(self, part: str, records: Records, mask: BoolArray) -> None:
        """Take a batch of segments, in the transport's thread."""
        with self._worker.adding():
            self.assembler.receive(records, mask, time.monotonic(), part)
        if part == INFO and self._renew is not None:
            self._renew()

    def _report_held(self) -> None:
        self._link.received(self.name, self._holding, self.assembler.REPORT_INTERVAL)

    def _holding(self) -> Optional[Holding]:
        with self._worker.lock:
            return self.assembler.holding()

    def _ages(self) -> Optional[Any]:
        with self._worker.lock:
            ages = self.assembler.ages(time.monotonic())
        return None if ages is None else self._prefixed(ages)

    def _forward(self, segment: Any) -> None:
        """Publish the messages that a segment completes, in the transport's thread."""
        try:
            with self._worker.changing():
                for message in self.assembler.join(segment):
                    self.received += 1
                    assembled = self.assembler.forward(message)
                    if assembled is not None:
                        self._publish(assembled)
        finally:
            self._log_warnings()

    def _next_job(self, now: float) -> Optional[Callable[[], None]]:
        finished = self.assembler.poll(now)
        if finished is not None:
            return functools.partial(self._show, finished)
        work = self.assembler.work()
        return None if work is None else functools.partial(self._do, work)

    def _work(self, job: Callable[[], None]) -> None:
        began = time.monotonic()
        try:
            job()
        finally:
            self._busy += time.monotonic() - began

    def _do(self, work: Work) -> None:
        """Do what takes time before a message can be finished, in the worker's thread."""
        try:
            work.do()
        finally:
            with self._worker.lock:
                work.done()
        self._report_held()

    def _show(self, finished: Any) -> None:
        """Assemble and publish one message, in the worker's thread."""
        self.received += 1
        settings, taken = self.settings.current, time.monotonic()
        try:
            assembled = self.assembler.assemble(finished, settings, self._link.is_still(), time.monotonic())
            if self._decoder is not None and self._decoder.broken:
                self._refuse_decoded()
            if self.assembler.HOLDS_SHOWN:
                self._report_held()
            if assembled is None:
                return
            if isinstance(finished, Frame):
                assembled.arrival = finished.head.arrival
            done = time.monotonic()
            self._publish(assembled)    # the outputs, too, show the frames that are published
            if TRACE.on and isinstance(finished, Frame):
                self._trace(finished, taken, done)
            for output in self._outputs:
                output.show(assembled)
            self.assembler.settle(finished, assembled, settings, time.monotonic())
            self._link.images_compared(assembled.changed)
        finally:
            self._log_warnings()

    def _trace(self, frame: Frame[Any], taken: float, done: float) -> None:
        """Trace a message that was published just now; times by time.monotonic() [s]."""
        for point, when in ((stages.ARRIVED, frame.latest), (stages.TAKEN, taken), (stages.ASSEMBLED, done),
                            (stages.PUBLISHED, None)):
            TRACE.mark(self.name, frame.head.stamp, point, when)

    def _refuse_decoded(self) -> None:
        """End the parts that nothing decodes: the robot then sends the others."""
        refused = [found for part, found in self._subscribers.items() if part in self.assembler.DECODED]
        self._subscribers = {part: found for part, found in self._subscribers.items()
                             if part not in self.assembler.DECODED}     # other threads iterate
        for subscriber in refused:
            subscriber.unregister()

    def _problem(self) -> Optional[str]:
        """Why compiled parts are not received; None: they are, or the robot has none."""
        return self._link.codec.problem if self._needs_codec and self._link.codec is not None else None

    def _publish(self, assembled: Assembled) -> None:
        assembled.message = self._prefixed(assembled.message)
        with self._publishing:
            self._publisher.publish(assembled.message)
            self.published += 1
            age = self._age_of(assembled)
            before = self.last_shown
            self._last_age, self.last_shown = age, time.monotonic()     # in this order, see `age`
            if before is not None:
                self._intervals.append(self.last_shown - before)
            self._last = assembled.message if has_blank(self.assembler.MESSAGE) else None
            self._cleared, self._clear_at = None, -math.inf
            self.last_stamp = assembled.stamp
        self._shown.append(Shown(age, assembled.completeness, assembled.error))

    @property
    def interval(self) -> float:
        """Median time from one message shown to the next, lately [s]; 0: unknown."""
        found = list(self._intervals)
        return statistics.median(found) if len(found) == INTERVALS else 0.0

    def _age_of(self, assembled: Assembled) -> Optional[float]:
        """The age of a message but for the offset of the robot's clock [s]; None: unknown, as that of a relayed one of
        another epoch, which crosses without its arrival."""
        taken, now = assembled.arrival or assembled.stamp, int(rospy.Time.now().to_nsec())
        offset = self._link.clock_offset()
        if self.assembler.FORWARDS and taken and math.isfinite(offset):
            self._epoch.look(taken, now + int(1e9 * offset))
        return (now - taken) / 1e9 if taken and not self._epoch.other else None

    def _prefixed(self, message: Any) -> Any:
        return add_prefix(message, self._link.frame_prefix)

    def _log_warnings(self) -> None:
        while self.assembler.warnings:
            logwarn("stream '%s'" % self.name, self.assembler.warnings.pop(0))

    def _report(self, error: Exception) -> None:
        logerr("stream '%s'" % self.name, 'a message is not published: %s' % error)
