# SPDX-License-Identifier: BSD-3-Clause
"""The rules at the head of operator_core, one after the other."""
import math
from typing import Any, List, Tuple

import pytest
from link_channel import KEY, OPERATOR, ROBOT, SIZE, batch, data, give, outputs, random_bytes, sent, shake_hands
from link_sides import ELSEWHERE, init_of, joined, operator_of, robot_of, the_robot

from smokebot_udp.link.control import Control, message
from smokebot_udp.link.core import MAX_ATTEMPTS
from smokebot_udp.link.noise import Responder
from smokebot_udp.link.operator_core import (
    CONFIRM,
    FAST_FOR,
    FIRST_RETRY,
    HINTED_SILENCE,
    JITTER,
    LAST_RETRY,
    REFUSED_RETRY,
    REKEY_AFTER,
    SILENCE,
    OperatorCore,
)
from smokebot_udp.link.packets import (
    ACCEPT,
    ACCEPT_SIZE,
    VERSION,
    Accept,
    Cookie,
    Hello,
    Init,
    Reason,
    Refuse,
    Reply,
    Suite,
    Unknown,
    parse,
    prologue,
)
from smokebot_udp.link.peer import Joined, Left, Moved, Quiet, Refused
from smokebot_udp.link.place import place_at
from smokebot_udp.link.robot_core import RobotCore
from smokebot_udp.link.tags import Tags
from smokebot_udp.version import RELEASE, WIRE_FORMAT


def run(core: Any, start: float, end: float) -> List[Any]:
    """Poll a core at its deadlines; returns (time, packet) for what it wants sent in [start, end)."""
    found, now = [], start
    while now < end:
        core.poll(now)
        found += [(now, packet) for packet in sent(core)]
        now = max(now + 1e-6, core.deadline(now))
    return found


def kinds(packets: List[Any]) -> List[type]:
    return [type(parse(packet)) for _, packet in packets if packet[0] < 7]


# 1. The attempts

def test_nothing_is_sent_without_an_address() -> None:
    operator = OperatorCore(KEY, random_bytes(2), SIZE, 'desk')
    assert not run(operator, 0.0, 5.0) and operator.problem == "the robot's address is not known"


def test_hello_is_repeated_ever_more_slowly() -> None:
    operator = operator_of()
    (address, packet), = outputs(operator)
    assert address == ROBOT and isinstance(parse(packet), Hello)
    packets = run(operator, 0.0, 60.0)
    assert {packet for _, packet in packets} == {packet}
    gaps = [later - before for (before, _), (later, _) in zip([(0.0, b''), *packets], packets)]
    assert gaps[0] == pytest.approx(FIRST_RETRY, rel=JITTER + 0.01)
    assert all(gap <= LAST_RETRY * (1 + JITTER) + 1e-5 for gap in gaps)
    fast = round(FAST_FOR / FIRST_RETRY)
    assert max(gaps[:fast // 2]) <= FIRST_RETRY * (1 + JITTER) + 1e-5
    assert min(gaps[fast + 30:]) >= LAST_RETRY * (1 - JITTER) - 1e-5 and len(set(gaps[fast:])) > 20
    assert operator.problem == 'no answer from 10.0.0.7:17001'


def test_init_follows_the_cookie_at_once_and_hello_goes_with_each_fourth() -> None:
    robot, operator = robot_of(), operator_of()
    give(robot, OPERATOR, *sent(operator))
    give(operator, ROBOT, *sent(robot), now=0.1)
    init, = sent(operator)
    assert isinstance(parse(init), Init)
    assert kinds(run(operator, 0.1, 3.0))[:9] == [Init, Init, Hello, Init, Init, Init, Init, Hello, Init]


def test_a_second_cookie_replaces_the_first_and_a_copy_does_nothing() -> None:
    robot, operator = robot_of(), operator_of()
    hello, = sent(operator)
    give(robot, OPERATOR, hello)
    cookie, = sent(robot)
    give(operator, ROBOT, cookie, cookie)
    assert len(sent(operator)) == 1
    restarted = RobotCore(KEY, random_bytes(77), SIZE, 'robot')
    now, answers = 0.0, []
    while not answers:      # to the HELLO that goes with an INIT
        now = operator.deadline(now)
        operator.poll(now)
        give(restarted, OPERATOR, *sent(operator), now=now)
        answers = sent(restarted)
    new, = answers
    give(operator, ROBOT, cookie, new, now=now)
    init, = sent(operator)
    give(restarted, OPERATOR, init, now=now)
    assert isinstance(parse(sent(restarted)[0]), Accept)


def test_another_address_is_tried_at_once() -> None:
    operator = operator_of()
    sent(operator)
    operator.set_places([place_at(ROBOT)], 1.0)
    assert not outputs(operator)
    operator.set_places([place_at(ELSEWHERE)], 1.0)
    (address, _), = outputs(operator)
    assert address == ELSEWHERE


# 2. Fresh attempts

def test_each_init_is_another() -> None:
    robot, operator = robot_of(), operator_of()
    first = init_of(robot, operator)
    later = [packet for _, packet in run(operator, 0.0, 2.0) if isinstance(parse(packet), Init)]
    inits = [parse(packet) for packet in [first, *later]]
    assert len(inits) > MAX_ATTEMPTS
    assert len({init.sender for init in inits}) == len({init.message[:32] for init in inits}) == len(inits)


def test_the_first_answer_ends_the_handshake() -> None:
    robot, operator = robot_of(), operator_of()
    give(robot, OPERATOR, init_of(robot, operator), *[packet for _, packet in run(operator, 0.0, 0.2)])
    first, *others = (packet for packet in sent(robot) if isinstance(parse(packet), Accept))
    give(operator, ROBOT, first, *others, first)
    assert len(operator.peers) == 1 and operator.dropped == {'not asked for': len(others) + 1}
    sent(operator)
    assert set(kinds(run(operator, 0.2, SILENCE - 0.01))) == set()


# 3. Answers to something else

def test_an_answer_to_nobody_changes_nothing() -> None:
    operator = operator_of()
    give(operator, ROBOT, Cookie(VERSION, Suite.AESGCM, 5, bytes(16)).pack(), Refuse(VERSION, Reason.FULL, 5).pack(),
         Accept(VERSION, Suite.AESGCM, 5, bytes(ACCEPT_SIZE - ACCEPT.size)).pack(), Unknown(VERSION, 5).pack(),
         Hello(VERSION, 5).pack())
    assert operator.dropped == {'not asked for': 3, "an operator's packet": 1}
    assert len(sent(operator)) == 1 and not operator.events()   # its HELLO


@pytest.mark.parametrize('change', [{'version': WIRE_FORMAT + 1}, {'suite': 9}, {'suite': 0}], ids=str)
def test_a_cookie_of_another_kind_is_dropped(change: Any) -> None:
    robot, operator = robot_of(), operator_of()
    give(robot, OPERATOR, *sent(operator))
    cookie = parse(sent(robot)[0])
    assert isinstance(cookie, Cookie)
    give(operator, ROBOT, cookie._replace(**change).pack())
    assert sum(operator.dropped.values()) == 1 and set(operator.dropped) <= {'another version or cipher', 'forged'}
    assert not sent(operator)


def test_a_cookie_whose_suite_was_changed_on_the_way_is_forged() -> None:
    robot, operator = robot_of(), operator_of()
    give(robot, OPERATOR, *sent(operator))
    cookie = parse(sent(robot)[0])
    assert isinstance(cookie, Cookie)
    give(operator, ROBOT, cookie._replace(suite=Suite.CHACHAPOLY).pack())
    assert operator.dropped == {'forged': 1} and not sent(operator)
    give(operator, ROBOT, cookie.pack())
    assert isinstance(parse(sent(operator)[0]), Init)


def cookies_of(operator: OperatorCore) -> Tuple[RobotCore, Cookie]:
    """A robot, and its answer to the operator's HELLO."""
    robot = robot_of()
    give(robot, OPERATOR, *sent(operator))
    cookie = parse(sent(robot)[0])
    assert isinstance(cookie, Cookie)
    return robot, cookie


def test_forged_cookies_do_not_lock_an_operator_out() -> None:
    """Who sees the HELLO answers it first, and again and again; an INIT with such a cookie would be dropped."""
    operator = operator_of()
    robot, true = cookies_of(operator)
    forged = [true._replace(cookie=bytes([number] * 16)).pack() for number in range(8)]
    for tick in range(20):
        now = tick / 20
        give(operator, ROBOT, *forged, now=now)
        operator.poll(now)
        give(robot, OPERATOR, *sent(operator), now=now)
        give(operator, ROBOT, *sent(robot), *forged, now=now)
    assert len(operator.peers) == 1 and operator.dropped['forged'] >= 8 and not robot.dropped


def test_a_cookie_is_taken_once_for_each_hello() -> None:
    """Who has the key and floods an operator with cookies gets one INIT for each HELLO."""
    operator = operator_of()
    _, true = cookies_of(operator)
    give(operator, ROBOT, *[Tags(KEY).tagged(true._replace(cookie=number.to_bytes(16, 'big'))).pack()
                            for number in range(2000)])
    assert [type(parse(packet)) for packet in sent(operator)] == [Init]
    assert operator.dropped == {'not asked for': 1999}


def test_a_cookie_is_taken_from_the_robots_address_only() -> None:
    operator = operator_of()
    _, true = cookies_of(operator)
    give(operator, ELSEWHERE, true.pack())
    assert operator.dropped == {'another address': 1} and not sent(operator)
    assert operator.problem == 'the robot answers from 10.0.0.99:5: give this address instead'
    give(operator, ROBOT, true.pack())
    assert [type(parse(packet)) for packet in sent(operator)] == [Init]


def test_a_refusal_from_another_address_is_none() -> None:
    operator = operator_of()
    hello = parse(sent(operator)[0])
    assert isinstance(hello, Hello)
    give(operator, ELSEWHERE, Refuse(VERSION, Reason.FULL, hello.nonce).pack())
    assert operator.dropped == {'not asked for': 1} and not operator.events()


def test_a_changed_accept_is_dropped_and_the_true_one_taken_after_it() -> None:
    robot, operator = robot_of(), operator_of()
    give(robot, OPERATOR, init_of(robot, operator))
    accept, = sent(robot)
    places = range(8, len(accept), 7)
    for at in places:
        give(operator, ROBOT, accept[:at] + bytes([accept[at] ^ 1]) + accept[at + 1:])
    assert operator.dropped == {'forged': len(places)} and not operator.peers
    give(operator, ROBOT, accept)
    assert len(operator.peers) == 1


@pytest.mark.parametrize('payload', [b'', Reply(5, bytes(16), 10, 'robot').pack()[:-1],
                                     Reply(5, bytes(16), 10, 'robot').pack()], ids=['empty', 'short', 'tiny'])
def test_an_authentic_accept_that_makes_no_sense_is_malformed_once(payload: bytes) -> None:
    robot, operator = robot_of(), operator_of()
    init = parse(init_of(robot, operator))
    assert isinstance(init, Init)
    noise = Responder(KEY, Suite.AESGCM, prologue(init))
    noise.read(init.message)
    message = noise.write(payload, b'e' * 32)
    accept = ACCEPT.pack(4, VERSION, Suite.AESGCM, init.sender) + message
    give(operator, ROBOT, accept, accept)
    assert not operator.peers and sum(operator.dropped.values()) == 2
    if len(accept) == ACCEPT_SIZE:
        assert operator.dropped == {'malformed': 1, 'not asked for': 1}


# 4. The robot is there

def test_joined_with_the_accept_and_kept_awake_until_data_comes() -> None:
    robot, operator = robot_of(), operator_of()
    give(robot, OPERATOR, init_of(robot, operator), now=0.0)
    give(operator, ROBOT, *sent(robot), now=0.1)
    event, = operator.events()
    assert isinstance(event, Joined) and event.peer is operator.robot and event.peer.address == ROBOT
    assert event.peer.round_trip == pytest.approx(0.1)
    first = sent(operator)
    times = [when for when, _ in run(operator, 0.1, 0.35)]
    assert len(first) == 1 and len(times) >= 4 and max(b - a for a, b in zip(times, times[1:])) <= CONFIRM + 1e-3
    assert operator.problem is None
    give(robot, OPERATOR, *first, now=0.3)
    give(operator, ROBOT, *sent(robot), now=0.4)
    run(operator, 0.35, 0.41)
    assert len(run(operator, 0.41, 0.59)) <= 2      # keep-alives only


# 5. Whose keys

def test_the_same_robot_has_new_keys_and_another_has_joined() -> None:
    robot, operator = joined()
    first = the_robot(operator)
    operator.events()
    operator.set_places([place_at(('10.0.0.8', 17001))], 1.0)
    shake_hands(robot, operator, 1.0, place=('10.0.0.8', 17001))
    assert operator.peers == [first] and first.handshakes == 2 and not operator.events()
    assert first.address == ('10.0.0.8', 17001)
    restarted = RobotCore(KEY, random_bytes(9), SIZE, 'robot')
    operator.poll(1.0 + SILENCE)
    shake_hands(restarted, operator, 1.0 + SILENCE, place=('10.0.0.8', 17001))
    left, came = operator.events()
    assert isinstance(left, Left) and left.peer is first and 'restarted' in left.reason
    assert isinstance(came, Joined) and came.peer is operator.robot and came.peer.number == first.number + 1


# 6. Silence

def test_silence_begins_a_handshake_beside_the_session() -> None:
    robot, operator = joined()
    assert Hello not in kinds(run(operator, 0.0, SILENCE - 0.001))
    assert kinds(run(operator, SILENCE, SILENCE + 0.01)) == [Hello]
    delivery, = give(operator, ROBOT, robot.peers[0].seal_one(data(20)), now=0.7)      # the session goes on
    assert delivery.peer is the_robot(operator)
    assert Hello not in kinds(run(operator, 0.7, 1.1))
    assert not [event for event in operator.events() if isinstance(event, Left)]


def test_keys_that_the_robot_does_not_use_are_made_anew() -> None:
    robot, operator = joined()
    place = '10.0.0.8', 17001
    operator.set_places([place_at(place)], 0.1)
    give(robot, OPERATOR, init_of(robot, operator, now=0.1, place=place), now=0.1)
    give(operator, ROBOT, *sent(robot), now=0.1)
    assert the_robot(operator).handshakes == 2
    sent(operator)      # all that is sent under the new keys is lost
    for tick in range(2, 80):
        run(operator, tick / 10, tick / 10 + 0.09)
        robot.poll(tick / 10)
        give(operator, ROBOT, robot.peers[0].seal_one(data(20)), now=tick / 10)     # under the old ones
    assert robot.peers[0].handshakes == 1 and operator.problem is None
    operator.poll(8.5)
    shake_hands(robot, operator, 8.5, place=place)
    assert robot.peers[0].handshakes == 2 and len(robot.peers) == 1
    assert len(give(robot, OPERATOR, the_robot(operator).seal_one(data(20)), now=8.6)) == 1


def test_the_hint_of_a_restarted_robot_shortens_it() -> None:
    _, operator = joined()
    packet = the_robot(operator).seal_one(message(Control.KEEP_ALIVE))
    restarted = RobotCore(KEY, random_bytes(9), SIZE, 'robot')
    give(restarted, OPERATOR, packet, now=0.1)
    give(operator, ROBOT, *sent(restarted), now=0.1)
    assert Hello not in kinds(run(operator, 0.1, HINTED_SILENCE - 0.001))
    assert kinds(run(operator, HINTED_SILENCE, HINTED_SILENCE + 0.01)) == [Hello]


def test_a_forged_hint_does_nothing_while_the_robot_is_heard() -> None:
    robot, operator = joined()
    hint = Unknown(VERSION, the_robot(operator).session.their_index).pack()
    for tick in range(1, 50):
        give(operator, ROBOT, hint, robot.peers[0].seal_one(data(20)), hint, now=tick / 10)
        assert not kinds(run(operator, tick / 10, tick / 10 + 0.099))
    assert len(operator.peers) == 1


def test_a_robot_that_was_heard_after_the_hint_has_its_time_again() -> None:
    robot, operator = joined()
    hint = Unknown(VERSION, the_robot(operator).session.their_index).pack()
    give(operator, ROBOT, hint, robot.peers[0].seal_one(data(20)), now=0.1)
    assert Hello not in kinds(run(operator, 0.1, 0.1 + SILENCE - 0.001))


def test_a_hint_about_another_session_does_nothing() -> None:
    _, operator = joined()
    give(operator, ROBOT, Unknown(VERSION, the_robot(operator).session.their_index ^ 1).pack(), now=0.1)
    assert Hello not in kinds(run(operator, 0.1, SILENCE - 0.001))


# 7. Renewal

def test_a_session_is_renewed_after_an_hour_or_very_many_messages(monkeypatch: Any) -> None:
    for hour in (True, False):
        robot, operator = joined()
        now = REKEY_AFTER if hour else 1.0
        give(operator, ROBOT, robot.peers[0].seal_one(data(20)), now=now - 0.01)
        if not hour:
            monkeypatch.setattr('smokebot_udp.link.operator_core.REKEY_MESSAGES', 8)
            for _ in range(8):
                the_robot(operator).seal_one(data(20))
        operator.poll(now)
        give(robot, OPERATOR, the_robot(operator).seal_one(data(20)), now=now)     # the old keys go on
        shake_hands(robot, operator, now)
        assert the_robot(operator).handshakes == robot.peers[0].handshakes == 2
        assert Hello not in kinds(run(operator, now, now + 0.4))


# 8. Refusals

def test_a_refusal_is_told_once_and_the_attempts_go_on() -> None:
    robot = RobotCore(bytes(32), random_bytes(1), SIZE, 'robot')
    operator = operator_of()
    refusals = []
    for tick in range(200):
        operator.poll(tick / 20)
        shake_hands(robot, operator, tick / 20)
        assert operator.problem is not None and 'another key' in operator.problem
        refusals.append(sum(robot.dropped.values()))
    event, = operator.events()
    assert isinstance(event, Refused) and event.sentence == operator.problem
    assert refusals[-1] > refusals[150] > refusals[100] > 10


def test_another_version_is_told_with_both_numbers_and_releases() -> None:
    operator = operator_of()
    hello = parse(sent(operator)[0])
    assert isinstance(hello, Hello)
    give(operator, ROBOT, Refuse(7, Reason.VERSION, hello.nonce, '4.5.6').pack())
    operator.poll(0.01)
    assert operator.problem == (
        'this machine has smokebot_udp %s (wire format %d), the robot has smokebot_udp 4.5.6 (wire format 7), and '
        'these cannot talk to each other: install the newer release for this machine, too' % (RELEASE, VERSION))
    assert not run(operator, 0.01, REFUSED_RETRY - 0.01)
    run(operator, REFUSED_RETRY, 5.0)
    assert operator.problem == 'no answer from 10.0.0.7:17001'


def test_a_reason_of_a_later_version_is_malformed() -> None:
    operator = operator_of()
    hello = parse(sent(operator)[0])
    assert isinstance(hello, Hello)
    give(operator, ROBOT, Refuse(VERSION, 99, hello.nonce).pack())
    assert operator.dropped == {'malformed': 1}


# 9. The end

def test_a_robot_that_is_silent_for_long_has_left_and_is_still_looked_for() -> None:
    _, operator = joined()
    packets = run(operator, 0.0, 70.0)
    left = [event for event in operator.events() if isinstance(event, Left)]
    assert len(left) == 1 and not operator.peers
    assert packets[-1][0] > 69.0 and operator.problem == 'no answer from 10.0.0.7:17001'


def test_a_close_is_heard_and_handshakes_go_on() -> None:
    robot, operator = joined()
    operator.events()
    robot.close(1.0)
    first, *copies = sent(robot)
    give(operator, ROBOT, first, now=1.0)
    give(operator, ROBOT, *copies, now=1.0)
    left, = operator.events()
    assert isinstance(left, Left) and left.reason == 'closed' and operator.dropped == {'unknown session': 2}
    assert kinds(run(operator, 1.0, 1.04)) == [Hello]


def test_after_its_own_close_it_is_silent() -> None:
    _, operator = joined()
    operator.close(1.0)
    assert len(sent(operator)) == 3
    assert not run(operator, 1.0, 5.0) and math.isfinite(operator.deadline(5.0))


def test_the_robots_own_address_may_differ() -> None:
    robot, operator = joined()
    delivery, = give(operator, ELSEWHERE, robot.peers[0].seal_one(data(20)), now=0.1)
    assert delivery.peer.address == ROBOT and not [packet for packet in sent(operator) if packet[0] != 7]


# 10. Several addresses

def two_ways() -> OperatorCore:
    operator = OperatorCore(KEY, random_bytes(2), SIZE, 'desk')
    operator.set_places([place_at(one) for one in (ROBOT, ELSEWHERE, ROBOT)], 0.0)
    return operator


def test_all_addresses_are_asked_and_the_one_that_answers_is_used() -> None:
    robot, operator = robot_of(), two_ways()
    (first, hello), (second, same) = outputs(operator)
    assert (first, second) == (ROBOT, ELSEWHERE) and hello == same
    assert operator.problem == 'no answer from 10.0.0.7:17001 or 10.0.0.99:5'
    give(robot, OPERATOR, hello)
    give(operator, ELSEWHERE, *sent(robot))
    (address, init), = outputs(operator)
    assert address == ELSEWHERE and isinstance(parse(init), Init)
    give(robot, OPERATOR, init)
    give(operator, ELSEWHERE, *sent(robot))
    assert the_robot(operator).address == ELSEWHERE and len(operator.paths) == 2


def test_one_address_is_never_probed() -> None:
    robot, operator = joined()
    assert not operator.paths
    packets = [packet for _, packet in run(operator, 1.0, 1.4)]
    given = [robot.receive(*batch([(OPERATOR, packet)]), 1.0) for packet in packets]
    assert packets and not any(given) and not [packet for packet in sent(robot) if len(packet) == len(packets[0])][1:]


def test_a_challenge_is_answered_on_its_path() -> None:
    robot, operator = robot_of(), two_ways()
    shake_hands(robot, operator)
    outputs(operator)
    for source, answered in ((ELSEWHERE, ELSEWHERE), (ROBOT, ROBOT), (('10.9.9.9', 9), ROBOT)):
        give(operator, source, robot.peers[0].seal_one(message(Control.PATH_CHALLENGE, b'12345678')))
        (address, _), = outputs(operator)
        assert address == answered


def test_one_address_is_asked_by_two_interfaces() -> None:
    robot, operator = robot_of(), operator_of()
    ways = [place_at(ROBOT, interface) for interface in (3, 5)]
    operator.set_places(ways, 0.0)
    asked = operator.outputs()
    assert [place for place, _ in asked][-2:] == ways
    give(robot, OPERATOR, asked[-1][1])
    give(operator, ROBOT, *sent(robot), interface=5)
    (place, init), = operator.outputs()
    assert place == ways[1]
    give(robot, OPERATOR, init, interface=5)
    give(operator, ROBOT, *sent(robot), interface=5)
    assert the_robot(operator).place == ways[1] and [path.place for path in operator.paths] == ways
    operator.outputs()
    operator.poll(1.0)
    assert {place for place, _ in operator.outputs()} == set(ways)     # probes
    operator.set_places(ways[:1], 1.1)      # the interface is gone
    assert {place for place, _ in operator.outputs()} == {ways[0]} and not operator.events()[1:]


def test_an_address_without_an_interface_is_heard_by_any_of_them() -> None:
    robot, operator = robot_of(), operator_of()
    give(robot, OPERATOR, *sent(operator))
    give(operator, ROBOT, *sent(robot), interface=5)
    (place, _), = operator.outputs()
    assert place == place_at(ROBOT)


def test_a_silent_path_is_left_and_the_robot_follows() -> None:
    """The robot is at both addresses, and the operator too."""
    robot, operator = robot_of(), two_ways()
    other = ('10.1.0.9', 7)
    source = {ROBOT: OPERATOR, ELSEWHERE: other}
    target = {OPERATOR: ROBOT, other: ELSEWHERE}
    shake_hands(robot, operator)
    robot.events(), operator.events()
    for step in range(2000):
        now = 1.0 + step / 200
        for core in (robot, operator):
            core.poll(now)
        for place, packet in outputs(operator):
            if place != ROBOT or now < 3.0:
                give(robot, source[place], packet, now=now)
        for place, packet in outputs(robot):
            if place != OPERATOR or now < 3.0:
                give(operator, target[place], packet, now=now)
        if now < 3.0:
            assert the_robot(operator).address == ROBOT and robot.peers[0].address == OPERATOR
    assert operator.events() == [Moved(the_robot(operator), ELSEWHERE)]
    assert robot.events() == [Quiet(robot.peers[0]), Moved(robot.peers[0], other)]
    assert operator.robot is not None and robot.peers[0].handshakes == 1
