# SPDX-License-Identifier: BSD-3-Clause
"""Robots that share the air, simulated: the supervisor's own code over channel.Channel, event by event, without a wait.

A robot has an estimate, a queue that paces and what puts frames into it; its operator reports over a channel
of their own. What is simulated is sizes and times; no pictures.
"""
import heapq
import itertools
import math
import random
from dataclasses import replace

from ..congestion.allocation import datagram_size
from ..congestion.estimator import LIMITS, REPORTS_APART, Estimator
from ..congestion.feedback import Arrivals, Reports
from ..congestion.packet_scheduler import Pace
from ..congestion.sent_history import Departures

FULL = 1500
"""A full datagram on the air [byte]."""


class Events:
    """What happens when: one clock for all."""

    def __init__(self):
        self.now = 0.0
        self._heap, self._order = [], itertools.count()

    def at(self, time, action, *arguments):
        """Do it at a time, now at the earliest."""
        heapq.heappush(self._heap, (max(time, self.now), next(self._order), action, arguments))

    def run(self, until):
        """Let it happen, until a time [s]."""
        while self._heap and self._heap[0][0] <= until:
            self.now, _, action, arguments = heapq.heappop(self._heap)
            action(*arguments)
        self.now = until


class Robot:
    """One robot and its operator.

    :param events: Events
    :param there, back: Channels: datagrams, reports
    :param load: f(robot), called at the start: has it put frames and publish messages
    :param clocks: what the robot's and the operator's steady clocks show at the beginning [s]
    """

    def __init__(self, events, there, back, load, seed=0, limits=LIMITS, clocks=(1000.0, 5000.0)):
        self.events, self.there, self.back = events, there, back
        self.robots_clock, self.operators_clock = clocks
        draw = random.Random('%s session' % seed)
        self.departures = Departures()
        self.reports = Reports(self.departures)
        self.estimator = Estimator(self.robot_time, limits)
        self.pace = Pace(self.estimator.rate)
        self.wanted = math.inf
        """What the load would send [byte/s]."""
        self.arrivals = Arrivals(lambda: draw.getrandbits(32))
        self.sent, self.came, self.history = [], [], []
        """(when, size, air time that waited before it) of what left; (when, stream, frame, index, when it left) of what
        came; (when, rate, Link) as it was concluded."""
        self._seq, self._next = {}, None
        phase = draw.uniform(0, REPORTS_APART)
        events.at(phase, self._report)
        events.at(phase, self._poll)
        load(self)

    @property
    def robot_time(self):
        return self.robots_clock + self.events.now

    def put(self, stream, frame, parts):
        """A frame is to leave: [(datagrams, bytes of each), ...]."""
        self.pace.put(stream, frame, parts)
        self._wake()

    def publish(self, stream, frame, size):
        """A protected message leaves at once [byte]."""
        self.pace.charge(size, self.robot_time)
        self._depart(stream, frame, 0, 1, size)

    def _wake(self):
        wait = self.pace.wait(self.robot_time)
        if wait < math.inf:
            at = self.events.now + wait
            if self._next is None or at < self._next:
                self._next = at
                self.events.at(at, self._send, at)

    def _send(self, planned):
        if planned != self._next:
            return
        self._next = None
        chunk = self.pace.take(self.robot_time + 1e-9)
        if chunk is not None:
            self._depart(chunk.stream, chunk.work, chunk.start, chunk.stop, chunk.size // (chunk.stop - chunk.start))
        self._wake()

    def _depart(self, stream, frame, start, stop, size):
        now, first = self.events.now, self._seq.get(stream, 0) + 1
        self._seq[stream] = first + stop - start - 1
        self.departures.note(stream, first, stop - start, size, self.robot_time)
        for index in range(start, stop):
            waits = self.there.waits(now)
            for time in self.there.fate(now, size)[:1]:
                self.events.at(time, self._arrive, stream, first + index - start, frame, index, size, now)
            self.sent.append((now, size, waits))

    def _arrive(self, stream, seq, frame, index, size, left):
        now = self.events.now
        self.came.append((now, stream, frame, index, left))
        self.arrivals.note(stream, seq, size, self.operators_clock + now)

    def _report(self):
        now = self.events.now
        report = self.arrivals.report(self.operators_clock + now)
        for time in self.back.fate(now, 600)[:1]:
            self.events.at(time, self.take, report)
        self.events.at(now + REPORTS_APART, self._report)

    def take(self, report):
        """A report came to the robot."""
        evidence = self.reports.take(report, self.robot_time)
        train = evidence and self.estimator.take(evidence, self.robot_time, self.wanted)
        self._follow()
        if train is not None:
            self.pace.train(train.rate, train.size)

    def _poll(self):
        self.estimator.poll(self.robot_time)
        self._follow()
        self.events.at(self.events.now + REPORTS_APART, self._poll)

    def _follow(self):
        self.pace.set_rate(self.estimator.rate)
        self.history.append((self.events.now, self.estimator.rate, replace(self.estimator.link)))
        self._wake()


def greedy(robot):
    """A load that always has more: datagrams as long as is right for the link."""
    def more():
        size = datagram_size(robot.estimator.link.capacity, FULL)
        robot.put('greedy', None, [(max(4, int(robot.estimator.rate * 0.2 / size)), size)])
        robot.events.at(robot.events.now + 0.05, more)
    more()
