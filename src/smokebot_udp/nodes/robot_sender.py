# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side: sends the streams of a streams.yaml over UDPROS, as the mission focus has it.

Parameters

| name | type | default | unit | meaning |
|---|---|---|---|---|
| ~streams_file | str | config/streams.yaml of this package | | the streams by name |
| ~focus_file | str | config/focus.yaml of this package | | the profiles by name |
| ~max_datagram_size | int | 1472 | byte | longest datagram: UDP payload, so that 1472 fills an Ethernet frame |
| ~adapt | bool | true | | whether the rate follows what the link carries, as operators report it; else it is max_rate |
| ~max_rate | double | 400 | Mbit/s | all streams together leave no faster; 0: as fast as they come |
| ~min_rate | double | 0.1 | Mbit/s | nor slower, whatever is reported, or where nothing is |
| ~start_rate | double | 0.5 | Mbit/s | until the first report |
| ~focus | str | default | | dynamic: the mission focus, a profile of focus_file; default: as streams.yaml has it |
| ~<stream>/<setting> | | as in streams.yaml | | dynamic: the settings of a stream that may change while it runs |

Each stream subscribes its robot_topic and publishes smokebot_udp/<stream>/segments. ~status (latched) tells the focus
and what each stream sends, ~focus/modified (latched) whether any of it was set by hand since the focus was switched.
Service: ~set_focus.
"""
import math

import rospy

from .. import udpros
from ..congestion.estimator import MBIT, Limits
from ..congestion.packet_scheduler import Pace
from ..mission import focus
from ..streams import robot_class
from ..streams.base import Link
from ..streams.outbox import Outbox
from ..udpros.endpoints import IP_UDP_HEADERS
from . import memory
from .allocation import Allocation
from .clock_sync import ClockServer
from .common import Parameters, load_streams, read_file
from .diagnostics import robot_diagnostics
from .focus import FocusControl
from .link_control import LinkControl
from .problems import Problems

BURST = 16
"""Datagrams that may leave at once on a fast link: roscpp's receiver holds 92, a Wi-Fi driver's queue not many more."""


class RobotSender:
    """Hosts the robot's streams; lives as long as its node."""

    def __init__(self):
        problems = Problems()
        parameters = Parameters(problems.tell)
        size = int(parameters.number('max_datagram_size', 1472, least=256, most=65507))
        profiles = read_file(parameters, 'focus_file', 'focus.yaml', focus.load)
        with udpros.registered_together():
            self._link = LinkControl(*_rates(parameters))
            self._outbox = Outbox(Pace(self._link.start_rate, BURST * (size + IP_UDP_HEADERS)), self._link.departed,
                                  _tell)
            self._outbox.start()
            link = Link(size, outbox=self._outbox)
            self.streams = load_streams(parameters, robot_class, link)
            allocation = Allocation(self.streams, link)
            self.focus = FocusControl(self.streams, profiles, allocation, problems.tell)
            self._link.start(self._outbox, allocation)
            self._clock = ClockServer()
            self._diagnostics = robot_diagnostics(self.streams, self._link, parameters, problems)
        rospy.on_shutdown(self.close)

    def close(self):
        self._diagnostics.close()
        self._link.close()
        self._clock.close()
        self.focus.close()
        for stream in self.streams.values():
            stream.close()
        self._outbox.stop()


def _rates(parameters):
    """(supervisor.estimate.Limits, adapt)"""
    most = parameters.number('max_rate', 400.0, least=0.0) or math.inf
    least = parameters.number('min_rate', 0.1, least=0.01)
    start = parameters.number('start_rate', 0.5, least=0.01)
    return Limits(min(least, most) * MBIT, start * MBIT, most * MBIT), parameters.flag('adapt', True)


def _tell(stream, error):
    if not rospy.is_shutdown():
        rospy.logerr_throttle(5, "stream '%s' cannot be sent: %s" % (stream, error))


def main():
    memory.keep_freed()
    udpros.race_all_connections()
    rospy.init_node('robot_sender')
    sender = RobotSender()
    rospy.loginfo('robot_sender: sending %s', ', '.join(sender.streams) or 'nothing: no stream is right')
    rospy.spin()
