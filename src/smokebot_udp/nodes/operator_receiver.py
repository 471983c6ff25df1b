# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side: makes pictures of what arrives of the robot's streams.

Parameters

| name | type | default | unit | meaning |
|---|---|---|---|---|
| ~streams_file | str | config/streams.yaml of this package | | the streams by name: the robot's file |
| ~max_datagram_size | int | 1472 | byte | longest datagram that is taken |
| ~receive_buffer | int | 4194304 | byte | asked of the kernel for each stream; net.core.rmem_max limits it |
| ~loss | double | 0 | | share of the datagrams to drop on arrival, to demonstrate a bad link |
| ~loss_seed | int | 0 | | which datagrams these are |
| ~odom_topic | str | /operator/odom | | nav_msgs/Odometry that tells whether the robot stands |
| ~cmd_vel_topic | str | /cmd_vel | | geometry_msgs/Twist that tells it where odometry is silent; else the pictures do |
| ~focus_patience | double | 10 | s | so long ~set_focus asks the robot |
| ~stale_after | double | 2 | s | rviz' 3D view says NO DATA where nothing came for so long |
| ~stale_topic | str | /operator/stale | | visualization_msgs/Marker that says it |
| ~base_frame | str | base_link | | the robot's, above which it stands |
| ~<stream>/<setting> | | as in streams.yaml | | dynamic: the settings of a stream that may change while it runs |

Each stream subscribes smokebot_udp/<stream>/segments and publishes its operator_topic. Service: ~set_focus, the robot's
mission focus.
"""
import threading

import numpy as np
import rospy

from .. import udpros
from ..mission.parameters import live
from ..msg import RobotStatus
from ..streams import operator_class
from ..streams.base import Link
from . import memory
from .clock_sync import ClockClient
from .common import Parameters, load_streams
from .diagnostics import operator_diagnostics
from .focus_client import FocusClient
from .link_reporter import LinkReporter
from .live import LiveSettings, ParameterWatch
from .motion import Motion
from .problems import Problems
from .stale import StaleMarker


class OperatorReceiver:
    """Hosts the operator's streams; lives as long as its node."""

    def __init__(self):
        problems = Problems()
        parameters = Parameters(problems.tell)
        with udpros.registered_together():
            self._motion = Motion(parameters.text('odom_topic', '/operator/odom'),
                                  parameters.text('cmd_vel_topic', '/cmd_vel'))
            self._clock = ClockClient()
            self._reporter = LinkReporter()
            self.streams = load_streams(parameters, operator_class, self._link(parameters))
            status = [stream.topic for stream in self.streams.values() if stream.MESSAGE is RobotStatus]
            self._focus = FocusClient(status[0] if status else None,
                                      parameters.number('focus_patience', 10.0, least=0.1))
            self._diagnostics = operator_diagnostics(self.streams, self._clock, parameters, problems, self._focus.sent)
            self._stale = StaleMarker(
                self.streams, self._focus.sent, parameters.text('stale_topic', '/operator/stale'),
                parameters.text('base_frame', 'base_link'), parameters.number('stale_after', 2.0, least=0.1))
        parts = [LiveSettings(name, live(stream.PARAMETERS), stream.settings, stream.configure, threading.RLock(),
                              problems.tell)
                 for name, stream in self.streams.items() if live(stream.PARAMETERS)]
        self._watch = ParameterWatch(parts, background=True)
        rospy.on_shutdown(self.close)

    def _link(self, parameters):
        loss = parameters.number('loss', 0.0, least=0.0, most=1.0)
        seed = int(parameters.number('loss_seed', 0, least=0))
        return Link(int(parameters.number('max_datagram_size', 1472, least=256, most=65507)),
                    receive_buffer=int(parameters.number('receive_buffer', 4 << 20, least=4096, most=1 << 30)),
                    drop=_demonstrate(loss, seed) if loss else None, motion=self._motion,
                    arrived=self._reporter.arrived, clock_offset=self._clock.offset)

    def close(self):
        self._stale.close()
        self._diagnostics.close()
        self._focus.close()
        self._watch.stop()
        self._motion.close()
        for stream in self.streams.values():
            stream.close()
        self._reporter.close()
        self._clock.close()


def _demonstrate(loss, seed):
    """A function that loses each datagram with the same probability, repeatably."""
    random = np.random.RandomState(seed)
    return lambda count: random.random_sample(count) < loss


def main():
    memory.keep_freed()
    udpros.race_all_connections()
    rospy.init_node('operator_receiver')
    receiver = OperatorReceiver()
    rospy.loginfo('operator_receiver: receiving %s', ', '.join(receiver.streams) or 'nothing: no stream is right')
    rospy.spin()
