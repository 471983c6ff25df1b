# SPDX-License-Identifier: BSD-3-Clause
"""Runs the operator's side of one stream: from its segments' topic to the operator's topic."""
import collections
import functools
import time
from dataclasses import dataclass
from typing import Any, Callable, Deque, Dict, List, Mapping, Optional, Tuple

import rospy

from .. import udpros
from ..arrays import BoolArray, Records
from ..mission.parameters import live
from ..mission.settings import Settings, SettingsStore
from ..monitoring.stats import ConnectionStats, StreamStats
from ..streams import assembler_class
from ..streams.assembler import Assembled, Assembler
from ..streams.relay.transforms import QUEUE
from ..streams.segments import wire_topic
from .common import operator_topic
from .worker import DeadlineWorker

MAX_SHOWN = 512
"""Age and completeness of this number of messages are kept until `stats` is called."""


@dataclass
class OperatorLink:
    """Shared by the operator's streams of one node."""
    max_datagram_size: int
    """[byte of UDP payload]"""
    receive_buffer: int = 4 << 20
    """Requested from the kernel for each stream [byte]."""
    is_still: Callable[[], bool] = lambda: False
    """Whether the robot stands still."""
    images_compared: Callable[[Optional[float]], None] = lambda changed: None
    """Receives the share of the cells that differ between two images of a stream, 0..1; None: not comparable."""
    arrived: Callable[..., None] = lambda *_: None
    """f(stream, number, seq, size, count, when), see udpros.Subscriber."""
    clock_offset: Callable[[], float] = lambda: 0.0
    """The robot's clock minus the operator's [s]."""


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
        self.assembler: Assembler[Any, Any] = class_(settings, time.monotonic)
        self.settings = SettingsStore(live(class_.PARAMETERS), settings)
        self.received, self.published = 0, 0
        self.last_shown: Optional[float] = None
        """When a message was published last, by time.monotonic() [s]."""
        self._link = link
        self._shown: Deque[Tuple[Optional[float], Optional[float]]] = collections.deque(maxlen=MAX_SHOWN)
        self._publisher: Any = None     # made by start(), as are these
        self._subscriber: Any = None
        self._outputs: List[Any] = []
        self._worker: DeadlineWorker[Any] = DeadlineWorker(
            name, self.assembler.poll, self.assembler.deadline, self._show, self._report)
        self.settings.subscribe(self._configure)

    def start(self) -> None:
        """Begin to receive."""
        self._publisher = rospy.Publisher(self.topic, self.assembler.MESSAGE, queue_size=2, latch=self.assembler.LATCH,
                                          tcp_nodelay=True)
        self._outputs = list(self._make_outputs())
        options: Dict[str, Any]
        if self.assembler.FORWARDS:
            options = {'callback': self._forward, 'queue_size': QUEUE}
        else:
            options = {'batch_callback': self._receive}
            self._worker.start()
        self._subscriber = udpros.Subscriber(
            wire_topic(self.name), self.assembler.SEGMENT, max_datagram_size=self._link.max_datagram_size,
            receive_buffer=self._link.receive_buffer, arrived=functools.partial(self._link.arrived, self.name),
            **options)

    def stats(self) -> StreamStats:
        """What the stream does and did, for diagnostics; `shown` since the last call."""
        shown = [self._shown.popleft() for _ in range(len(self._shown))]
        return StreamStats(
            self.received, self.published, steady=self.assembler.STEADY, dropped=dict(self.assembler.dropped),
            shown=shown, connections=[ConnectionStats(**found) for found in self._subscriber.connections()],
            problem=self.assembler.problem(self.settings.current, time.monotonic()))

    def close(self) -> None:
        """End all threads and topics."""
        self._worker.close()
        if self._subscriber is not None:
            self._subscriber.unregister()
        for output in self._outputs:
            output.close()
        if self._publisher is not None:
            self._publisher.unregister()

    def _make_outputs(self) -> Any:
        settings = self.settings.current
        if 'publish_mask' not in settings:
            return
        from .image_outputs import OUTPUTS  # imports OpenCV, for images only
        for setting, output in OUTPUTS.items():
            if settings[setting]:
                yield output(self.topic, self.settings, self._link.clock_offset)

    def _configure(self, settings: Settings, changed: Mapping[str, Any]) -> None:
        with self._worker.changing():
            self.assembler.configure(settings, changed)

    def _receive(self, records: Records, mask: BoolArray) -> None:
        """Take a batch of segments, in the transport's thread."""
        with self._worker.changing():
            self.assembler.receive(records, mask, time.monotonic())

    def _forward(self, message: Any) -> None:
        """Publish a message that crossed whole, in the transport's thread."""
        self.received += 1
        try:
            with self._worker.changing():
                assembled = self.assembler.forward(message)
                if assembled is not None:
                    self._publish(assembled)
        finally:
            self._log_warnings()

    def _show(self, finished: Any) -> None:
        """Assemble and publish one message, in the worker's thread."""
        self.received += 1
        settings = self.settings.current
        try:
            assembled = self.assembler.assemble(finished, settings, self._link.is_still(), time.monotonic())
            if assembled is None:
                return
            self._publish(assembled)
            for output in self._outputs:
                output.show(assembled)
            self.assembler.settle(finished, assembled, settings, time.monotonic())
            self._link.images_compared(assembled.changed)
        finally:
            self._log_warnings()

    def _publish(self, assembled: Assembled) -> None:
        self._publisher.publish(assembled.message)
        self.published += 1
        self.last_shown = time.monotonic()
        age = (rospy.Time.now().to_nsec() - assembled.stamp) / 1e9 if assembled.stamp else None
        self._shown.append((age, assembled.completeness))

    def _log_warnings(self) -> None:
        while self.assembler.warnings:
            rospy.logwarn_throttle_identical(60, "stream '%s': %s" % (self.name, self.assembler.warnings.pop(0)))

    def _report(self, error: Exception) -> None:
        rospy.logerr_throttle_identical(5, "stream '%s': a message is not published: %s" % (self.name, error))
