# SPDX-License-Identifier: BSD-3-Clause
"""Reports to the robot what this operator holds of its streams (msg/Held), so that it is not sent again."""
import time
from typing import Callable, Dict, Optional

from ..msg import Held
from ..streams.held import TOPIC, Holding, to_message
from ..streams.held_schedule import HeldSchedule
from ..traffic import EXPEDITED
from ..transport import Transport
from .logging import log_error
from .opened import Part
from .worker import DeadlineWorker

QUEUE_SIZE = 8
"""Reports of different streams that leave at one moment."""


class HeldReporter(Part):
    """Sends the reports of a node's streams; lives as long as the node."""

    def __init__(self, transport: Transport) -> None:
        super().__init__()
        self._transport = transport
        self._schedule = HeldSchedule()
        self._streams: Dict[str, Callable[[], Optional[Holding]]] = {}
        self._publisher = self._opened.topic(
            transport.publisher(TOPIC, Held, queue_size=QUEUE_SIZE, tos=EXPEDITED))
        self._worker: DeadlineWorker[str] = self._opened.started(DeadlineWorker(
            'held reports', self._schedule.poll, self._schedule.deadline, self._report,
            log_error('reports of what is held')))

    def received(self, name: str, holding: Callable[[], Optional[Holding]], interval: float) -> None:
        """Note that segments of a stream were received that may be held; any thread.

        :param holding: f(), called in a thread of its own, soon; None: there is nothing to report
        :param interval: between reports of the stream, at least [s]
        """
        with self._worker.adding():
            self._streams[name] = holding
            self._schedule.received(name, time.monotonic(), interval)

    def _report(self, name: str) -> None:
        holding = self._streams[name]()
        if holding is not None:
            self._publisher.publish(to_message(holding, name, self._transport.room))
