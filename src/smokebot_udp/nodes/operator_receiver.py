# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side: receives the robot's streams and publishes them.

Parameters: OPERATOR_RECEIVER in nodes/parameters.py, listed in doc/parameters.md.

Each stream subscribes /smokebot_udp/<stream>/segments, an image stream also /smokebot_udp/<stream>/layers, and a grid
stream /smokebot_udp/<stream>/tiles. It publishes its operator_topic in the node's namespace, which distinguishes
several operators of one robot. Service: ~set_focus, the robot's mission focus.
"""
import rospy

from .. import udpros
from ..msg import RobotStatus
from . import garbage, malloc_tuning
from .clock_sync import ClockClient
from .common import Parameters, load_streams, operator_topic
from .compiled_codec import CompiledCodec
from .diagnostics import operator_diagnostics
from .focus_client import FocusClient
from .held_reporter import HeldReporter
from .link_reporter import LinkReporter
from .live import LiveSettings, ParameterWatch
from .motion import MotionListener
from .namesake import SECOND_OPERATOR, wait_until_free
from .operator_stream import OperatorLink, OperatorStream
from .parameters import OPERATOR_RECEIVER
from .problems import Problems
from .stale import StaleMarker


class OperatorReceiver:
    """Hosts the operator's streams; lives as long as its node."""

    def __init__(self) -> None:
        problems = Problems()
        parameters = Parameters(OPERATOR_RECEIVER, problems.report)
        udpros.emulate_loss(parameters['loss'], parameters['loss_seed'])
        with udpros.registered_together():
            self._motion = MotionListener(operator_topic(parameters['odom_topic']), parameters['cmd_vel_topic'])
            self._clock = ClockClient()
            self._reporter = LinkReporter()
            self._codec = CompiledCodec()
            self._held = HeldReporter(parameters['max_datagram_size'])
            link = OperatorLink(parameters['max_datagram_size'], parameters['receive_buffer'], self._motion.is_still,
                                self._motion.images_compared, self._reporter.arrived, self._clock.offset, self._codec,
                                self._held.received)
            self.streams = load_streams(parameters, lambda name, settings: OperatorStream(name, settings, link))
            status = [stream.topic for stream in self.streams.values() if stream.assembler.MESSAGE is RobotStatus]
            self._focus = FocusClient(status[0] if status else None, parameters['focus_patience'])
            self._diagnostics = operator_diagnostics(self.streams, self._clock, parameters, problems, self._focus.sent)
            self._stale = StaleMarker(self.streams, self._focus.sent, operator_topic(parameters['stale_topic']),
                                      parameters['base_frame'], parameters['stale_after'])
        parts = [LiveSettings(name, stream.settings, problems.report) for name, stream in self.streams.items()
                 if stream.settings.table]
        self._watch = ParameterWatch(parts, background=True)
        rospy.on_shutdown(self.close)

    def close(self) -> None:
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


def main() -> None:
    malloc_tuning.keep_freed_memory()
    udpros.race_all_connections()
    wait_until_free('operator_receiver', SECOND_OPERATOR)
    udpros.init_node('operator_receiver')
    receiver = OperatorReceiver()
    garbage.collect_regularly()
    rospy.loginfo('operator_receiver: receiving %s', ', '.join(receiver.streams) or 'nothing: no stream is valid')
    rospy.spin()
