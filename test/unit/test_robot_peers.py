# SPDX-License-Identifier: BSD-3-Clause
"""The rules at the head of robot_core that follow the handshake, and what both cores have in common."""
from typing import Any

import numpy as np
import pytest
from link_channel import KEY, OPERATOR, ROBOT, SIZE, data, give, outputs, random_bytes, sent, shake_hands
from link_sides import ELSEWHERE, ROW, init_of, joined, operator_of, robot_of, the_robot

from smokebot_udp.link.control import COPY, Control, message, with_mark
from smokebot_udp.link.core import MAX_OLD, OLD_KEYS
from smokebot_udp.link.operator_core import OperatorCore
from smokebot_udp.link.packets import VERSION, Cookie, Suite, Unknown, parse
from smokebot_udp.link.path import PROVED_FOR
from smokebot_udp.link.peer import Joined, Moved, Quiet
from smokebot_udp.link.place import place_at
from smokebot_udp.link.robot_core import QUIET, RobotCore
from smokebot_udp.link.robot_paths import ALIVE, MAX_PATHS

ROBOT_2 = '10.0.0.8', 17001
"""Another address of the robot."""

# 7. Confirmation and new keys

def test_the_first_data_makes_the_peer() -> None:
    robot, operator = robot_of(), operator_of()
    give(robot, OPERATOR, init_of(robot, operator))
    give(operator, ROBOT, *sent(robot), now=0.1)
    assert not robot.peers and not robot.events() and len(operator.peers) == 1
    give(robot, OPERATOR, *sent(operator), now=0.2)
    event, = robot.events()
    assert isinstance(event, Joined) and robot.peers == [event.peer]
    peer = event.peer
    assert (peer.name, peer.address, peer.number, peer.heard) == ('desk', OPERATOR, 1, 0.2)
    assert peer.instance == operator.instance and the_robot(operator).instance == robot.instance
    assert peer.max_datagram_size == SIZE
    assert peer.round_trip == pytest.approx(0.2) and the_robot(operator).name == 'robot'
    assert len(sent(robot)) == 1    # a keep-alive, so that the operator knows


def test_both_sides_send_no_more_than_the_other_receives() -> None:
    robot = RobotCore(KEY, random_bytes(1), 1400, 'robot')
    operator = operator_of()
    shake_hands(robot, operator)
    assert the_robot(operator).max_datagram_size == robot.peers[0].max_datagram_size == 1400


def test_new_keys_replace_the_old_ones_after_the_first_data() -> None:
    robot, operator = joined()
    peer, old = robot.peers[0], the_robot(operator).session
    late = old.seal(ROW)
    operator.set_places([place_at(ROBOT_2)], 1.0)
    accept = pending_accept(robot, operator)
    under_old = peer.seal_one(data(20))
    give(operator, ROBOT, accept, under_old, now=1.0)
    assert the_robot(operator).session is not old
    give(robot, OPERATOR, *sent(operator), now=1.0)
    assert robot.peers == [peer] and peer.handshakes == 2 and not robot.events()
    deliveries = give(robot, OPERATOR, late.tobytes(), now=1.0 + OLD_KEYS - 0.2)
    assert [delivery.peer for delivery in deliveries] == [peer]
    robot.poll(1.0 + OLD_KEYS + 0.1)
    give(robot, OPERATOR, old.seal(ROW).tobytes(), now=1.0 + OLD_KEYS + 0.1)
    assert robot.dropped == {'unknown session': 1}


def pending_accept(robot: RobotCore, operator: OperatorCore) -> bytes:
    give(robot, OPERATOR, init_of(robot, operator, now=1.0, place=ROBOT_2), now=1.0)
    accept, = sent(robot)
    return accept


def test_few_old_keys_are_kept() -> None:
    robot, operator = joined()
    sessions = []
    for number in range(MAX_OLD + 2):
        sessions.append(the_robot(operator).session)
        place = '10.0.3.%d' % number, 17001
        operator.set_places([place_at(place)], 1.0 + number / 10)
        shake_hands(robot, operator, 1.0 + number / 10, place=place)
    taken = [len(give(robot, OPERATOR, session.seal(ROW).tobytes(), now=2.0)) for session in sessions]
    assert taken == [0, 0] + [1] * MAX_OLD and robot.peers[0].handshakes == MAX_OLD + 3


def test_a_handshake_from_another_address_moves_the_peer() -> None:
    robot, operator = joined()
    operator.set_places([place_at(ROBOT_2)], 1.0)
    give(robot, ELSEWHERE, init_of(robot, operator, ELSEWHERE, 1.0, ROBOT_2), now=1.0)
    give(operator, ROBOT, *sent(robot), now=1.0)
    give(robot, ELSEWHERE, *sent(operator), now=1.0)
    peer, = robot.peers
    assert peer.address == ELSEWHERE and robot.events() == [Moved(peer, ELSEWHERE)]


def test_chachapoly_works_as_well() -> None:
    robot, operator = robot_of(suite=Suite.CHACHAPOLY), operator_of()
    shake_hands(robot, operator)
    delivery, = give(robot, OPERATOR, the_robot(operator).seal_one(data(20, b'payload')))
    assert delivery.datagrams[0, :delivery.lengths[0]].tobytes() == data(20, b'payload')


# 8. Another address

def test_an_operator_moves() -> None:
    robot, operator = joined()
    peer = robot.peers[0]
    packet = the_robot(operator).seal_one(message(Control.KEEP_ALIVE))
    give(robot, ELSEWHERE, packet, now=1.0)
    assert peer.address == OPERATOR and not robot.events()
    (address, challenge), = outputs(robot)
    assert address == ELSEWHERE and len(challenge) <= len(packet)
    give(operator, ROBOT, challenge, now=1.0)
    response, = sent(operator)
    give(robot, OPERATOR, response, now=1.0)        # from the address before: no proof
    assert peer.address == OPERATOR
    give(robot, ELSEWHERE, packet, the_robot(operator).seal_one(message(Control.KEEP_ALIVE)), now=2.0)
    (_, challenge), = outputs(robot)
    give(operator, ROBOT, challenge, now=2.0)
    give(robot, ELSEWHERE, *sent(operator), now=2.0)
    assert peer.address == ELSEWHERE
    assert [event for event in robot.events() if isinstance(event, Moved)] == [Moved(peer, ELSEWHERE)]


def test_a_copy_from_elsewhere_moves_nobody() -> None:
    robot, operator = joined()
    packet = the_robot(operator).seal_one(data(20))
    give(robot, OPERATOR, packet)
    give(robot, ELSEWHERE, packet)
    assert robot.dropped == {'replayed data': 1} and not sent(robot)


def test_a_late_packet_from_the_address_before_moves_nobody_back() -> None:
    robot, operator = joined()
    late, newer = (the_robot(operator).seal_one(data(20)) for _ in range(2))
    give(robot, OPERATOR, newer)
    assert len(give(robot, ELSEWHERE, late)) == 1 and not sent(robot)


def test_a_wrong_response_moves_nobody() -> None:
    robot, operator = joined()
    give(robot, ELSEWHERE, the_robot(operator).seal_one(message(Control.KEEP_ALIVE)), now=1.0)
    give(robot, ELSEWHERE, the_robot(operator).seal_one(message(Control.PATH_RESPONSE, b'12345678')), now=1.0)
    give(robot, ELSEWHERE, the_robot(operator).seal_one(message(Control.PATH_CHALLENGE, b'12345678')), now=1.0)
    assert robot.peers[0].address == OPERATOR and not robot.events()


def test_a_late_response_does_not_move_a_peer_back_to_an_address_that_it_has_left() -> None:
    """It was elsewhere for a moment, and is heard from its present address again."""
    robot, operator = joined()
    seal = the_robot(operator).seal_one
    give(robot, ELSEWHERE, seal(message(Control.KEEP_ALIVE)), now=1.0)
    give(operator, ROBOT, *sent(robot), now=1.0)
    response, = sent(operator)
    give(robot, OPERATOR, seal(message(Control.KEEP_ALIVE)), now=1.3)
    give(robot, ELSEWHERE, response, now=1.4)
    assert robot.peers[0].address == OPERATOR and not robot.events()


def probe(operator: Any, challenge: bytes = b'12345678') -> bytes:
    return the_robot(operator).seal_one(message(Control.PATH_CHALLENGE, challenge))


def test_a_probe_is_answered_where_it_came_from_and_moves_nobody() -> None:
    robot, operator = joined()
    give(robot, OPERATOR, probe(operator), now=1.0)
    assert [address for address, _ in outputs(robot)] == [OPERATOR]
    for number in range(20):
        now = 1.0 + number / 4
        give(robot, ELSEWHERE, probe(operator), now=now)
        packets = outputs(robot)
        assert packets and {address for address, _ in packets} == {ELSEWHERE}
        give(operator, ROBOT, *[packet for _, packet in packets], now=now)
        give(robot, ELSEWHERE, *sent(operator), now=now)
        give(robot, OPERATOR, the_robot(operator).seal_one(data(20)), now=now)
    assert robot.peers[0].address == OPERATOR and not robot.events()
    assert operator.dropped['not asked for'] >= 9       # of this test: the operator's own core did not ask


def test_an_address_that_probes_have_proved_is_followed_at_once() -> None:
    robot, operator = joined()
    give(robot, ELSEWHERE, probe(operator), now=1.0)
    give(operator, ROBOT, *sent(robot), now=1.0)
    give(robot, ELSEWHERE, *sent(operator), now=1.0)
    late, newer = the_robot(operator).seal_one(data(20)), the_robot(operator).seal_one(data(20))
    give(robot, ELSEWHERE, newer, now=2.0)
    assert robot.peers[0].address == ELSEWHERE
    give(robot, OPERATOR, late, now=2.0)                # late packets move nobody back
    assert robot.peers[0].address == ELSEWHERE
    give(robot, OPERATOR, the_robot(operator).seal_one(data(20)), now=2.1)      # the one before is proved, too
    assert robot.peers[0].address == OPERATOR
    give(robot, ELSEWHERE, the_robot(operator).seal_one(data(20)), now=2.0 + 2 * PROVED_FOR)
    assert robot.peers[0].address == OPERATOR           # the proof has become old


def test_an_address_without_proof_gets_no_more_than_came_from_there() -> None:
    robot, operator = joined()
    up = down = 0
    for number in range(100):
        packet = probe(operator)
        up += len(packet)
        give(robot, ELSEWHERE, packet, now=1.0 + number / 100)
        down += sum(len(one) for address, one in outputs(robot) if address == ELSEWHERE)
    assert 0 < down <= up


@pytest.mark.parametrize('others, follows', [(MAX_PATHS - 1, True), (MAX_PATHS, False)])
def test_few_addresses_of_a_peer_are_remembered(others: int, follows: bool) -> None:
    robot, operator = joined()
    give(robot, ELSEWHERE, probe(operator), now=1.0)
    give(operator, ROBOT, *sent(robot), now=1.0)
    give(robot, ELSEWHERE, *sent(operator), now=1.0)
    for number in range(others):
        give(robot, ('10.0.1.%d' % number, 1), probe(operator), now=1.1)
    give(robot, ELSEWHERE, the_robot(operator).seal_one(data(20)), now=1.2)
    assert (robot.peers[0].address == ELSEWHERE) is follows


def proved(robot: Any, operator: Any, now: float) -> None:
    """The operator's second address has proved itself, and is known; it is heard from the first one."""
    give(robot, ELSEWHERE, probe(operator), now=now)
    give(operator, ROBOT, *sent(robot), now=now)
    give(robot, ELSEWHERE, *sent(operator), now=now)
    give(robot, OPERATOR, the_robot(operator).seal_one(data(20)), now=now)
    robot.poll(now)


def test_a_proved_address_from_which_probes_come_gets_copies_until_they_end() -> None:
    robot, operator = joined()
    assert robot.peers[0].second is None
    proved(robot, operator, 1.0)
    assert robot.peers[0].second == place_at(ELSEWHERE) and robot.peers[0].address == OPERATOR
    robot.poll(1.0 + ALIVE / 2)
    assert robot.peers[0].second is not None
    robot.poll(1.2 + ALIVE)
    assert robot.peers[0].second is None


def test_an_address_that_was_left_is_second_when_probes_come_that_were_sent_later() -> None:
    """It was left as nothing passes there: what came from there before says nothing."""
    robot, operator = joined()
    proved(robot, operator, 1.0)
    give(robot, OPERATOR, probe(operator), now=1.1)
    give(robot, ELSEWHERE, the_robot(operator).seal_one(data(20)), now=1.2)
    robot.poll(1.2)
    assert robot.peers[0].address == ELSEWHERE and robot.peers[0].second is None
    give(robot, OPERATOR, probe(operator), now=1.3)
    robot.poll(1.4)
    assert robot.peers[0].second == place_at(OPERATOR) and robot.peers[0].second_heard == 1.3


def test_an_address_that_becomes_the_first_one_is_not_the_second_one_any_more() -> None:
    """Until the next poll, too: it would count as two paths."""
    robot, operator = joined()
    proved(robot, operator, 1.0)
    give(robot, ELSEWHERE, the_robot(operator).seal_one(data(20)), now=1.1)
    assert robot.peers[0].address == ELSEWHERE and robot.peers[0].second is None


def test_a_peer_that_is_heard_from_its_second_address_only_is_quiet() -> None:
    robot, operator = joined()
    proved(robot, operator, 1.0)
    peer = robot.peers[0]
    robot.events()
    give(robot, OPERATOR, probe(operator), now=1.1)
    give(robot, ELSEWHERE, probe(operator), now=1.12)
    robot.poll(1.15)
    assert robot.deadline(1.15) == pytest.approx(1.1 + QUIET)
    robot.poll(1.11 + QUIET)
    assert peer.is_quiet and robot.events() == [Quiet(peer)]
    robot.poll(1.15 + QUIET)
    assert peer.is_quiet and robot.events() == [] and robot.deadline(1.15 + QUIET) > 1.15 + QUIET
    give(robot, OPERATOR, the_robot(operator).seal_one(data(20)), now=1.16 + QUIET)
    robot.poll(1.16 + QUIET)
    assert not peer.is_quiet and robot.events() == []


def test_a_peer_that_is_heard_from_nowhere_is_not_quiet() -> None:
    """Then it has stopped for a moment, rather than the path."""
    robot, operator = joined()
    proved(robot, operator, 1.0)
    give(robot, OPERATOR, the_robot(operator).seal_one(data(20)), now=1.1)
    robot.events()
    robot.poll(1.2 + QUIET)
    assert robot.peers[0].second is not None and not robot.peers[0].is_quiet and robot.events() == []


def test_an_address_without_proof_gets_no_copies() -> None:
    robot, operator = joined()
    for number in range(9):
        give(robot, ELSEWHERE, probe(operator), now=1.0 + number / 10)
        robot.poll(1.0 + number / 10)
        assert robot.peers[0].second is None


def test_an_operator_with_one_address_has_two_paths_where_it_is_heard_by_two_interfaces() -> None:
    robot, operator = joined()
    give(robot, OPERATOR, probe(operator), now=1.0, interface=5)
    (place, challenge), = robot.outputs()
    assert place == place_at(OPERATOR, 5)       # it leaves as the probe came
    give(operator, ROBOT, challenge, now=1.0)
    give(robot, OPERATOR, *sent(operator), now=1.0, interface=5)
    robot.poll(1.0)
    assert robot.peers[0].place == place_at(OPERATOR) and robot.peers[0].second == place_at(OPERATOR, 5)
    give(robot, OPERATOR, the_robot(operator).seal_one(data(20)), now=1.1, interface=5)
    assert robot.peers[0].place == place_at(OPERATOR, 5)
    assert [type(event) for event in robot.events()] == [Quiet, Moved]


@pytest.mark.parametrize('is_proved', [True, False])
def test_a_copy_is_delivered_and_moves_nobody(is_proved: bool) -> None:
    robot, operator = joined()
    if is_proved:
        proved(robot, operator, 1.0)
    outputs(robot)
    copy = with_mark(np.frombuffer(data(20, b'stop'), np.uint8)[np.newaxis], COPY).tobytes()
    delivery, = give(robot, ELSEWHERE, the_robot(operator).seal_one(copy), now=1.1)
    assert delivery.datagrams[0, :delivery.lengths[0]].tobytes() == copy
    assert robot.peers[0].address == OPERATOR and not outputs(robot) and not robot.events()


# 9. Names

def test_two_living_peers_never_have_one_name() -> None:
    robot = robot_of()
    for number, told in enumerate(['desk', 'desk #2', 'desk', 'desk', 'other']):
        shake_hands(robot, operator_of(10 + number, told), address=('10.0.1.%d' % number, 9))
    assert [peer.name for peer in robot.peers] == ['desk', 'desk #2', 'desk #3', 'desk #4', 'other']
    assert [peer.told for peer in robot.peers] == ['desk', 'desk #2', 'desk', 'desk', 'other']


# 11. Unknown sessions

def test_data_of_an_unknown_session_is_answered_by_a_short_hint() -> None:
    _, operator = joined()
    packet = the_robot(operator).seal_one(message(Control.KEEP_ALIVE))
    robot = robot_of()
    for repeat in range(1000):
        give(robot, OPERATOR, packet, now=repeat * 1e-4)
    hints = sent(robot)
    assert {parse(hint) for hint in hints} == {Unknown(VERSION, the_robot(operator).session.their_index)}
    assert len(hints) <= 16 + 6 and len(hints[0]) <= len(packet)
    assert robot.dropped == {'unknown session': 1000}


# The common part

def test_the_topics_get_their_datagrams_and_not_the_cores_own() -> None:
    robot, operator = joined()
    seal = the_robot(operator).seal_one
    delivery, = give(robot, OPERATOR, seal(data(4, b'table')), seal(message(Control.KEEP_ALIVE)), seal(data(1 << 31)),
                     seal(data(16, b'topic')))
    assert delivery.rows.tolist() == [0, 2, 3] and delivery.lengths.tolist() == [13, 8, 13]
    assert delivery.datagrams.flags.c_contiguous and delivery.peer is robot.peers[0]
    assert [row[:length].tobytes() for row, length in zip(delivery.datagrams, delivery.lengths)] == [
        data(4, b'table'), data(1 << 31), data(16, b'topic')]
    assert not delivery.datagrams[1, 8:].any()


def test_the_cores_own_messages_have_one_length() -> None:
    robot, operator = joined()
    assert not give(robot, OPERATOR, the_robot(operator).seal_one(message(Control.CLOSE), b'\0'),
                    the_robot(operator).seal_one(message(Control.CLOSE)[:-1]))
    assert robot.dropped == {'malformed': 2} and robot.peers


def test_what_is_no_packet_is_counted() -> None:
    robot, operator = joined()
    packet = the_robot(operator).seal_one(data(20))
    give(robot, OPERATOR, b'', b'\x07', packet[:39], b'\xff' * 100, packet + bytes(SIZE), bytes(SIZE + 1),
         Cookie(1, 1, 0, bytes(16)).pack())
    assert robot.dropped == {'malformed': 4, 'too long': 2, "a robot's packet": 1}


def test_it_says_something_when_nothing_else_is_sent() -> None:
    robot, operator = joined()
    sent(robot)
    times = []
    for tick in range(1, 101):
        now = tick / 100
        robot.poll(now)
        if tick % 2 and tick < 50:
            robot.peers[0].seal_one(data(20))       # the transport sends
        times += [now] * len(sent(robot))
    assert times[0] >= 0.5 and len(times) >= 4 and max(np.diff(times)) <= 0.11
    assert robot.deadline(1.0) <= 1.1
