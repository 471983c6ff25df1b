# SPDX-License-Identifier: BSD-3-Clause
"""The program `check [STREAMS_YAML]`: finds before a mission what is wrong with streams, sources, frames and
machine."""
import argparse
import collections
import os
import pathlib
import statistics
import struct
import sys
import time
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import rosgraph
import rospkg
import rospy
import rosservice
from genpy.message import get_message_class

from ..link.keys import read_key
from ..mission import focus
from ..mission.parameters import kind_of
from ..mission.roles import roles_of
from ..mission.settings import Settings
from ..monitoring import check
from ..monitoring.check import Checked, Cost, Finding, Heard
from ..monitoring.sources import ACTION, LISTENER, SERVICE, TOPIC, Graph, Source, graph_of
from ..monitoring.status import ERROR, WARN
from ..msg import LinkStatus
from ..serialised import serialised
from ..streams import KINDS, config, encoder_class, live_tables
from ..streams.config import Streams
from ..streams.encoder import LinkView
from ..streams.message_types import action_types
from ..streams.relay.parameters import TO_ROBOT
from ..streams.segments import size_on_air
from ..udpros import rpc
from ..units import KBIT
from .any_type import read
from .parameters import OPERATOR_RECEIVER, ROBOT_SENDER
from .terminal import fail, master_answers, run_node

RMEM_MAX = '/proc/sys/net/core/rmem_max'

BUFFER = 1 << 24
"""Size of the buffer from which rospy reads a source: a large image fits as a whole [byte]."""

HEADER = struct.Struct('<IIII')
"""The layout of a serialised std_msgs/Header: seq, secs, nsecs, length of the frame_id."""

LINK_TIMEOUT = 3.0
"""Time to wait for the state of the link, which robot_sender publishes once a second [s]."""


class TopicListener:
    """Listens to one topic of any type.

    :param each: called with each message, rospy.AnyMsg
    """

    def __init__(self, topic: str, class_: Any, each: Callable[[Any], None] = lambda message: None) -> None:
        self._class, self._each, self._sizes = class_, each, []     # type: Any, Callable[[Any], None], List[int]
        self._ages: List[float] = []
        self._begun = time.monotonic()
        self.last: Any = None
        """The last message: a rospy.AnyMsg, or of its type where this node also subscribes to the topic with it."""
        self._frame: Optional[str] = None
        self._subscriber = rospy.Subscriber(topic, rospy.AnyMsg, self._take, buff_size=BUFFER, queue_size=10)

    def _take(self, message: Any) -> None:
        # of another type where this node subscribes the topic with its type as well, as tf2 does
        self.last, data = message, message._buff if isinstance(message, rospy.AnyMsg) else serialised(message)
        self._each(message)
        self._sizes.append(len(data))
        if self._class is not None and self._class._has_header and len(data) >= HEADER.size:
            _, seconds, nanoseconds, length = HEADER.unpack_from(data)
            self._frame = data[HEADER.size:HEADER.size + length].decode('utf-8', 'replace')
            if seconds or nanoseconds:
                self._ages.append(rospy.get_time() - seconds - 1e-9 * nanoseconds)

    def heard(self) -> Heard:
        """What came until now; it ends."""
        self._subscriber.unregister()
        if not self._sizes:
            return Heard()
        stamped = self._class is not None and bool(self._class._has_header)
        return Heard(len(self._sizes) / (time.monotonic() - self._begun), statistics.mean(self._sizes),
                     statistics.median(self._ages) if self._ages else None, self._frame, stamped)


def checked(name: str, settings: Dict[str, Any]) -> Checked:
    """A stream, and where its messages come from."""
    kind = settings['type']
    if kind == 'service':
        return Checked(name, settings, Source(SERVICE, _resolved(settings['robot_service'])), True)
    if kind == 'action':
        return Checked(name, settings, Source(ACTION, _resolved(settings['robot_action']), action_types(
            settings['action_type']).result._type), True)
    topic = _resolved(settings['robot_topic'])
    if kind == 'command' or settings.get('direction') == TO_ROBOT:
        return Checked(name, settings, Source(LISTENER, topic, settings['message_type']), False)
    if kind == 'relay':
        steady = not (settings['latch'] or settings['reliable'])
        return Checked(name, settings, Source(TOPIC, topic, settings['message_type']), steady)
    encoder = encoder_class(kind)
    accepted = ' or '.join(class_._type for class_ in encoder.ACCEPTED or [encoder.MESSAGE])
    return Checked(name, settings, Source(TOPIC, topic, accepted), encoder.traits.steady)


def _resolved(name: str) -> str:
    """The name on the robot; private ones are robot_sender's."""
    return '/robot_sender/' + name[1:] if name.startswith('~') else str(rospy.resolve_name(name))


def cost_of(stream: Checked, message: Any) -> Tuple[Optional[Cost], str]:
    """(what a stream takes of the link, why a message of it cannot be sent), by the stream's own encoder.

    :param message: rospy.AnyMsg
    """
    settings = Settings(stream.settings)
    try:
        encoder = encoder_class(stream.settings['type'])(stream.settings)
        classes = list(encoder.ACCEPTED) or [encoder.MESSAGE]
        found = next((class_ for class_ in classes if class_._type == message._connection_header['type']), None)
        if found is None:
            return None, ''
        derived = encoder.derive(encoder.merge(None, read(message, found)), settings)
        link = LinkView(ROBOT_SENDER['max_datagram_size'].default, source_rate=stream.heard.rate)
        frames = encoder.encode(derived, settings, link).frames
        rate = min(stream.settings['rate'], stream.heard.rate)
        points = [] if encoder.protected else encoder.operating_points(rate, settings)
    except ValueError as error:
        return None, str(error)
    if points:
        return Cost(points[0].cost / KBIT, points[-1].cost / KBIT), ''
    cost = rate * size_on_air(frames) / KBIT
    return Cost(cost, cost), ''


def listen(streams: Sequence[Checked], graph: Graph, seconds: float) -> List[Checked]:
    """The streams with what came from their sources meanwhile, and what they take of the link."""
    listeners = {}
    for stream in streams:
        source = stream.source
        if source.kind == TOPIC and graph.publishers.get(source.name):
            found = graph.types.get(source.name, '*')
            listeners[stream.name] = TopicListener(source.name, get_message_class(found) if '/' in found else None)
    time.sleep(seconds)
    heard = {name: listener.heard() for name, listener in listeners.items()}
    result = []
    for stream in streams:
        stream = stream._replace(heard=heard.get(stream.name, Heard()))
        if stream.heard.rate and kind_of(stream.settings) in KINDS:
            cost, failure = cost_of(stream, listeners[stream.name].last)
            stream = stream._replace(cost=cost, failure=failure)
        result.append(stream)
    return result


def missing_frames(buffer: Any, streams: Sequence[Checked], fixed: str) -> List[str]:
    """The frames of messages that tf cannot transform into the fixed one."""
    frames = {stream.heard.frame for stream in streams if stream.heard.frame}
    return [frame for frame in sorted(frames) if not buffer.can_transform(fixed, frame.lstrip('/'), rospy.Time(0))]


def check_files(arguments: argparse.Namespace) -> Tuple[Streams, List[Finding]]:
    """The streams, and what is wrong with the files and the machine."""
    found: List[Finding] = []
    texts = collections.OrderedDict([('streams', arguments.streams), ('focus', arguments.focus)])
    for name, path in texts.items():
        path = path or os.path.join(rospkg.RosPack().get_path('smokebot_udp'), 'config', name + '.yaml')
        try:
            texts[name] = pathlib.Path(path).read_text()
        except (OSError, UnicodeDecodeError) as error:
            found.append(Finding(ERROR, path, str(error)))
            texts[name] = '%s: {}' % {'streams': 'streams', 'focus': 'profiles'}[name]
    streams, problems = config.load(texts['streams'], lambda text: found.append(Finding(WARN, 'streams', text)))
    found += [Finding(ERROR, 'streams', problem) for problem in problems]
    profiles, problems = focus.load(texts['focus'])
    tables = {name: live_tables(settings).robot for name, settings in streams.items()}
    problems += focus.settings_of(profiles, tables, streams)[1]
    found += [Finding(ERROR, 'focus', problem) for problem in problems]
    found += [Finding(WARN, 'focus', problem) for problem in focus.missing_streams(profiles, streams)]
    if arguments.key_file:
        try:
            read_key(arguments.key_file)
        except ValueError as error:
            found.append(Finding(ERROR, 'key', str(error)))
    try:
        allowed = int(pathlib.Path(RMEM_MAX).read_text())
        found += check.judge_buffer(allowed, OPERATOR_RECEIVER['receive_buffer'].default)
    except (OSError, ValueError):
        pass    # in a container the file may be missing: the kernel's limit is unknown
    return streams, found


def check_robot(streams: Streams, graph: Graph, seconds: float, link: Optional[float]
                ) -> Tuple[List[Checked], List[Finding]]:
    """What the robot publishes, and what is wrong with it."""
    import tf2_ros  # takes a second
    buffer = tf2_ros.Buffer()
    listener = tf2_ros.TransformListener(buffer)
    robot = listen([checked(name, dict(settings)) for name, settings in streams.items()], graph, seconds)
    fixed, base = streams.frames
    missing = missing_frames(buffer, robot, fixed)
    found: List[Finding] = []
    if any(stream.settings['type'] in check.PLACED for stream in robot) and not buffer.can_transform(
            fixed, base, rospy.Time(0)):
        found.append(Finding(WARN, 'tf', 'it knows no way from %s to %s: rviz shows little in 3D (see "frames:" of '
                             'streams.yaml, which make_streams proposes)' % (base, fixed)))
    for stream in robot:
        found += check.judge(stream, graph, missing)
        if check.is_there(stream.source, graph):
            found += check.judge_service_type(stream.name, service_type(stream.source.name),
                                              stream.settings['service_type'])
    listener.unregister()
    return robot, found + check.judge_link(robot, link)


def service_type(name: str) -> Optional[str]:
    """The type of a service; None: it does not answer."""
    try:
        return str(rosservice.get_service_type(name))
    except rosservice.ROSServiceIOException:
        return None


def link_capacity(graph: Graph) -> Optional[float]:
    """The capacity of the link, where robot_sender runs and has measured it [kbit/s]."""
    if not graph.publishers.get('/robot_sender/link'):
        return None
    try:
        capacity = float(rospy.wait_for_message('/robot_sender/link', LinkStatus, LINK_TIMEOUT).capacity)
    except rospy.ROSException:
        return None
    return 1e3 * capacity if capacity > 0 else None


def run(arguments: argparse.Namespace) -> int:
    """Check, and print what is found; returns the exit code."""
    streams, found = check_files(arguments)
    if not master_answers():
        print('\n'.join(check.lines(found)))
        return fail('check', 'no ROS master answers at %s: the robot is not checked' % rosgraph.get_master_uri())
    rospy.init_node('check', anonymous=True, disable_signals=True, log_level=rospy.FATAL)
    master = rosgraph.get_master_uri()
    graph = graph_of(rpc.call(master, 'getSystemState'), rpc.call(master, 'getTopicTypes'))
    link = 1e3 * arguments.link if arguments.link else link_capacity(graph)
    robot, more = check_robot(streams, graph, arguments.seconds, link)
    found += more
    print('\n'.join([*check.table(robot, roles_of(streams)), '', *check.lines(found)]))
    return int(any(finding.level > WARN for finding in found))


def main() -> None:
    parser = argparse.ArgumentParser(
        prog='check', description='Say what is wrong with the streams, before a mission; to be run on the robot.',
        epilog='Exit code: 0 where there is no error, 1 where there is one, or no master.')
    parser.add_argument('streams', nargs='?', default='', metavar='STREAMS_YAML',
                        help="file that defines the streams (default: this package's config/streams.yaml)")
    parser.add_argument('--focus', default='', metavar='FILE',
                        help='file of the profiles, as focus_config of robot.launch')
    parser.add_argument('--key-file', default='', metavar='FILE', help="the link's key, as of robot.launch")
    parser.add_argument('--link', type=float, default=0.0, metavar='MBIT',
                        help='capacity of the link [Mbit/s] (default: what robot_sender has measured, if it runs)')
    parser.add_argument('--seconds', type=float, default=5.0, help='how long to listen (default: %(default)s)')
    arguments = parser.parse_args(rospy.myargv(sys.argv)[1:])
    run_node(lambda: run(arguments))
