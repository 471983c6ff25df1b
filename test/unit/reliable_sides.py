# SPDX-License-Identifier: BSD-3-Clause
"""Two nodes with reliable channels, a bad link between them, and a clock that the test moves."""
import heapq
import itertools
import math
from random import Random
from typing import Any, Dict, List, Optional, Tuple

from smokebot_udp.reliable.bounds import USUAL, Bounds
from smokebot_udp.reliable.conversation import Definition
from smokebot_udp.reliable.events import GivenUp, Joined, Left, Received
from smokebot_udp.reliable.peers import Peers

ROOM = 1300
HEADERS = 110
UP, DOWN = 7, 8
"""Channels to the robot, and to the operator."""
END = 1e9       # later than any of it [s]


class Node:
    """One side: its channels, and what happened to them.

    :param sends: numbers of the channels on which it sends
    """

    def __init__(self, name: str, random: Random, sends: Tuple[int, ...], channels: Dict[int, Dict[str, Any]]) -> None:
        self.name = name
        self.peers = Peers(lambda: random.randint(1, 2 ** 32 - 1), ROOM, HEADERS)
        self.got: Dict[int, List[bytes]] = {number: [] for number in channels}
        self.given_up: List[Tuple[int, int, str]] = []
        self.told: List[str] = []
        for number, options in channels.items():
            self.peers.add(definition(number, number in sends, **options))

    def take(self, event: Any) -> None:
        if isinstance(event, Received):
            self.got[event.channel].append(event.data)
        elif isinstance(event, GivenUp):
            self.given_up.append((event.channel, event.number, event.reason))
        elif isinstance(event, Joined):
            self.told.append('joined')
        elif isinstance(event, Left):
            self.told.append('left: ' + event.reason)


def definition(number: int, sends: bool, ordered: bool = True, expedited: bool = False,
               bounds: Bounds = USUAL) -> Definition:
    return Definition(number, sends, ordered, expedited, bounds)


class Link:
    """A robot and an operator.

    :param channels: {number: options of `definition`}
    :param rate: of each direction; what exceeds it waits in a queue [byte/s]
    """

    def __init__(self, seed: int = 1, loss: float = 0.0, delay: float = 0.05, jitter: float = 0.0,
                 duplicates: float = 0.0, channels: Optional[Dict[int, Dict[str, Any]]] = None,
                 rate: float = math.inf) -> None:
        self.random = Random(seed)
        self.loss, self.delay, self.jitter, self.duplicates = loss, delay, jitter, duplicates
        self._rate, self._free_at = rate, {'robot': 0.0, 'desk': 0.0}
        self.queue_delays: List[float] = []
        """Time that each segment spent in a queue [s]."""
        self.channels = channels or {UP: {}, DOWN: {}}
        self.now = 1000.0
        self.sent = self.bytes = 0
        self.seen: List[Tuple[str, Any]] = []
        """All that ever left: (name of the node that it is for, segment)."""
        self._air: List[Tuple[float, int, str, str, Any]] = []
        self._numbers = itertools.count()
        self.nodes: Dict[str, Node] = {}
        for name in ('robot', 'desk'):
            self.restart(name)

    @property
    def robot(self) -> Node:
        return self.nodes['robot']

    @property
    def desk(self) -> Node:
        return self.nodes['desk']

    def restart(self, name: str) -> None:
        """A node ends without a word, and another one starts. What is on the air stays there."""
        self.nodes[name] = Node(name, self.random, (DOWN,) if name == 'robot' else (UP,), self.channels)
        self.nodes[name].peers.connect([other_of(name)], self.now)

    def connect(self, name: str, connected: bool) -> None:
        self.nodes[name].peers.connect([other_of(name)] if connected else [], self.now)

    def send(self, channel: int, data: bytes) -> int:
        node = self.desk if channel == UP else self.robot
        return node.peers.send(channel, data, None, self.now)

    def work(self) -> bool:
        """Each node does what is due; whether there was anything."""
        worked = False
        for name, node in self.nodes.items():
            work = node.peers.poll(self.now)
            if work is None:
                continue
            worked = True
            for event in work.events:
                node.take(event)
            for peer, segment in work.segments:
                self._transmit(name, peer, segment)
        return worked

    def _transmit(self, name: str, peer: str, segment: Any) -> None:
        self.sent += 1
        size = HEADERS + len(segment.data)
        self.bytes += size
        self.queue_delays.append(max(0.0, self._free_at[name] - self.now))
        left = self._free_at[name] = max(self._free_at[name], self.now) + size / self._rate
        assert all(0 <= value < 2 ** 32 for value in segment if isinstance(value, int)), segment
        assert max(segment.part, segment.parts) < 2 ** 16
        self.seen.append((peer, segment))
        copies = 0 if self.random.random() < self.loss else 1 + (self.random.random() < self.duplicates)
        for _ in range(copies):
            due = left + self.delay + self.random.random() * self.jitter
            heapq.heappush(self._air, (due, next(self._numbers), peer, name, segment))

    def deliver(self, name: str, segment: Any) -> None:
        """A segment reaches a node, from the other one."""
        self.nodes[name].peers.take(other_of(name), segment, self.now)

    def run(self, seconds: float) -> None:
        """Time passes."""
        end = self.now + seconds
        while True:
            while self.work():
                pass
            due = min(self._air[0][0] if self._air else END, *(node.peers.deadline() for node in self.nodes.values()))
            if due >= end:
                self.now = end
                return
            self.now = max(self.now, due)
            while self._air and self._air[0][0] <= self.now:
                _, _, name, sender, segment = heapq.heappop(self._air)
                self.nodes[name].peers.take(sender, segment, self.now)


def other_of(name: str) -> str:
    return 'desk' if name == 'robot' else 'robot'
