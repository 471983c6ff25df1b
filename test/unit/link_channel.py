# SPDX-License-Identifier: BSD-3-Clause
"""A simulated network between the cores of a link: delay, loss, duplicates, reordering; time is simulated, too."""
import heapq
import itertools
from random import Random
from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy as np

from smokebot_udp.link.core import LinkCore
from smokebot_udp.link.peer import Delivery, Event
from smokebot_udp.link.place import Address, address_of
from smokebot_udp.udpros.datagram import HEADER, Op
from smokebot_udp.udpros.endpoints import SOCKADDR_IN, number_of

ROBOT: Address = ('10.0.0.7', 17001)
OPERATOR: Address = ('10.0.0.9', 40001)
KEY = bytes(range(32))
SIZE = 1472


def random_bytes(seed: int) -> Callable[[int], bytes]:
    """A source of bytes that is the same in each run."""
    random = Random(seed)
    return lambda count: bytes(random.getrandbits(8) for _ in range(count))


def batch(packets: List[Tuple[Address, bytes]], slot: int = SIZE + 1, interface: int = 0) -> Tuple[
        np.ndarray, np.ndarray, np.ndarray]:
    """Packets as a DatagramReceiver has them, with rubbish behind each."""
    datagrams = np.full((len(packets), slot), 0xa5, np.uint8)
    sources = np.zeros(len(packets), SOCKADDR_IN)
    for row, ((host, port), packet) in enumerate(packets):
        datagrams[row, :len(packet)] = np.frombuffer(packet[:slot], np.uint8)
        sources[row]['address'], sources[row]['port'], sources[row]['interface'] = number_of(host), port, interface
    return datagrams, np.array([min(slot, len(packet)) for _, packet in packets], np.int64), sources


def give(core: LinkCore, source: Address, *packets: bytes, now: float = 0.0, interface: int = 0) -> List[Delivery]:
    """Let a core receive packets in one batch, by an interface of its machine."""
    return core.receive(*batch([(source, packet) for packet in packets], interface=interface), now)


def data(identifier: int, payload: bytes = b'') -> bytes:
    """A UDPROS datagram of a topic."""
    return HEADER.pack(identifier, Op.DATA0, 1, 1) + payload


def outputs(core: LinkCore) -> List[Tuple[Address, bytes]]:
    """The packets that a core wants sent, and their addresses."""
    return [(address_of(place), packet) for place, packet in core.outputs()]


def sent(core: LinkCore) -> List[bytes]:
    """The packets that a core wants sent, without their addresses."""
    return [packet for _, packet in outputs(core)]


def shake_hands(robot: LinkCore, operator: LinkCore, now: float = 0.0, address: Address = OPERATOR,
                place: Address = ROBOT) -> None:
    """Exchange what both cores want sent until they want nothing more, without any loss or delay.

    :param address: the operator's
    :param place: the robot's
    """
    while True:
        up = sent(operator)
        give(robot, address, *up, now=now)
        down = [packet for target, packet in outputs(robot) if target == address]
        give(operator, place, *down, now=now)
        if not up and not down:
            return


class Network:
    """Cores by address, and the packets between them.

    :param delay: each way [s]
    :param loss: share of the packets lost each way
    :param duplicates: share that comes twice
    :param reorder: up to this much more delay [s]
    """

    def __init__(self, seed: int = 0, delay: float = 0.05, loss: float = 0.0, duplicates: float = 0.0,
                 reorder: float = 0.0) -> None:
        self.random = Random(seed)
        self.delay, self.loss, self.duplicates, self.reorder = delay, loss, duplicates, reorder
        self.now = 100.0
        self.cores: Dict[Address, LinkCore] = {}
        self.events: List[Tuple[float, Address, Event]] = []
        self.deliveries: List[Tuple[float, Address, Delivery]] = []
        self.cut = False
        """Whether nothing gets through."""
        self.log: List[Tuple[Address, Address, bytes]] = []
        """All packets sent: from, to."""
        self._flying: List[Any] = []
        self._order = itertools.count()

    def add(self, address: Address, core: Any) -> Any:
        """Put a core at an address."""
        self.cores[address] = core
        return core

    def move(self, old: Address, new: Address) -> None:
        """Give a core another address; packets to the old one are lost."""
        self.cores[new] = self.cores.pop(old)

    def send(self, source: Address, target: Address, packet: bytes) -> None:
        """Put a packet on its way."""
        self.log.append((source, target, packet))
        if self.cut:
            return
        for _ in range(1 + (self.random.random() < self.duplicates)):
            if self.random.random() >= self.loss:
                at = self.now + self.delay + self.random.random() * self.reorder
                heapq.heappush(self._flying, (at, next(self._order), source, target, packet))

    def run(self, duration: float, until: Optional[Callable[[], bool]] = None) -> bool:
        """Let time pass; returns whether `until` became true [s]."""
        end = self.now + duration
        while True:
            self._flush()
            if until is not None and until():
                return True
            times = [core.deadline(self.now) for core in self.cores.values()]
            if self._flying:
                times.append(self._flying[0][0])
            following = max(self.now, min(times, default=end))
            if following > end:
                self.now = end
                return False
            self.now = following
            self._step()

    def _step(self) -> None:
        while self._flying and self._flying[0][0] <= self.now:
            _, _, source, target, packet = heapq.heappop(self._flying)
            if target in self.cores:
                for delivery in give(self.cores[target], source, packet, now=self.now):
                    self.deliveries.append((self.now, target, delivery))
        for core in self.cores.values():
            core.poll(self.now)

    def _flush(self) -> None:
        for address, core in list(self.cores.items()):
            self.events += [(self.now, address, event) for event in core.events()]
            for target, packet in outputs(core):
                self.send(address, target, packet)

    def happened(self, kind: type, address: Address) -> List[Tuple[float, Any]]:
        """The events of one kind at an address, with their times."""
        return [(when, event) for when, where, event in self.events if where == address and isinstance(event, kind)]
