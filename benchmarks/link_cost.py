# SPDX-License-Identifier: BSD-3-Clause
"""What sealing and opening a datagram costs, with this interpreter's `cryptography`, and what a hostile peer's table
costs the robot: prints JSON, see `costs`.

    PYTHONPATH=src:. python3 -m benchmarks.link_cost
"""
import json
import platform
import time
from typing import Any, Callable, Dict, List, Tuple

import cryptography
import numpy as np

from evaluation.link_pair import OPERATOR, ROBOT, joined, received
from smokebot_udp.link.packets import Suite
from smokebot_udp.link.parts import PART
from smokebot_udp.link.tables import CHANGE_PERIOD, Exchange, Local, NameEntry, Role, Table, Topic, pack_names
from smokebot_udp.udpros.datagram import HEADER, Op

SIZE, FRAME = 1400, 50
"""Bytes of a datagram's payload, and datagrams sent or received at a time."""

TABLE, FLOOD = 100, 1e4
"""Topics in a hostile peer's table, and how many of these it sends a second."""

ROUNDS, BATCHES = 9, 20
UNKNOWN, FLOODED = 'unknown session', 'table, in a flood'
TOPIC = 4711
KEY = b'k' * 32

LINKS = {'AES-GCM': Suite.AESGCM, 'ChaCha20-Poly1305': Suite.CHACHAPOLY}


def cost(link: str) -> Dict[str, float]:
    """The least processor time of both sides for a datagram of a frame: {'send', 'receive'} [us]."""
    robot, operator, now = joined(KEY, LINKS[link])
    rows = np.zeros((FRAME, HEADER.size + SIZE), np.uint8)
    rows[:, :HEADER.size] = np.frombuffer(HEADER.pack(TOPIC, Op.DATA0, 1, 1), np.uint8)
    times: List[Tuple[float, float]] = []
    for _ in range(ROUNDS):
        begun = time.process_time()
        sealed = [robot.peers[0].seal(rows) for _ in range(BATCHES)]
        send = time.process_time() - begun
        batches = [received([(ROBOT, row.tobytes()) for row in batch]) for batch in sealed]
        begun = time.process_time()
        count = sum(len(delivery.rows) for batch in batches for delivery in operator.receive(*batch, now))
        times.append((send, time.process_time() - begun))
        if count != FRAME * BATCHES:
            raise RuntimeError('%d of %d datagrams are accepted: %s' % (count, FRAME * BATCHES, operator.dropped))
    return {name: round(1e6 * min(column) / (FRAME * BATCHES), 3)
            for name, column in zip(('send', 'receive'), zip(*times))}


def hostile_costs() -> Dict[str, float]:
    """The mean processor time of the robot for a datagram of a peer, each with another table of TABLE topics:
    {UNKNOWN, 'table, read', FLOODED} [us].

    The first one is the same datagram of a session that there is not. Of a flood some tables are read, see
    tables.CHANGES.
    """
    robot, operator, now = joined(KEY)
    names = pack_names([NameEntry(Role.SENDS, Topic('/topic%d' % number, 'x/Y', '%032x' % number))
                        for number in range(TABLE)], SIZE - PART.size)
    exchange, number = Exchange(Local()), 0

    def take(batch: Any, at: float) -> None:
        for delivery in robot.receive(*batch, at):
            for datagram, length in zip(delivery.datagrams, delivery.lengths.tolist()):
                if exchange.take(Table.NAMES, datagram[HEADER.size:length].tobytes(), at):
                    exchange.differences('a peer')

    def mean(change: Callable[[bytes], bytes], count: int, period: float) -> float:
        """[us], of `count` datagrams at a time, one each period [s]"""
        nonlocal number, now
        total = 0.0
        for _ in range(ROUNDS * BATCHES):
            packets = [operator.peers[0].seal_one(HEADER.pack(Table.NAMES, Op.DATA0, 1, 1), PART.pack(
                number + one, 0, 1), names) for one in range(1, count + 1)]
            batch = received([(OPERATOR, change(packet)) for packet in packets])
            number, now = number + count, now + count * period
            begun = time.process_time()
            take(batch, now)
            total += time.process_time() - begun
        return round(1e6 * total / (ROUNDS * BATCHES * count), 3)

    return {UNKNOWN: mean(lambda packet: packet[:4] + bytes(4) + packet[8:], FRAME, 1 / FLOOD),
            'table, read': mean(bytes, 1, CHANGE_PERIOD), FLOODED: mean(bytes, FRAME, 1 / FLOOD)}


def costs() -> Dict[str, Any]:
    """{'python', 'cryptography': versions, 'links': {link: cost}, 'hostile': hostile_costs}"""
    return {'python': platform.python_version(), 'cryptography': cryptography.__version__,
            'links': {link: cost(link) for link in LINKS}, 'hostile': hostile_costs()}


if __name__ == '__main__':
    print(json.dumps(costs()))
