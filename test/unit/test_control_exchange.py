# SPDX-License-Identifier: BSD-3-Clause
"""Both halves of control over a simulated link: presence, who drives, requests, the emergency stop."""
from typing import Dict, List

import pytest
from control_world import World

from smokebot_udp.teleop.control_client import STATUS_LEASE, ControlClient
from smokebot_udp.teleop.control_server import (
    EMERGENCY_STOP,
    IDLE_PERIOD,
    MAX_SESSIONS,
    MIN_INTERVAL,
    NO_OPERATOR,
    NOT_IN_CONTROL,
    PERIOD,
    ControlServer,
)
from smokebot_udp.teleop.records import MAX_OPERATORS, PeerStatus, Request, Status, Wish
from smokebot_udp.teleop.requests import SUPERSEDED, TIMEOUT, UNANSWERED
from smokebot_udp.teleop.sessions import LEASE

SETTLE = 0.6
"""Until all know everything without loss: a period and the delay [s]."""


def world(*names: str, **link: float) -> World:
    """Operators that came in this order, and know the robot."""
    result = World(1, **link)
    for name in names:
        result.add(name)
        result.run(SETTLE)
    return result


def views(link: World) -> Dict[str, str]:
    """{operator: why it may not drive}"""
    return {name: desk.client.refusal(link.desk_now(name)) for name, desk in link.desks.items()}


def command(link: World, name: str) -> object:
    """What the robot says to a command that comes from an operator now."""
    return link.server.command(name, link.desks[name].client.session, '/commands', 1, link.robot_now)


def test_all_operators_are_told_who_drives() -> None:
    link = world('a', 'b')
    assert views(link) == {'a': '', 'b': 'a drives'}
    assert (command(link, 'a'), command(link, 'b')) == (None, NOT_IN_CONTROL)
    request = link.ask('b', Wish.TAKE_CONTROL)
    assert link.run(0.2, lambda: views(link) == {'a': 'b drives', 'b': ''}) and link.outcome('b', request) == ''
    assert (command(link, 'a'), command(link, 'b')) == (NOT_IN_CONTROL, None)


def test_a_release_by_who_does_not_drive_is_refused_and_it_is_told_why() -> None:
    link = world('a', 'b')
    request = link.ask('b', Wish.RELEASE_CONTROL)
    link.run(SETTLE)
    assert link.outcome('b', request) == 'a drives' and views(link)['a'] == ''
    request = link.ask('a', Wish.RELEASE_CONTROL)
    link.run(SETTLE)
    assert link.outcome('a', request) == '' and views(link) == {'a': 'nobody drives', 'b': 'nobody drives'}


def test_a_holder_whose_link_is_cut_for_3_s_and_returns() -> None:
    link = world('a', 'b')
    link.cut['a'] = True
    link.run(1.0)
    assert views(link) == {'a': '', 'b': 'a drives'}
    link.run(2.0)
    assert views(link)['a'].startswith('the robot was not heard for 3.') and views(link)['b'] == ''
    link.cut['a'] = False
    link.run(SETTLE)
    assert views(link) == {'a': 'b drives', 'b': ''}


def test_a_link_that_is_dead_towards_the_robot_only() -> None:
    link = world('a', 'b')
    client = link.desks['a'].client
    link.cut['a'] = True
    for _ in range(30):
        link.run(0.1)
        link.desks['b'].client.poll(link.desk_now('b'))
        client.receive(Status(link.server.session, link.robot_now, operators=tuple(
            link.server.operators(link.robot_now))), link.desk_now('a'))
    assert views(link)['a'] == 'the robot does not hear this operator'


def test_the_status_is_sent_less_often_while_nobody_does_anything() -> None:
    server, now, sent = ControlServer(7), 100.0, []

    def run(duration: float, commands: bool = False) -> float:
        """Statuses a second while time passes, and an operator is present, which may send commands."""
        nonlocal now
        sent.clear()
        end = now + duration
        while now < end:
            now += 0.01
            server.receive('a', 1, Request(1, now), now)
            if commands:
                server.command('a', 1, '/commands', 1, now)
            if server.poll(now) is not None:
                sent.append(now)
        return len(sent) / duration

    run(LEASE + 1.0)        # it has come
    assert run(10.0) == pytest.approx(1 / IDLE_PERIOD, rel=0.1)
    assert run(10.0, commands=True) == pytest.approx(1 / PERIOD, rel=0.1)
    assert run(LEASE) == pytest.approx(1 / PERIOD, rel=0.1)
    assert run(10.0) == pytest.approx(1 / IDLE_PERIOD, rel=0.1)
    server.set_estop(True, 'the robot', now)
    assert server.poll(now + MIN_INTERVAL) is not None and run(LEASE) == pytest.approx(1 / PERIOD, rel=0.1)


def test_other_datagrams_show_that_the_link_is_up_for_a_while() -> None:
    link = world('a')
    client, now = link.desks['a'].client, link.desk_now('a')
    client.alive = now + 1.0
    assert client.heard(now + LEASE + 0.5) and client.refusal(now + LEASE + 0.5) == ''
    assert not client.heard(now + 1.0 + LEASE)
    client.alive = now + 100.0
    assert client.heard(now + STATUS_LEASE - 0.7) and not client.heard(now + STATUS_LEASE)


def test_commands_and_reports_renew_the_lease() -> None:
    link = world('a', 'b')
    link.cut['a'] = True
    for number in range(10):
        link.run(0.5)
        if number % 2:
            link.server.reported('a', number, link.robot_now)
        else:
            assert command(link, 'a') is None
    link.run(LEASE)
    assert command(link, 'b') is None and command(link, 'a') == NOT_IN_CONTROL


def test_the_emergency_stop_ends_commands_of_all_until_it_is_released() -> None:
    link = world('a', 'b')
    stop = link.ask('b', Wish.ENGAGE_ESTOP)
    assert views(link) == {'a': '', 'b': 'emergency stop by this operator'}
    link.run(SETTLE)
    assert link.outcome('b', stop) == ''
    assert views(link) == {'a': 'emergency stop by b', 'b': 'emergency stop by b'}
    assert (command(link, 'a'), command(link, 'b')) == (EMERGENCY_STOP, EMERGENCY_STOP)
    release = link.ask('a', Wish.RELEASE_ESTOP)
    link.run(SETTLE)
    assert link.outcome('a', release) == '' and views(link) == {'a': '', 'b': 'a drives'}
    assert not link.desks['b'].client.estop and command(link, 'a') is None


def test_a_second_press_counts_though_the_first_one_was_not_answered() -> None:
    link = world('a', 'b')
    link.deaf['a'] = True
    first = link.ask('a', Wish.ENGAGE_ESTOP)
    link.run(SETTLE)
    assert link.server.estop.engaged and link.outcome('a', first) is None
    link.ask('b', Wish.RELEASE_ESTOP)
    link.run(SETTLE)
    assert not link.server.estop.engaged        # the copies of the first press that still come are none
    second = link.ask('a', Wish.ENGAGE_ESTOP)
    link.run(SETTLE)
    assert link.server.estop.engaged and link.outcome('a', second) is None
    link.deaf['a'] = False
    link.run(SETTLE)
    assert (link.outcome('a', first), link.outcome('a', second)) == ('', '')
    assert link.server.estop.engaged


def test_a_second_release_counts_though_the_first_one_was_not_answered() -> None:
    link = world('a', 'b')
    link.ask('b', Wish.ENGAGE_ESTOP)
    link.run(SETTLE)
    link.deaf['a'] = True
    first = link.ask('a', Wish.RELEASE_ESTOP)
    link.run(0.2)
    assert not link.server.estop.engaged and link.outcome('a', first) is None
    link.ask('b', Wish.ENGAGE_ESTOP)
    link.run(0.2)
    assert link.server.estop.engaged            # the first release was made before that
    second = link.ask('a', Wish.RELEASE_ESTOP)
    link.run(0.2)
    assert not link.server.estop.engaged and link.outcome('a', second) is None


def test_who_takes_control_again_has_it_again() -> None:
    link = world('a', 'b')
    link.deaf['b'] = True
    link.ask('b', Wish.TAKE_CONTROL)
    link.run(0.2)
    link.ask('a', Wish.TAKE_CONTROL)
    link.run(0.2)
    assert command(link, 'b') == NOT_IN_CONTROL
    link.ask('b', Wish.TAKE_CONTROL)
    link.run(0.2)
    assert command(link, 'b') is None


def test_two_engage_one_releases() -> None:
    link = world('a', 'b')
    link.ask('a', Wish.ENGAGE_ESTOP)
    link.run(SETTLE)
    release = link.ask('a', Wish.RELEASE_ESTOP)
    stop = link.ask('b', Wish.ENGAGE_ESTOP)     # comes before or after the release: in force either way
    link.run(SETTLE)
    assert link.server.estop.engaged and link.server.estop.by == 'b' and link.outcome('b', stop) == ''
    assert link.outcome('a', release) in ('', 'b engaged it after that')
    assert link.desks['a'].client.estop and link.desks['b'].client.estop
    release = link.ask('a', Wish.RELEASE_ESTOP)
    link.run(SETTLE)
    assert link.outcome('a', release) == '' and not link.server.estop.engaged and not link.desks['b'].client.estop


def test_an_operator_that_was_restarted_while_the_stop_is_engaged() -> None:
    link = world('a')
    link.ask('a', Wish.ENGAGE_ESTOP)
    link.run(SETTLE)
    link.add('a')
    link.run(SETTLE)
    assert link.server.estop.engaged and link.desks['a'].client.estop
    link.restart_robot()
    assert not link.server.estop.engaged
    link.run(SETTLE)
    assert link.server.estop.engaged
    release = link.ask('a', Wish.RELEASE_ESTOP)
    link.run(SETTLE)
    assert link.outcome('a', release) == '' and not link.server.estop.engaged


def test_a_person_at_the_robot_releases_for_all() -> None:
    link = world('a')
    link.server.set_estop(True, 'the robot', link.robot_now)
    link.run(SETTLE)
    assert views(link) == {'a': 'emergency stop by the robot'}
    link.ask('a', Wish.ENGAGE_ESTOP)
    link.run(SETTLE)
    link.server.set_estop(False, 'the robot', link.robot_now)
    link.run(SETTLE)
    assert views(link) == {'a': ''}
    link.restart_robot()
    link.run(SETTLE)
    assert not link.server.estop.engaged


def test_what_the_link_cannot_carry_now_is_not_asked_except_for_the_stop() -> None:
    link = World(1)
    link.add('a')
    with pytest.raises(ValueError, match='not heard yet'):
        link.ask('a', Wish.TAKE_CONTROL)
    link.run(SETTLE)
    with pytest.raises(ValueError, match='clock is not known'):
        link.desks['a'].client.ask(Wish.RELEASE_ESTOP, link.desk_now('a'), None)
    link.cut['a'] = True
    link.run(LEASE + 1)
    with pytest.raises(ValueError, match='not heard for'):
        link.ask('a', Wish.RELEASE_ESTOP)
    link.ask('a', Wish.ENGAGE_ESTOP)
    link.run(30.0)
    link.cut['a'] = False
    assert link.run(0.1, lambda: link.server.estop.engaged)


def test_what_was_asked_of_a_robot_before_its_restart_is_refused() -> None:
    link = world('a', 'b')
    requests = [link.ask('b', Wish.TAKE_CONTROL), link.ask('b', Wish.RELEASE_ESTOP)]
    link.restart_robot()
    link.server.set_estop(True, 'the robot', link.robot_now)
    link.run(SETTLE)
    assert [link.outcome('b', request) for request in requests] == 2 * ['the robot was restarted']
    assert link.server.estop.engaged


def test_a_status_that_was_overtaken_is_no_news() -> None:
    link = world('a')
    client, now = link.desks['a'].client, link.desk_now('a')
    status = client.status
    assert status is not None and not client.receive(status, now)
    assert not client.receive(status._replace(clock=status.clock - 0.1, estop=True, estop_by='a'), now)
    assert client.status == status and not client.estop
    assert client.receive(status._replace(clock=status.clock + 0.1), now)


def test_a_release_that_is_held_up_by_the_link_is_refused() -> None:
    link = world('a')
    link.ask('a', Wish.ENGAGE_ESTOP)
    link.run(SETTLE)
    link.cut['a'] = True
    release = link.ask('a', Wish.RELEASE_ESTOP)
    link.run(1.2)
    link.cut['a'] = False
    link.run(SETTLE)
    assert link.server.estop.engaged and 's after it was made' in str(link.outcome('a', release))
    link.cut['a'] = True
    release = link.ask('a', Wish.RELEASE_ESTOP)
    link.run(TIMEOUT + SETTLE)
    assert link.outcome('a', release) == UNANSWERED


def test_a_stop_supersedes_a_release_that_waits() -> None:
    link = world('a')
    link.cut['a'] = True
    release = link.ask('a', Wish.RELEASE_ESTOP)
    link.ask('a', Wish.ENGAGE_ESTOP)
    link.cut['a'] = False
    link.run(SETTLE)
    assert link.outcome('a', release) == SUPERSEDED and link.server.estop.engaged


def test_who_is_one_too_many_is_told_so_and_stops_the_robot_all_the_same() -> None:
    link = world(*['operator %d' % number for number in range(MAX_OPERATORS + 1)])
    last = 'operator %d' % MAX_OPERATORS
    assert views(link)[last] == 'too many operators' and link.server.dropped['too many operators'] > 0
    assert command(link, last) == NO_OPERATOR
    stop = link.ask(last, Wish.ENGAGE_ESTOP)
    assert link.run(0.1, lambda: link.server.estop.engaged)
    link.run(1.5)
    assert link.outcome(last, stop) == ''       # otherwise it would engage it for ever
    link.ask('operator 0', Wish.RELEASE_ESTOP)
    link.run(SETTLE)
    assert not link.server.estop.engaged and not link.desks[last].client.estop


def test_who_is_one_too_many_engages_the_stop_once_with_each_press() -> None:
    link = world(*['operator %d' % number for number in range(MAX_OPERATORS + 1)])
    last = 'operator %d' % MAX_OPERATORS
    for _ in range(2):
        stop = link.ask(last, Wish.ENGAGE_ESTOP)
        assert link.run(0.1, lambda: link.server.estop.engaged)
        assert link.run(0.2, lambda sent=stop: link.outcome(last, sent) == '')      # type: ignore[misc]
        link.run(SETTLE)    # a release counts if it is newer for certain: the robot's clock is known with a tolerance
        link.ask('operator 0', Wish.RELEASE_ESTOP)
        link.run(SETTLE)
        assert not link.server.estop.engaged
    refused = link.ask(last, Wish.TAKE_CONTROL)
    link.run(SETTLE)
    assert link.outcome(last, refused) == 'too many operators'


def test_a_copy_of_a_press_that_comes_long_after_it_is_no_press() -> None:
    server, press = ControlServer(7), Request(1, 5.0, 0, 1, Wish.ENGAGE_ESTOP)
    server.receive('a', 1, press, 100.0)
    assert server.estop.engaged
    server.left('a')
    for number in range(50):
        server.receive('b', 1 + number, Request(2, number / 10), 100.0 + number / 10)
    server.receive('b', 60, Request(2, 5.0, 7, 1, Wish.RELEASE_ESTOP, 105.0), 105.1)
    assert not server.estop.engaged
    server.receive('a', 1, press, 105.2)
    assert not server.estop.engaged
    server.receive('a', 2, press._replace(id=2), 105.3)
    assert server.estop.engaged


def test_the_status_is_sent_at_once_for_news_and_requests_but_not_in_a_flood() -> None:
    server, now, sent = ControlServer(7), 100.0, 0
    assert server.poll(now) is not None and server.poll(now) is None and server.deadline() == now + PERIOD
    server.receive('a', 1, Request(1, 5.0), now + 0.05)
    assert server.poll(now + 0.05) is not None      # there is an operator
    for number in range(1000):
        now = 101.0 + number / 1000
        server.receive('a', number, Request(1, now, 7, 1 + number, Wish.TAKE_CONTROL, now), now)
        sent += server.poll(now) is not None
    assert 95 <= sent <= 1 / MIN_INTERVAL + 1


def test_forged_sessions_cost_bounded_memory_and_cannot_repeat_what_was_done() -> None:
    server = ControlServer(7)
    for number in range(10_000):
        now = 100.0 + number * 1e-4
        server.receive('operator %d' % (number % 20), number, Request(1 + number, now), now)
        if number % 7 == 0:
            server.left('operator %d' % (number % 11))
    assert len(server.operators(101.0)) <= MAX_OPERATORS and server.remembered <= MAX_SESSIONS


def test_a_link_that_ends_and_begins_again_does_not_repeat_a_request() -> None:
    server = ControlServer(7)
    take = Request(1, 5.0, 7, 1, Wish.TAKE_CONTROL, 100.0)
    server.receive('b', 1, Request(2, 5.0), 100.0)
    server.receive('a', 1, take, 100.1)
    assert server.control.driver is not None and server.control.driver.name == 'a'
    server.left('a')
    server.receive('a', 2, Request(1, 5.1), 100.2)
    assert server.control.driver.name == 'b'
    server.receive('a', 3, take, 100.3)     # a late copy
    assert server.control.driver.name == 'b'


def test_the_answer_to_the_clock_question_is_of_the_newest_request() -> None:
    server, client = ControlServer(7), ControlClient(1)
    server.receive('a', 1, Request(1, 5.2), 100.0)
    server.receive('a', 2, Request(1, 5.0), 100.1)      # late
    peer, = server.operators(100.3)
    assert (peer.echo, peer.held) == (5.2, pytest.approx(0.3))
    assert client.own is None and client.loss is None


def test_loss_is_measured_and_told() -> None:
    link = world('a', loss=0.0)
    link.loss = 0.5
    link.run(1.0)
    losses: List[float] = []
    for _ in range(20):
        link.run(2.0)
        if link.desks['a'].client.loss is not None:
            losses.append(link.desks['a'].client.loss)
    assert sum(losses) / len(losses) == pytest.approx(0.5, abs=0.12)


def test_loss_of_link_reports_counts() -> None:
    server = ControlServer(7)
    for number in range(40):
        now = 100.0 + 0.1 * number
        if number % 5 == 0:
            server.receive('a', 1 + number // 5, Request(1, now), now)
        if number % 4:
            server.reported('a', number, now)       # a quarter is lost
            server.reported('stranger', number, now)
    peer, = server.operators(104.0)
    assert peer.loss == pytest.approx(0.2, abs=0.04)    # of those of the last 2 s, requests included


def test_a_late_status_of_a_robot_that_was_never_heard_is_no_restart() -> None:
    link = world('a')
    client, now = link.desks['a'].client, link.desk_now('a')
    robot, session = client.robot, client.session
    assert not client.receive(Status(99, 1.0), now)
    assert not client.receive(Status(99, 1.0, operators=(PeerStatus(session, 'a', now - 3.0, 0.0),)), now)
    assert not client.receive(Status(99, 1.0, operators=(PeerStatus(session + 1, 'b', now, 0.0),)), now)
    assert client.robot == robot
    assert client.receive(Status(99, 1.0, operators=(PeerStatus(session, 'a', now - 0.1, 0.0),)), now)
    assert client.robot == 99 and not client.receive(Status(robot, 1e9), now)
    assert client.receive(Status(robot, 1e9), now + LEASE + 0.1)    # the other one is silent
