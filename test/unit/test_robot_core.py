# SPDX-License-Identifier: BSD-3-Clause
"""The rules at the head of robot_core, one after the other."""
from typing import Any, List, Tuple

import pytest
from link_channel import KEY, OPERATOR, ROBOT, Address, give, outputs, random_bytes, sent, shake_hands
from link_sides import ELSEWHERE, hello, init_of, joined, operator_of, robot_of, the_robot

from smokebot_udp.link.control import Control, message
from smokebot_udp.link.core import MAX_ATTEMPTS, MIN_DATAGRAM_SIZE, SILENT
from smokebot_udp.link.operator_core import OperatorCore
from smokebot_udp.link.packets import (
    VERSION,
    Accept,
    Cookie,
    Hello,
    Init,
    Reason,
    Refuse,
    Suite,
    parse,
)
from smokebot_udp.link.peer import Joined, Left, Refused
from smokebot_udp.link.place import place_at
from smokebot_udp.link.robot_core import (
    INIT_BURST,
    INIT_PERIOD,
    MAX_PEERS,
    MAX_PENDING,
    PENDING,
    REPLACED,
    YIELDS,
    RobotCore,
)
from smokebot_udp.link.tags import Tags
from smokebot_udp.version import WIRE_FORMAT

# 1. HELLO

def test_hello_is_answered_by_a_cookie() -> None:
    robot = robot_of()
    give(robot, OPERATOR, hello(77))
    (address, packet), = outputs(robot)
    cookie = parse(packet)
    assert isinstance(cookie, Cookie) and address == OPERATOR
    assert cookie[:3] == (VERSION, Suite.AESGCM, 77)
    assert robot.deadline(5.0) == 6.0   # nothing to wait for


@pytest.mark.parametrize('another, reason', [
    (Hello(VERSION + 1, 77), Reason.VERSION),
    (Hello(0, 77), Reason.VERSION),
    (Hello(VERSION, 77), Reason.WRONG_KEY),
    (parse(hello(77, bytes(32))), Reason.WRONG_KEY),
])
def test_another_hello_is_refused(another: Any, reason: Reason) -> None:
    robot = robot_of()
    give(robot, OPERATOR, another.pack(), another.pack())
    assert {parse(packet) for packet in sent(robot)} == {Refuse(VERSION, reason, 77)}
    assert list(robot.dropped.values()) == [2]
    event, = robot.events()     # one for both
    assert isinstance(event, Refused) and event.reason == reason and '10.0.0.9:40001' in event.sentence


# 2. The cookie

def test_an_init_counts_only_with_the_cookie_of_its_address_and_nonce() -> None:
    robot, operator = robot_of(), operator_of()
    packet = init_of(robot, operator)
    init = parse(packet)
    assert isinstance(init, Init)
    give(robot, ELSEWHERE, packet)
    give(robot, (OPERATOR[0], 1), packet)
    give(robot, OPERATOR, init._replace(nonce=init.nonce ^ 1).pack())
    give(robot, OPERATOR, init._replace(cookie=bytes(16)).pack())
    give(robot, OPERATOR, packet, now=1000.0)
    give(robot_of(), OPERATOR, packet)
    assert robot.dropped == {'wrong cookie': 5} and not sent(robot)
    give(robot, OPERATOR, init_of(robot, operator_of()))
    assert isinstance(parse(sent(robot)[0]), Accept)


def test_an_init_of_another_version_or_cipher_is_dropped() -> None:
    robot, operator = robot_of(), operator_of()
    init = parse(init_of(robot, operator))
    assert isinstance(init, Init)
    give(robot, OPERATOR, init._replace(version=WIRE_FORMAT + 1).pack(), init._replace(suite=2).pack())
    assert robot.dropped == {'another version or cipher': 2} and not sent(robot)


# 3. Each once, and so many from each host

def inits_of(robot: RobotCore, operator: OperatorCore, count: int, address: Address = OPERATOR) -> List[bytes]:
    """As many INITs of an operator; its clock goes on, the robot's does not."""
    packets, now = [init_of(robot, operator, address)], 0.0
    while len(packets) < count:
        now = operator.deadline(now)
        operator.poll(now)
        packets += [packet for packet in sent(operator) if isinstance(parse(packet), Init)]
    return packets[:count]


def test_a_host_has_its_share_of_handshakes() -> None:
    robot, operator, other = robot_of(), operator_of(), operator_of(3)
    packets, fair = inits_of(robot, operator, INIT_BURST + 7, ELSEWHERE), init_of(robot, other)
    give(robot, ELSEWHERE, *packets[:-2])
    assert robot.dropped == {'too many handshakes': 5}
    give(robot, OPERATOR, fair)
    give(robot, ELSEWHERE, *packets[-2:], now=1.5 * INIT_PERIOD)
    assert robot.dropped == {'too many handshakes': 6}


def test_forged_handshakes_in_an_operators_name_do_not_take_its_share(monkeypatch: Any) -> None:
    """Without the key nothing is charged, nor computed but the tag."""
    robot, operator = robot_of(), operator_of()
    packet = init_of(robot, operator)
    forged = [packet[:-1] + bytes([packet[-1] ^ change]) for change in range(1, 200)]
    with monkeypatch.context() as patched:
        patched.delattr('smokebot_udp.link.robot_core.Responder')
        give(robot, OPERATOR, *forged)
    assert robot.dropped == {'refused: wrong key': len(forged)} and len(forged) > 2 * INIT_BURST
    sent(robot)
    give(robot, OPERATOR, packet)
    assert [type(parse(answer)) for answer in sent(robot)] == [Accept]


def test_replays_do_not_take_an_operators_share_of_handshakes() -> None:
    robot, operator, other = robot_of(), operator_of(), operator_of(3)
    packet, fair = init_of(robot, operator), init_of(robot, other)
    give(robot, OPERATOR, *[packet] * (2 * INIT_BURST), fair)
    assert robot.dropped == {'replayed handshake': 2 * INIT_BURST - 1}
    assert [type(parse(answer)) for answer in sent(robot)] == [Accept, Accept]


# 4. What is not authentic

def test_a_repeated_handshake_is_dropped() -> None:
    robot, operator = robot_of(), operator_of()
    packet = init_of(robot, operator)
    give(robot, OPERATOR, packet, packet)
    give(robot, OPERATOR, packet, now=100.0)
    assert robot.dropped == {'replayed handshake': 2}
    assert len(sent(robot)) == 1


def test_a_wrong_key_is_refused_before_any_exchange_of_keys(monkeypatch: Any) -> None:
    robot, operator = robot_of(), operator_of()
    init = parse(init_of(robot, operator))
    assert isinstance(init, Init)
    monkeypatch.delattr('smokebot_udp.link.noise.X25519PrivateKey')
    monkeypatch.delattr('smokebot_udp.link.noise.X25519PublicKey')
    packet = Tags(bytes(32)).tagged(init).pack()
    give(robot, OPERATOR, packet, packet)
    assert robot.dropped == {'refused: wrong key': 2}
    assert {type(parse(answer)) for answer in sent(robot)} == {Refuse}
    assert [event.reason for event in robot.events() if isinstance(event, Refused)] == [Reason.WRONG_KEY]


def test_a_changed_init_is_refused_and_the_true_one_is_taken_after_it() -> None:
    robot, operator = robot_of(), operator_of()
    packet = init_of(robot, operator)
    give(robot, OPERATOR, packet[:-1] + bytes([packet[-1] ^ 1]), packet)
    assert [type(parse(answer)) for answer in sent(robot)] == [Refuse, Accept]


def test_an_operator_that_receives_tiny_datagrams_is_malformed() -> None:
    robot, operator = robot_of(), operator_of()
    operator.max_datagram_size = MIN_DATAGRAM_SIZE - 1
    give(robot, OPERATOR, init_of(robot, operator))
    assert robot.dropped == {'malformed': 1} and not sent(robot)
    with pytest.raises(ValueError, match='at least 256 bytes'):
        OperatorCore(KEY, random_bytes(2), MIN_DATAGRAM_SIZE - 1, 'desk')


# 5. and 10. Places

def full_robot() -> Tuple[RobotCore, List[OperatorCore]]:
    robot, operators = robot_of(), []
    for number in range(MAX_PEERS):
        operators.append(operator_of(10 + number, 'desk %d' % number))
        shake_hands(robot, operators[-1], address=('10.0.1.%d' % number, 9))
    assert len(robot.peers) == MAX_PEERS == 8
    robot.events()
    return robot, operators


def test_the_ninth_is_refused() -> None:
    robot, _ = full_robot()
    ninth = operator_of(now=5.0)
    shake_hands(robot, ninth, 5.0)
    assert len(robot.peers) == MAX_PEERS and not ninth.peers
    assert robot.dropped == {'refused: full': 1}
    event, = ninth.events()
    assert isinstance(event, Refused) and event.reason == Reason.FULL
    assert ninth.problem is not None and 'as many operators' in ninth.problem


def test_the_ninth_has_the_place_of_one_that_is_silent_for_long() -> None:
    robot, operators = full_robot()
    for number, operator in enumerate(operators):
        if number != 3:
            give(robot, ('10.0.1.%d' % number, 9), the_robot(operator).seal_one(message(Control.KEEP_ALIVE)),
                 now=YIELDS - 1)
    shake_hands(robot, operator_of(now=YIELDS), YIELDS)
    left, came = robot.events()
    assert isinstance(left, Left) and left.peer.name == 'desk 3' and 'place' in left.reason
    assert isinstance(came, Joined) and came.peer.name == 'desk'
    assert len(robot.peers) == MAX_PEERS


def test_nobody_gives_a_place_up_for_another_host() -> None:
    robot, operators = robot_of(), []
    for number in range(MAX_PEERS):
        operators.append(operator_of(10 + number, 'desk %d' % number))
        shake_hands(robot, operators[-1], address=('10.0.1.1', 100 + number))
    shake_hands(robot, operator_of())
    assert robot.dropped == {'refused: full': 1}


def test_a_known_operator_is_not_refused_by_a_full_robot() -> None:
    robot, operators = full_robot()
    operators[0].set_places([place_at(('10.0.0.8', 1))], 1.0)
    shake_hands(robot, operators[0], 1.0, ('10.0.1.0', 9), ('10.0.0.8', 1))
    assert not robot.dropped and robot.peers[0].handshakes == 2


def test_a_later_one_of_the_name_has_the_place_of_a_silent_one() -> None:
    robot, _ = full_robot()
    shake_hands(robot, operator_of(77, 'desk 5', now=REPLACED), REPLACED)
    left, came = robot.events()
    assert isinstance(left, Left) and isinstance(came, Joined)
    assert left.peer.told == came.peer.told == came.peer.name == 'desk 5' and left.peer.number < came.peer.number
    assert 'replaced' in left.reason


def test_two_of_one_name_that_are_both_heard_stay() -> None:
    robot, first = joined()
    second = operator_of(3, now=0.5)
    shake_hands(robot, second, 0.5, ELSEWHERE)
    for tick in range(6, 40):
        now = tick / 10
        give(robot, OPERATOR, the_robot(first).seal_one(message(Control.KEEP_ALIVE)), now=now)
        if now <= 2.0:
            give(robot, ELSEWHERE, the_robot(second).seal_one(message(Control.KEEP_ALIVE)), now=now)
        robot.poll(now)
        assert len(robot.peers) == 2    # the later one may be silent
    robot.events()
    give(robot, ELSEWHERE, the_robot(second).seal_one(message(Control.KEEP_ALIVE)), now=4.5)
    robot.poll(5.0)
    assert [peer.number for peer in robot.peers] == [2]
    assert [type(event) for event in robot.events()] == [Left]


def test_a_silent_peer_is_forgotten() -> None:
    robot, operator = joined()
    for tick in range(1, 10 * int(SILENT)):
        robot.poll(tick / 10)
    assert len(robot.peers) == 1
    robot.poll(SILENT)
    left, = robot.events()
    assert isinstance(left, Left) and 'silent' in left.reason and not robot.peers
    sent(robot)
    give(robot, OPERATOR, the_robot(operator).seal_one(message(Control.KEEP_ALIVE)), now=SILENT + 1)
    assert robot.dropped == {'unknown session': 1}


def test_a_close_ends_the_peer_at_once() -> None:
    robot, operator = joined()
    operator.close(1.0)
    packets = sent(operator)
    assert len(packets) == 3 and not operator.peers
    give(robot, OPERATOR, packets[2], packets[0], now=1.0)
    left, = robot.events()
    assert isinstance(left, Left) and left.reason == 'closed' and not robot.peers
    give(robot, OPERATOR, *packets, now=1.0)
    assert robot.dropped == {'unknown session': 3} and not robot.events()


# 6. Pending sessions

def pending(robot: RobotCore, operator: OperatorCore, count: int, address: Address = OPERATOR) -> List[bytes]:
    """ACCEPTs to as many attempts of one operator, newest last."""
    give(robot, address, *inits_of(robot, operator, count, address))
    return sent(robot)


def test_the_answer_to_each_of_the_last_attempts_makes_a_session() -> None:
    for chosen in range(MAX_ATTEMPTS):
        robot, operator = robot_of(), operator_of()
        accepts = pending(robot, operator, MAX_ATTEMPTS + 3)[-MAX_ATTEMPTS:]
        give(operator, ROBOT, accepts[chosen])
        give(robot, OPERATOR, *sent(operator))
        assert len(robot.peers) == 1, chosen


def test_an_attempt_before_them_is_no_more() -> None:
    robot, operator = robot_of(), operator_of()
    accepts = pending(robot, operator, MAX_ATTEMPTS + 1)
    give(operator, ROBOT, accepts[0])
    assert operator.dropped == {'not asked for': 1} and not operator.peers


def test_a_pending_session_ends() -> None:
    robot, operator = robot_of(), operator_of()
    accept, = pending(robot, operator, 1)
    give(operator, ROBOT, accept)
    packet, = sent(operator)
    robot.poll(PENDING - 0.1)
    robot.poll(PENDING + 0.1)
    give(robot, OPERATOR, packet, now=PENDING + 0.1)
    assert not robot.peers and robot.dropped == {'unknown session': 1}


def test_few_sessions_are_pending_in_all() -> None:
    robot = robot_of()
    operators = [operator_of(10 + number) for number in range(MAX_PENDING + 1)]
    for number, operator in enumerate(operators):
        accept, = pending(robot, operator, 1, ('10.0.1.%d' % number, 9))
        give(operator, ROBOT, accept)
    give(robot, OPERATOR, *sent(operators[0]))
    assert robot.dropped == {'unknown session': 1}
    give(robot, OPERATOR, *sent(operators[1]))
    assert len(robot.peers) == 1


def test_the_attempts_of_one_operator_do_not_end_those_of_another() -> None:
    robot, quiet, eager = robot_of(), operator_of(3), operator_of()
    accept, = pending(robot, quiet, 1)
    pending(robot, eager, MAX_PENDING + 8)
    give(quiet, ROBOT, accept)
    give(robot, OPERATOR, *sent(quiet))
    assert [peer.instance for peer in robot.peers] == [quiet.instance]


def test_the_first_data_ends_the_other_pending_sessions_of_its_instance() -> None:
    robot, operator, twin = robot_of(), operator_of(), operator_of()     # the same random numbers: the same packets
    accepts = pending(robot, operator, 2)
    with_twin = robot_of()
    assert pending(with_twin, twin, 2) == accepts
    give(operator, ROBOT, accepts[0])
    give(twin, ROBOT, accepts[1])
    give(robot, OPERATOR, *sent(operator))
    give(robot, OPERATOR, *sent(twin))
    assert robot.dropped == {'unknown session': 1} and robot.peers[0].handshakes == 1
