# SPDX-License-Identifier: BSD-3-Clause
"""Which topics the black box records, and what its bags are called."""
import json
from typing import Dict

import pytest

from smokebot_udp.nodes.black_box import bag_prefix, description
from smokebot_udp.streams.config import load
from smokebot_udp.streams.recorded_topics import RecordedStream, all_topics, recorded_streams

TEXT = """
streams:
  camera: {type: image, robot_topic: /camera, operator_topic: /operator/camera, view_topic: /operator/view}
  scan: {type: virtual_scan, robot_topic: /points, operator_topic: /operator/scan, select: obstacle}
  lidar: {type: cloud, robot_topic: /points, operator_topic: /operator/points}
  cmd_vel: {type: command, message_type: geometry_msgs/Twist, robot_topic: /cmd, operator_topic: /operator/cmd}
  lamp: {type: service, service_type: std_srvs/SetBool, robot_service: /lamp, operator_service: /operator/lamp}
  move: {type: action, action_type: move_base_msgs/MoveBaseAction, robot_action: /move, operator_action: /operator/move}
"""
def recorded(side: str) -> Dict[str, RecordedStream]:
    definitions, problems = load(TEXT)
    assert not problems
    return recorded_streams(definitions, side, lambda name: resolve(side, name))


def resolve(side: str, name: str) -> str:
    """As the nodes /robot_sender and /desk/operator_receiver do."""
    if side == 'robot':
        return name.replace('~', '/robot_sender/')
    return name.replace('~', '/desk/operator_receiver/') if name[0] == '~' else '/desk/' + name.lstrip('/')


MOVE = ['cancel', 'feedback', 'goal', 'result', 'status']


@pytest.mark.parametrize('side, expected', [
    ('robot', {'/camera', '/points', '/cmd', *('/move/' + part for part in MOVE), '/robot_sender/link',
               '/robot_sender/status', '/robot_sender/estop', '/robot_sender/focus/modified', '/tf', '/tf_static'}),
    ('operator', {*('/desk/operator/' + name for name in (
        'camera', 'points', 'scan', 'cmd', 'link', 'status', 'control', 'estop', 'estop_release', 'stale')),
                  *('/desk/operator/move/' + part for part in MOVE), '/desk/operator_receiver/clock_offset'})])
def test_all_topics_of_a_side_once(side: str, expected: set) -> None:
    topics = all_topics(recorded(side), side, lambda name: resolve(side, name))
    assert len(topics) == len(set(topics)) and set(topics) == expected


def test_streams_by_direction() -> None:
    found = recorded('robot')
    assert 'lamp' not in found      # a service has no topics
    assert {name: stream.to_robot for name, stream in found.items()} == {
        'camera': False, 'scan': False, 'lidar': False, 'cmd_vel': True, 'move': False, 'link': False, 'status': False}
    assert found['scan'] == RecordedStream('virtual_scan', False, ['/points'])


@pytest.mark.parametrize('side, namespace, prefix', [
    ('robot', '/', 'black_box_robot'), ('operator', '/', 'black_box_operator'),
    ('operator', '/desk2/', 'black_box_operator_desk2'), ('operator', '/crew/desk2/', 'black_box_operator_crew_desk2')])
def test_the_name_of_the_bags(side: str, namespace: str, prefix: str) -> None:
    assert bag_prefix(side, namespace) == prefix


def test_a_bag_describes_itself() -> None:
    text = description('robot', '/', {'camera': RecordedStream('image', False, ['/camera'])})
    assert json.loads(text) == {'side': 'robot', 'namespace': '/', 'streams': {
        'camera': {'type': 'image', 'to_robot': False, 'topics': ['/camera']}}}
