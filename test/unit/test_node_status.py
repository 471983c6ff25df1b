# SPDX-License-Identifier: BSD-3-Clause
import dataclasses
import math
from typing import List

import pytest

from smokebot_udp.monitoring.clock_offset import ClockEstimate
from smokebot_udp.monitoring.node_status import (
    RequestMonitor,
    clock_status,
    control_text,
    link_status,
    operator_control_status,
    peers_in,
    robot_control_status,
    transport_status,
)
from smokebot_udp.monitoring.stats import LinkStats, PathRates
from smokebot_udp.monitoring.status import ERROR, OK, ROBOT, WARN, Status, Verdict
from smokebot_udp.monitoring.thresholds import Thresholds
from smokebot_udp.nodes.status_messages import as_message, statuses_of
from smokebot_udp.streams.config import NAME
from smokebot_udp.transport import BESIDE, COPIES, UNUSED, PathStats, PeerStats, TransportStats
from smokebot_udp.units import MBIT


def test_thresholds_must_be_numbers() -> None:
    thresholds, problems = Thresholds().override({'warn_loss': 0.1, 'error_silence': 5, 'fill': 'nearest'})
    assert thresholds == Thresholds(warn_loss=0.1, error_silence=5.0) and not problems
    for wrong in ('0.1', True, -1, math.nan, None, [1]):
        thresholds, problems = Thresholds(warn_loss=0.2).override({'warn_loss': wrong})
        assert thresholds == Thresholds(warn_loss=0.2) and 'warn_loss' in problems[0] and '0.2' in problems[0]


def test_the_worst_level_is_the_verdict_s() -> None:
    verdict = Verdict()
    verdict.check(None, 1.0, 2.0, '%.0f', 1)
    verdict.check(0.9, 1.0, 2.0, '%.0f', 1)
    assert verdict.level == OK and not str(verdict)
    verdict.check(2.0, 1.0, 2.0, '%.0f cm', 100)
    verdict.check(1.0, 1.0, 2.0, '%.0f m', 1)
    assert verdict.level == ERROR and str(verdict) == '200 cm, 1 m'


def test_the_clock_s_status() -> None:
    status = clock_status(ClockEstimate(-0.0125, 0.003, 0.002), {'jumps': 1})
    assert status.level == OK and status.values == pytest.approx(
        {'offset [ms]': -12.5, 'round_trip [ms]': 3.0, 'uncertainty [ms]': 2.0, 'jumps': 1})
    assert clock_status(None, {'jumps': 0}).level == WARN


def test_the_link_s_status() -> None:
    stats = LinkStats(True, 2 * MBIT, MBIT, 5 * MBIT, 3 * MBIT, 0.1, 0.02, operator='/op', silence=2.0,
                      refused_reports={'too many operators': 5, 'order': 1})
    status = link_status(stats)
    assert (status.name, status.level, status.message) == ('link control', OK, 'fine')
    assert not NAME.match(status.name)      # else diagnostics could have it twice: streams.yaml has a stream `link`
    numbers = dict(status.values)
    assert numbers.pop('state') == 'as /op reports'
    assert numbers == pytest.approx({
        'rate [Mbit/s]': 2, 'sent [Mbit/s]': 1, 'wanted [Mbit/s]': 5,
        'capacity [Mbit/s]': 3, 'loss [%]': 10, 'queue delay [ms]': 20, 'round trip [ms]': math.nan,
        'reports refused, order': 1, 'reports refused, too many operators': 5}, nan_ok=True)
    status = link_status(dataclasses.replace(stats, timeout=True))
    assert (status.level, status.message) == (WARN, 'no reports of /op for 2.0 s')
    holed = link_status(dataclasses.replace(stats, timeout=True, longest=1172))
    assert (holed.level, holed.message) == (
        WARN, 'no reports of /op for 2.0 s, datagrams above 1172 bytes do not pass')
    assert holed.values['longest datagram [byte]'] == 1172
    two = dataclasses.replace(stats, paths=[PathRates('wlan0', MBIT, 2 * MBIT, 0.05, 0.01),
                                            PathRates('10.1.0.9', 0.25 * MBIT, math.nan, math.nan, math.nan)])
    assert {name: value for name, value in link_status(two).values.items() if name.startswith('by ')} == {
        'by wlan0': '1.00 of 2.00 Mbit/s sent, loss 5 %', 'by 10.1.0.9': '0.25 of nan Mbit/s sent, loss nan %'}
    lone = dataclasses.replace(stats, only='wwan0')
    assert (link_status(lone).level, link_status(lone).message) == (WARN, 'as /op reports, over wwan0 only')
    fixed = link_status(dataclasses.replace(stats, adaptive=False, rate=None, timeout=True))
    assert (fixed.level, fixed.message) == (OK, 'fine')
    assert fixed.values['state'] == 'fixed' and fixed.values['rate [Mbit/s]'] == 0
    assert link_status(dataclasses.replace(stats, operator=None)).values['state'] == 'no operator has reported yet'


def test_a_message_has_no_unknown_values() -> None:
    message = as_message(Status('k', 'a', WARN, 'b', {'x': None, 'y': 1.23456789, 'z': 1234567}), ROBOT)
    assert [(pair.key, pair.value) for pair in message.values] == [
        ('side', 'robot'), ('kind', 'k'), ('y', '1.23457'), ('z', '1234567')]
    assert (message.name, message.level, message.message) == ('a', WARN, 'b')


def test_a_message_is_read_as_the_status_that_it_was_made_of() -> None:
    """Also where a value has the name of what tells statuses apart, as that of a refused stream may."""
    status = Status('refused', 'node: a', WARN, 'b', {'refused': 2, 'kind': 'rate is -5', 'x': 'y'})
    read, = statuses_of([as_message(status, ROBOT)])
    assert read == Status('refused', 'a', WARN, 'b', {'refused': '2', 'x': 'y'}, ROBOT, '/node')


@pytest.mark.parametrize('driver, estop, operators, text', [
    ('', False, [], 'nobody drives'), ('/a', False, ['/a'], '/a drives'),
    ('/a', True, ['/b', '/a'], 'EMERGENCY STOP; /a drives, present: /b'),
    ('', False, ['/a', '/b'], 'nobody drives, present: /a, /b')])
def test_who_drives_in_words(driver: str, estop: bool, operators: List[str], text: str) -> None:
    assert control_text(driver, estop, operators) == text


def test_an_emergency_stop_is_a_warning_that_names_who_engaged_it() -> None:
    status = robot_control_status('/a', '/b', ['/a', '/b'], {'too many operators': 3})
    assert (status.level, status.message) == (WARN, 'emergency stop, engaged by /b')
    assert status.values == {'control': 'EMERGENCY STOP; /a drives, present: /b', 'driver': '/a',
                             'emergency stop': 'engaged', 'operators': '/a, /b', 'dropped, too many operators': 3}
    fine = robot_control_status('', None, [], {})
    assert (fine.level, fine.message, fine.values['driver']) == (OK, 'fine', 'nobody')


def test_an_operator_without_the_robots_clock_cannot_command() -> None:
    assert operator_control_status('in control', False, 0.002, 0.5)[2:5] == (OK, 'fine', {
        'control': 'in control', "uncertainty of the robot's clock [ms]": 2.0,
        'loss to the robot [%]': 50.0})
    assert operator_control_status('LOCKED: thermal is 2.0 s old', True, 0.002, None).level == WARN
    unknown = operator_control_status('LOCKED: the robot was not heard yet', True, None, None)
    assert (unknown.level, unknown.message) == (ERROR, 'LOCKED: the robot was not heard yet')
    unlocked = operator_control_status('in control', False, None, None)
    assert (unlocked.level, unlocked.message) == (ERROR, "the robot's clock is not known")


def test_peers_and_drops_are_listed() -> None:
    peers = [PeerStats('/operator_receiver@desk', ('10.0.0.9', 40000), 0.2, 0.0124),
             PeerStats('/ugv1/operator_receiver@truck', ('10.0.0.8', 40001), 12.4, None)]
    status = transport_status(TransportStats(peers, 3, {'wrong tag': 2, 'replayed': 5}, None))
    assert (status.name, status.level, status.message) == ('link transport', OK, 'fine')
    assert status.values == {
        'connected to': '/operator_receiver@desk at 10.0.0.9:40000 (round trip 12 ms); '
                        '/ugv1/operator_receiver@truck at 10.0.0.8:40001 (silent for 12 s)',
        'handshakes': 3, 'dropped': 7, 'dropped, replayed': 5, 'dropped, wrong tag': 2}
    both = PeerStats('/robot_sender@ugv', ('10.0.0.7', 17001), 3.2, 0.3)
    text = transport_status(TransportStats([*peers, both], 3, {}, None)).values['connected to']
    assert [tuple(peer.values()) for peer in peers_in(text)] == [
        ('/operator_receiver@desk', '10.0.0.9', 40000, '', 0.012, True),
        ('/ugv1/operator_receiver@truck', '10.0.0.8', 40001, '', None, True),
        ('/robot_sender@ugv', '10.0.0.7', 17001, '', 0.3, True)]


@pytest.mark.parametrize('text', ['', 'nobody', '/a at b', '/a at b:', '/a at b:1 (x)', '/a at b:123456', '; ; '])
def test_other_words_are_no_peers(text: str) -> None:
    assert peers_in(text) == []


def test_the_paths_that_are_not_used_are_listed() -> None:
    others = [PathStats(('10.0.0.7', 17001), '', UNUSED, 5.4, 0.01),
              PathStats(('10.1.0.7', 17001), 'wlan1', BESIDE, 0.3, 0.07),
              PathStats(('10.3.0.7', 17001), '', UNUSED, 0.3, None)]
    peer = PeerStats('robot', ('10.1.0.7', 17001), 0.2, 0.06, 'wwan0', others)
    status = transport_status(TransportStats([peer], 1, {}, None))
    text = status.values['connected to']
    assert text == ('robot at 10.1.0.7:17001 by wwan0 (round trip 60 ms); '
                    'robot at 10.0.0.7:17001 (not used, silent for 5 s, round trip 10 ms); '
                    'robot at 10.1.0.7:17001 by wlan1 (beside, round trip 70 ms); robot at 10.3.0.7:17001 (not used)')
    assert [(peer['host'], peer['interface'], peer['used'], peer['round_trip']) for peer in peers_in(text)] == [
        ('10.1.0.7', 'wwan0', True, 0.06), ('10.0.0.7', '', False, 0.01), ('10.1.0.7', 'wlan1', False, 0.07),
        ('10.3.0.7', '', False, None)]


def test_what_was_sent_to_each_address_of_a_peer_is_listed() -> None:
    sent = {('10.0.0.9', 'wlan0'): 12345678, ('10.0.0.9', 'wwan0'): 50000, ('10.9.0.9', ''): 1000000}
    others = [PathStats(('10.0.0.9', 40001), 'wwan0', COPIES, 0.1, None)]
    peer = PeerStats('desk', ('10.0.0.9', 40000), 0.2, 0.01, 'wlan0', others, sent)
    text = transport_status(TransportStats([peer], 1, {}, None)).values['connected to']
    assert text == ('desk at 10.0.0.9:40000 by wlan0 (round trip 10 ms, 12.3 MB sent); '
                    'desk at 10.0.0.9:40001 by wwan0 (commands only, 0.1 MB sent)')
    assert [(peer['host'], peer['used'], peer['round_trip']) for peer in peers_in(text)] == [
        ('10.0.0.9', True, 0.01), ('10.0.0.9', False, None)]


def test_a_problem_is_a_warning() -> None:
    remarked = transport_status(TransportStats([], 0, {}, None, ['the buffer is short']))
    assert (remarked.level, remarked.message) == (WARN, 'the buffer is short')
    status = transport_status(TransportStats([], 0, {}, '10.0.0.7:17001 does not answer'))
    assert (status.level, status.message) == (WARN, '10.0.0.7:17001 does not answer')
    assert status.values == {'connected to': 'nobody', 'handshakes': 0, 'dropped': 0}


def test_requests_that_are_refused_are_a_warning_for_a_while() -> None:
    monitor = RequestMonitor()
    assert monitor.update({}, 0.0)[2:4] == (OK, 'fine')
    status = monitor.update({'address': 2, 'datagram size': 1}, 1.0)
    assert (status.level, status.message) == (WARN, 'requests refused: 2 address, 1 datagram size')
    assert status.values == {'refused requests': 3, 'refused, address': 2, 'refused, datagram size': 1}
    for now in range(2, 20):
        status = monitor.update({'address': 2, 'datagram size': 1}, float(now))
    assert (status.level, status.values['refused requests']) == (OK, 3)
    assert monitor.update({'address': 3, 'datagram size': 1}, 20.0).message == 'requests refused: 1 address'
