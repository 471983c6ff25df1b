# SPDX-License-Identifier: BSD-3-Clause
"""Robots that share the air, simulated: the supervisor's own code over channel.Channel, event by event, without a wait.

A robot has an estimate, a queue that paces and what puts frames into it; its operator reports over a channel
of their own. What is simulated is sizes and times; no pictures.
"""
import heapq
import itertools
import random

from ..supervisor.departures import Departures
from ..supervisor.estimate import Estimator, Limits
from ..supervisor.pace import PaceQueue, datagram_size
from ..supervisor.report import Arrivals, Reports

REPORTS_APART = 0.1
"""[s]"""

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
    :param load: f(robot), called at the start: puts frames into robot.queue and calls robot.wake()
    :param clocks: what the robot's and the operator's steady clocks show at the beginning [s]
    """

    def __init__(self, events, there, back, load, seed=0, limits=Limits(), clocks=(1000.0, 5000.0)):
        self.events, self.there, self.back = events, there, back
        self.robots_clock, self.operators_clock = clocks
        draw = random.Random('%s session' % seed)
        self.departures = Departures()
        self.reports = Reports(self.departures)
        self.estimator = Estimator(self.robot_time, limits)
        self.queue = PaceQueue(self.estimator.rate, self.robot_time)
        self.arrivals = Arrivals(lambda: draw.getrandbits(32))
        self.wanted = float('inf')
        self.sent, self.came, self.history = [], [], []
        """(when, size, air time that waited before it) of what left; (when, stream, frame, index, size, when it left)
        of what came; (when, Link's values, rate) at each report."""
        self._seq, self._next = {}, None
        phase = draw.uniform(0, REPORTS_APART)
        events.at(phase, self._report)
        events.at(phase, self._poll)
        load(self)

    @property
    def robot_time(self):
        return self.robots_clock + self.events.now

    def wake(self):
        """There may be something to send."""
        when = self.queue.next_time()
        if when < float('inf'):
            at = max(self.events.now, when - self.robots_clock)
            if self._next is None or at < self._next:
                self._next = at
                self.events.at(at, self._send, at)

    def _send(self, planned):
        if planned != self._next:
            return
        self._next = None
        now = self.events.now
        item = self.queue.pop(self.robot_time + 1e-9)
        if item is not None:
            seq = self._seq[item.stream] = self._seq.get(item.stream, 0) + 1
            self.departures.note(item.stream, seq, 1, item.size, self.robot_time)
            self.sent.append((now, item.size, self.there.waits(now)))
            for time in self.there.fate(now, item.size)[:1]:
                self.events.at(time, self._arrive, item, seq, now)
        self.wake()

    def _arrive(self, item, seq, left):
        now = self.events.now
        self.came.append((now, item.stream, item.frame, item.index, item.size, left))
        self.arrivals.note(item.stream, seq, item.size, self.operators_clock + now)

    def _report(self):
        now = self.events.now
        report = self.arrivals.report(self.operators_clock + now)
        for time in self.back.fate(now, 600)[:1]:
            self.events.at(time, self.take, report)
        self.events.at(now + REPORTS_APART, self._report)

    def take(self, report):
        """A report came to the robot."""
        now = self.robot_time
        evidence = self.reports.take(report, now)
        if evidence is not None:
            train = self.estimator.take(evidence, now, self.wanted)
            self._follow()
            if train is not None:
                self.queue.start_train(train)

    def _poll(self):
        self.estimator.poll(self.robot_time)
        self._follow()
        self.events.at(self.events.now + REPORTS_APART, self._poll)

    def _follow(self):
        self.queue.set_rate(self.estimator.rate, self.robot_time)
        link = self.estimator.link
        self.history.append((self.events.now, link.capacity, self.estimator.rate, link.queue_delay, link.loss))
        self.wake()


def greedy(robot):
    """A load that always has more."""
    robot.queue.put('greedy', None, _Endless(robot))
    robot.wake()


class _Endless:
    """Datagrams without end, as a sequence of their sizes."""

    def __init__(self, robot):
        self._robot = robot

    def __len__(self):
        return 1 << 60

    def __getitem__(self, index):
        return datagram_size(self._robot.estimator.link.capacity, FULL)
