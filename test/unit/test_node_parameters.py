# SPDX-License-Identifier: BSD-3-Clause
"""The nodes' private parameters."""
import pathlib
from typing import Any, List, Tuple

import pytest

from smokebot_udp.mission.parameters import Table
from smokebot_udp.nodes import parameters as tables
from smokebot_udp.nodes.common import Parameters, read_file, read_streams

TABLES = {'robot_sender': tables.ROBOT_SENDER, 'operator_receiver': tables.OPERATOR_RECEIVER,
          'operator_desk': tables.OPERATOR_DESK,
          'simulated_robot': tables.SIMULATED_ROBOT, 'demo_report': tables.DEMO_REPORT,
          'demo_robots': tables.DEMO_ROBOTS}


def node(monkeypatch: Any, table: Table, found: Any) -> Tuple[Parameters, List[str]]:
    """The parameters of a node, with what the parameter server has, and the problems that are reported."""
    monkeypatch.setattr('rospy.get_param', lambda name, default: default if found is None else found)
    monkeypatch.setattr('rospy.resolve_name', lambda name: name.replace('~', '/node/'))
    problems: List[str] = []
    return Parameters(table, problems.append), problems


@pytest.mark.parametrize('name', TABLES)
def test_every_default_is_allowed_and_every_parameter_explained(name: str) -> None:
    for parameter in TABLES[name].values():
        assert parameter.check(parameter.default) == parameter.default
        assert parameter.meaning


@pytest.mark.parametrize('found', [None, {}, 5])
def test_without_any_the_defaults_are_used(monkeypatch: Any, found: Any) -> None:
    parameters, problems = node(monkeypatch, tables.ROBOT_SENDER, found)
    assert (parameters['max_datagram_size'], parameters['max_rate'], parameters['adapt']) == (1472, 50.0, True)
    assert not problems


def test_values_come_in_their_type(monkeypatch: Any) -> None:
    parameters, problems = node(monkeypatch, tables.OPERATOR_RECEIVER, {
        'max_datagram_size': 1400.0, 'loss': 1, 'odom_topic': '/odom', 'thermal': {'fill': 'nearest'}})
    size, loss = parameters['max_datagram_size'], parameters['loss']
    assert (size, loss, parameters['odom_topic']) == (1400, 1.0, '/odom')
    assert type(size) is int and type(loss) is float and not problems


@pytest.mark.parametrize('name, value, problem', [
    ('max_datagram_size', 100, '/node/max_datagram_size is 100, must be a whole number from 256 to 65507 [byte]: '
                               '1472 is used'),
    ('max_datagram_size', 1400.5, '/node/max_datagram_size is 1400.5, must be a whole number from 256 to 65507 '
                                  '[byte]: 1472 is used'),
    ('max_rate', 'fast', "/node/max_rate is 'fast', must be a number from 0 [Mbit/s]: 50.0 is used"),
    ('min_rate', float('nan'), '/node/min_rate is nan, must be a number from 0.01 [Mbit/s]: 0.1 is used'),
    ('adapt', 1, '/node/adapt is 1, must be true or false: True is used'),
    ('streams_file', 7, "/node/streams_file is 7, must be a text: '' is used")])
def test_a_wrong_value_is_reported_and_the_default_used(monkeypatch: Any, name: str, value: Any, problem: str) -> None:
    parameters, problems = node(monkeypatch, tables.ROBOT_SENDER, {name: value})
    assert parameters[name] == tables.ROBOT_SENDER[name].default
    assert problems == [problem]


def test_what_is_wrong_in_a_file_is_reported_with_its_path(monkeypatch: Any, tmp_path: pathlib.Path) -> None:
    path = tmp_path / 'streams.yaml'
    path.write_text('streams:\n  state: {type: relay, reliable: true, robot_topic: a, operator_topic: b,'
                    ' message_type: std_msgs/String, rate: 5}\n'
                    '  map: 7\n')
    warnings: List[str] = []
    monkeypatch.setattr('rospy.logwarn', lambda text, *args: warnings.append(text % args))
    parameters, problems = node(monkeypatch, tables.ROBOT_SENDER, {'streams_file': str(path)})
    assert list(read_streams(parameters)) == ['state', 'link', 'status']
    assert problems == ["%s: stream 'map': its settings are 7, not names with values" % path]
    assert warnings == ["%s: stream 'state': rate is not used: a reliable relay sends every message" % path]
    parameters, problems = node(monkeypatch, tables.ROBOT_SENDER, {'focus_file': str(tmp_path / 'none.yaml')})
    assert read_file(parameters, 'focus_file', 'focus.yaml', lambda text, warn: ({}, [])) == {}
    assert len(problems) == 1 and 'it cannot be read' in problems[0]
