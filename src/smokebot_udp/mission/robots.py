# SPDX-License-Identifier: BSD-3-Clause
"""Reads robots.yaml: the robots of a desk by name, each with its own master.

    ugv1: {host: 10.0.0.7, key_file: /etc/smokebot/ugv1.key}
    ugv2: {host: ugv2.local, port: 17002, frame_prefix: second/, streams: my_streams.yaml}
    ugv3: {host: [10.0.0.8, 100.64.0.8]}

A robot that is wrong is left out and reported; the others are used.
"""
import re
from typing import Any, Dict, List, Mapping, Tuple

from .footprint import read_footprint
from .parameters import Parameter, check
from .yaml_text import read_yaml

NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*$')
HOST = re.compile(r'[A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9])?(%[^%\s/:,]+)?$')

ROBOT = {
    'host': Parameter(None, '', 'host name or IPv4 address of the robot; a list of one robot\'s: in order of '
                      'preference. With %NAME after it, an interface of the desk by which it is reached'),
    'port': Parameter(17001, '', "UDP port of the robot: its link_port", least=1, most=65535),
    'key_file': Parameter('', '', "file with a copy of the robot's key; empty: ~/.ros/smokebot_udp/NAME.key"),
    'frame_prefix': Parameter('', '', "goes before all frames of the robot; if it is missing: the robot's name and a "
                              'slash'),
    'footprint': Parameter('', 'm', 'outline of the robot, [[x, y], ...]; empty: the default of operator_receiver'),
    'streams': Parameter('', '', "file that defines the streams, the same as the robot's; empty: the desk's"),
}
"""What robots.yaml may set for a robot."""


def load(text: str) -> Tuple[Dict[str, Dict[str, Any]], List[str]]:
    """Read the text of a robots.yaml.

    :return: ({name: {setting: value}} of the good robots, [problem, ...] in words)
    """
    document, problems = read_yaml(text)
    if document is None and problems:
        return {}, problems
    if not isinstance(document, dict) or not document:
        return {}, problems + ['it has no robots: "ugv1: {host: 10.0.0.7}" is one']
    good: Dict[str, Dict[str, Any]] = {}
    for name, values in document.items():
        try:
            good[name] = _check(name, values, good)
        except ValueError as error:
            problems.append('robot %r: %s' % (name, error))
    return good, problems


def _check(name: Any, values: Any, others: Mapping[str, Mapping[str, Any]]) -> Dict[str, Any]:
    """The settings of a robot.

    :param others: {name: settings} of the robots before it
    :raises ValueError: where something is wrong
    """
    if not isinstance(name, str) or not NAME.match(name):
        raise ValueError('a name has letters, digits and _, and begins with a letter')
    if not isinstance(values, dict):
        raise ValueError('its settings are %r, not names with values' % (values,))
    if isinstance(values.get('footprint'), list):
        values = {**values, 'footprint': str(values['footprint'])}
    if isinstance(values.get('host'), list):
        values = {**values, 'host': ','.join(map(str, values['host']))}
    settings = check({'frame_prefix': name + '/', **values}, ROBOT)
    if settings['footprint']:
        read_footprint(settings['footprint'])
    for address in addresses(settings):
        _check_address(address, others)
    return settings


def _check_address(address: Tuple[str, int], others: Mapping[str, Mapping[str, Any]]) -> None:
    if not HOST.match(address[0]):
        raise ValueError('host is %r, must be a host name or an IPv4 address; its port is a setting of its own'
                         % address[0])
    for other, theirs in others.items():
        if _host_and_port(address) in map(_host_and_port, addresses(theirs)):
            raise ValueError("%s:%d is already robot '%s'" % (*_host_and_port(address), other))


def _host_and_port(address: Tuple[str, int]) -> Tuple[str, int]:
    """An address without the interface."""
    return address[0].partition('%')[0].lower(), address[1]


def addresses(settings: Mapping[str, Any]) -> List[Tuple[str, int]]:
    """The hosts and ports of a robot, in order of preference. A host may end with % and an interface of the desk.

    :param settings: one robot's in robots.yaml
    """
    return [(host, settings['port']) for host in settings['host'].split(',')]
