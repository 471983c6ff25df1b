# SPDX-License-Identifier: BSD-3-Clause
"""The demo with several robots: starts simulated robots with a master each, and the desk that operates them.

Parameters: DEMO_ROBOTS in nodes/parameters.py.

The desk's master is that of this node. Robot ugv1 differs from the others by its seed only.
"""
import os
import pathlib
import socket
import tempfile
import time
from typing import Any, Dict, List, Mapping

import rosgraph
import rospy

from .. import udpros
from ..link.keys import make_key
from ..nodes.common import Parameters
from ..nodes.launches import Launch, end_all, end_own_launch, keep_all
from ..nodes.operator_desk import LAUNCH, QUIET
from ..nodes.parameters import DEMO_ROBOTS

ROBOT_LAUNCH = ('roslaunch', *QUIET, 'smokebot_udp', 'simulated_robot.launch')


def free_port(kind: int) -> int:
    """A port that nobody uses now.

    :param kind: socket.SOCK_STREAM or SOCK_DGRAM
    """
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(('', 0))
        return int(probe.getsockname()[1])


def robots_yaml(ports: Mapping[str, int], key_file: str) -> str:
    """The text of a robots.yaml.

    :param ports: {name of a robot: its link_port on this machine}
    :param key_file: of all robots
    """
    return ''.join('%s: {host: 127.0.0.1, port: %d, key_file: %s}\n' % (name, port, key_file)
                   for name, port in ports.items())


def picture_of(robot: str, path: str) -> str:
    """The file of a robot's images: demo_ugv1.png where `path` is demo.png; an empty one stays empty."""
    stem, extension = os.path.splitext(path)
    return '%s_%s%s' % (stem, robot, extension) if path else ''


def _arguments(values: Mapping[str, Any]) -> List[str]:
    """Arguments of roslaunch, those that are not empty."""
    return ['%s:=%s' % (name, str(value).lower() if isinstance(value, bool) else value)
            for name, value in values.items() if value != '']


class Demo:
    """The launches of a demo.

    :param values: {name: value} of DEMO_ROBOTS
    :param folder: for the robots.yaml and the key of all links: without one, nobody could drive
    """

    def __init__(self, values: Mapping[str, Any], folder: str) -> None:
        self._seconds = values['seconds']
        ports = {'ugv%d' % (number + 1): free_port(socket.SOCK_DGRAM) for number in range(values['robots'])}
        robots_file, self._key_file = pathlib.Path(folder, 'robots.yaml'), os.path.join(folder, 'demo.key')
        make_key(self._key_file)
        robots_file.write_text(robots_yaml(ports, os.path.basename(self._key_file)))
        self._desk = Launch('the desk', [*LAUNCH, *_arguments({
            'robots': robots_file, 'streams': values['streams_file'], 'rviz': values['rviz'], 'loss': values['loss']})])
        self._robots = [self._robot(name, port, values['seed'] + number, values)
                        for number, (name, port) in enumerate(ports.items())]

    def _robot(self, name: str, port: int, seed: int, values: Mapping[str, Any]) -> Launch:
        report: Dict[str, Any] = {'seconds': values['seconds'], 'picture': picture_of(name, values['picture']),
                                  'operator': name, 'frame_prefix': name + '/',
                                  'operator_master': rosgraph.get_master_uri()}
        master_port = free_port(socket.SOCK_STREAM)
        return Launch("robot '%s'" % name, [*ROBOT_LAUNCH, '-p', str(master_port), *_arguments({
            'streams': values['streams_file'], 'adapt': values['adapt'], 'max_rate': values['max_rate'],
            'link_port': port, 'key_file': self._key_file, 'loss': values['loss'], 'seed': seed, **report})],
            {'ROS_MASTER_URI': 'http://localhost:%d' % master_port})

    def run(self) -> None:
        """Return when all robots have reported, or this node shuts down."""
        try:
            if self._seconds:
                for robot in self._robots:
                    robot.start(time.monotonic())
                keep_all([self._desk], self._is_over)
            else:
                keep_all([self._desk, *self._robots], rospy.is_shutdown)
        finally:
            end_all(self._robots)

    def _is_over(self) -> bool:
        return rospy.is_shutdown() or not any(robot.running for robot in self._robots)


def main() -> None:
    udpros.init_node('demo_robots')
    parameters = Parameters(DEMO_ROBOTS)
    with tempfile.TemporaryDirectory(prefix='demo_robots_') as folder:
        Demo({name: parameters[name] for name in DEMO_ROBOTS}, folder).run()
    end_own_launch()
