# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS for rospy, interoperable with roscpp: Publisher and Subscriber as rospy's, over UDP.

    from smokebot_udp import udpros
    rospy.init_node('talker')
    publisher = udpros.Publisher('chatter', String, queue_size=10)
    subscriber = udpros.Subscriber('chatter', String, callback, transport='udp')

Usable without the rest of this package. doc/wire_format.md has the protocol.
"""
from .frame import Frame
from .pacer import Pacer
from .registration import registered_together
from .rpc import race_all_connections
from .topics import Publisher, Subscriber

__all__ = ['Frame', 'Pacer', 'Publisher', 'Subscriber', 'race_all_connections', 'registered_together']
