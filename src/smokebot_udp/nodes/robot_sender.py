# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side: sends the streams of a streams.yaml over UDPROS.

Parameters

| name | type | default | unit | meaning |
|---|---|---|---|---|
| ~streams_file | str | config/streams.yaml of this package | | the streams by name |
| ~max_datagram_size | int | 1472 | byte | longest datagram: UDP payload, so that 1472 fills an Ethernet frame |
| ~pacing_rate | double | 400 | Mbit/s | all streams together leave no faster; 0: as fast as they come |
| ~pacing_burst | int | 16 | datagrams | so many may leave at once |
| ~<stream>/enabled | bool | as in streams.yaml | | dynamic: whether the stream is sent |
| ~<stream>/rate | double | as in streams.yaml | Hz | dynamic: at most so many messages a second |

Each stream subscribes its robot_topic and publishes smokebot_udp/<stream>/segments.
"""
import rospy
from dynamic_reconfigure.server import Server

from .. import udpros
from ..cfg import RobotStreamConfig
from ..streams import robot_class
from ..streams.base import Link
from .common import load_streams, number_parameter


class RobotSender:
    """Hosts the robot's streams; lives as long as its node."""

    def __init__(self):
        size = int(number_parameter('~max_datagram_size', 1472, least=256, most=65507))
        rate = number_parameter('~pacing_rate', 400.0, least=0.0)
        burst = number_parameter('~pacing_burst', 16, least=1)
        pacer = udpros.Pacer(rate * 1e6 / 8 if rate else None, int(burst) * size)
        self.streams = load_streams(robot_class, Link(size, pacer=pacer), prepare=_announce)
        self._servers = [Server(RobotStreamConfig, _reconfigure(stream), namespace='~' + name)
                         for name, stream in self.streams.items()]
        rospy.on_shutdown(self.close)

    def close(self):
        for stream in self.streams.values():
            stream.close()


def _announce(name, settings):
    """What streams.yaml says is what dynamic_reconfigure starts from, unless a parameter is set already."""
    for key in ('enabled', 'rate'):
        parameter = '~%s/%s' % (name, key)
        if not rospy.has_param(parameter):
            rospy.set_param(parameter, settings[key])


def _reconfigure(stream):
    def callback(config, level):
        stream.configure(config.enabled, config.rate)
        return config
    return callback


def main():
    rospy.init_node('robot_sender')
    sender = RobotSender()
    rospy.loginfo('robot_sender: sending %s', ', '.join(sender.streams) or 'nothing: no stream is right')
    rospy.spin()
