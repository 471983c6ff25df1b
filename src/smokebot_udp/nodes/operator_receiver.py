# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side: receives the robot's streams and publishes them.

Parameters: OPERATOR_RECEIVER in nodes/parameters.py, listed in doc/parameters.md.

Each stream subscribes /smokebot_udp/<stream>/segments, an image stream also /smokebot_udp/<stream>/layers, and a grid
stream /smokebot_udp/<stream>/tiles. It publishes its operator_topic in the node's namespace, which distinguishes
several operators of one robot. Service: ~set_focus, the robot's mission focus. Where the robot has a master of its own,
the robot's settings are mirrored in robot_sender/, in the node's namespace.
"""
from typing import Optional

import rospy

from .. import udpros
from ..mission.parameters import live
from ..msg import RobotStatus
from ..srv import SetFocus
from ..streams import encoder_class
from . import garbage, malloc_tuning
from .clock_sync import ClockClient
from .common import Parameters, operator_topic, read_streams, start_streams
from .compiled_codec import CompiledCodec
from .diagnostics import operator_diagnostics
from .focus_client import FocusClient
from .held_reporter import HeldReporter
from .link_reporter import LinkReporter
from .live import LiveSettings, ParameterWatch
from .motion import MotionListener
from .namesake import SECOND_OPERATOR, living, wait_until_free
from .operator_stream import OperatorLink, OperatorStream
from .parameters import OPERATOR_RECEIVER
from .problems import Problems
from .settings_mirror import SettingsMirror
from .stale import StaleMarker
from .transports import operator_transport


class OperatorReceiver:
    """Hosts the operator's streams; lives as long as its node."""

    def __init__(self) -> None:
        problems = Problems()
        parameters = Parameters(OPERATOR_RECEIVER, problems.report)
        udpros.emulate_loss(parameters['loss'], parameters['loss_seed'])
        definitions = read_streams(parameters)
        self._transport = operator_transport(parameters)
        with udpros.registered_together():
            self._motion = MotionListener(operator_topic(parameters['odom_topic']), parameters['cmd_vel_topic'])
            self._clock = ClockClient(self._transport)
            self._reporter = LinkReporter(self._transport)
            self._codec = CompiledCodec()
            self._held = HeldReporter(self._transport)
            link = OperatorLink(self._transport, self._motion.is_still, self._motion.images_compared,
                                self._reporter.arrived, self._clock.offset, self._codec, self._held.received,
                                parameters['frame_prefix'])
            self.streams = start_streams(
                definitions, lambda name, settings: OperatorStream(name, settings, link), parameters.report)
            status = [stream.topic for stream in self.streams.values() if stream.assembler.MESSAGE is RobotStatus]
            self._focus = FocusClient(status[0] if status else None, parameters['focus_patience'],
                                      self._transport)
            self._diagnostics = operator_diagnostics(self.streams, self._clock, parameters, problems, self._focus.sent,
                                                     self._transport)
            self._stale = StaleMarker(self.streams, self._focus.sent, operator_topic(parameters['stale_topic']),
                                      parameters['frame_prefix'] + parameters['base_frame'], parameters['stale_after'])
        parts = [LiveSettings(name, stream.settings, problems.report) for name, stream in self.streams.items()
                 if stream.settings.table]
        self._watch = ParameterWatch(parts, background=True)
        self._mirror = self._mirror_settings(problems)
        rospy.on_shutdown(self.close)

    def _mirror_settings(self, problems: Problems) -> Optional[SettingsMirror]:
        """The robot's settings at this master, unless they are there already."""
        robot = rospy.resolve_name('robot_sender')
        if not self._transport.own_masters or living(robot):
            return None
        rospy.Service(robot + '/set_focus', SetFocus, self._focus.serve)
        tables = {name: live(encoder_class(stream.settings.current['type']).PARAMETERS)
                  for name, stream in self.streams.items()}
        return SettingsMirror(robot, tables, self._transport, problems.report)

    def close(self) -> None:
        if self._mirror is not None:
            self._mirror.close()
        self._stale.close()
        self._diagnostics.close()
        self._focus.close()
        self._watch.stop()
        self._motion.close()
        for stream in self.streams.values():
            stream.close()
        self._held.close()
        self._codec.close()
        self._reporter.close()
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
