# SPDX-License-Identifier: BSD-3-Clause
"""Proposed streams; integration/own_streams.test runs make_streams and check."""
from typing import Any, Dict, List, Sequence

from smokebot_udp.streams import config
from smokebot_udp.streams.proposal import Proposed, Topic, propose, text_of


def read(proposed: Sequence[Proposed]) -> Dict[str, Any]:
    """As streams.yaml: all of it is valid."""
    streams, problems = config.load(text_of(proposed, {}, 5.0))
    assert not problems
    return streams


ROBOT = [
    Topic('/front/image_raw', 'sensor_msgs/Image', 29.9, 2e6, encoding='bgr8'),
    Topic('/front/image_raw/compressed', 'sensor_msgs/CompressedImage', 29.9, 1e5),
    Topic('/front/image_rect', 'sensor_msgs/Image', 29.9, 2e6, encoding='mono8'),
    Topic('/front/camera_info', 'sensor_msgs/CameraInfo', 29.9, 400.0),
    Topic('/rear/image_raw/compressed', 'sensor_msgs/CompressedImage', 15.0, 1e5),
    Topic('/depth/image', 'sensor_msgs/Image', 30.0, 1e6, encoding='32FC1'),
    Topic('/map', 'nav_msgs/OccupancyGrid', 0.2, 1e5, True),
    Topic('/move_base/local_costmap/costmap', 'nav_msgs/OccupancyGrid', 2.0, 1e4),
    Topic('/move_base/local_costmap/costmap_updates', 'map_msgs/OccupancyGridUpdate', 2.0, 1e4),
    Topic('/ouster/points', 'sensor_msgs/PointCloud2', 10.0, 1e6), Topic('/sick/scan', 'sensor_msgs/LaserScan', 40.0),
    Topic('/imu/data', 'sensor_msgs/Imu', 100.0, 320.0), Topic('/tf', 'tf2_msgs/TFMessage', 50.0, 3000.0),
    Topic('/tf_static', 'tf2_msgs/TFMessage', 0.2, 400.0, True),
    Topic('/robot_description', 'std_msgs/String', 0.2, 3e5, True),
    Topic('/grid_cells', 'nav_msgs/Path', 2.0, 5000.0), Topic('/plan', 'nav_msgs/Path', 1.0, 4200.0),
    Topic('/2nd', 'std_msgs/Int8', 0.0),
    Topic('/odd', 'odd_msgs/Odd', 1.0, installed=False),
    Topic('/move_base/status', 'actionlib_msgs/GoalStatusArray', 5.0),
    Topic('/move_base/feedback', 'move_base_msgs/MoveBaseActionFeedback', 5.0),
    Topic('/move_base/result', 'move_base_msgs/MoveBaseActionResult', 0.0),
    Topic('/driver/parameter_updates', 'dynamic_reconfigure/Config', 0.1), Topic('/rosout', 'rosgraph_msgs/Log', 1.0)]
LONG = ('a message takes 4 datagrams, and is lost with any of them; with "reliable: true" and "newest: true" the '
        'newest one arrives whole')
LISTENED = {'/joy/cmd_vel': 'geometry_msgs/Twist', '/cmd_vel': 'geometry_msgs/Twist',
            '/goal': 'geometry_msgs/PoseStamped', '/initialpose': 'geometry_msgs/PoseWithCovarianceStamped',
            '/clicked': 'geometry_msgs/PointStamped'}


def proposed() -> List[Proposed]:
    names = [topic.name for topic in ROBOT]
    return propose(ROBOT, LISTENED, [*names, '/rosout_agg'], {'/horn': 'std_srvs/Trigger'})


def test_each_source_is_a_stream_of_its_type() -> None:
    streams = read(proposed())
    assert {name: (settings['type'], settings.get('robot_topic')) for name, settings in streams.items()} == {
        'front': ('image', '/front/image_raw'), 'rear': ('image', '/rear/image_raw/compressed'),
        'depth': ('image', '/depth/image'), 'map': ('grid', '/map'),
        'local_costmap_costmap': ('grid', '/move_base/local_costmap/costmap'), 'ouster': ('cloud', '/ouster/points'),
        'sick': ('scan', '/sick/scan'), 'imu': ('relay', '/imu/data'), 'tf': ('relay', '/tf'),
        'tf_static': ('relay', '/tf_static'), 'robot_description': ('relay', '/robot_description'),
        'stream_2nd': ('relay', '/2nd'),
        'plan': ('relay', '/plan'), 'cmd_vel': ('command', '/cmd_vel'), 'goal': ('relay', '/goal'),
        'initialpose': ('relay', '/initialpose'), 'move_base': ('action', None), 'log': ('relay', '/rosout_agg'),
        'diagnostics': ('relay', '/diagnostics'), 'link': ('relay', '~link'), 'status': ('relay', '~status')}


def test_rates_roles_and_weights() -> None:
    streams = read(proposed())
    assert {name: (settings['rate'], settings['role'], settings['weight']) for name, settings in streams.items()
            if settings.get('role')} == {
        'front': (10.0, 'primary_image', 4.0), 'rear': (5.0, 'secondary_image', 1.0),
        'depth': (5.0, 'secondary_image', 1.0), 'map': (5.0, 'map', 1.0), 'local_costmap_costmap': (5.0, 'map', 1.0),
        'ouster': (10.0, 'cloud', 1.0), 'sick': (10.0, 'obstacles', 2.0), 'imu': (10.0, 'state', 1.0),
        'tf': (20.0, 'state', 1.0), 'tf_static': (10.0, 'state', 1.0), 'stream_2nd': (10.0, 'state', 1.0)}
    assert streams['front']['camera_info'] and not streams['rear']['camera_info']
    assert streams['rear']['operator_topic'] == '/operator/rear/image_raw' and streams['depth']['depth_unit'] == 0.001
    assert streams['plan']['reliable'] and streams['plan']['newest']
    assert streams['robot_description']['latch'] and streams['robot_description']['reliable']
    assert streams['goal']['needs_control'] and streams['goal']['direction'] == 'to_robot'
    assert streams['move_base']['action_type'] == 'move_base_msgs/MoveBaseAction'


def test_what_the_user_has_to_decide_stands_as_a_comment() -> None:
    off = {stream.name: stream.comment for stream in proposed() if stream.off}
    assert off == {'grid_cells': LONG, 'horn': 'for operators to call',
                   'odd': 'this machine does not know its type', 'joy_cmd_vel': 'drives the robot, too'}
    text = text_of(proposed(), {}, 5.0)
    assert '  # grid_cells:    # %s\n' % LONG in text
    assert '  #   service_type: std_srvs/Trigger\n' in text
    assert '  front:    # also: /front/image_rect, /front/image_raw/compressed\n' in text


def test_a_robot_that_publishes_nothing() -> None:
    assert read(propose([], {}, [], {})).keys() == {'link', 'status'}


def test_the_first_topic_that_drives_is_what_teleop_keyboard_publishes() -> None:
    driven = {'/mole/cmd_vel': 'geometry_msgs/Twist', '/mole/joy_vel': 'geometry_msgs/Twist'}
    streams = read(propose([], driven, [], {}))
    assert [(settings['robot_topic'], settings['operator_topic']) for settings in streams.values()
            if settings['type'] == 'command'] == [('/mole/cmd_vel', '/operator/cmd_vel')]


def test_names_are_unique() -> None:
    topics = [Topic('/%s/data' % name, 'sensor_msgs/Imu') for name in ('a/imu', 'b/a/imu', 'c/a/imu')]
    assert list(read(propose(topics, {}, [], {}))) == ['a_imu', 'a_imu_2', 'a_imu_3', 'diagnostics', 'link', 'status']


def test_frames() -> None:
    for frames in ({'fixed': 'odom', 'base': 'rover'}, {'fixed': 'no', 'base': 'null'}, {'base': 'rover'}, {}):
        streams, problems = config.load(text_of(proposed(), frames, 5.0))
        assert not problems and streams.frames == config.Frames(**frames)
