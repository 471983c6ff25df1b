# SPDX-License-Identifier: BSD-3-Clause
"""Commands, services, actions and reliable relays in streams.yaml."""
from typing import Any, Dict, List, Tuple

import pytest
from geometry_msgs.msg import Twist, Vector3
from sensor_msgs.msg import Joy

from smokebot_udp.mission.control import MissionControl
from smokebot_udp.mission.focus import Profile
from smokebot_udp.mission.parameters import RELIABLE, kind_of
from smokebot_udp.mission.settings import SettingsStore
from smokebot_udp.streams import TYPES, classified, config, live_tables, tables
from smokebot_udp.streams.command.parameters import timeout_message

THERMAL = 'thermal: {type: image, robot_topic: /thermal/image_raw, operator_topic: /operator/thermal/image_raw}'
CMD_VEL = 'cmd_vel: {type: command, message_type: geometry_msgs/Twist, operator_topic: /operator/cmd_vel, ' \
    'robot_topic: /cmd_vel}'
COUNT = 'count: {type: service, service_type: std_srvs/Trigger, robot_service: /count, ' \
    'operator_service: /operator/count}'
MOVE = 'move: {type: action, action_type: move_base_msgs/MoveBaseAction, robot_action: /move_base, ' \
    'operator_action: /operator/move_base}'
GOAL = 'goal: {type: relay, message_type: geometry_msgs/PoseStamped, robot_topic: /move_base_simple/goal, ' \
    'operator_topic: /operator/goal, reliable: true, direction: to_robot}'
LOG = 'log: {type: relay, message_type: rosgraph_msgs/Log, robot_topic: /rosout_agg, ' \
    'operator_topic: /operator/rosout, reliable: true, level: warn}'


def load(*streams: str) -> Tuple[Dict[str, Any], List[str]]:
    """The good streams without the package's own, and the problems."""
    good, problems = config.load('streams:\n' + ''.join('  %s\n' % stream for stream in streams))
    return {name: settings for name, settings in good.items() if name not in config.OWN_STREAMS}, problems


def with_settings(stream: str, text: str) -> str:
    return '%s, %s}' % (stream[:-1], text)


def relay(name: str, robot: str, operator: str, type_: str = 'geometry_msgs/Twist', more: str = '') -> str:
    return '%s: {type: relay, message_type: %s, robot_topic: %s, operator_topic: %s%s}' % (
        name, type_, robot, operator, more)


def test_the_examples_of_all_types_have_their_defaults() -> None:
    streams, problems = load(THERMAL, CMD_VEL, COUNT, MOVE, GOAL, LOG)
    assert not problems and list(streams) == ['thermal', 'cmd_vel', 'count', 'move', 'goal', 'log']
    assert streams['cmd_vel'] == {
        'type': 'command', 'message_type': 'geometry_msgs/Twist', 'operator_topic': '/operator/cmd_vel',
        'robot_topic': '/cmd_vel', 'enabled': True, 'max_age': 0.3, 'timeout': 0.5, 'on_timeout': 'stop', 'rate': 20.0,
        'hold': 2.0, 'require_fresh': '', 'max_view_age': 1.0}
    assert streams['count'] == {
        'type': 'service', 'service_type': 'std_srvs/Trigger', 'robot_service': '/count',
        'operator_service': '/operator/count', 'timeout': 10.0}
    assert streams['move'] == {
        'type': 'action', 'action_type': 'move_base_msgs/MoveBaseAction', 'robot_action': '/move_base',
        'operator_action': '/operator/move_base', 'max_age': 5.0, 'feedback_rate': 10.0}
    assert [streams['goal'][name] for name in ('reliable', 'direction', 'max_age', 'max_messages', 'max_bytes', 'level')
            ] == [True, 'to_robot', 10.0, 1000, 1 << 20, '']
    assert (streams['log']['direction'], streams['log']['level']) == ('to_operator', 'warn')


def test_streams_are_divided_by_what_runs_them() -> None:
    good, _ = config.load('streams: {%s}' % ', '.join((LOG, CMD_VEL, THERMAL, MOVE, GOAL, COUNT)))
    found = classified(good)
    assert [list(part) for part in found] == [
        ['thermal', 'link', 'status'], ['cmd_vel'], ['count'], ['move'], ['log', 'goal']]
    assert found.commands['cmd_vel'] is good['cmd_vel']
    assert [kind_of(good[name]) for name in ('log', 'goal', 'link')] == [RELIABLE, RELIABLE, 'relay']


def test_every_type_has_settings_for_both_sides() -> None:
    for kind in TYPES:
        assert tables(kind).robot and tables(kind).operator


def test_what_may_change_while_it_runs() -> None:
    good, _ = load(CMD_VEL, COUNT, MOVE, GOAL)
    assert set(live_tables(good['cmd_vel']).robot) == {'enabled', 'max_age', 'timeout', 'rate', 'hold'}
    assert set(live_tables(good['cmd_vel']).operator) == {'max_view_age'}
    assert live_tables(good['count']) == live_tables(good['move']) == ({}, {})
    assert live_tables(good['goal']) == ({'enabled': tables('relay').robot['enabled']}, {})


@pytest.mark.parametrize('stream, problem', [
    (with_settings(CMD_VEL, 'max_age: 0'), "stream 'cmd_vel': max_age is 0, must be a number above 0 to 10 [s]"),
    (with_settings(CMD_VEL, 'timeout: -1'), "stream 'cmd_vel': timeout is -1, must be a number above 0 to 10 [s]"),
    (with_settings(CMD_VEL, 'weight: 2'), "stream 'cmd_vel': weight: no such setting; there are enabled, hold, "
     'max_age, max_view_age, message_type, on_timeout, operator_topic, rate, require_fresh, robot_topic, timeout, '
     'type'),
    (CMD_VEL.replace('Twist', 'Twirl'), "stream 'cmd_vel': message_type 'geometry_msgs/Twirl' is no message type that "
     'is installed here'),
    (COUNT.replace('Trigger', 'Triggers'), "stream 'count': service_type 'std_srvs/Triggers' is no service type that "
     'is installed here'),
    (COUNT.replace('robot_service: /count', 'latch: true'), "stream 'count': latch: no such setting; there are "
     'operator_service, robot_service, service_type, timeout, type'),
    (COUNT.replace('robot_service: /count, ', ''), "stream 'count': robot_service is missing: name of the service on "
     'the robot'),
    (MOVE.replace('BaseAction', 'BaseGoal'), "stream 'move': action_type 'move_base_msgs/MoveBaseGoal' is no action "
     'type, such as move_base_msgs/MoveBaseAction'),
    (GOAL.replace('reliable: true, ', ''), "stream 'goal': direction: to_robot needs reliable: true; what the robot "
     'obeys only while it is new, such as cmd_vel, is of type: command'),
    (GOAL.replace('to_robot', 'up'), "stream 'goal': direction is 'up', must be one of to_operator, to_robot"),
    (GOAL.replace('PoseStamped', 'PosedStamp'), "stream 'goal': message_type 'geometry_msgs/PosedStamp' is no message "
     'type that is installed here'),
    (with_settings(GOAL, 'level: warn'), "stream 'goal': level is 'warn': message_type must be rosgraph_msgs/Log, not "
     'geometry_msgs/PoseStamped'),
    (LOG.replace('reliable: true, ', ''), "stream 'log': level is 'warn': it needs reliable: true"),
    (with_settings(LOG.replace('reliable: true, level: warn', 'rate: 1'), 'newest: true'), "stream 'log': newest is "
     'True: it needs reliable: true'),
    (with_settings(LOG, 'newest: true, latch: true'), "stream 'log': newest and latch are both true: latch keeps one "
     'message, newest one of each publisher'),
    (with_settings(LOG, 'needs_control: true'), "stream 'log': needs_control is true: it needs direction: to_robot"),
    (LOG.replace('warn', 'warning'), "stream 'log': level is 'warning', must be one of '', debug, info, warn, "
     'error, fatal'),
    (with_settings(LOG, 'max_messages: 0'), "stream 'log': max_messages is 0, must be a whole number from 1 to "
     '100000')])
def test_a_wrong_setting_costs_its_stream_only(stream: str, problem: str) -> None:
    streams, problems = load(stream, THERMAL)
    assert list(streams) == ['thermal'] and problems == [problem]


def test_a_reliable_relay_warns_of_settings_that_it_does_not_use() -> None:
    warnings: List[str] = []
    log = with_settings(LOG, 'rate: 2, weight: 3, latch: true')
    good, problems = config.load('streams: {%s}' % log, warnings.append)
    assert not problems and good['log']['latch']
    assert warnings == ["stream 'log': rate is not used: a reliable relay sends every message",
                        "stream 'log': weight is not used: a reliable relay sends every message"]


def test_only_a_focus_that_names_it_changes_what_operators_send() -> None:
    good, _ = load(THERMAL, CMD_VEL, GOAL, LOG)
    stores = {name: SettingsStore(live_tables(settings).robot, settings) for name, settings in good.items()}
    profiles = {'standby': Profile('standby', '', {}, {'enabled': False}),
                'parked': Profile('parked', '', {'cmd_vel': {'enabled': False}}, {'enabled': False})}
    control = MissionControl(stores, profiles, pytest.fail, lambda focus: None, lambda: None)

    def enabled(focus: str) -> List[str]:
        control.switch(focus)
        return [name for name, store in stores.items() if store.current['enabled']]
    assert enabled('standby') == ['cmd_vel', 'goal', 'log'] and enabled('parked') == ['goal', 'log']
    assert control.warning('parked') is None


# on_timeout

def timeout_of(text: str, type_: str = 'geometry_msgs/Twist') -> Any:
    good, problems = load(with_settings(CMD_VEL.replace('geometry_msgs/Twist', type_), 'on_timeout: ' + text))
    assert not problems
    return timeout_message(good['cmd_vel'])


def test_on_timeout_is_a_message_of_the_type_or_none() -> None:
    assert timeout_of('stop') == timeout_of('{}') == Twist()
    assert timeout_of('nothing') is None
    assert timeout_of('{linear: {x: -0.1}, angular: {z: 1}}') == Twist(Vector3(-0.1, 0, 0), Vector3(0, 0, 1))
    assert timeout_of('{axes: [0.0, 0.5], buttons: [1]}', 'sensor_msgs/Joy') == Joy(axes=[0.0, 0.5], buttons=[1])


@pytest.mark.parametrize('value, problem', [
    ('brake', "on_timeout is 'brake', must be one of stop, nothing, or the fields of a message, such as "
              '{linear: {x: 0.0}}'),
    ('[0, 0]', 'on_timeout is [0, 0], must be one of stop, nothing, or the fields of a message'),
    ('false', 'on_timeout is False, must be one of stop, nothing'),
    ('{linear: {w: 1}}', "on_timeout is {'linear': {'w': 1}}, must be stop, nothing, or fields of a "
                         'geometry_msgs/Twist: No field name [linear.w]'),
    ('{linear: {x: fast}}', "on_timeout is {'linear': {'x': 'fast'}}, must be stop, nothing, or fields of a "
                            'geometry_msgs/Twist'),
    ('{linear: {x: [1]}}', 'must be stop, nothing, or fields of a geometry_msgs/Twist'),
    ('{linear: 5}', 'must be stop, nothing, or fields of a geometry_msgs/Twist'),
    ('{linear: {x: }}', 'must be stop, nothing, or fields of a geometry_msgs/Twist'),
    ('{linear: now}', 'must be stop, nothing, or fields of a geometry_msgs/Twist'),
    ('{7: 5}', 'must be stop, nothing, or fields of a geometry_msgs/Twist')])
def test_on_timeout_is_compared_with_the_type(value: str, problem: str) -> None:
    streams, problems = load(with_settings(CMD_VEL, 'on_timeout: ' + value), THERMAL)
    assert list(streams) == ['thermal'] and len(problems) == 1
    assert problems[0].startswith("stream 'cmd_vel': on_timeout is ") and problem in problems[0]


# require_fresh

@pytest.mark.parametrize('order', [(THERMAL, 0), (THERMAL, 1)])
def test_require_fresh_names_a_stream_before_or_after(order: Tuple[str, int]) -> None:
    streams = [with_settings(CMD_VEL, 'require_fresh: thermal')]
    streams.insert(order[1], order[0])
    good, problems = load(*streams)
    assert not problems and good['cmd_vel']['require_fresh'] == 'thermal'


@pytest.mark.parametrize('view, others', [
    ('camera', [THERMAL]), ('thermal', [with_settings(THERMAL, 'rate: -1')]), ('count', [COUNT]), ('cmd_vel', []),
    ('map', ['map: {type: grid, robot_topic: /map, operator_topic: /operator/map}']), ('log', [LOG]),
    ("'thermal, camera'", [THERMAL])])
def test_require_fresh_must_be_a_stream_with_an_age(view: str, others: List[str]) -> None:
    good, problems = load(with_settings(CMD_VEL, 'require_fresh: %s' % view), *others)
    assert 'cmd_vel' not in good
    assert problems[-1] == "stream 'cmd_vel': require_fresh is '%s', must be the name of a stream of type cloud, " \
        'image, scan, virtual_scan' % view.strip("'")
