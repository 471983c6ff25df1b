# SPDX-License-Identifier: BSD-3-Clause
"""What a stranger makes of good datagrams, and what a core does with its handshakes."""
import collections
import random

from evaluation.link_attack import Attack, Stranger, stranger
from evaluation.link_pair import ROBOT, joined, received
from smokebot_udp.link.packets import Kind

GENUINE = [(('10.77.0.2', 40000), bytes([Kind.DATA, 0, 0, 0]) + bytes(range(60))),
           (('10.77.0.2', 40000), bytes([Kind.HELLO, 1, 1, 0]) + bytes(28))]
OWN = [(('10.77.0.2', 40000), bytes([Kind.DATA, 7, 7, 7]) + bytes(60))]


def test_every_kind_comes_and_only_replays_are_genuine() -> None:
    attack = Attack(GENUINE, OWN, random.Random(1))
    counts = collections.Counter()
    for _ in range(2000):
        name, forged = attack.next()
        counts[name] += 1
        assert (forged in GENUINE) == (name == 'replayed') or name in ('mutated',)
        assert (forged in OWN) == (name == 'reflected')
        assert name != 'replayed by a stranger' or (forged[1] in [data for _, data in GENUINE]
                                                    and forged[0][0].startswith('10.78.'))
    assert len(counts) == 7 and min(counts.values()) > 200


def test_strangers_have_addresses_of_their_own() -> None:
    assert len({stranger(number) for number in range(1 << 16)}) == 1 << 16
    assert stranger(0) == ('10.78.0.0', 1024) and stranger(65535)[0] == '10.78.255.255'


def test_strangers_without_the_key_leave_nothing_behind() -> None:
    robot, _, now = joined(b'k' * 32)
    for number in range(300):
        who = Stranger(number, b'x' * 32, ROBOT)
        hello, = who.sent()
        assert hello[0] == Kind.HELLO
        robot.receive(*received([(who.address, hello)]), now)
        assert [answer[0] for _, answer in robot.outputs()] == [Kind.REFUSE]
    assert len(robot.peers) == 1 and robot.dropped['refused: wrong key'] == 300
