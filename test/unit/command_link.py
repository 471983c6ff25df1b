# SPDX-License-Identifier: BSD-3-Clause
"""An operator that commands a robot over a simulated link, measured by a clock that neither of them sees."""
import bisect
import heapq
import random
from dataclasses import dataclass, field
from typing import Any, Callable, List, Optional, Tuple

import numpy as np

from smokebot_udp.teleop.command_copy import Copy
from smokebot_udp.teleop.command_gate import CommandGate
from smokebot_udp.teleop.command_sender import CommandSender
from smokebot_udp.teleop.robot_clock import RobotClock
from smokebot_udp.teleop.timeout import CommandTimeout, State

OPERATOR, ROBOT = 7, 9      # sessions
MAX_AGE, TIMEOUT = 0.3, 0.5
MD5SUM = '9f195f881246fdfa2798d1d3eebca84a'
MEASURED = 400              # datagrams over which the robot measures the loss


@dataclass
class Way:
    """What happens to a datagram."""
    draw: random.Random
    delay: float = 0.05
    jitter: float = 0.01                        # uniform; more than a gap: copies overtake one another
    loss: float = 0.0
    duplicated: float = 0.02
    late: float = 0.01                          # by up to two seconds
    cut: Callable[[float], bool] = lambda now: False

    def arrivals(self, now: float) -> List[float]:
        draw = self.draw
        if draw.random() < self.loss or self.cut(now):
            return []
        wait = self.delay + self.jitter * draw.random()
        if draw.random() < self.late:
            wait += 2 * draw.random()
        again = [now + wait + draw.choice((0.01, 0.5, 5.0)) * draw.random()] if draw.random() < self.duplicated else []
        return [now + wait, *again]


@dataclass
class Clock:
    """A steady clock: what it shows at a true time."""
    start: float
    drift: float

    def at(self, now: float) -> float:
        return self.start + (1 + self.drift) * now


@dataclass
class Sums:
    """What happened, in true time."""
    made: List[float] = field(default_factory=list)                     # of command 1, 2, ...
    in_force: List[Tuple[float, int]] = field(default_factory=list)     # (since, number)
    stops: List[float] = field(default_factory=list)                    # when on_timeout began
    copies: int = 0

    def within(self, limit: float) -> float:
        """The share of the commands that took effect, or a newer one did, within a time; without the very last."""
        times, numbers = [at for at, _ in self.in_force], [number for _, number in self.in_force]
        places = [bisect.bisect_left(numbers, number) for number in range(1, len(self.made) + 1)]
        waits = [times[place] - made for place, made in zip(places, self.made) if place < len(times)]
        return float(np.mean(np.array(waits) <= limit))

    def age(self, percent: float) -> float:
        """Percentile of the age of the command that is in force, over the time [s]."""
        times = np.array([at for at, _ in self.in_force])
        made = np.array([self.made[number - 1] for _, number in self.in_force])
        moments = np.linspace(times[0], times[-1], 20 * len(times))
        return float(np.percentile(moments - made[np.searchsorted(times, moments, 'right') - 1], percent))


class CommandLink:
    """Runs both sides, event by event, each with its own clock; asserts what must never happen."""

    def __init__(self, seed: int, rate: float = 20.0, there: Optional[Way] = None, back: Optional[Way] = None) -> None:
        self.draw, self.now = random.Random(seed), 0.0
        self.there, self.back = there or Way(self.draw), back or Way(self.draw)
        self.operator, self.robot = OPERATOR, ROBOT
        self.here_clock = Clock(self.draw.uniform(1, 1e6), self.draw.uniform(-5e-5, 5e-5))
        self.start_robot(ROBOT)
        self.start_operator(OPERATOR)
        self.period, self.sums = 1 / rate, Sums()
        self._events: List[Tuple[float, int, Callable[..., None], Tuple[Any, ...]]] = []
        self._order = 0
        self._wake = self._watched = np.inf     # when the threads wake up that send, and that watch the timeout
        self._sent: List[bool] = []     # whether a datagram arrived, in a ring
        self.at(0.0, self._ask)
        self.at(1.0, self._command)

    def at(self, when: float, act: Callable[..., None], *what: Any) -> None:
        """Do something at a true time."""
        self._order += 1
        heapq.heappush(self._events, (when, self._order, act, what))

    def run(self, until: float) -> Sums:
        while True:
            self.now = min(self._wake, self._watched, self._events[0][0])
            if self.now >= until:
                return self.sums
            if self.now == self._wake:
                self._send()
            elif self.now == self._watched:
                self._watch()
            else:
                _, _, act, what = heapq.heappop(self._events)
                act(*what)

    def start_robot(self, session: int) -> None:
        """The machine and its node start, once more or for the first time."""
        self.robot = session
        self.robot_clock = Clock(self.draw.uniform(1, 1e6), self.draw.uniform(-5e-5, 5e-5))
        self.gate = CommandGate(session, MD5SUM, MAX_AGE)
        self.timeout = CommandTimeout(TIMEOUT, 20.0, 2.0)
        self._let_drive()

    def start_operator(self, session: int) -> None:
        """The node starts, once more or for the first time."""
        self.operator = session
        self.clock, self.sender = RobotClock(), CommandSender(session, MD5SUM, MAX_AGE)
        self._let_drive()

    def _let_drive(self) -> None:
        self.gate.rule(self.operator, False, 0, self.robot_clock.at(self.now))

    def accepted_between(self, begin: float, end: float) -> List[float]:
        """When commands took effect."""
        return [at for at, _ in self.sums.in_force if begin < at < end]

    # operator

    def _ask(self) -> None:
        echo = self.clock.ask(self.here_clock.at(self.now))
        for arrival in self.there.arrivals(self.now):
            self.at(arrival, self._answer, echo)
        self.at(self.now + (0.2 if self.clock.session else 0.05), self._ask)

    def _command(self) -> None:
        here = self.here_clock.at(self.now)
        made = self.clock.robot_time(here)
        if made is not None:
            self.sums.made.append(self.now)
            self.sender.put(b'%d' % len(self.sums.made), made, 0, here)
            self._schedule()
        self.at(self.now + self.period, self._command)

    def _schedule(self) -> None:
        """The thread that sends wakes up late by up to 1 ms."""
        due = self.sender.deadline()
        late = 0.001 * self.draw.random()
        self._wake = np.inf if due is None else max(self.now, self._true(self.here_clock, due)) + late

    def _true(self, clock: Clock, shown: float) -> float:
        return (shown - clock.start) / (1 + clock.drift)

    def _send(self) -> None:
        copy = self.sender.poll(self.here_clock.at(self.now))
        if copy is not None:
            self.sums.copies += 1
            arrivals = self.there.arrivals(self.now)
            self._sent.append(bool(arrivals))
            for arrival in arrivals:
                self.at(arrival, self._receive, copy)
        self._schedule()

    def _status(self, robot: int, echo: int, held: int, clock: int, loss: Optional[float]) -> None:
        self.clock.update(robot, echo, held, clock, self.here_clock.at(self.now))
        self.sender.loss = loss

    # robot

    def _answer(self, echo: int) -> None:
        held = self.draw.randrange(20000)
        self._sent = self._sent[-MEASURED:]
        loss = 1 - sum(self._sent) / len(self._sent) if self._sent else None
        shown = int(1e6 * self.robot_clock.at(self.now)) + held
        for arrival in self.back.arrivals(self.now + 1e-6 * held):
            self.at(arrival, self._status, self.robot, echo, held, shown, loss)

    def _receive(self, copy: Copy) -> None:
        now = self.robot_clock.at(self.now)
        accepted = self.gate.take(copy, now)
        if accepted is None:
            return
        number = int(accepted.data)
        assert self.now - self.sums.made[number - 1] <= MAX_AGE
        assert not self.sums.in_force or number > self.sums.in_force[-1][1]
        self.sums.in_force.append((self.now, number))
        self.timeout.accepted(now, accepted.age)
        self._watch()

    def _watch(self) -> None:
        """The robot's thread polls at the deadline, late by up to 5 ms."""
        driving = self.timeout.state is State.DRIVING
        if self.timeout.poll(self.robot_clock.at(self.now)) and driving:
            self.sums.stops.append(self.now)
        due = self.timeout.deadline()
        late = 0.005 * self.draw.random()
        self._watched = np.inf if due is None else max(self.now, self._true(self.robot_clock, due)) + late
