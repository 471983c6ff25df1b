# SPDX-License-Identifier: BSD-3-Clause
"""Topics and services that clash, or make a loop, in either direction."""
from typing import List, Sequence

import pytest

from smokebot_udp.streams import config

CMD_VEL = 'cmd_vel: {type: command, message_type: geometry_msgs/Twist, operator_topic: /operator/cmd_vel, ' \
    'robot_topic: /cmd_vel}'
COUNT = 'count: {type: service, service_type: std_srvs/Trigger, robot_service: /count, ' \
    'operator_service: /operator/count}'
MOVE = 'move: {type: action, action_type: move_base_msgs/MoveBaseAction, robot_action: /move_base, ' \
    'operator_action: /operator/move_base}'

MAP = 'map: {type: grid, robot_topic: /map, operator_topic: operator/map, publish_updates: true}'


def command(name: str, operator: str, robot: str, type_: str = 'geometry_msgs/Twist') -> str:
    return '%s: {type: command, message_type: %s, operator_topic: %s, robot_topic: %s}' % (name, type_, operator, robot)


def relay(name: str, robot: str, operator: str, type_: str = 'geometry_msgs/Twist') -> str:
    return '%s: {type: relay, message_type: %s, robot_topic: %s, operator_topic: %s}' % (name, type_, robot, operator)


def service(name: str, operator: str, robot: str, type_: str = 'std_srvs/Trigger') -> str:
    return '%s: {type: service, service_type: %s, operator_service: %s, robot_service: %s}' % (
        name, type_, operator, robot)


def problems_of(streams: Sequence[str]) -> List[str]:
    return config.load('streams:\n' + ''.join('  %s\n' % stream for stream in streams))[1]


@pytest.mark.parametrize('streams, problem', [
    # a loop of one stream
    ([command('a', '/x', '/x')], "stream 'a': robot_topic and operator_topic are both /x: the stream would send again "
     'and again what it publishes itself'),
    ([command('a', '//x/', '/x')], "stream 'a': robot_topic and operator_topic are both /x: the stream would send "
     'again and again what it publishes itself'),
    ([service('a', '/x', '/x')], "stream 'a': robot_service and operator_service are both /x: the service would call "
     'itself'),
    ([MOVE.replace('/operator/move_base', '/move_base')], "stream 'move': robot_action and operator_action are both "
     '/move_base/goal: the stream would send again and again what it publishes itself'),
    # a loop of several
    ([CMD_VEL, relay('echo', '/cmd_vel', '/operator/cmd_vel')], "stream 'echo': what it sends would come back to it by "
     "way of stream 'cmd_vel', again and again"),
    ([CMD_VEL, relay('echo', '/cmd_vel', 'operator/cmd_vel')], "stream 'echo': what it sends would come back to it by "
     "way of stream 'cmd_vel', again and again"),
    ([relay('one', '/a', '/b'), relay('two', '/b', '/a')], "stream 'two': what it sends would come back to it by way "
     "of stream 'one', again and again"),
    ([CMD_VEL, relay('one', '/cmd_vel', '/b'), command('two', '/b', '/c'), relay('three', '/c', '/operator/cmd_vel')],
     "stream 'three': what it sends would come back to it by way of stream 'two', again and again"),
    ([service('a', '/x', '/y'), service('b', '/y', '/x')], "stream 'b': what it sends would come back to it by way of "
     "stream 'a', again and again"),
    ([MOVE, relay('echo', '/move_base/goal', '/operator/move_base/goal', 'move_base_msgs/MoveBaseActionGoal')],
     "stream 'echo': what it sends would come back to it by way of stream 'move', again and again"),
    # a name that is published or served twice
    ([CMD_VEL, command('joy', '/operator/joy_vel', '/cmd_vel')], "stream 'joy': robot_topic /cmd_vel is already the "
     "robot_topic of stream 'cmd_vel'"),
    ([COUNT, service('more', 'operator/count', '/more')], "stream 'more': operator_service operator/count is already "
     "the operator_service of stream 'count'"),
    ([MOVE, relay('status', '/s', '/operator/move_base/status', 'actionlib_msgs/GoalStatusArray')],
     "stream 'status': operator_topic /operator/move_base/status is already the operator_action of stream 'move'"),
    ([command('c', '/o', '/move_base/cancel', 'actionlib_msgs/GoalID'), MOVE], "stream 'move': robot_action "
     "/move_base/cancel is already the robot_topic of stream 'c'"),
    # updates of a map
    ([MAP, relay('raw', '/raw_updates', '/operator/map_updates', 'map_msgs/OccupancyGridUpdate')], "stream 'raw': "
     "operator_topic /operator/map_updates is already the operator_topic of stream 'map'"),
    # different types
    ([CMD_VEL, relay('echo', '/cmd_vel', '/operator/echo', 'geometry_msgs/TwistStamped')], "stream 'echo': robot_topic "
     "/cmd_vel must be geometry_msgs/TwistStamped, but geometry_msgs/Twist for stream 'cmd_vel'"),
    ([CMD_VEL, command('b', 'operator/cmd_vel', '/b', 'sensor_msgs/Joy')], "stream 'b': operator_topic "
     "operator/cmd_vel must be sensor_msgs/Joy, but geometry_msgs/Twist for stream 'cmd_vel'"),
    ([COUNT, service('more', '/more', '/count', 'std_srvs/Empty')], "stream 'more': robot_service /count must be "
     "std_srvs/Empty, but std_srvs/Trigger for stream 'count'")])
def test_the_last_stream_of_a_clash_is_refused(streams: List[str], problem: str) -> None:
    assert problems_of(streams) == [problem]
    assert not streams[:-1] or not problems_of(streams[:-1])


@pytest.mark.parametrize('streams', [
    [CMD_VEL, relay('echo', '/cmd_vel', '/operator/cmd_vel_in_force')],
    [CMD_VEL, command('arm', '/operator/cmd_vel', '/arm/cmd_vel')],
    [COUNT, service('again', '/operator/again', '/count')],
    [COUNT, command('count_topic', '/operator/count', '/count')],
    [MOVE, relay('status', '/move_base/status', '/operator/status_copy', 'actionlib_msgs/GoalStatusArray')],
    [command('a', 'cmd_vel', 'cmd_vel')],
    [service('a', 'count', 'count')],
    [relay('one', '/a', '/b'), relay('two', '/b', '/c'), command('three', '/c', '/d')]])
def test_what_only_looks_alike_is_accepted(streams: List[str]) -> None:
    assert not problems_of(streams)


def test_a_refused_stream_keeps_no_name() -> None:
    streams = [CMD_VEL.replace('/cmd_vel}', '/cmd_vel, rate: 0}'), command('joy', '/operator/joy_vel', '/cmd_vel')]
    assert len(problems_of(streams)) == 1
