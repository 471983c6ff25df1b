#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A stranger and a hostile insider on the network of a link.

    ./smokebot exec python3 test/fuzz/fuzz_link.py [DATAGRAMS [SEED]]

A robot and an operator exchange datagrams. The stranger sees them all, and sends mutated, cut, replayed and forged ones
in anybody's name to both, see evaluation/link_attack.py. The insider has the key, and seals control messages of random
bytes. Faults are: any exception; a batch that takes more than MAX_TIME of processor time; more than MAX_PEERS peers;
more bytes to a stranger than from it; a delivery of what the peer did not send, or sent once and was
delivered before; and two sides that do not find each other within RECOVERY_TIME.
"""
import collections
import pathlib
import sys
import time
from random import Random
from typing import Any, Counter, Deque, List, Sequence, Set, Tuple

import numpy as np

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2]), str(pathlib.Path(__file__).resolve().parent)]
from fuzzing import run  # noqa: E402

from evaluation.link_attack import Attack  # noqa: E402
from evaluation.link_pair import MAX_DATAGRAM_SIZE, OPERATOR, ROBOT, Address, received  # noqa: E402
from smokebot_udp.link.operator_core import OperatorCore  # noqa: E402
from smokebot_udp.link.place import address_of, place_at  # noqa: E402
from smokebot_udp.link.robot_core import RobotCore  # noqa: E402
from smokebot_udp.udpros.datagram import HEADER, Op  # noqa: E402

MAX_PEERS = 8
MAX_TIME = 1.0
"""[s]"""
RECOVERY_TIME, STEP = 30.0, 0.05
"""By the world's clock [s]."""
DATAGRAMS = 1000000
BATCH = 200
KEPT = 300
"""Good datagrams that a stranger has at hand."""
CONTROL_IDS = 16
"""Connection ids below are the link's own."""
TOPIC = 4711
LENGTHS = 0, 1, 7, 8, 9, 100, 1000
SILENCES = 0.001, 0.001, 0.01, 0.5, 3.0, 70.0

SILENT: Address = ('10.0.0.66', 17001)
"""Another address of the robot, which never answers."""

Forged = Tuple[Address, bytes]


class Side:
    """A core, what reached it, and what may reach it."""

    def __init__(self, core: Any, address: Address) -> None:
        self.core, self.address = core, address
        self.genuine: Deque[Forged] = collections.deque(maxlen=KEPT)
        self.owed: Set[bytes] = set()
        """Datagrams sent to it, but not delivered."""
        self.got = 0
        """Number of datagrams delivered of those."""


class World:
    """A robot and an operator, a network without loss between them, and a clock.

    :param key: of both
    """

    def __init__(self, key: bytes, random: Random) -> None:
        self.now, self.key, self._random = 1000.0, key, random
        self.from_strangers: Counter[Address] = collections.Counter()
        self.to_strangers: Counter[Address] = collections.Counter()
        self.robot = Side(RobotCore(key, self.bytes, MAX_DATAGRAM_SIZE, 'robot'), ROBOT)
        self.restart_operator()

    def bytes(self, count: int) -> bytes:
        return self._random.getrandbits(8 * count).to_bytes(count, 'little') if count else b''

    def restart_operator(self) -> None:
        """The operator's process ends without a word, and another one starts."""
        self.operator = Side(OperatorCore(self.key, self.bytes, MAX_DATAGRAM_SIZE, 'operator'), OPERATOR)
        self.operator.core.set_places([place_at(ROBOT), place_at(SILENT)][:1 + self._random.randrange(2)], self.now)

    def give(self, side: Side, datagrams: Sequence[Forged]) -> None:
        """Datagrams reach a side, which may answer."""
        for source, payload in datagrams if side is self.robot else ():
            self.from_strangers[source] += len(payload)
        for delivery in side.core.receive(*received(datagrams), self.now) if datagrams else ():
            for row, length in zip(delivery.datagrams, delivery.lengths):
                whole = row[:length].tobytes()
                if HEADER.unpack_from(whole)[0] >= CONTROL_IDS:
                    assert whole in side.owed, whole[:64]
                side.got += whole in side.owed
                side.owed.discard(whole)

    def step(self, seconds: float) -> None:
        """Time passes, and what both want to send arrives."""
        self.now += seconds
        for side, other in ((self.operator, self.robot), (self.robot, self.operator)):
            side.core.poll(self.now)
            side.core.events()
            sent = [(address_of(place), packet) for place, packet in side.core.outputs()]
            good = [(side.address, payload) for address, payload in sent if address == other.address]
            other.genuine.extend(good)
            self.give(other, good)
            for address, payload in sent:
                if side is self.robot and address != OPERATOR:
                    self.to_strangers[address] += len(payload)

    def send(self, side: Side, other: Side) -> None:
        """A side that has the other one as its peer sends it three datagrams."""
        for peer in [peer for peer in side.core.peers if tuple(peer.address) == other.address][-1:]:
            rows = np.zeros((3, HEADER.size + self._random.choice(LENGTHS)), np.uint8)
            rows[:, HEADER.size:] = np.frombuffer(self.bytes(rows[:, HEADER.size:].size), np.uint8).reshape(3, -1)
            for number, row in enumerate(rows):
                head = HEADER.pack(TOPIC + self._random.randrange(10 ** 6), Op.DATA0, number, 1)
                row[:HEADER.size] = np.frombuffer(head, np.uint8)
                other.owed.add(row.tobytes())
            sealed = [(side.address, row.tobytes()) for row in peer.seal(rows)]
            other.genuine.extend(sealed)
            self.give(other, sealed)

    def insider(self, side: Side, other: Side) -> List[Forged]:
        """A side seals control messages that make no sense."""
        sealed = []
        for peer in side.core.peers[-1:]:
            head = HEADER.pack(self._random.randrange(CONTROL_IDS), self._random.randrange(256),
                               self._random.randrange(256), self._random.randrange(1 << 16))
            body = (head + self.bytes(self._random.choice(LENGTHS)))[:self._random.choice((1, 7, 8, 9, 2000))]
            sealed.append((side.address, peer.seal_one(body)))
        return sealed

    def check_bounds(self) -> None:
        """What holds at any time."""
        assert len(self.robot.core.peers) <= MAX_PEERS
        for address, size in self.to_strangers.items():
            assert size <= self.from_strangers[address], (address, size)
        self.to_strangers.clear()       # all answers are out; what a core keeps must show in the memory
        self.from_strangers.clear()

    def meet(self) -> None:
        """Both find each other, and datagrams cross whole in both directions."""
        end, before = self.now + RECOVERY_TIME, (self.robot.got, self.operator.got)
        for side in (self.robot, self.operator):
            side.owed.clear()       # of a session that has ended
        while self.robot.got == before[0] or self.operator.got == before[1]:
            assert self.now < end, (self.operator.core.problem, self.robot.core.dropped)
            self.step(STEP)
            self.send(self.robot, self.operator)
            self.send(self.operator, self.robot)


class Fuzzer:
    """Feeds datagrams to both sides of a link.

    :param random: of all that is random
    """

    def __init__(self, random: Random) -> None:
        self._random = random
        self.world = World(b'k' * 32, random)
        self.inputs, self.worst = 0, 0.0

    def report(self) -> str:
        """What was dropped, by reason."""
        return str(dict(self.world.robot.core.dropped + self.world.operator.core.dropped))

    def good(self) -> None:
        """See World.meet."""
        self.world.meet()

    def batch(self) -> None:
        """Feed some to both sides."""
        world = self.world
        begun = time.process_time()
        for side, other in ((world.robot, world.operator), (world.operator, world.robot)):
            self._attack(world, side, other)
        if self._random.random() < 0.02:
            world.restart_operator()
            world.meet()
        world.step(self._random.choice(SILENCES))
        world.check_bounds()
        if not world.robot.core.peers:
            world.meet()
        self.worst = max(self.worst, time.process_time() - begun)

    def _attack(self, world: World, side: Side, other: Side) -> None:
        own = [(other.address, payload) for _, payload in other.genuine]
        attack = Attack(side.genuine, own, self._random)
        forged = [attack.next()[1] for _ in range(BATCH)]
        if self._random.random() < 0.3:
            forged += world.insider(other, side)
        self._random.shuffle(forged)
        world.send(other, side)
        world.give(side, forged)
        world.send(other, side)
        self.inputs += len(forged)


if __name__ == '__main__':
    count, seed = [int(argument) for argument in sys.argv[1:]] + [DATAGRAMS, 1][len(sys.argv) - 1:]
    sys.exit(run(Fuzzer(Random(seed)), count, MAX_TIME))
