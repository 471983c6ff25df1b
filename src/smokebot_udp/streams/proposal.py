# SPDX-License-Identifier: BSD-3-Clause
"""A streams.yaml for what a running robot publishes and listens to, as a proposal with comments."""
import math
import re
from typing import Any, Collection, Dict, List, Mapping, NamedTuple, Sequence, Set, Tuple

from ..long_messages import REMEDY, datagrams
from ..mission.roles import OBSTACLES, PRIMARY_IMAGE, roles_of, words_of
from .config import FRAMES

MAX_RATE = 10.0
"""Maximum rate that is proposed. Operators see no more, and the link has other streams [Hz]."""

MAX_WHOLE = 5e3
"""Longer messages are proposed as reliable ones where they take less of the link than this [byte/s]."""

SECONDARY_RATE = 5.0
"""Maximum rate that is proposed for images that one does not drive by [Hz]."""

WEIGHTS = {PRIMARY_IMAGE: 4.0, OBSTACLES: 2.0}
"""{role: weight}; others have the default."""

IMAGES = 'sensor_msgs/Image', 'sensor_msgs/CompressedImage'
PREFERRED = ('image_color', 'image_rect_color', 'image_raw', 'image', 'image_mono', 'image_rect')
"""Names of the image topics of one camera, the best first. Compressed ones come after all others, which have been
decoded anyway."""

UNNAMED = {*PREFERRED, 'compressed', 'points', 'data', 'raw', 'out', 'scan', 'rgb', 'color'}
"""Parts of topics that name no sensor."""

KINDS = {**dict.fromkeys(IMAGES, 'image'), 'nav_msgs/OccupancyGrid': 'grid', 'sensor_msgs/PointCloud2': 'cloud',
         'sensor_msgs/LaserScan': 'scan'}
"""{message type: type of its stream}; all others are relays."""

LEFT_OUT = re.compile(r'^(dynamic_reconfigure|bond|smokebot_udp|theora_image_transport|rosgraph_msgs/(Clock|TopicStat)|'
                      r'map_msgs/OccupancyGridUpdate|sensor_msgs/CameraInfo|actionlib_msgs)')
"""Types of messages that no operator needs, or that belong to another stream."""

LEFT_OUT_TOPICS = re.compile(
    r'(/compressedDepth|/theora|^/rosout|^/diagnostics(_agg|_toplevel_state)?|^/smokebot_udp/.*)$')

Settings = List[Tuple[str, Any, str]]
"""[(name, value, comment), ...]"""

TWIST, TRANSFORMS = 'geometry_msgs/Twist', ('tf2_msgs/TFMessage', 'tf/tfMessage')

DRIVEN_BY = '/operator/cmd_vel'
"""What teleop_keyboard publishes, whatever the robot's topic is."""

TO_ROBOT: Mapping[str, Settings] = {
    'geometry_msgs/PoseStamped': [('needs_control', True, 'taken only from who drives')],
    'geometry_msgs/PoseWithCovarianceStamped': []}
"""{type of what rviz sends: further settings}"""

ACTION_TOPICS = '/status', '/feedback', '/result', '/goal', '/cancel'

DIAGNOSTICS = '/diagnostics'
"""robot_sender publishes it, too: without it a desk with a master of its own does not see what the robot counts."""

REPORTS: Sequence[Tuple[str, str, Settings]] = (
    ('/log', '/rosout_agg', [('message_type', 'rosgraph_msgs/Log', ''), ('level', 'warn', '')]),
    ('/diagnostics', DIAGNOSTICS, [('message_type', 'diagnostic_msgs/DiagnosticArray', ''), ('newest', True, '')]))
"""What robots say of themselves: (name, topic, settings), sent reliably."""


class Topic(NamedTuple):
    """A topic of the robot."""
    name: str
    type: str
    rate: float = 0.0
    """[Hz]; 0: nothing came."""
    size: float = 0.0
    """Mean size of a message [byte]."""
    latched: bool = False
    encoding: str = ''
    """Encoding of an image, as in sensor_msgs/Image."""
    installed: bool = True
    """Whether this machine knows its type."""


class _Draft(NamedTuple):
    """A stream without a name."""
    topic: str
    settings: Settings
    comment: str = ''
    off: bool = False


class Proposed(NamedTuple):
    """A stream."""
    name: str
    settings: Settings
    comment: str = ''
    off: bool = False
    """Whether it stands as a comment: the user has to decide."""


def propose(published: Sequence[Topic], listened: Mapping[str, str], names: Collection[str],
            services: Mapping[str, str]) -> List[Proposed]:
    """The streams for a robot.

    :param published: by its nodes
    :param listened: {topic to which a node of it listens, and that nobody publishes: type}
    :param names: all topics that are published
    :param services: {service: its type}
    """
    actions = _actions(published)
    of_actions = {action + part for action in actions for part in ACTION_TOPICS}
    topics = [topic for topic in published if not LEFT_OUT.match(topic.type) and not LEFT_OUT_TOPICS.search(topic.name)
              and topic.name not in of_actions]
    cameras = _cameras([topic for topic in topics if topic.type in IMAGES])
    drafts = [_Draft(best.name, _image(best, names), 'also: ' + ', '.join(others) if others else '')
              for best, others in cameras]
    drafts += [_Draft(topic.name, _sensor(topic)) for topic in topics if KINDS.get(topic.type, 'image') != 'image']
    drafts += [_relay(topic) for topic in topics if topic.type not in KINDS]
    drafts += _way_back(listened)
    drafts += [_Draft(action, [('type', 'action', ''), ('action_type', type_, ''), ('robot_action', action, ''),
                               ('operator_action', '/operator' + action, '')])
               for action, type_ in sorted(actions.items())]
    drafts += [_Draft(service, [('type', 'service', ''), ('service_type', type_, ''), ('robot_service', service, ''),
                                ('operator_service', '/operator' + service, '')], 'for operators to call', True)
               for service, type_ in sorted(services.items())]
    drafts += [_Draft(name, [*_both('relay', topic), *settings, ('reliable', True, '')])
               for name, topic, settings in REPORTS if topic in names or (drafts and topic == DIAGNOSTICS)]
    taken: Set[str] = set()
    return _with_roles([Proposed(_name(draft.topic, taken), draft.settings, draft.comment, draft.off)
                        for draft in drafts])


def text_of(proposed: Sequence[Proposed], frames: Mapping[str, str], seconds: float) -> str:
    """The text of a streams.yaml.

    :param frames: entries of "frames:", by proposed_frames
    """
    lines = ['# Proposed by make_streams: what the robot published within %g s. Remove what you do not need: it costs'
             % seconds, '# bandwidth. Give robot.launch and operator.launch this file (streams:=FILE), and try',
             '# `rosrun smokebot_udp check FILE`. All settings: doc/parameters.md; roles: doc/focus.md.']
    if frames:
        lines += ['frames:', *("  %s: '%s'    # %s" % (name, frame, FRAMES[name].meaning)
                               for name, frame in frames.items())]
    lines.append('streams:')
    if not proposed:
        lines[-1] = 'streams: {}     # nothing was published'
    for stream in proposed:
        block = ['  %s:%s' % (stream.name, '    # ' + stream.comment if stream.comment else '')]
        block += ['    %s: %s%s' % (name, _yaml(value), '    # ' + comment if comment else '')
                  for name, value, comment in stream.settings]
        lines += ['  # ' + line[2:] for line in block] if stream.off else block
    return '\n'.join(lines) + '\n'


def _yaml(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _with_roles(streams: Sequence[Proposed]) -> List[Proposed]:
    """With the roles and what follows from them."""
    roles = roles_of({stream.name: {name: value for name, value, _ in stream.settings} for stream in streams
                      if not stream.off})
    found = []
    for stream in streams:
        role, settings = roles.get(stream.name, ''), list(stream.settings)
        if role:
            settings.append(('role', role, 'for the mission focus' if role != PRIMARY_IMAGE else
                             'what one drives by: give it to another image if that is wrong'))
        if role in WEIGHTS:
            settings.append(('weight', WEIGHTS[role], 'share of the link, relative to the others\' (1.0)'))
        if settings[0][1] == 'image' and role != PRIMARY_IMAGE:
            settings = [(name, min(value, SECONDARY_RATE) if name == 'rate' else value, comment)
                        for name, value, comment in settings]
        found.append(stream._replace(settings=settings))
    return found


def _cameras(images: Sequence[Topic]) -> List[Tuple[Topic, List[str]]]:
    """The best topic of each camera, and the others."""
    cameras: Dict[str, List[Topic]] = {}
    for topic in images:
        raw = topic.name[:-len('/compressed')] if topic.name.endswith('/compressed') else topic.name
        cameras.setdefault(raw.rpartition('/')[0] or raw, []).append(topic)

    def rank(topic: Topic) -> Tuple[bool, bool, int, str]:
        last = topic.name.replace('/compressed', '').rpartition('/')[2]
        known = PREFERRED.index(last) if last in PREFERRED else len(PREFERRED)
        return not topic.rate, topic.type == IMAGES[1], known, topic.name
    ranked = [sorted(topics, key=rank) for topics in cameras.values()]
    return [(topics[0], [topic.name for topic in topics[1:]]) for topics in ranked]


def _actions(published: Sequence[Topic]) -> Dict[str, str]:
    """{action: its type} of the action servers."""
    return {topic.name[:-len('/result')]: topic.type[:-len('Result')] for topic in published
            if topic.name.endswith('/result') and topic.type.endswith('ActionResult')}


def _both(kind: str, topic: str) -> Settings:
    """The settings that all have."""
    shown = topic[:-len('/compressed')] if topic.endswith('/compressed') else topic
    return [('type', kind, ''), ('robot_topic', topic, ''), ('operator_topic', '/operator' + shown, '')]


def _rate(topic: Topic) -> Settings:
    """Its maximum rate: not above what is published, and a little above slow sources."""
    rate = min(MAX_RATE, math.ceil(topic.rate)) if topic.rate else MAX_RATE
    return [('rate', float(max(1.0, rate)), 'published at %.3g Hz' % topic.rate if topic.rate else
             'nothing came while it was listened to')]


def _image(topic: Topic, names: Collection[str]) -> Settings:
    settings = _both('image', topic.name) + _rate(topic)
    if topic.name.replace('/compressed', '').rpartition('/')[0] + '/camera_info' in names:
        settings.append(('camera_info', True, 'its calibration crosses, too'))
    if topic.encoding == '32FC1':
        settings.append(('depth_unit', 0.001, '[m] for compressed depth'))
    if topic.encoding in ('mono16', '16UC1') and not words_of(topic.name) & {'depth'}:
        settings.append(('unit', 'counts', 'of a thermal camera for example: counts_per_unit: 25.0, zero: -273.15, '
                                           'unit: degC'))
    return settings


def _sensor(topic: Topic) -> Settings:
    """The settings of a grid, cloud or scan."""
    kind = KINDS[topic.type]
    settings = _both(kind, topic.name)
    if kind == 'grid':
        return settings + [('rate', 5.0, 'only what has changed is sent')]
    settings += _rate(topic)
    if kind == 'cloud':
        settings += [('encoding', 'sorted', '2 to 3 bytes per point'), ('leaf_size', 0.1, '[m] one point per voxel')]
    return settings


def _relay(topic: Topic) -> _Draft:
    """A relay; one that would not work well is a comment."""
    settings, parts = _typed('relay', topic.name, topic.type), datagrams(topic.size)
    if not topic.installed:
        return _Draft(topic.name, settings, 'this machine does not know its type', True)
    if topic.latched:
        settings.append(('latch', True, ''))
        if parts > 1:
            settings.append(('reliable', True, '%.0f bytes: sent once, until it has arrived' % topic.size))
        return _Draft(topic.name, settings)
    if topic.type in TRANSFORMS:
        return _Draft(topic.name, [*settings, ('rate', 20.0, 'of each frame')])
    if parts > 1 and topic.rate * topic.size <= MAX_WHOLE:
        return _Draft(topic.name, [*settings, ('reliable', True, 'a message takes %d datagrams' % parts),
                                   ('newest', True, 'a new one replaces one that waits')])
    if parts > 1:
        return _Draft(topic.name, settings + _rate(topic), 'a message takes %d datagrams, and is lost with any of '
                      'them; %s' % (parts, REMEDY), True)
    return _Draft(topic.name, settings + _rate(topic))


def _way_back(listened: Mapping[str, str]) -> List[_Draft]:
    """What operators send: of several topics by which the robot is driven, one; the others are comments."""
    drivers = sorted((topic for topic, type_ in listened.items() if type_ == TWIST),
                     key=lambda topic: (topic.strip('/') != 'cmd_vel', topic))
    found = []
    for topic in drivers:
        is_first = topic == drivers[0]
        settings = [(name, DRIVEN_BY if is_first and name == 'operator_topic' else value, comment)
                    for name, value, comment in _typed('command', topic, TWIST)]
        settings.append(('timeout', 0.5, '[s] without commands the robot stops'))
        found.append(_Draft(topic, settings, '' if is_first else 'drives the robot, too', not is_first))
    for topic, type_ in sorted(listened.items()):
        if type_ in TO_ROBOT:
            found.append(_Draft(topic, [*_typed('relay', topic, type_), ('direction', 'to_robot', ''),
                                        ('reliable', True, ''), *TO_ROBOT[type_]]))
    return found


def _typed(kind: str, topic: str, type_: str) -> Settings:
    settings = _both(kind, topic)
    return [settings[0], ('message_type', type_, ''), *settings[1:]]


def _name(topic: str, taken: Set[str]) -> str:
    """A name for the stream of a topic that no other one has."""
    parts = [part for part in topic.split('/') if part]
    named = [part for part in parts if part not in UNNAMED] or parts[-1:] or ['stream']
    base = re.sub(r'\W', '_', '_'.join(named[-2:]))
    base = base if base[:1].isalpha() else 'stream_' + base
    name, number = base, 2
    while name in taken:
        name, number = '%s_%d' % (base, number), number + 1
    taken.add(name)
    return name
