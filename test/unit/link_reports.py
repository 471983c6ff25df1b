# SPDX-License-Identifier: BSD-3-Clause
"""Boards with reports of nodes, for tests of what shows them."""
from typing import Any, Dict

from smokebot_udp.monitoring.link_board import Board
from smokebot_udp.monitoring.status import Status


def report(kind: str, node: str, side: str, level: int = 0, message: str = 'fine', name: str = '',
           **values: Any) -> Status:
    return Status(kind, name or kind, level, message, {key: str(value) for key, value in values.items()}, side, node)


def stream(node: str, side: str, name: str = 'thermal', level: int = 0, message: str = 'fine',
           **values: float) -> Status:
    return report('stream', node, side, level, message, name, stream=name, topic='/' + name, **values)


SOURCE: Dict[str, float] = {'rate in [Hz]': 30.0, 'rate out [Hz]': 10.0, 'bytes/s': 512000.0}
SHOWN: Dict[str, float] = {'rate in [Hz]': 9.9, 'rate out [Hz]': 9.8, 'loss [%]': 12.5, 'completeness [%]': 87.5,
                           'age p50 [ms]': 123.0, 'age p99 [ms]': 456.0, 'bytes/s': 400000.0}
LINK: Dict[str, Any] = {
    'state': 'as /op reports', 'rate [Mbit/s]': 5.0, 'sent [Mbit/s]': 4.4, 'wanted [Mbit/s]': 77.0,
    'capacity [Mbit/s]': 'nan', 'loss [%]': 5.0, 'queue delay [ms]': 14.0, 'round trip [ms]': 'inf'}
WIFI: Dict[str, Any] = {'wifi': 'wlan0', 'ssid': 'net', 'signal [dBm]': -60.0, 'noise [dBm]': 'nan',
                        'tx bitrate [Mbit/s]': 65.0, 'rx bitrate [Mbit/s]': 6.5, 'retries [1/s]': 12.0}


def board(now: float = 0.0, robot: str = '/robot_sender') -> Board:
    """A robot, an operator that receives from it, a robot alone, and a command."""
    made = Board()
    made.add([report('link', robot, 'robot', **LINK), report('wifi', robot, 'robot', **WIFI),
              report('control', robot, 'robot', 1, 'emergency stop', control='EMERGENCY STOP'),
              stream(robot, 'robot', **SOURCE),
              stream(robot, 'robot', 'cmd_vel', direction='to the robot', **{'rate in [Hz]': 5.0})], now)
    made.add([report('clock', '/op', 'operator', jumps=0, **{'offset [ms]': -12.0, 'uncertainty [ms]': 1.5}),
              report('wifi', '/op', 'operator', wifi='-'), stream('/op', 'operator', level=1, message='old', **SHOWN),
              report('connection', '/op', 'operator', stream='thermal', peer=robot, address='10.0.0.7:4000',
                     datagrams=12, **{'loss [%]': 50.0})], now)
    made.add([stream('/alone', 'robot', **SOURCE)], now)
    return made
