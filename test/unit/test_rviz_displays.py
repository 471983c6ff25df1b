# SPDX-License-Identifier: BSD-3-Clause
"""What rviz shows of a streams.yaml; integration/rviz.test looks at rviz itself."""
from typing import Any, Dict, List

from smokebot_udp.nodes import rviz_displays
from smokebot_udp.streams import config


def streams_of(text: str) -> Dict[str, Any]:
    streams, problems = config.load(text)
    assert not problems
    return streams


def shown(displays: List[Any]) -> List[Any]:
    return [(display['Name'], display['Class'], display.get('Topic') or display.get('Marker Topic'),
             display.get('Color', '')) for display in displays]


OWN = """
streams:
  rear_cam: {type: image, robot_topic: /rear/rgb, operator_topic: /desk/rear}
  front_cam: {type: image, robot_topic: /front/rgb, operator_topic: /desk/front, view_topic: /desk/front_view}
  depth: {type: image, robot_topic: /depth, operator_topic: /desk/depth, view_topic: none}
  web: {type: relay, message_type: sensor_msgs/CompressedImage, robot_topic: /web, operator_topic: /desk/web/compressed}
  web2: {type: relay, message_type: sensor_msgs/CompressedImage, robot_topic: /web2, operator_topic: /desk/web2}
  kinect: {type: cloud, robot_topic: /kinect, operator_topic: /desk/kinect, leaf_size: 0.02, fields: 'ring, rgb'}
  ouster: {type: cloud, robot_topic: /ouster, operator_topic: /desk/ouster, leaf_size: 0.2}
  sick: {type: scan, robot_topic: /sick, operator_topic: /desk/sick}
  local_costmap: {type: grid, robot_topic: /local, operator_topic: /desk/local}
  plan: {type: relay, message_type: nav_msgs/Path, robot_topic: /plan, operator_topic: /desk/plan}
  boxes: {type: relay, message_type: visualization_msgs/MarkerArray, robot_topic: /boxes, operator_topic: /desk/boxes}
  imu: {type: relay, message_type: sensor_msgs/Imu, robot_topic: /imu, operator_topic: /desk/imu}
  wheels: {type: relay, message_type: nav_msgs/Odometry, robot_topic: /wheels, operator_topic: /desk/wheels}
  frames: {type: relay, message_type: tf2_msgs/TFMessage, robot_topic: /tf, operator_topic: /desk/frames}
  start: {type: relay, message_type: geometry_msgs/PoseWithCovarianceStamped, robot_topic: /initialpose,
          operator_topic: /desk/start, direction: to_robot, reliable: true}
"""


def test_an_own_robot() -> None:
    streams = streams_of(OWN)
    assert [(image.name, image.display['Image Topic'], image.display['Transport Hint'], image.primary)
            for image in rviz_displays.images_of(streams)] == [
        ('Front cam', 'desk/front_view', 'raw', True), ('Rear cam', 'desk/rear/view', 'raw', False),
        ('Web', 'desk/web', 'compressed', False)]
    assert shown(rviz_displays.displays_of(streams)) == [
        ('Local costmap', 'rviz/Map', 'desk/local', ''), ('Local costmap age', 'rviz/Map', 'desk/local/age', ''),
        ('Kinect', 'rviz/PointCloud2', 'desk/kinect', ''),
        ('Ouster', 'rviz/PointCloud2', 'desk/ouster', '255; 40; 40'),
        ('Sick', 'rviz/LaserScan', 'desk/sick', '60; 160; 255'), ('Plan', 'rviz/Path', 'desk/plan', '80; 255; 80'),
        ('Boxes', 'rviz/MarkerArray', 'desk/boxes', ''),
        ('Start', 'rviz/PoseWithCovariance', 'desk/start', '80; 255; 80')]
    by_name = {display['Name']: display for display in rviz_displays.displays_of(streams)}
    assert by_name['Kinect']['Color Transformer'] == 'RGB8' and by_name['Kinect']['Size (m)'] == 0.02
    assert by_name['Ouster']['Size (m)'] == 0.12 and by_name['Local costmap']['Color Scheme'] == 'costmap'
    assert rviz_displays.tools_of(streams) == [{'Class': 'rviz/SetInitialPose', 'Topic': 'desk/start'}]
    assert rviz_displays.transforms_of(streams) == {'/tf': 'desk/frames'}
    assert rviz_displays.odometry_of(streams) == '/desk/wheels'
    assert rviz_displays.colours_of(streams) == {
        'kinect': None, 'ouster': (255, 40, 40), 'sick': (60, 160, 255)}


def test_of_several_maps_the_first_is_shown() -> None:
    streams = streams_of('streams: {a: {type: grid, robot_topic: /a, operator_topic: /o/a}, '
                         'b: {type: grid, robot_topic: /b, operator_topic: /o/b}}')
    assert [display['Enabled'] for display in rviz_displays.displays_of(streams)] == [True, True, False, False]
