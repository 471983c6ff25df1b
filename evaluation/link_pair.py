# SPDX-License-Identifier: BSD-3-Clause
"""A robot's and an operator's core of a link, joined in memory by a network without loss."""
import os
from typing import Any, Sequence, Tuple

import numpy as np

from smokebot_udp.arrays import IntArray, Records, UInt8Array
from smokebot_udp.link.operator_core import OperatorCore
from smokebot_udp.link.packets import Suite
from smokebot_udp.link.place import place_at
from smokebot_udp.link.robot_core import RobotCore
from smokebot_udp.udpros.endpoints import SOCKADDR_IN, number_of

Address = Tuple[str, int]
"""Numeric IPv4 address, and port."""

ROBOT: Address = ('10.0.0.1', 17001)
OPERATOR: Address = ('10.0.0.2', 40000)
MAX_DATAGRAM_SIZE = 1472
"""[byte]"""

STEP, STEPS = 0.05, 100
"""A handshake takes some steps of time [s]."""


def received(datagrams: Sequence[Tuple[Address, bytes]]) -> Tuple[UInt8Array, IntArray, Records]:
    """A batch as an endpoint gives it to a core: (n, slot) bytes, (n,) lengths, (n,) sources.

    :param datagrams: (source, payload); what is longer than MAX_DATAGRAM_SIZE is cut after one more byte
    """
    rows = np.zeros((len(datagrams), MAX_DATAGRAM_SIZE + 1), np.uint8)
    sources = np.zeros(len(datagrams), SOCKADDR_IN)
    lengths = np.array([min(len(payload), rows.shape[1]) for _, payload in datagrams], np.int64)
    for row, ((host, port), payload) in enumerate(datagrams):
        rows[row, :lengths[row]] = np.frombuffer(payload[:lengths[row]], np.uint8)
        sources[row] = (2, port, number_of(host), 0, 0)
    return rows, lengths, sources


def joined(key: bytes, suite: Suite = Suite.AESGCM) -> Tuple[Any, Any, float]:
    """(RobotCore, OperatorCore, now [s]) after their handshake.

    :raises RuntimeError: where they do not find each other
    """
    now = 1000.0
    robot = RobotCore(key, os.urandom, MAX_DATAGRAM_SIZE, 'robot', suite=suite)
    operator = OperatorCore(key, os.urandom, MAX_DATAGRAM_SIZE, 'operator')
    operator.set_places([place_at(ROBOT)], now)
    for _ in range(STEPS):
        now += STEP
        for core, other, address in ((operator, robot, OPERATOR), (robot, operator, ROBOT)):
            core.poll(now)
            sent = [(address, payload) for _, payload in core.outputs()]
            if sent:
                other.receive(*received(sent), now)
        if robot.peers and operator.peers:
            return robot, operator, now
    raise RuntimeError('no handshake: %s' % operator.problem)
