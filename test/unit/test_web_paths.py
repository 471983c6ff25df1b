# SPDX-License-Identifier: BSD-3-Clause
"""The paths between a desk and a robot that the page shows."""
from typing import Any, Dict, List, Optional

import pytest

from smokebot_udp.monitoring.wifi_texts import Route
from smokebot_udp.nodes.route import route_to
from smokebot_udp.web.paths import MAX_PATHS, paths_of


def route(host: str) -> Route:
    return Route('10.0.0.5', 'wlan0') if host.startswith('10.') else Route('', '')


def operator(peers: Optional[List[Dict[str, Any]]]) -> Dict[str, Any]:
    return {'node': '/op', 'transport': None if peers is None else {'peers': peers}}


def connection(side: str, peer: Optional[str], address: Optional[str]) -> Dict[str, Any]:
    return {'side': side, 'peer': peer, 'address': address}


def test_the_robot_of_a_link_of_two_masters() -> None:
    peer = {'name': '/robot_sender@ugv', 'host': '10.0.0.7', 'port': 17001, 'interface': '',
            'round_trip': 0.031, 'used': True}
    other = {'name': '/robot_sender@ugv', 'host': '192.168.1.7', 'port': 17001, 'interface': '',
             'round_trip': None, 'used': False}
    tree = {'operators': [operator([peer, other])],
            'connections': [connection('operator', '/robot_sender@ugv', '10.0.0.7:17001')]}
    assert paths_of(tree, route) == [
        {'name': '/robot_sender@ugv', 'address': '10.0.0.7:17001', 'own_address': '10.0.0.5', 'interface': 'wlan0',
         'round_trip': 0.031, 'used': True},
        {'name': '/robot_sender@ugv', 'address': '192.168.1.7:17001', 'own_address': '', 'interface': '',
         'round_trip': None, 'used': False}]


def test_the_streams_of_a_shared_master_have_one_path() -> None:
    tree = {'operators': [operator(None)], 'connections': [
        connection('operator', '/robot_sender', '10.0.0.7:40001'),
        connection('operator', '/robot_sender', '10.0.0.7:40002'),
        connection('robot', '/op', '10.0.0.5:40003'), connection('operator', None, None)]}
    assert paths_of(tree, route) == [{'name': '/robot_sender', 'address': '10.0.0.7', 'own_address': '10.0.0.5',
                                      'interface': 'wlan0', 'round_trip': None, 'used': True}]


def test_they_are_few_and_their_names_short_and_harmless() -> None:
    peers = [{'name': '/\x1b' + 1000 * 'x', 'host': '10.0.0.%d' % number, 'port': 1, 'interface': '',
              'round_trip': None, 'used': True} for number in range(2 * MAX_PATHS)]
    tree = {'operators': [operator(peers)]}
    paths = paths_of(tree, route)
    assert len(paths) == MAX_PATHS and paths[0]['name'] == '/?' + 98 * 'x'
    assert paths_of({}, route) == paths_of({'operators': [operator([])], 'connections': []}, route) == []


@pytest.mark.parametrize('host', ['', 'robot.example', '10.0.0', '::1', '255.255.255.255'])
def test_there_is_no_route_to_what_is_no_address(host: str) -> None:
    assert route_to(host) == Route('', '')


def test_the_route_to_this_machine() -> None:
    assert route_to('127.0.0.1') == Route('127.0.0.1', 'lo')
