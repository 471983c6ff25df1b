# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of congestion control: reports to the robot, ten times a second, what arrived."""
import os
import threading
import time
from typing import List

from ..congestion.estimator import REPORT_INTERVAL
from ..congestion.feedback import ReceiveHistory, Report
from ..msg import ArrivalMark, LinkReport, StreamArrivals
from ..traffic import EXPEDITED
from ..transport import Transport
from .logging import log_error
from .opened import Part
from .worker import PeriodicWorker

TOPIC = '/smokebot_udp/link/report'
"""Topic of the reports, on the wire."""

SECOND = '#2'
"""After the names of all streams in a report about an operator's second path."""


def as_message(report: Report) -> LinkReport:
    """The LinkReport message of a report."""
    return LinkReport(
        session=report.session, clock=report.clock, marked=report.marked,
        streams=[StreamArrivals(one.name, one.highest, one.received, one.bytes) for one in report.streams],
        marks=[ArrivalMark(mark.stream, mark.seq, mark.age) for mark in report.marks])


def path_of(report: LinkReport) -> int:
    """Index of the path that a report is about; its streams' names lose what says so."""
    path = int(any(one.name.endswith(SECOND) for one in report.streams))
    for one in report.streams if path else ():
        one.name = one.name[:-len(SECOND)] if one.name.endswith(SECOND) else ''
    return path


class LinkReporter(Part):
    """Counts what the streams' subscribers receive, and reports it, by path."""

    def __init__(self, transport: Transport) -> None:
        super().__init__()
        self._histories = [ReceiveHistory(lambda: int.from_bytes(os.urandom(4), 'little')) for _ in range(2)]
        self._lock = threading.Lock()
        self._publisher = self._opened.topic(transport.publisher(TOPIC, LinkReport, queue_size=1, tos=EXPEDITED))
        self._opened.started(PeriodicWorker(
            'link reports', self._report, log_error('link reports to the robot'), REPORT_INTERVAL))

    def arrived(self, stream: str, number: int, seq: int, size: int, count: int, when: float,
                marked: int, path: int = 0) -> None:
        """Record datagrams of a stream; any thread, see Transport.subscriber.

        :param number: of the connection
        """
        with self._lock:
            self._histories[path].add(stream + SECOND * path, seq, size, when, count, number, marked)

    def _report(self) -> None:
        with self._lock:
            first, second = (history.report(time.monotonic()) for history in self._histories)
        self._publisher.publish(as_message(first))
        if second.marks:
            self._publisher.publish(as_message(second))

    def hosts(self) -> List[str]:
        """The hosts that get the reports: the robot's."""
        return [connection['address'][0] for connection in self._publisher.connections()]
