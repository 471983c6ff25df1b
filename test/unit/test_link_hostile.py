# SPDX-License-Identifier: BSD-3-Clause
"""What anybody may send to a link: nothing is accepted, little is kept, and less is sent back than came."""
import collections
import gc
import tracemalloc
from random import Random
from typing import Any, Counter, List, Tuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from link_channel import KEY, OPERATOR, ROBOT, SIZE, Address, data, give, outputs, random_bytes, sent
from link_sides import hello, init_of, joined, operator_of, robot_of, the_robot

from smokebot_udp.link.control import Control, message
from smokebot_udp.link.core import LinkCore
from smokebot_udp.link.operator_core import REFUSED_RETRY, OperatorCore
from smokebot_udp.link.packets import (
    HELLO,
    INIT,
    INIT_SIZE,
    VERSION,
    Cookie,
    Hello,
    Init,
    Reason,
    Refuse,
    Suite,
    parse,
)
from smokebot_udp.link.place import place_at
from smokebot_udp.link.robot_core import RobotCore

MAX_MEMORY = 1 << 20
"""A core may keep this much more after an attack [byte]."""


def works(robot: RobotCore, operator: OperatorCore, now: float) -> bool:
    """Whether the session of the two still carries datagrams both ways."""
    up = give(robot, OPERATOR, the_robot(operator).seal_one(data(20, b'up')), now=now)
    down = give(operator, ROBOT, robot.peers[0].seal_one(data(20, b'down')), now=now)
    return [[bytes(row[8:length]) for row, length in zip(delivery.datagrams, delivery.lengths)]
            for delivery in (*up, *down)] == [[b'up'], [b'down']]


def forged_address(random: Random) -> Address:
    return '172.16.%d.%d' % (random.randrange(256), random.randrange(256)), random.randrange(1, 65536)


def held_memory() -> int:
    """Without Python's lists of free objects, which a collection empties [byte]."""
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


def test_ten_thousand_half_open_handshakes() -> None:
    robot, operator = joined()
    random = Random(1)
    give(robot, OPERATOR, hello(1))
    sent(robot)
    tracemalloc.start()
    before = held_memory()
    for number in range(10000):
        init = Init(VERSION, Suite.AESGCM, number, random.getrandbits(128).to_bytes(16, 'big'), number,
                    bytes(INIT_SIZE - INIT.size))
        give(robot, forged_address(random), hello(number), init.pack(), now=number * 1e-3)
        assert len(sent(robot)) == 1    # a COOKIE
    robot.poll(10.0)
    sent(robot)
    after = held_memory()
    tracemalloc.stop()
    assert after - before < 64e3 and robot.dropped == {'wrong cookie': 10000}       # nothing is kept
    assert works(robot, operator, 10.0)


def test_ten_thousand_handshakes_that_are_never_finished() -> None:
    """From addresses that do receive, by somebody who has the key."""
    robot, operator = joined()
    random = Random(1)
    initiators = [OperatorCore(KEY, random_bytes(seed), SIZE, 'stranger %d' % seed) for seed in range(20)]
    tracemalloc.start()
    before = held_memory()
    for number in range(300):
        now = number * 5e-3
        core = initiators[number % 20]
        address = forged_address(random)
        core.set_places([place_at(address)], now)
        give(robot, address, *sent(core), now=now)
        give(core, address, *sent(robot), now=now)     # which is wherever it looks for it
        give(robot, address, *sent(core) * 4, now=now)
        sent(robot)
    after = held_memory()
    tracemalloc.stop()
    assert after - before < MAX_MEMORY
    assert robot.dropped['replayed handshake'] >= 900
    assert len(robot.peers) == 1 and works(robot, operator, 2.0)


def test_nothing_is_answered_by_more_than_came(monkeypatch: Any) -> None:
    robot, operator = joined()
    packets = [hello(1), Hello(VERSION, 1).pack(), Hello(9, 1).pack(),
               init_of(robot_of(), operator_of()), the_robot(operator).seal_one(message(Control.KEEP_ALIVE)),
               bytes(HELLO.size)]
    random = Random(2)
    came: Counter[Address] = collections.Counter()
    answered: Counter[Address] = collections.Counter()
    addresses = [forged_address(random) for _ in range(20)]
    for step in range(3000):
        address = random.choice(addresses)
        packet = mutated(random.choice(packets), random) if random.random() < 0.7 else random.choice(packets)
        came[address] += len(packet)
        give(robot, address, packet, now=1.0 + step * 1e-3)
        for target, answer in outputs(robot):
            if target != OPERATOR:
                answered[target] += len(answer)
        assert all(answered[target] <= came[target] for target in answered)
    assert sum(answered.values()) > 10000 and robot.peers[0].address == OPERATOR


def mutated(packet: bytes, random: Random) -> bytes:
    """A packet with some bytes changed, left out, repeated or added."""
    out = bytearray(packet)
    for _ in range(random.randrange(1, 4)):
        at = random.randrange(len(out) + 1)
        kind = random.randrange(4)
        if kind == 0 and at < len(out):
            out[at] ^= 1 << random.randrange(8)
        elif kind == 1:
            del out[at:at + random.randrange(1, 20)]
        elif kind == 2:
            out[at:at] = bytes(random.randrange(256) for _ in range(random.randrange(1, 20)))
        elif at < len(out):
            out[at] = random.choice((0, 1, 2, 7, 255))
    return bytes(out)


def recorded() -> Tuple[RobotCore, OperatorCore, List[bytes], List[bytes]]:
    """A joined pair, and all that went up and down so far."""
    robot, operator = robot_of(), operator_of()
    up: List[bytes] = []
    down: List[bytes] = []
    while True:
        packets = sent(operator)
        give(robot, OPERATOR, *packets)
        answers = sent(robot)
        give(operator, ROBOT, *answers)
        up, down = up + packets, down + answers
        if not packets and not answers:
            break
    for peer, packets in ((the_robot(operator), up), (robot.peers[0], down)):
        packets += [peer.seal_one(message(kind)) for kind in (Control.KEEP_ALIVE, Control.PATH_CHALLENGE)]
        packets += [peer.seal_one(data(20, bytes(50))), peer.seal_one(data(4)), peer.seal_one(message(Control.CLOSE))]
    return robot, operator, up, down


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 1 << 32))
def test_mutated_packets_do_nothing(seed: int) -> None:
    random = Random(seed)
    robot, operator, up, down = recorded()
    packets = [mutated(random.choice(up + down), random) for _ in range(40)]
    robot.events(), operator.events()
    for core, source, true in ((robot, OPERATOR, up), (operator, ROBOT, down)):
        deliveries = give(core, source, *[packet for packet in packets if packet not in true], now=0.1)
        assert not deliveries and not [event for event in core.events() if not hasattr(event, 'reason')]
        assert len(core.peers) == 1 and core.dropped
    assert robot.peers[0].address == OPERATOR and works(robot, operator, 0.2)


@pytest.mark.parametrize('side', ['robot', 'operator'])
def test_random_packets_with_true_indices(side: str) -> None:
    robot, operator = joined()
    core: LinkCore = robot if side == 'robot' else operator
    other = the_robot(operator) if side == 'robot' else robot.peers[0]
    index, random = other.session.their_index, Random(3)
    before = sum(core.dropped.values())
    for _ in range(50):
        packets = [b'\7\0\0\0' + index.to_bytes(4, 'little') + random.getrandbits(64).to_bytes(8, 'little')
                   + bytes(random.randrange(256) for _ in range(random.randrange(0, 60))) for _ in range(40)]
        assert not give(core, ROBOT if side == 'operator' else OPERATOR, *packets, now=0.1)
    assert sum(core.dropped.values()) - before == 2000
    assert works(robot, operator, 0.2)


def test_everything_recorded_comes_again() -> None:
    robot, operator, up, down = recorded()
    up, down = up[:-1], down[:-1]       # without the CLOSE
    for _ in range(3):
        give(robot, OPERATOR, *up, now=0.5)
        give(operator, ROBOT, *down, now=0.5)
    give(robot, ('10.9.9.9', 1), *up, now=0.6)
    assert len(robot.peers) == len(operator.peers) == 1 and robot.peers[0].handshakes == 1
    assert robot.dropped['replayed handshake'] >= 3 and operator.dropped['not asked for'] >= 3
    assert robot.dropped['replayed data'] >= 6
    assert robot.peers[0].address == OPERATOR and works(robot, operator, 0.7)


def test_a_cookie_that_is_sent_by_thousands_is_taken_once() -> None:
    robot, operator = robot_of(), operator_of()
    give(robot, OPERATOR, *sent(operator))
    true = parse(sent(robot)[0])
    assert isinstance(true, Cookie)
    random = Random(4)
    give(operator, ROBOT, *[true._replace(nonce=random.getrandbits(64)).pack() for _ in range(2000)])
    assert operator.dropped == {'not asked for': 2000} and not sent(operator)
    give(operator, ROBOT, *[true.pack()] * 2000)
    assert len(sent(operator)) == 1


def test_the_reasons_are_few() -> None:
    robot, operator, up, down = recorded()
    random = Random(5)
    for _ in range(100):
        packets = [mutated(random.choice(up + down), random) for _ in range(40)]
        give(robot, forged_address(random), *packets)
        give(operator, forged_address(random), *packets)
    assert len(robot.dropped) <= 16 and len(operator.dropped) <= 10


def test_a_refusal_that_comes_again_and_again_does_not_end_the_attempts() -> None:
    """It may be a replay: its nonce crosses in clear."""
    operator = operator_of()
    hello, = sent(operator)
    question = parse(hello)
    assert isinstance(question, Hello)
    refusal = Refuse(VERSION, Reason.FULL, question.nonce).pack()
    hellos = 0
    for tick in range(100):
        give(operator, ROBOT, refusal, now=tick / 20)
        operator.poll(tick / 20)
        hellos += sent(operator).count(hello)
    assert hellos >= 5 / (REFUSED_RETRY + 0.1)
