# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of the link's supervision: tells the robot ten times a second what arrived."""
import os
import threading
import time

import rospy

from .. import udpros
from ..congestion.estimator import REPORTS_APART
from ..congestion.feedback import Arrivals
from ..msg import ArrivalMark, LinkReport, StreamArrivals
from ..streams.rate import Repeater

TOPIC = 'smokebot_udp/link/report'
"""Where reports cross."""


def as_message(report):
    """A supervisor.report.Report as a LinkReport."""
    return LinkReport(
        session=report.session, clock=report.clock,
        streams=[StreamArrivals(one.name, one.highest, one.received, one.bytes) for one in report.streams],
        marks=[ArrivalMark(mark.stream, mark.seq, mark.age) for mark in report.marks])


class LinkReporter:
    """Counts what the streams' transports take, and reports it."""

    def __init__(self):
        self._arrivals, self._lock = Arrivals(lambda: int.from_bytes(os.urandom(4), 'little')), threading.Lock()
        self._connections = {}      # {stream: number of its newest connection}
        self._publisher = udpros.Publisher(TOPIC, LinkReport, queue_size=1)
        self._reports = Repeater('link reports', self._report, self._tell, REPORTS_APART)
        self._reports.start()

    def arrived(self, stream, number, seq, size, count, when):
        """Datagrams of a stream came, see udpros.Subscriber; any thread."""
        with self._lock:
            if number > self._connections.setdefault(stream, number):
                self._connections[stream] = number
                self._arrivals.begin()      # the robot began anew: it knows nothing of what came before
            if number == self._connections[stream]:
                self._arrivals.note(stream, seq, size, when, count)

    def _report(self):
        with self._lock:
            report = self._arrivals.report(time.monotonic())
        self._publisher.publish(as_message(report))

    def _tell(self, error):
        if not rospy.is_shutdown():
            rospy.logerr_throttle_identical(60, 'the robot cannot be told what arrives: %s' % error)

    def close(self):
        self._reports.stop()
        self._publisher.unregister()
