# SPDX-License-Identifier: BSD-3-Clause
import json
from typing import Any, Dict

from hypothesis import given
from hypothesis import strategies as st
from link_reports import board, report

from smokebot_udp.monitoring.link_board import STALE_AFTER, Board
from smokebot_udp.monitoring.link_snapshot import snapshot
from smokebot_udp.monitoring.link_table import render
from smokebot_udp.monitoring.status import Kind


def test_robots_and_operators_are_apart() -> None:
    tree = snapshot(board(), 0.5)
    alone, robot = tree['robots']
    assert tree['last_report_age'] == 0.5
    assert (alone['node'], alone['link'], alone['wifi'], alone['control']) == ('/alone', None, None, None)
    assert (robot['node'], robot['level'], robot['problems'], robot['control']) == (
        '/robot_sender', 'WARN', ['emergency stop'], 'EMERGENCY STOP')
    assert robot['link'] == {'state': 'as /op reports', 'rate_mbit': 5.0, 'sent_mbit': 4.4, 'wanted_mbit': 77.0,
                             'capacity_mbit': None, 'loss': 0.05, 'queue_delay': 0.014, 'round_trip': None,
                             'paths': {}}
    assert robot['wifi'] == {
        'interface': 'wlan0', 'ssid': 'net', 'signal_dbm': -60.0, 'noise_dbm': None, 'tx_bitrate_mbit': 65.0,
        'rx_bitrate_mbit': 6.5, 'retries': 12.0, 'failed': None, 'beacon_loss': None}
    operator, = tree['operators']
    assert operator == {'node': '/op', 'level': 'WARN', 'problems': [], 'wifi': None, 'control': None,
                        'transport': None, 'receives_from': ['/robot_sender'],
                        'clock': {'offset': -0.012, 'uncertainty': 0.0015, 'round_trip': None}}


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
        'node': '/op', 'side': 'operator', 'level': 'OK', 'problems': [], 'stream': 'thermal', 'peer': '/robot_sender',
        'address': '10.0.0.7:4000', 'datagrams': 12.0, 'loss': 0.5, 'bytes_per_second': None, 'kernel_drops': None}]


def test_one_operator_alone() -> None:
    tree = snapshot(board(), 0.5, 'op')
    assert [robot['node'] for robot in tree['robots']] == ['/robot_sender']
    assert snapshot(board(), 0.5, 'nobody')['operators'] == []


def test_old_numbers_are_unknown() -> None:
    tree = snapshot(board(), STALE_AFTER + 1)
    assert {robot['level'] for robot in tree['robots']} == {'STALE'} and tree['robots'][1]['link'] is None
    numbers = [value for stream in tree['streams'] for name, value in stream.items()
               if name not in ('robots', 'operator', 'stream', 'to_robot', 'level', 'problems')]
    assert set(numbers) == {None}


def test_nothing_reported() -> None:
    assert snapshot(Board(), 0.0) == {'last_report_age': None, 'robots': [], 'operators': [], 'streams': [],
                                      'connections': [], 'statuses': []}


def test_the_statuses_of_nodes_as_a_whole() -> None:
    tree = snapshot(board(), 0.5)
    assert [(status['node'], status['kind'], status['level']) for status in tree['statuses']] == [
        ('/op', 'clock', 'OK'), ('/op', 'wifi', 'OK'), ('/robot_sender', 'link', 'OK'), ('/robot_sender', 'wifi', 'OK'),
        ('/robot_sender', 'control', 'WARN')]
    assert tree['statuses'][-1] == {
        'node': '/robot_sender', 'side': 'robot', 'level': 'WARN', 'problems': ['emergency stop'], 'kind': 'control',
        'name': 'control', 'message': 'emergency stop'}


def test_the_transport() -> None:
    made = Board()
    made.add([report('transport', '/op', 'operator', handshakes=2, dropped=12, **{
        'connected to': 'nobody', 'dropped, replayed': 12})], 0.0)
    assert snapshot(made, 0.0)['operators'][0]['transport'] == {
        'connected_to': 'nobody', 'peers': [], 'handshakes': 2.0, 'dropped': 12.0,
        'dropped_by_reason': {'replayed': 12.0}}


KINDS = st.sampled_from([kind for name, kind in vars(Kind).items() if name.isupper()]) | st.text(max_size=3)


@given(KINDS, st.dictionaries(st.sampled_from([
    'wifi', 'state', 'jumps', 'peer', 'control', 'stream', 'topic', 'signal [dBm]', 'loss [%]', 'offset [ms]',
    'rate in [Hz]']), st.text(max_size=8)))
def test_every_tree_is_json_and_a_table(kind: str, values: Dict[str, Any]) -> None:
    made = Board()
    made.add([report(kind, '/n', side, 2, 'x', **values) for side in ('robot', 'operator')], 0.0)
    made.add([report(kind, '/m', 'robot', 9 % 4, 'x', **values)], 0.0)
    tree = snapshot(made, 0.0)
    json.dumps(tree, allow_nan=False)
    assert len(render(tree)) > 1
