# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of the link's supervision: what leaves follows what the operators report to have arrived."""
import collections
import math
import threading
import time

import rospy

from .. import udpros
from ..congestion.estimator import MBIT, REPORTS_APART, Estimator, Link
from ..congestion.feedback import Reports
from ..congestion.sent_history import Departures
from ..monitoring.windows import Rate
from ..msg import LinkReport, LinkStatus
from ..streams.rate import Repeater
from .link_reporter import TOPIC

MOST_OPERATORS = 8
"""Who else reports is not listened to: reports come from the network, and each operator costs memory."""

GONE = 10.0
"""An operator that does not report for so long counts no more, where others do [s]."""

SENT_OVER = 1.0
"""[s]"""

UNKNOWN = Link(math.nan, math.nan, math.nan, math.nan)


class Operator:
    """What is known of the link to one operator."""

    def __init__(self, departures, limits, now):
        self.reports, self.estimator = Reports(departures), Estimator(now, limits)
        self.heard = now
        self.known = False      # whether a report of it ever told of datagrams that came


class LinkControl:
    """Sets the rate at which the robot's outbox sends.

    Where several operators listen, what the worst link carries counts: each gets the same.

    :param limits: supervisor.estimate.Limits
    :param adapt: whether the rate follows the reports; else max_rate it is
    """

    def __init__(self, limits, adapt):
        self._limits, self._adapt = limits, adapt
        self._lock = threading.Lock()
        self._departures = Departures()
        self._operators = {}    # {node's name: Operator}
        self._strangers = 0
        self._sent = Rate(SENT_OVER)

    @property
    def start_rate(self):
        """[byte/s]; None: unlimited."""
        rate = min(self._limits.start, self._limits.max_rate) if self._adapt else self._limits.max_rate
        return rate if rate < math.inf else None

    def departed(self, stream, seq, count, size, now):
        """Datagrams left, see streams.outbox; any thread."""
        with self._lock:
            if seq is None:
                self._departures.note_unnumbered(count * size)
            else:
                self._departures.note(stream, seq, count, size, now)

    def start(self, outbox, allocation):
        """Begin to set an outbox's rate, to divide it by an allocation.Allocation, and to tell of the link."""
        self._outbox, self._allocation = outbox, allocation
        self._status = rospy.Publisher('~link', LinkStatus, queue_size=1)
        self._reports = udpros.Subscriber(TOPIC, LinkReport, self._take, queue_size=10)
        self._polls = Repeater('link', self._poll, self._tell, REPORTS_APART)
        self._polls.start()

    def _take(self, report):
        """A report came: the transport's thread."""
        name, now = report._connection_header['callerid'], time.monotonic()
        with self._lock:
            operator = self._operator(name, now)
            evidence = operator and operator.reports.take(report, now)
            if evidence is None:
                return
            operator.heard = now
            operator.known |= bool(evidence.points)
            train = operator.estimator.take(evidence, now, self._allocation.wanted)
        if self._adapt:
            self._set_rate(now)
            if train is not None:
                self._outbox.change(lambda pace: pace.train(train.rate, train.size))

    def _operator(self, name, now):
        if name not in self._operators:
            for other, operator in list(self._operators.items()):
                if now - operator.heard > GONE:
                    del self._operators[other]
            if len(self._operators) >= MOST_OPERATORS:
                self._strangers += 1
                return None
            self._operators[name] = Operator(self._departures, self._limits, now)
        return self._operators[name]

    def _worst(self, now):
        """The (name, Operator) that the rate goes by; None where none ever reported what came."""
        known = [item for item in self._operators.items() if item[1].known]
        heard = [item for item in known if now - item[1].heard <= GONE] or known
        return min(heard, key=lambda item: item[1].estimator.rate, default=None)

    def _rate(self, now):
        """What may leave [byte/s]; None: there is no limit."""
        worst = self._worst(now) if self._adapt else None
        return worst[1].estimator.rate if worst else self.start_rate

    def _budget(self, now):
        """What streams may plan with [byte/s]: a dip in the rate soon passes, and is no reason for coarser pictures."""
        worst = self._worst(now) if self._adapt else None
        return worst[1].estimator.link.capacity if worst else self.start_rate

    def _set_rate(self, now):
        with self._lock:
            rate = self._rate(now)
        self._outbox.change(lambda pace: pace.set_rate(rate))

    def _poll(self):
        now = time.monotonic()
        with self._lock:
            self._sent.read(self._departures.total, now)
            for operator in self._operators.values():
                operator.estimator.poll(now)
            budget = self._budget(now)
        self._set_rate(now)
        self._allocation.divide(budget, now)
        self._status.publish(self.status(now))

    def status(self, now):
        """LinkStatus."""
        with self._lock:
            worst = self._worst(now)
            link = worst[1].estimator.link if worst else UNKNOWN
            status = LinkStatus(
                state=self._state(worst, now), rate=(self._rate(now) or 0.0) / MBIT,
                sent=(self._sent.per_second or 0.0) / MBIT, wanted=self._allocation.wanted / MBIT,
                capacity=link.capacity / MBIT, loss=link.loss, queue_delay=link.queue_delay, round_trip=link.round_trip)
        status.header.stamp = rospy.Time.now()
        return status

    def _state(self, worst, now):
        if not self._adapt:
            return 'fixed'
        if worst is None:
            return 'no operator has reported yet'
        name, operator = worst
        if operator.estimator.missing:
            return 'no reports of %s for %.1f s' % (name, now - operator.heard)
        return 'as %s reports' % name

    def figures(self, now):
        """What diagnostics tell: (problem or None, {what: value})."""
        status = self.status(now)
        with self._lock:
            refused = collections.Counter()
            for operator in self._operators.values():
                refused.update(operator.reports.dropped)
            worst = self._worst(now)
            missing = self._adapt and worst is not None and worst[1].estimator.missing
        values = {'state': status.state, **{'%s [Mbit/s]' % name: getattr(status, name)
                                            for name in ('rate', 'sent', 'wanted', 'capacity')},
                  'loss [%]': 100 * status.loss, 'queue delay [ms]': 1e3 * status.queue_delay,
                  'round trip [ms]': 1e3 * status.round_trip}
        values.update({'reports refused, ' + reason: count for reason, count in sorted(refused.items())})
        if self._strangers:
            values['reports refused, too many operators'] = self._strangers
        return status.state if missing else None, values

    def _tell(self, error):
        if not rospy.is_shutdown():
            rospy.logerr_throttle_identical(60, 'link: %s' % error)

    def close(self):
        self._polls.stop()
        self._reports.unregister()
        self._status.unregister()
