# SPDX-License-Identifier: BSD-3-Clause
"""What sealing and opening a datagram costs, with this interpreter's `cryptography`: prints JSON, see `costs`.

    PYTHONPATH=src:. python3 -m benchmarks.link_cost
"""
import json
import platform
import time
from typing import Any, Dict, List, Tuple

import cryptography
import numpy as np

from evaluation.link_pair import ROBOT, joined, received
from smokebot_udp.link.packets import Suite
from smokebot_udp.udpros.datagram import HEADER, Op

SIZE, FRAME = 1400, 50
"""Bytes of a datagram's payload, and datagrams sent or received at a time."""

ROUNDS, BATCHES = 9, 20
TOPIC = 4711
KEY = b'k' * 32

LINKS = {'open': (None, Suite.AESGCM), 'AES-GCM': (KEY, Suite.AESGCM), 'ChaCha20-Poly1305': (KEY, Suite.CHACHAPOLY)}


def cost(link: str) -> Dict[str, float]:
    """The least processor time of both sides for a datagram of a frame: {'send', 'receive'} [us]."""
    robot, operator, now = joined(*LINKS[link])
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


def costs() -> Dict[str, Any]:
    """{'python', 'cryptography': versions, 'links': {link: cost}}"""
    return {'python': platform.python_version(), 'cryptography': cryptography.__version__,
            'links': {link: cost(link) for link in LINKS}}


if __name__ == '__main__':
    print(json.dumps(costs()))
