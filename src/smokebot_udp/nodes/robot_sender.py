# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side: sends the streams of a streams.yaml over UDPROS, as the mission focus has it.

Parameters

| name | type | default | unit | meaning |
|---|---|---|---|---|
| ~streams_file | str | config/streams.yaml of this package | | the streams by name |
| ~focus_file | str | config/focus.yaml of this package | | the profiles by name |
| ~max_datagram_size | int | 1472 | byte | longest datagram: UDP payload, so that 1472 fills an Ethernet frame |
| ~pacing_rate | double | 400 | Mbit/s | all streams together leave no faster; 0: as fast as they come |
| ~pacing_burst | int | 16 | datagrams | so many may leave at once |
| ~focus | str | default | | dynamic: the mission focus, a profile of focus_file; default: as streams.yaml has it |
| ~<stream>/<setting> | | as in streams.yaml | | dynamic: the settings of a stream that may change while it runs |

Each stream subscribes its robot_topic and publishes smokebot_udp/<stream>/segments. ~status (latched) tells the focus
and what each stream sends, ~focus/modified (latched) whether any of it was set by hand since the focus was switched.
Service: ~set_focus.
"""
import rospy

from .. import udpros
from ..streams import robot_class
from ..streams.base import Link
from ..streams.outbox import Outbox
from ..supervisor import focus
from ..supervisor.pace import Pace
from ..udpros.endpoints import IP_UDP_HEADERS
from . import memory
from .clock_sync import ClockServer
from .common import Parameters, load_streams, read_file
from .diagnostics import robot_diagnostics
from .focus import FocusControl
from .problems import Problems


class RobotSender:
    """Hosts the robot's streams; lives as long as its node."""

    def __init__(self):
        problems = Problems()
        parameters = Parameters(problems.tell)
        size = int(parameters.number('max_datagram_size', 1472, least=256, most=65507))
        rate = parameters.number('pacing_rate', 400.0, least=0.0)
        burst = parameters.number('pacing_burst', 16, least=1)
        profiles = read_file(parameters, 'focus_file', 'focus.yaml', focus.load)
        with udpros.registered_together():
            self._outbox = Outbox(Pace(rate * 1e6 / 8 if rate else None, int(burst) * (size + IP_UDP_HEADERS)),
                                  on_error=_tell)
            self._outbox.start()
            self.streams = load_streams(parameters, robot_class, Link(size, outbox=self._outbox))
            self.focus = FocusControl(self.streams, profiles, problems.tell)
            self._clock = ClockServer()
            self._diagnostics = robot_diagnostics(self.streams, parameters, problems)
        rospy.on_shutdown(self.close)

    def close(self):
        self._diagnostics.close()
        self._clock.close()
        self.focus.close()
        for stream in self.streams.values():
            stream.close()
        self._outbox.stop()


def _tell(stream, error):
    if not rospy.is_shutdown():
        rospy.logerr_throttle(5, "stream '%s' cannot be sent: %s" % (stream, error))


def main():
    memory.keep_freed()
    rospy.init_node('robot_sender')
    sender = RobotSender()
    rospy.loginfo('robot_sender: sending %s', ', '.join(sender.streams) or 'nothing: no stream is right')
    rospy.spin()
