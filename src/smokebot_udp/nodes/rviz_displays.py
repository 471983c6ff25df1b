# SPDX-License-Identifier: BSD-3-Clause
"""What rviz shows of the streams of a streams.yaml: a display for each, tools for what goes to the robot.

All topics are relative: operators use the same streams.yaml, each in the namespace of its rviz.
"""
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

from ..mission.roles import PRIMARY_IMAGE, roles_of, words_of
from ..streams.relay.parameters import TO_ROBOT

Colour = Tuple[int, int, int]
"""(red, green, blue), 0..255."""

Display = Dict[str, Any]
"""As in an .rviz file."""

Streams = Mapping[str, Mapping[str, Any]]
"""{name: settings}, as config.load returns them."""

PALETTE: Tuple[Colour, ...] = ((255, 40, 40), (60, 160, 255), (255, 255, 80), (255, 150, 40), (255, 90, 255),
                               (90, 255, 255), (170, 255, 120), (200, 160, 255))
"""Colours of scans, and of clouds but the first one, in the order of the file."""

BY_HEIGHT = None
"""Value in place of a colour: the first cloud is coloured by its heights."""

POINT = 0.6
"""Size of a point in rviz as a ratio of the voxel's size: neighbours do not touch."""

SMALLEST_POINT, SCAN_POINT, VIRTUAL_SCAN_POINT = 0.02, 0.06, 0.1
"""Minimum size of a cloud's point, and sizes of the points of a scan and of a virtual scan [m]."""

QUEUE = 2
"""Messages that wait for their transforms: older ones are of no use."""

CLOUDS, SCANS = {'cloud', 'sensor_msgs/PointCloud2'}, {'scan', 'virtual_scan', 'sensor_msgs/LaserScan'}
IMAGES = {'image', 'sensor_msgs/Image', 'sensor_msgs/CompressedImage'}
GRIDS = {'grid', 'nav_msgs/OccupancyGrid'}
"""What is shown alike: types of streams, and of relayed messages."""

RELAYED: Dict[str, Display] = {
    'nav_msgs/Path': {'Class': 'rviz/Path', 'Line Style': 'Billboards', 'Line Width': 0.05},
    'geometry_msgs/PoseStamped': {'Class': 'rviz/Pose', 'Shape': 'Arrow', 'Shaft Length': 0.7, 'Shaft Radius': 0.06,
                                  'Head Length': 0.3, 'Head Radius': 0.15},
    'geometry_msgs/PoseArray': {'Class': 'rviz/PoseArray'},
    'geometry_msgs/PoseWithCovarianceStamped': {'Class': 'rviz/PoseWithCovariance'},
    'geometry_msgs/PolygonStamped': {'Class': 'rviz/Polygon'},
    'geometry_msgs/PointStamped': {'Class': 'rviz/PointStamped'},
    'nav_msgs/GridCells': {'Class': 'rviz/GridCells'},
    'sensor_msgs/Range': {'Class': 'rviz/Range', 'Buffer Length': 1},
    'visualization_msgs/Marker': {'Class': 'rviz/Marker'},
    'visualization_msgs/MarkerArray': {'Class': 'rviz/MarkerArray'}}
"""{type of a relay's messages: its display}; others have none."""

TOOLS = {'geometry_msgs/PoseStamped': 'rviz/SetGoal', 'geometry_msgs/PoseWithCovarianceStamped': 'rviz/SetInitialPose',
         'geometry_msgs/PointStamped': 'rviz/PublishPoint'}
"""{type of a message to the robot: tool that publishes it}"""

ODOMETRY = 'nav_msgs/Odometry'
TF_STATIC = '/tf_static'
TF, TF_TYPES = {'/tf', TF_STATIC}, {'tf2_msgs/TFMessage', 'tf/tfMessage'}


class Image(NamedTuple):
    """An image, in a dock of its own."""
    name: str
    display: Display
    primary: bool


def kind_of(settings: Mapping[str, Any]) -> str:
    """The type of a stream; of a relay that of its messages."""
    return str(settings.get('message_type') or settings['type'])


def colours_of(streams: Streams) -> Dict[str, Optional[Colour]]:
    """The colour of each scan and cloud; BY_HEIGHT: it is coloured by its heights."""
    clouds = [name for name, settings in streams.items() if kind_of(settings) in CLOUDS]
    flat = [name for name, settings in streams.items()
            if kind_of(settings) in SCANS or name in clouds[1:]]
    return {**{name: BY_HEIGHT for name in clouds[:1]},
            **{name: PALETTE[number % len(PALETTE)] for number, name in enumerate(flat)}}


def images_of(streams: Streams) -> List[Image]:
    """The images, the primary one first."""
    roles, found = roles_of(streams), []
    for name, settings in streams.items():
        if kind_of(settings) not in IMAGES:
            continue
        topic, hint = relative(settings['view_topic' if settings['type'] == 'image' else 'operator_topic']), 'raw'
        if not topic:
            continue
        if settings.get('message_type') == 'sensor_msgs/CompressedImage':
            if not topic.endswith('/compressed'):
                continue    # image_transport finds no other one
            topic, hint = topic[:-len('/compressed')], 'compressed'
        found.append(Image(title(name), {
            'Class': 'rviz/Image', 'Enabled': True, 'Image Topic': topic, 'Max Value': 1, 'Median window': 5,
            'Min Value': 0, 'Name': title(name), 'Normalize Range': False, 'Queue Size': QUEUE, 'Transport Hint': hint,
            'Unreliable': False, 'Value': True}, roles[name] == PRIMARY_IMAGE))
    return sorted(found, key=lambda image: not image.primary)


def displays_of(streams: Streams) -> List[Display]:
    """The displays of all streams that the 3D view can show: maps first, as they are drawn beneath."""
    colours = colours_of(streams)
    found: List[Display] = []
    for name, settings in sorted(streams.items(), key=lambda item: kind_of(item[1]) not in GRIDS):
        kind = kind_of(settings)
        if kind in GRIDS:
            found += _grid(name, settings, not any(display['Class'] == 'rviz/Map' for display in found))
        elif name in colours:
            found.append(_points(name, settings, colours[name]))
        elif kind in RELAYED:
            found.append(_relayed(name, settings))
    return found


def tools_of(streams: Streams) -> List[Display]:
    """The tools that publish what streams send to the robot."""
    return [{'Class': TOOLS[settings['message_type']], 'Topic': relative(settings['operator_topic'])}
            for settings in streams.values() if settings.get('direction') == TO_ROBOT
            and settings['message_type'] in TOOLS]


def transforms_of(streams: Streams) -> Dict[str, str]:
    """{/tf or /tf_static: the operator's topic of it}, of those that are relayed."""
    return {settings['robot_topic']: relative(settings['operator_topic']) for settings in streams.values()
            if settings.get('message_type') in TF_TYPES and settings['robot_topic'] in TF}


def odometry_of(streams: Streams) -> str:
    """The operator's topic of the robot's odometry."""
    return next((str(settings['operator_topic']) for settings in streams.values()
                 if settings.get('message_type') == ODOMETRY and settings.get('direction') != TO_ROBOT),
                'operator/odom')


def title(name: str) -> str:
    """The name of a stream as rviz shows it."""
    return (name[:1].upper() + name[1:]).replace('_', ' ')


def relative(topic: str) -> str:
    """A topic of the operator's side, in the namespace of rviz."""
    return str(topic).lstrip('/')


def _grid(name: str, settings: Mapping[str, Any], first: bool) -> List[Display]:
    """A map, and the ages of its regions; only the first map is shown until others are chosen."""
    topic = relative(settings['operator_topic'])
    shown = {'Class': 'rviz/Map', 'Draw Behind': True, 'Enabled': first, 'Unreliable': False, 'Use Timestamp': False,
             'Value': first}
    costs = 'costmap' in words_of(name)
    found = [{**shown, 'Alpha': 0.7, 'Color Scheme': 'costmap' if costs else 'map', 'Name': title(name),
              'Topic': topic}]
    if settings['type'] == 'grid':
        found.append({**shown, 'Alpha': 0.3, 'Color Scheme': 'costmap', 'Name': title(name) + ' age',
                      'Topic': topic + '/age'})
    return found


def _points(name: str, settings: Mapping[str, Any], colour: Optional[Colour]) -> Display:
    """A cloud or scan."""
    cloud = kind_of(settings) in CLOUDS
    size = (max(SMALLEST_POINT, POINT * settings.get('leaf_size', 0.1)) if cloud else
            VIRTUAL_SCAN_POINT if settings['type'] == 'virtual_scan' else SCAN_POINT)
    found = {'Alpha': 1, 'Autocompute Intensity Bounds': True, 'Class': 'rviz/PointCloud2' if cloud else
             'rviz/LaserScan', 'Decay Time': 0, 'Enabled': True, 'Name': title(name), 'Position Transformer': 'XYZ',
             'Queue Size': QUEUE, 'Selectable': True, 'Size (m)': round(size, 3), 'Style': 'Flat Squares',
             'Topic': relative(settings['operator_topic']), 'Unreliable': False, 'Use Fixed Frame': True, 'Value': True}
    if 'rgb' in settings.get('fields', '').replace(',', ' ').split():
        return {**found, 'Color Transformer': 'RGB8'}
    if colour is None:
        return {**found, 'Color Transformer': 'AxisColor', 'Axis': 'Z', 'Use rainbow': True,
                'Autocompute Value Bounds': {'Max Value': 2.4, 'Min Value': -1.2, 'Value': False}}
    return {**found, 'Color': text_of(colour), 'Color Transformer': 'FlatColor'}


def _relayed(name: str, settings: Mapping[str, Any]) -> Display:
    """What rviz draws of a small message."""
    display, topic = RELAYED[settings['message_type']], relative(settings['operator_topic'])
    if 'Marker' in display['Class']:
        return {**display, 'Enabled': True, 'Marker Topic': topic, 'Name': title(name), 'Namespaces': {},
                'Queue Size': 100, 'Value': True}
    return {**display, 'Color': '80; 255; 80', 'Alpha': 1, 'Enabled': True, 'Name': title(name), 'Queue Size': QUEUE,
            'Topic': topic, 'Unreliable': False, 'Value': True}


def text_of(colour: Colour) -> str:
    """A colour as .rviz files have it."""
    return '%d; %d; %d' % colour
