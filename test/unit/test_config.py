# SPDX-License-Identifier: BSD-3-Clause
import pathlib
from typing import Any, Dict, List, Tuple

import pytest

from smokebot_udp.streams import config

GOOD = '''
streams:
  thermal: {type: image, robot_topic: /thermal/image_raw, operator_topic: /operator/thermal/image_raw}
'''


def with_setting(text: str) -> Tuple[Dict[str, Any], List[str]]:
    return config.load(GOOD.replace('}', ', %s}' % text))


def users(streams: Dict[str, Any]) -> List[str]:
    """The names of the streams that are not the package's own."""
    return [name for name in streams if name not in config.OWN_STREAMS]


def test_the_shipped_file_is_right() -> None:
    path = pathlib.Path(__file__).parents[2] / 'config' / 'streams.yaml'
    streams, problems = config.load(path.read_text())
    assert not problems
    assert streams['thermal']['robot_topic'] == '/thermal/image_raw'
    assert streams['camera']['operator_topic'] == '/operator/camera/image_raw'


def test_defaults() -> None:
    streams, problems = config.load(GOOD)
    assert not problems
    assert streams['thermal']['rate'] == 10.0 and streams['thermal']['enabled'] is True
    assert with_setting('rate: 5')[0]['thermal']['rate'] == 5.0


@pytest.mark.parametrize('text, message', [
    ('rate: 0', "stream 'thermal': rate is 0, must be a number above 0"),
    ('rate: -5', 'rate is -5'),
    ('rate: .nan', 'rate is nan'),
    ('rate: .inf', 'rate is inf'),
    ('rate: fast', "rate is 'fast'"),
    ('rate: true', 'rate is True'),
    ('enabled: 1', 'enabled is 1, must be true or false'),
    ('fill: magic', "fill is 'magic', must be one of"),
    ('max_wait: 0', 'max_wait is 0'),
    ('colour: red', 'colour: no such setting')])
def test_a_wrong_setting_costs_its_stream_only(text, message) -> None:
    good = '\n  other: {type: image, robot_topic: a, operator_topic: b}\n'
    streams, problems = config.load(GOOD.rstrip().replace('}', ', %s}' % text) + good)
    assert users(streams) == ['other']
    assert len(problems) == 1 and message in problems[0]


@pytest.mark.parametrize('text, message', [
    ('', 'no "streams:"'), ('[1, 2]', 'no "streams:"'), ('streams: 5', 'no "streams:"'), ('a: [', 'not valid YAML'),
    ('streams: {x: {type: video, robot_topic: a, operator_topic: b}}', "stream 'x': type is 'video', must be one of"),
    ('streams: {x: {type: [1], robot_topic: a, operator_topic: b}}', 'type is [1]'),
    ('streams: {x: {type: image, operator_topic: b}}', "stream 'x': robot_topic is missing"),
    ('streams: {x y: {type: image}}', "stream 'x y': a name has"),
    ('streams: {7: {type: image}}', 'stream 7: a name has'),
    ('streams: {x: thermal}', "stream 'x': its settings are 'thermal'")])
def test_bad_files(text, message) -> None:
    streams, problems = config.load(text)
    assert not users(streams)
    assert len(problems) == 1 and message in problems[0]


def test_a_name_that_stands_twice() -> None:
    streams, problems = config.load(GOOD + '  thermal: {type: image, robot_topic: x, operator_topic: y}\n')
    assert streams['thermal']['robot_topic'] == '/thermal/image_raw'
    assert problems == ["'thermal' is given twice, again in line 4: the first one counts"]


@pytest.mark.parametrize('topic', ['/operator/thermal/image_raw', '/operator//thermal/image_raw/',
                                   'operator/thermal/image_raw'])
@pytest.mark.parametrize('kind', ['image', 'scan'])
def test_the_second_stream_with_an_operator_topic_is_refused(kind: str, topic: str) -> None:
    streams, problems = config.load(
        GOOD + '  rear: {type: %s, robot_topic: /rear, operator_topic: %s}\n' % (kind, topic))
    assert 'thermal' in streams and 'rear' not in streams
    assert problems == ["stream 'rear': operator_topic %soperator/thermal/image_raw is already the operator_topic of "
                        "stream 'thermal'" % ('/' * topic.startswith('/'))]


@pytest.mark.parametrize('topic', ['/gas', '//gas/'])
def test_a_stream_that_would_send_its_own_output_is_refused(topic: str) -> None:
    streams, problems = config.load(
        GOOD + '  gas: {type: relay, message_type: std_msgs/Float32, robot_topic: %s, operator_topic: /gas}\n' % topic)
    assert 'thermal' in streams and 'gas' not in streams
    assert problems == ["stream 'gas': robot_topic and operator_topic are both /gas: the stream would send again and "
                        "again what it publishes itself"]


def test_the_same_relative_name_on_both_sides_is_resolved_by_each_node() -> None:
    streams, problems = config.load('streams: {x: {type: scan, robot_topic: scan, operator_topic: scan}}')
    assert 'x' in streams and not problems


def test_one_robot_topic_has_one_type() -> None:
    cam = '  cam: {type: relay, message_type: %s, robot_topic: /thermal/image_raw, operator_topic: /operator/cam}\n'
    streams, problems = config.load(GOOD + cam % 'sensor_msgs/CompressedImage')
    assert 'thermal' in streams and 'cam' not in streams
    assert problems == ["stream 'cam': robot_topic /thermal/image_raw must be sensor_msgs/CompressedImage, but "
                        "sensor_msgs/Image for stream 'thermal'"]
    streams, problems = config.load(GOOD + cam % 'sensor_msgs/Image')
    assert 'cam' in streams and not problems


OWN = '  %s: {type: relay, message_type: smokebot_udp/%s, robot_topic: /r/%s, operator_topic: /o/%s}\n'


def test_the_package_s_own_streams_are_added() -> None:
    streams, problems = config.load(GOOD)
    assert list(streams) == ['thermal', 'link', 'status'] and not problems
    link, status = streams['link'], streams['status']
    assert [link[key] for key in ('type', 'message_type', 'robot_topic', 'operator_topic', 'rate', 'latch')] == [
        'relay', 'smokebot_udp/LinkStatus', '~link', 'operator/link', 2.0, False]
    assert [status[key] for key in ('type', 'message_type', 'robot_topic', 'operator_topic', 'latch', 'enabled')] == [
        'relay', 'smokebot_udp/RobotStatus', '~status', 'operator/status', True, True]
    assert set(config.load('streams: {}')[0]) == {'link', 'status'}


def test_the_package_s_own_streams_may_be_in_the_file() -> None:
    mine = GOOD + OWN % ('mine', 'RobotStatus', 'a', 'b')
    streams, problems = config.load(mine)
    assert list(streams) == ['thermal', 'mine', 'link'] and not problems
    streams, problems = config.load(mine + OWN % ('l', 'LinkStatus', 'c', 'd'))
    assert list(streams) == ['thermal', 'mine', 'l'] and not problems


@pytest.mark.parametrize('user', [
    'link: {type: scan, robot_topic: /l, operator_topic: /m}',
    'link: {type: scan, rate: -1, robot_topic: /l, operator_topic: /m}',
    'other: {type: scan, robot_topic: /l, operator_topic: /operator/link}'])
def test_the_package_s_own_streams_take_no_name_or_topic_of_the_user_s(user: str) -> None:
    streams, _ = config.load(GOOD + '  ' + user)
    assert streams['robot_link']['message_type'] == 'smokebot_udp/LinkStatus'
    assert streams['robot_link']['robot_topic'] == '~link'
    assert streams['robot_link']['operator_topic'] == 'operator/robot_link'
    assert streams['status']['operator_topic'] == 'operator/status'


# frames

PLACED = """
streams:
  plan: {type: grid, robot_topic: /plan, operator_topic: /o/plan}
  walls: {type: virtual_scan, robot_topic: /walls, operator_topic: /o/walls}
  own: {type: virtual_scan, robot_topic: /own, operator_topic: /o/own, base_frame: level}
  none: {type: virtual_scan, robot_topic: /none, operator_topic: /o/none, base_frame: ''}
"""


def test_frames_and_what_they_are_the_default_of() -> None:
    streams, problems = config.load('frames: {fixed: odom, base: rover}' + PLACED)
    assert not problems and streams.frames == ('odom', 'rover')
    assert streams['plan']['robot_frame'] == 'rover'
    assert [streams[name]['base_frame'] for name in ('walls', 'own', 'none')] == ['rover', 'level', '']


def test_frames_that_are_not_given() -> None:
    streams, _ = config.load(PLACED)
    assert streams.frames == ('map', 'base_link') and streams['walls']['base_frame'] == 'base_link'
    assert config.load('frames: {base: rover}' + PLACED)[0].frames == ('map', 'rover')
    assert config.load('')[0].frames == ('map', 'base_link')


@pytest.mark.parametrize('frames', [
    '5', '[map]', '{odd: map}', '{fixed: 5}', "{fixed: ''}", '{base: /rover}', '{base: "a b"}', r'{base: "rover\n"}',
    '{base: %s}' % ('r' * 101), '{base: r\u00f6ver}'])
def test_wrong_frames_are_reported_and_the_streams_are_used(frames: str) -> None:
    streams, problems = config.load('frames: ' + frames + PLACED)
    assert len(problems) == 1 and problems[0].startswith('frames: ')
    assert streams.frames == ('map', 'base_link') and 'plan' in streams
