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
from typing import Optional

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
from .operator_capture import OperatorCapture
from .operator_control import OperatorControl
from .operator_stream import OperatorLink, OperatorStream
from .overlay import Overlay
from .parameter_watch import ParameterWatch
from .parameters import OPERATOR_RECEIVER
from .path_monitor import PathAnswers
from .problems import Problems
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
    """Hosts the operator's streams; lives as long as its node."""

    def __init__(self) -> None:
        problems = Problems()
        parameters = Parameters(OPERATOR_RECEIVER, problems.report)
        udpros.emulate_loss(parameters['loss'], parameters['loss_seed'])
        streams = read_streams(parameters)
        parameters.fill_in({'odom_topic': odometry_of(streams), 'base_frame': streams.frames.base})
        definitions = classified(streams)
        self._transport = operator_transport(parameters)
        self._path = PathAnswers(self._transport)
        notice = Notice()
        with udpros.registered_together():
            self._motion = MotionListener(operator_topic(parameters['odom_topic']), parameters['cmd_vel_topic'])
            self._clock = ClockClient(self._transport)
            self._reporter = LinkReporter(self._transport)
            self._codec = CompiledCodec()
            self._held = HeldReporter(self._transport)
            control = self._control = OperatorControl(self._transport, notice)
            link = OperatorLink(self._transport, self._motion.is_still, self._motion.images_compared,
                                self._arrived, self._clock.offset, self._codec, VideoDecoder,
                                self._held.received, parameters['frame_prefix'], notice)
            self.streams = start_streams(
                definitions.streams, lambda name, settings: OperatorStream(name, settings, link), parameters.report,
                parameters.refused.__setitem__)
            self._capture = OperatorCapture(self._transport, self.streams, self._codec, self._reporter.arrived,
                                            parameters)
            status = [stream.topic for stream in self.streams.values() if stream.assembler.MESSAGE is RobotStatus]
            self._robot = StatusListener(status[0] if status else None)
            self._way_back = WayBack(
                OPERATOR, definitions, control, lambda reliable: OperatorWay(
                    self._transport, control, reliable, parameters.report, parameters['frame_prefix'], self._view_age),
                self._transport, parameters)
            self._wifi = WifiMonitor(self._reporter.hosts, parameters['wifi_interface'])
            self._wifi.start()
            self._diagnostics = operator_diagnostics(self.streams, self._way_back, self._clock, parameters, problems,
                                                     self._robot.sent, self._transport, lambda: self._wifi.state)
            self._start_displays(parameters, control)
        stores = {name: stream.settings for name, stream in self.streams.items() if stream.settings.table}
        parts = [LiveSettings(name, store, problems.report)
                 for name, store in {**stores, **self._way_back.stores}.items()]
        self._watch = ParameterWatch(parts, background=True)
        self._mirror = self._mirror_settings(parameters['focus_patience'], problems)
        rospy.on_shutdown(self.close)

    def _arrived(self, stream: str, number: int, seq: int, size: int, count: int, when: float, marked: int) -> None:
        """Datagrams of a stream arrived, see udpros.depacketizer.Arrived; any thread."""
        self._reporter.arrived(stream, number, seq, size, count, when, marked)
        self._control.alive(when)

    def _start_displays(self, parameters: Parameters, control: OperatorControl) -> None:
        """Start what rviz shows beside the streams."""
        self._stale = StaleStreams(
            self.streams, self._robot.sent, operator_topic(parameters['stale_topic']),
            with_prefix(parameters['base_frame'], parameters['frame_prefix']), parameters['stale_after'],
            parameters['clear_stale'])
        self._markers = RobotMarkers(parameters)
        self._overlay = Overlay(self.streams, self._robot, control, operator_topic(parameters['overlay_topic']),
                                colours_of({name: stream.settings.current for name, stream in self.streams.items()}),
                                lambda: self._wifi.state.signal)

    def _view_age(self, name: str, now: float) -> Optional[float]:
        """How old what is shown of a stream is [s]; None: unknown."""
        stream, estimate = self.streams.get(name), self._clock.estimate
        return None if stream is None else stream.age(estimate.offset if estimate else None, now)

    def _mirror_settings(self, timeout: float, problems: Problems) -> SettingsMirror:
        """The robot's settings at this master, unless they are there already."""
        robot = rospy.resolve_name('robot_sender')
        if not self._transport.own_masters or living(robot):
            return SettingsMirror(None, {}, self._transport, timeout, problems.report)
        tables = {name: live_tables(stream.settings.current.requested).robot
                  for name, stream in {**self.streams, **self._way_back.streams}.items()}
        return SettingsMirror(robot, tables, self._transport, timeout, problems.report)

    def close(self) -> None:
        self._mirror.close()
        self._overlay.close()
        self._markers.close()
        self._stale.close()
        self._diagnostics.close()
        self._wifi.close()
        self._robot.close()
        self._capture.close()
        self._watch.close()
        self._motion.close()
        self._way_back.close()
        for stream in self.streams.values():
            stream.close()
        self._held.close()
        self._codec.close()
        self._reporter.close()
        self._path.close()
        self._clock.close()
        self._transport.close()


def main() -> None:
    malloc_tuning.keep_freed_memory()
    udpros.race_all_connections()
    wait_until_free('operator_receiver', SECOND_OPERATOR)
    udpros.init_node('operator_receiver')
    receiver = OperatorReceiver()
    garbage.collect_regularly()
    rospy.loginfo('operator_receiver: receiving %s', ', '.join(receiver.streams) or 'nothing: no stream is valid')
    rospy.spin()
