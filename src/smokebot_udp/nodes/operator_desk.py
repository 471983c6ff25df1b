# SPDX-License-Identifier: BSD-3-Clause
"""The operators of several robots, each with its own master: starts one operator.launch for each robot of robots.yaml.

Parameters: OPERATOR_DESK in nodes/parameters.py.

An operator.launch that ends is started again. All end with this node.
"""
import os
from typing import Any, List, Mapping

import rospy

from .. import udpros
from ..link.keys import KEY_FOLDER
from ..mission import robots
from .common import Parameters, read_file
from .launches import Launch, keep_all
from .namesake import SECOND_OPERATOR, wait_until_free
from .parameters import OPERATOR_DESK

QUIET = ('--no-summary', '--disable-title', '--skip-log-check')
"""Options of roslaunch beneath another one."""

LAUNCH = ('roslaunch', '--wait', *QUIET, 'smokebot_udp', 'operator.launch')
"""It waits for the desk's master: otherwise it would start one of its own where that one is being restarted."""

PASSED_ON = ('rviz', 'max_datagram_size', 'loss', 'dscp', 'record', 'record_streams', 'record_lossless',
             'record_image_rate', 'record_dir', 'record_split_mb', 'record_max_mb')
"""Arguments of operator.launch that are the desk's."""


def operator_launch(name: str, robot: Mapping[str, Any], parameters: Mapping[str, Any], folder: str) -> List[str]:
    """The command that starts the operator of a robot.

    :param name: of the robot
    :param robot: its settings in robots.yaml
    :param parameters: of the desk
    :param folder: that relative paths of the robot's settings begin at
    """
    streams = _path(folder, robot['streams']) or parameters['streams_file']
    arguments = {
        'name': name, 'robot': ','.join('%s:%d' % address for address in robots.addresses(robot)),
        'frame_prefix': robot['frame_prefix'],
        'key_file': _path(folder, robot['key_file'] or '%s/%s.key' % (KEY_FOLDER, name)),
        **{one: parameters[one] for one in PASSED_ON},
        **({'streams': streams} if streams else {}),
        **({'footprint': robot['footprint']} if robot['footprint'] else {})}
    return [*LAUNCH, *('%s:=%s' % (argument, str(value).lower() if isinstance(value, bool) else value)
                       for argument, value in arguments.items())]


def _path(folder: str, path: str) -> str:
    """A path of robots.yaml as an absolute one; an empty one stays empty."""
    return os.path.join(folder, os.path.expanduser(path)) if path else ''


def main() -> None:
    udpros.race_all_connections()
    wait_until_free('operator_desk', SECOND_OPERATOR)
    udpros.init_node('operator_desk')
    parameters = Parameters(OPERATOR_DESK)
    values = {name: parameters[name] for name in OPERATOR_DESK}
    found = read_file(parameters, 'robots_file', 'robots.yaml', lambda text, warn: robots.load(text))
    folder = os.path.dirname(os.path.abspath(values['robots_file']))
    rospy.loginfo('operator_desk: %s', ', '.join(found) or 'nothing to do: no robot is valid')
    keep_all([Launch("operator.launch of robot '%s'" % name, operator_launch(name, robot, values, folder))
              for name, robot in found.items()], rospy.is_shutdown)
