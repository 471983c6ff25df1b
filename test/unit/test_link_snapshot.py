# SPDX-License-Identifier: BSD-3-Clause
import json
from typing import Any, Dict

from hypothesis import given
from hypothesis import strategies as st
from link_reports import board, report

from smokebot_udp.monitoring.link_board import STALE_AFTER, Board
from smokebot_udp.monitoring.link_snapshot import Key, plotted, snapshot


def test_robots_and_operators_are_apart() -> None:
    tree = snapshot(board(), 0.5)
    alone, robot = tree['robots']
    assert tree['last_report_age'] == 0.5
    assert (alone['node'], alone['link'], alone['wifi'], alone['control']) == ('/alone', None, None, None)
    assert (robot['node'], robot['level'], robot['problems'], robot['control']) == (
        '/robot_sender', 'WARN', ['emergency stop'], 'EMERGENCY STOP')
    assert robot['link'] == {'state': 'as /op reports', 'rate_mbit': 5.0, 'sent_mbit': 4.4, 'wanted_mbit': 77.0,
                             'capacity_mbit': None, 'loss': 0.05, 'queue_delay': 0.014, 'round_trip': None}
    assert robot['wifi'] == {
        'interface': 'wlan0', 'ssid': 'net', 'signal_dbm': -60.0, 'noise_dbm': None, 'tx_bitrate_mbit': 65.0,
        'rx_bitrate_mbit': 6.5, 'retries': 12.0, 'failed': None, 'beacon_loss': None}
    operator, = tree['operators']
    assert operator == {'node': '/op', 'level': 'WARN', 'problems': [], 'wifi': None,
                        'receives_from': ['/robot_sender'], 'clock': {'offset': -0.012, 'uncertainty': 0.0015}}


def test_streams_have_the_values_of_both_sides() -> None:
    streams = {(stream['robots'][0], stream['stream']): stream for stream in snapshot(board(), 0.5)['streams']}
    assert streams['/robot_sender', 'thermal'] == {
        'robots': ['/robot_sender'], 'operator': '/op', 'stream': 'thermal', 'to_robot': False, 'level': 'WARN',
        'problems': ['operator: old'], 'source_hz': 30.0, 'sent_hz': 10.0, 'sent_at_most_hz': None,
        'received_hz': 9.9, 'shown_hz': 9.8, 'loss': 0.125, 'age_median': 0.123, 'age_p99': 0.456,
        'completeness': 0.875, 'error': None, 'bytes_per_second': 400000.0}
    command = streams['/robot_sender', 'cmd_vel']
    assert (command['to_robot'], command['source_hz'], command['received_hz']) == (True, None, 5.0)
    assert streams['/alone', 'thermal']['operator'] is None


def test_connections() -> None:
    assert snapshot(board(), 0.5)['connections'] == [{
        'node': '/op', 'level': 'OK', 'problems': [], 'stream': 'thermal', 'peer': '/robot_sender',
        'address': '10.0.0.7:4000', 'datagrams': 12.0, 'loss': 0.5, 'bytes_per_second': None, 'kernel_drops': None}]


def test_one_operator_alone() -> None:
    tree = snapshot(board(), 0.5, 'op')
    assert [robot['node'] for robot in tree['robots']] == ['/robot_sender']
    assert snapshot(board(), 0.5, 'nobody')['operators'] == []


def test_old_numbers_are_unknown() -> None:
    tree = snapshot(board(), STALE_AFTER + 1)
    assert {robot['level'] for robot in tree['robots']} == {'STALE'} and tree['robots'][1]['link'] is None
    assert all(number is None for number in plotted(tree).values())


def test_nothing_reported() -> None:
    assert snapshot(Board(), 0.0) == {'last_report_age': None, 'robots': [], 'operators': [], 'streams': [],
                                      'connections': []}


def test_what_is_plotted() -> None:
    numbers = plotted(snapshot(board(), 0.5))
    assert numbers[Key('robots', '/robot_sender', '', 'sent_mbit')] == 4.4
    assert numbers[Key('streams', '/op', 'thermal', 'age_median')] == 0.123
    assert numbers[Key('streams', '/alone', 'thermal', 'shown_hz')] is None


@given(st.dictionaries(st.sampled_from(['wifi', 'state', 'jumps', 'peer', 'control', 'stream', 'topic', 'signal [dBm]',
                                        'loss [%]', 'offset [ms]', 'rate in [Hz]']), st.text(max_size=8)))
def test_every_tree_is_json(values: Dict[str, Any]) -> None:
    made = Board()
    made.add([report('/n', side, 2, 'x', **{**values, 'peer': '/r'}) for side in ('robot', 'operator')], 0.0)
    made.add([report('/m', 'robot', 9 % 4, 'x', **values)], 0.0)
    json.dumps(snapshot(made, 0.0), allow_nan=False)
