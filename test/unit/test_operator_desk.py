# SPDX-License-Identifier: BSD-3-Clause
"""The command for each robot of a desk; integration/operator_desk.test runs them."""
import pathlib
from typing import Any
from xml.etree import ElementTree

import pytest
import roslaunch

from smokebot_udp.mission.robots import load
from smokebot_udp.nodes.operator_desk import PASSED_ON, operator_launch

DESK = {'robots_file': '/crew/robots.yaml', 'streams_file': '/crew/streams.yaml', 'rviz': False,
        'max_datagram_size': 1392, 'loss': 0.0, 'dscp': False, 'record': True, 'record_streams': 'camera,odom',
        'record_lossless': False, 'record_image_rate': 2.5, 'record_dir': '/crew/bags', 'record_split_mb': 64,
        'record_max_mb': 256}
PACKAGE = pathlib.Path(__file__).resolve().parents[2]
CONFIG = PACKAGE / 'config' / 'robots.yaml'


def arguments(line: str, **desk: Any) -> Any:
    robots, problems = load(line)
    assert problems == []
    command = operator_launch('ugv1', robots['ugv1'], {**DESK, **desk}, '/crew')
    assert command[:2] == ['roslaunch', '--wait'] and 'operator.launch' in command
    return dict(argument.split(':=') for argument in command if ':=' in argument)


def test_a_robot_has_the_settings_of_the_desk_and_its_own(monkeypatch: Any) -> None:
    monkeypatch.setenv('HOME', '/home/desk')
    assert arguments('ugv1: {host: 10.0.0.7, port: 17002}') == {
        'name': 'ugv1', 'robot': '10.0.0.7:17002', 'frame_prefix': 'ugv1/',
        'key_file': '/home/desk/.ros/smokebot_udp/ugv1.key', 'rviz': 'false', 'max_datagram_size': '1392',
        'loss': '0.0', 'dscp': 'false', 'streams': '/crew/streams.yaml', 'record': 'true',
        'record_streams': 'camera,odom', 'record_lossless': 'false', 'record_image_rate': '2.5',
        'record_dir': '/crew/bags', 'record_split_mb': '64', 'record_max_mb': '256'}


@pytest.mark.parametrize('path, expected', [
    ('ugv1.key', '/crew/ugv1.key'), ('/etc/ugv1.key', '/etc/ugv1.key'), ('~/ugv1.key', '/home/desk/ugv1.key')])
def test_relative_paths_begin_at_the_folder_of_the_file(path: str, expected: str, monkeypatch: Any) -> None:
    monkeypatch.setenv('HOME', '/home/desk')
    found = arguments('ugv1: {host: a, key_file: %s, streams: %s}' % (path, path))
    assert (found['key_file'], found['streams']) == (expected, expected)


def test_without_a_file_of_streams_it_is_the_default_of_the_launch_file() -> None:
    assert 'streams' not in arguments('ugv1: {host: a}', streams_file='')


def test_the_example_is_valid() -> None:
    assert load(CONFIG.read_text())[1] == []


@pytest.mark.parametrize('path, expected', [
    ('robots.yaml', '/crew/robots.yaml'), ('my desk/robots.yaml', '/crew/my desk/robots.yaml'),
    ('/etc/robots.yaml', '/etc/robots.yaml')])
@pytest.mark.parametrize('name', ['', 'crew'])
def test_the_launch_file_takes_a_relative_robots_yaml_from_the_folder_of_the_user(
        path: str, expected: str, name: str, monkeypatch: Any) -> None:
    monkeypatch.setenv('PWD', '/crew')
    config = roslaunch.config.ROSLaunchConfig()
    roslaunch.xmlloader.XmlLoader().load(str(PACKAGE / 'launch' / 'operator.launch'), config, verbose=False,
                                         argv=['robots:=' + path, 'name:=' + name])
    node, = config.nodes
    assert '_robots_file:="%s"' % expected in node.args
    assert [one for one in PASSED_ON if '_%s:=' % one not in node.args] == []


def test_a_desk_of_several_robots_records_as_one_of_a_single_robot_may() -> None:
    root = ElementTree.parse(str(PACKAGE / 'launch' / 'operator.launch')).getroot()
    names = {arg.get('name', '') for arg in root.iter('arg')}
    assert {name for name in names if name.startswith('record')} <= set(PASSED_ON)
