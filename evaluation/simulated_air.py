# SPDX-License-Identifier: BSD-3-Clause
"""Robots that share the air, simulated: the package's congestion control over link_lab's Channel, event by event.

A robot has the nodes' congestion.controller.Controller and packet scheduler, and a load that sends; its operators
report over channels of their own. Datagrams have sizes and times, and no content.
"""
import heapq
import itertools
import math
import random
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

from smokebot_udp.congestion.controller import Controller, Demand, Plan
from smokebot_udp.congestion.estimator import LIMITS, REPORT_INTERVAL, Limits
from smokebot_udp.congestion.feedback import ReceiveHistory, Report
from smokebot_udp.congestion.operating_points import OperatingPoint
from smokebot_udp.congestion.packet_scheduler import PacketScheduler
from smokebot_udp.link_lab.channel import Channel
from smokebot_udp.paths import STRAIGHT, Route

from .simulated_paths import Path

FULL = 1500
"""A full datagram on the air [byte]."""

REPORT_SIZE = 600
"""[byte]"""

REFILL_INTERVAL = 0.05
"""A greedy load sends more this often [s]."""


class Events:
    """A queue of events: one clock for all."""

    def __init__(self) -> None:
        self.now = 0.0
        self._heap: List[Tuple[float, int, Callable[..., None], Tuple[Any, ...]]] = []
        self._order = itertools.count()

    def at(self, time: float, action: Callable[..., None], *arguments: Any) -> None:
        """Call action(*arguments) at a time, but not before now."""
        heapq.heappush(self._heap, (max(time, self.now), next(self._order), action, arguments))

    def run(self, until: float) -> None:
        """Process all events up to a time [s]."""
        while self._heap and self._heap[0][0] <= until:
            self.now, _, action, arguments = heapq.heappop(self._heap)
            action(*arguments)
        self.now = until


class Load:
    """What a robot sends."""

    def start(self, robot: 'Robot') -> None:
        """Begin to put frames and to publish messages; the robot has a plan already."""
        raise NotImplementedError

    def demands(self) -> Dict[str, Demand]:
        """The demands of this moment."""
        raise NotImplementedError

    def apply(self, plan: Plan) -> None:
        """Follow a new plan."""


class Operator:
    """One operator of a robot: gets datagrams over one channel, and reports over another one.

    :param clock: reading of its steady clock at the start [s]
    """

    def __init__(self, name: str, there: Path, back: Channel, clock: float, seed: int) -> None:
        self.name, self.there, self.back, self.clock = name, there, back, clock
        draw = random.Random('%s session' % seed)
        self.arrivals = ReceiveHistory(lambda: draw.getrandbits(32))
        self.phase = draw.uniform(0, REPORT_INTERVAL)
        self.came: List[Tuple[float, str, Any, int, float]] = []
        """(when, stream, frame, index, when it was sent) of each datagram that arrived"""
        self.reads: Callable[[float], float] = lambda arrives: arrives
        """When it reads what arrives at a time [s]"""


class Robot:
    """One robot and its operators.

    :param there: channel of the datagrams to its first operator
    :param back: channel of that one's reports
    :param seed: of what is random
    :param clocks: readings of the robot's and the operator's steady clocks at the start [s]
    """

    def __init__(self, events: Events, there: Path, back: Channel, load: Load, seed: int = 0,
                 limits: Limits = LIMITS, clocks: Tuple[float, float] = (1000.0, 5000.0)) -> None:
        self.events, self.there, self.back, self.load = events, there, back, load
        self.robots_clock, clock = clocks
        self.controller = Controller(limits, True, FULL)
        self.scheduler = PacketScheduler(self.controller.rate(self.robot_time))
        self.operators: Dict[str, Operator] = {}
        self.sent: List[Tuple[float, int, float]] = []
        """(when, size, air time that was queued before it) of each datagram"""
        self._protected_bytes = 0
        self._seq: Dict[str, int] = {}
        self._next: Optional[float] = None
        first = self.join('operator', there, back, seed, clock)
        self.came = first.came
        events.at(first.phase, self._tick)
        self.plan = self.controller.tick(self.robot_time, load.demands(), 0)
        load.start(self)

    def join(self, name: str, there: Path, back: Channel, seed: int = 0, clock: float = 5000.0) -> Operator:
        """Another operator gets all from now on."""
        operator = Operator(name, there, back, clock, seed)
        self.operators[name] = operator
        self.controller.on_operators(dict.fromkeys(self.operators, 1), self.robot_time)
        self.events.at(self.events.now + operator.phase, self._report, operator)
        return operator

    def leave(self, name: str) -> None:
        """An operator ends."""
        del self.operators[name]

    @property
    def robot_time(self) -> float:
        """By the robot's steady clock [s]."""
        return self.robots_clock + self.events.now

    def put(self, stream: str, frame: Any, parts: Sequence[Tuple[int, int]]) -> None:
        """Send a frame: [(datagrams, bytes of each), ...]."""
        self.scheduler.put(stream, frame, parts)
        self._wake()

    def publish(self, stream: str, frame: Any, size: int) -> None:
        """Send a protected message at once [byte]."""
        self._protected_bytes += size
        self.scheduler.charge(size, self.robot_time)
        self._depart(stream, frame, 0, 1, size)

    def _wake(self) -> None:
        wait = self.scheduler.wait(self.robot_time)
        if wait < math.inf:
            at = self.events.now + wait
            if self._next is None or at < self._next:
                self._next = at
                self.events.at(at, self._send, at)

    def _send(self, planned: float) -> None:
        if planned != self._next:
            return
        self._next = None
        chunk = self.scheduler.take(self.robot_time + 1e-9)
        if chunk is not None:
            count = chunk.stop - chunk.start
            route = self.controller.route(chunk.stream, count, chunk.size // count, self.robot_time, chunk.start,
                                          chunk.total, chunk.waiting)
            self._depart(chunk.stream, chunk.work, chunk.start, chunk.stop, chunk.size // count, route)
        self._wake()

    def _depart(self, stream: str, frame: Any, start: int, stop: int, size: int,
                route: Route = STRAIGHT) -> None:
        now, first = self.events.now, self._seq.get(stream, 0) + 1
        self._seq[stream] = first + stop - start - 1
        self.controller.on_sent(stream, first, stop - start, size, self.robot_time, route)
        for index in range(start, stop):
            queued = self.there.waits(now)
            for operator in self.operators.values():
                if index - start < route.limits.get(operator.name, stop - start):
                    for time in operator.there.fate(now, size)[:1]:
                        self.events.at(operator.reads(time), self._arrive, operator, stream, first + index - start,
                                       frame, index, size, now)
            self.sent.append((now, size, queued))

    def _arrive(self, operator: Operator, stream: str, seq: int, frame: Any, index: int, size: int,
                left: float) -> None:
        now = self.events.now
        operator.came.append((now, stream, frame, index, left))
        operator.arrivals.add(stream, seq, size, operator.clock + now)

    def _report(self, operator: Operator) -> None:
        if self.operators.get(operator.name) is not operator:
            return
        now = self.events.now
        report = operator.arrivals.report(operator.clock + now)
        for time in operator.back.fate(now, REPORT_SIZE)[:1]:
            self.events.at(time, self._take, operator, report)
        self.events.at(now + REPORT_INTERVAL, self._report, operator)

    def _take(self, operator: Operator, report: Report) -> None:
        train = self.controller.on_report(operator.name, report, self.robot_time)
        self._follow()
        if train is not None:
            self.scheduler.start_probe(train.rate, train.size)
            if self.controller.gain(self.robot_time) > 1:
                self._make_plan()

    def _tick(self) -> None:
        self._make_plan()
        self.events.at(self.events.now + REPORT_INTERVAL, self._tick)

    def _make_plan(self) -> None:
        self.controller.on_operators(dict.fromkeys(self.operators, 1), self.robot_time)
        self.plan = self.controller.tick(self.robot_time, self.load.demands(), self._protected_bytes)
        self.load.apply(self.plan)
        self._follow()

    def _follow(self) -> None:
        self.scheduler.set_rate(self.controller.rate(self.robot_time), self.robot_time)
        self.scheduler.set_tokens(*self.controller.tokens(self.robot_time), self.robot_time)
        self._wake()


class Greedy(Load):
    """Always has more to send.

    :param starts: when [s]
    """
    DEMAND = Demand([OperatingPoint({}, 1.0), OperatingPoint({}, 1e9)])

    def __init__(self, starts: float = 0.0) -> None:
        self._starts = starts

    def start(self, robot: Robot) -> None:
        robot.events.at(self._starts, self._refill, robot)

    def demands(self) -> Dict[str, Demand]:
        return {'greedy': self.DEMAND}

    def _refill(self, robot: Robot) -> None:
        size, rate = robot.plan.datagram_size, robot.controller.rate(robot.robot_time) or 0.0
        robot.put('greedy', None, [(max(4, int(rate * 0.2 / size)), size)])
        robot.events.at(robot.events.now + REFILL_INTERVAL, self._refill, robot)
