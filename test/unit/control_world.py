# SPDX-License-Identifier: BSD-3-Clause
"""Operators and a robot that exchange requests and statuses over a simulated link; time is simulated, too.

Each node has a steady clock of its own that begins anew when the node is restarted.
"""
import heapq
import itertools
from random import Random
from typing import Any, Callable, Dict, List, Optional

from smokebot_udp.teleop.control_client import ControlClient
from smokebot_udp.teleop.control_server import ControlServer
from smokebot_udp.teleop.records import Status, Wish


class Desk:
    """An operator's node, and the person in front of it."""

    def __init__(self, name: str, session: int, started: float) -> None:
        self.name, self.client, self.seq = name, ControlClient(session), 0
        self.began = started - 1000.0 - session
        """When its clock was 0 [s]."""


class World:
    """A robot, its operators, and the link between them.

    :param delay: each way [s]
    :param loss, duplicates: share of the datagrams that are lost, or come twice
    :param held_up: share that comes up to 3 s later than others
    """

    def __init__(self, seed: int, delay: float = 0.05, jitter: float = 0.02, loss: float = 0.0,
                 duplicates: float = 0.0, held_up: float = 0.0) -> None:
        self.random = Random(seed)
        self.delay, self.jitter, self.loss, self.duplicates, self.held_up = delay, jitter, loss, duplicates, held_up
        self.now = 0.0
        self.desks: Dict[str, Desk] = {}
        self.cut: Dict[str, bool] = {}
        """{operator: whether no datagrams pass between it and the robot, in either direction}"""
        self.mute: Dict[str, bool] = {}
        """{operator: whether none of its datagrams come to the robot}"""
        self.deaf: Dict[str, bool] = {}
        """{operator: whether none of the robot's datagrams come to it}"""
        self.after: Callable[[], None] = lambda: None
        """Called after each datagram that came and each step in time."""
        self._sessions = itertools.count(1)
        self._flying: List[Any] = []
        self._order = itertools.count()
        self._starts: Dict[int, float] = {}     # {session of the robot's node: when its clock was 0}
        self.restart_robot()

    def restart_robot(self) -> None:
        """End the robot's node and start it again; its clock is another one."""
        self.server = ControlServer(next(self._sessions))
        self._starts[self.server.session] = self.now - self.random.uniform(1.0, 1e6)

    def add(self, name: str) -> Desk:
        """Start an operator's node, or start it again."""
        desk = self.desks[name] = Desk(name, next(self._sessions), self.now)
        for failures in (self.cut, self.mute, self.deaf):
            failures.setdefault(name, False)
        return desk

    @property
    def robot_now(self) -> float:
        """The robot's steady clock [s]."""
        return self.now - self._starts[self.server.session]

    def desk_now(self, name: str) -> float:
        """An operator's steady clock [s]."""
        return self.now - self.desks[name].began

    def robot_time(self, name: str) -> Optional[float]:
        """The earliest that it may be by the robot's clock: an operator's estimate is wrong by half the round trip at
        most."""
        robot = self.desks[name].client.robot
        error = self.random.uniform(-self.delay, self.delay)
        return self.now - self._starts[robot] + error - self.delay if robot else None

    def ask(self, name: str, wish: Wish) -> int:
        """A person asks something of the robot; see ControlClient.ask."""
        request = self.desks[name].client.ask(wish, self.desk_now(name), self.robot_time(name))
        self.flush()
        return request

    def outcome(self, name: str, request: int) -> Optional[str]:
        """See ControlClient.outcome."""
        return self.desks[name].client.outcome(request)

    def run(self, duration: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass; returns whether `until` became true [s]."""
        end = self.now + duration
        while True:
            self.flush()
            self.after()
            if until():
                return True
            following = max(self.now + 1e-6, self._deadline())
            if following > end:
                self.now = end
                return False
            self.now = following
            while self._flying and self._flying[0][0] <= self.now:
                _, _, name, datagram = heapq.heappop(self._flying)
                self.arrive(name, datagram)
                self.flush()
                self.after()

    def _deadline(self) -> float:
        desks = [desk.client.deadline() + desk.began for desk in self.desks.values()]
        arrivals = [self._flying[0][0]] if self._flying else []
        return min([self.server.deadline() + self._starts[self.server.session], *desks, *arrivals])

    def flush(self) -> None:
        """Send what is to be sent now."""
        status = self.server.poll(self.robot_now)
        for name, desk in self.desks.items():
            request = desk.client.poll(self.desk_now(name))
            if request is not None:
                desk.seq += 1
                self._send(name, (desk.seq, request))
            if status is not None:
                self._send(name, status)

    def _send(self, name: str, datagram: Any) -> None:
        failed = self.cut[name] or (self.deaf if isinstance(datagram, Status) else self.mute)[name]
        for _ in range(1 + (self.random.random() < self.duplicates)):
            if not failed and self.random.random() >= self.loss:
                late = 3 * self.random.random() if self.random.random() < self.held_up else 0.0
                at = self.now + self.delay + self.jitter * self.random.random() + late
                heapq.heappush(self._flying, (at, next(self._order), name, datagram))

    def arrive(self, name: str, datagram: Any) -> None:
        """A datagram comes: a Status, or (seq, Request)."""
        if isinstance(datagram, Status):
            self.desks[name].client.receive(datagram, self.desk_now(name))
        else:
            seq, request = datagram
            self.server.receive(name, seq, request, self.robot_now)
