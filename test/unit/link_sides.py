# SPDX-License-Identifier: BSD-3-Clause
"""A robot's and an operator's core for tests, joined or not."""
from typing import Tuple

import numpy as np
from link_channel import KEY, OPERATOR, ROBOT, SIZE, Address, data, give, random_bytes, sent, shake_hands

from smokebot_udp.link.operator_core import OperatorCore
from smokebot_udp.link.packets import VERSION, Hello, Init, Suite, parse
from smokebot_udp.link.peer import Peer
from smokebot_udp.link.place import place_at
from smokebot_udp.link.robot_core import RobotCore
from smokebot_udp.link.tags import Tags

ROW = np.frombuffer(data(20), np.uint8)[np.newaxis]
"""One datagram of a topic as Peer.seal takes it."""

ELSEWHERE: Address = ('10.0.0.99', 5)


def robot_of(key: bytes = KEY, suite: Suite = Suite.AESGCM) -> RobotCore:
    return RobotCore(key, random_bytes(1), SIZE, 'robot', suite)


def operator_of(seed: int = 2, name: str = 'desk', key: bytes = KEY, now: float = 0.0) -> OperatorCore:
    operator = OperatorCore(key, random_bytes(seed), SIZE, name)
    operator.set_places([place_at(ROBOT)], now)
    return operator


def joined(key: bytes = KEY, now: float = 0.0) -> Tuple[RobotCore, OperatorCore]:
    """A robot and its operator."""
    robot, operator = robot_of(key), operator_of(key=key, now=now)
    shake_hands(robot, operator, now)
    robot.events()
    return robot, operator


def hello(nonce: int, key: bytes = KEY, version: int = VERSION) -> bytes:
    """A HELLO of who has this key."""
    return Tags(key).tagged(Hello(version, nonce)).pack()


def init_of(robot: RobotCore, operator: OperatorCore, address: Address = OPERATOR, now: float = 0.0,
            place: Address = ROBOT) -> bytes:
    """The operator's next INIT; the robot is at `place`."""
    give(robot, address, *sent(operator), now=now)
    give(operator, place, *sent(robot), now=now)
    return next(packet for packet in sent(operator) if isinstance(parse(packet), Init))


def the_robot(operator: OperatorCore) -> Peer:
    assert operator.robot is not None
    return operator.robot
