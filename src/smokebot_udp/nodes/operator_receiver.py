# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side: receives the robot's streams and publishes them.

Parameters: OPERATOR_RECEIVER in nodes/parameters.py, listed in doc/parameters.md.

Each stream subscribes /smokebot_udp/<stream>/segments, an image stream also /smokebot_udp/<stream>/layers and
/smokebot_udp/<stream>/video, and a grid stream /smokebot_udp/<stream>/tiles. It publishes its operator_topic in the
node's namespace, which distinguishes several operators of one robot. Services: ~set_focus, the robot's mission focus;
~capture, an original of a stream, see operator_capture.py; ~take_control, ~release_control and ~estop, see
operator_control.py. Commands, services, actions and reliable relays go back over the same link, see way_back.py. Where
the robot has a master of its own, the robot's settings are mirrored in robot_sender/, in the node's namespace.
"""
from typing import Any, Mapping, Optional

import rospy

from .. import udpros
from ..monitoring.status import OPERATOR
from ..msg import RobotStatus
from ..streams import classified, live_tables
from ..streams.frame_prefix import with_prefix
from . import garbage, malloc_tuning
from .clock_sync import ClockClient
from .common import Parameters, operator_topic, read_streams, start_streams
from .compiled_codec import CompiledCodec
from .diagnostics import operator_diagnostics
from .held_reporter import HeldReporter
from .link_reporter import LinkReporter
from .live import LiveSettings
from .motion import MotionListener
from .namesake import SECOND_OPERATOR, living, wait_until_free
from .notice import Notice
from .opened import Opened, open_until_end
from .operator_capture import OperatorCapture
from .operator_control import OperatorControl
from .operator_stream import OperatorLink, OperatorStream
from .overlay import Overlay
from .parameter_watch import ParameterWatch
from .parameters import OPERATOR_RECEIVER
from .path_monitor import PathAnswers
from .problems import Problems
from .reliable_link import ReliableLink
from .robot_markers import RobotMarkers
from .rviz_displays import colours_of, odometry_of
from .settings_mirror import SettingsMirror
from .stale import StaleStreams
from .status_listener import StatusListener
from .transports import operator_transport
from .video_decoder import VideoDecoder
from .way import OperatorWay
from .way_back import WayBack
from .wifi_monitor import WifiMonitor


class OperatorReceiver:
    """Hosts the operator's streams; lives as long as its node.

    :param opened: what closes its parts
    """

    def __init__(self, opened: Opened) -> None:
        self._opened = opened
        problems = Problems()
        parameters = Parameters(OPERATOR_RECEIVER, problems.report)
        udpros.emulate_loss(parameters['loss'], parameters['loss_seed'])
        streams = read_streams(parameters)
        parameters.fill_in({'odom_topic': odometry_of(streams), 'base_frame': streams.frames.base})
        definitions, prefix = classified(streams), parameters['frame_prefix']
        self._transport = transport = opened.add(operator_transport(parameters))
        opened.add(PathAnswers(transport))
        notice = Notice()
        with udpros.registered_together():
            motion = opened.add(MotionListener(operator_topic(parameters['odom_topic']), parameters['cmd_vel_topic']))
            self._clock = opened.add(ClockClient(transport))
            self._reporter = opened.add(LinkReporter(transport))
            codec = opened.add(CompiledCodec())
            held = opened.add(HeldReporter(transport))
            self._control = control = opened.add(OperatorControl(transport, notice))
            link = OperatorLink(transport, motion.is_still, motion.images_compared, self._arrived, self._clock.offset,
                                codec, VideoDecoder, held.received, prefix, notice)
            self.streams = start_streams(
                definitions.streams, lambda name, settings: OperatorStream(name, settings, link), parameters.report,
                parameters.refused.__setitem__)
            for stream in self.streams.values():
                opened.add(stream)
            opened.add(OperatorCapture(transport, self.streams, codec, self._reporter.arrived, parameters))
            status = [stream.topic for stream in self.streams.values() if stream.assembler.MESSAGE is RobotStatus]
            robot = opened.add(StatusListener(status[0] if status else None))
            reliable = opened.add(ReliableLink(transport, OPERATOR))
            way_back = opened.add(WayBack(OPERATOR, definitions, OperatorWay(
                transport, control, reliable, prefix, self._view_age), parameters))
            wifi = opened.started(WifiMonitor(self._reporter.hosts, parameters['wifi_interface']))
            opened.add(operator_diagnostics(self.streams, way_back, self._clock, parameters, problems, robot,
                                            transport, lambda: wifi.state))
            self._start_displays(parameters, robot, wifi)
        stores = {name: stream.settings for name, stream in self.streams.items() if stream.settings.table}
        parts = [LiveSettings(name, store, problems.report) for name, store in {**stores, **way_back.stores}.items()]
        opened.add(ParameterWatch(parts, background=True))
        opened.add(self._mirror_settings({**self.streams, **way_back.streams}, reliable,
                                         parameters['focus_timeout'], problems))
        reliable.start()

    def _arrived(self, stream: str, number: int, seq: int, size: int, count: int, when: float, marked: int,
                 path: int) -> None:
        """Datagrams of a stream arrived, see udpros.depacketizer.Arrived; any thread."""
        self._reporter.arrived(stream, number, seq, size, count, when, marked, path)
        self._control.alive(when)

    def _start_displays(self, parameters: Parameters, robot: StatusListener, wifi: WifiMonitor) -> None:
        """Start what rviz shows beside the streams."""
        self._opened.add(StaleStreams(
            self.streams, robot.sent, operator_topic(parameters['stale_topic']),
            with_prefix(parameters['base_frame'], parameters['frame_prefix']), parameters['stale_after'],
            parameters['clear_stale']))
        self._opened.add(RobotMarkers(parameters))
        colours = colours_of({name: stream.settings.current for name, stream in self.streams.items()})
        self._opened.add(Overlay(self.streams, robot, self._control, operator_topic(parameters['overlay_topic']),
                                 colours, lambda: wifi.state.signal, self._transport.problem))

    def _view_age(self, name: str, now: float) -> Optional[float]:
        """How old what is shown of a stream is [s]; None: unknown."""
        stream, estimate = self.streams.get(name), self._clock.estimate
        return None if stream is None else stream.age(estimate.offset if estimate else None, now)

    def _mirror_settings(self, streams: Mapping[str, Any], reliable: ReliableLink, timeout: float,
                         problems: Problems) -> SettingsMirror:
        """The robot's settings at this master, unless they are there already."""
        robot = rospy.resolve_name('robot_sender')
        if not self._transport.own_masters or living(robot):
            return SettingsMirror(None, {}, reliable, timeout, problems.report)
        tables = {name: live_tables(stream.settings.current.requested).robot for name, stream in streams.items()}
        return SettingsMirror(robot, tables, reliable, timeout, problems.report)


def main() -> None:
    malloc_tuning.keep_freed_memory()
    udpros.race_all_connections()
    wait_until_free('operator_receiver', SECOND_OPERATOR)
    udpros.init_node('operator_receiver')
    with open_until_end() as opened:
        receiver = OperatorReceiver(opened)
    garbage.collect_regularly()
    rospy.loginfo('operator_receiver: receiving %s', ', '.join(receiver.streams) or 'nothing: no stream is valid')
    rospy.spin()
