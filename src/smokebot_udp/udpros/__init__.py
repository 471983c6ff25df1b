# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS for rospy, interoperable with roscpp: rospy's Publisher and Subscriber over UDP.

    from smokebot_udp import udpros
    rospy.init_node('talker')
    publisher = udpros.Publisher('chatter', String, queue_size=10)
    subscriber = udpros.Subscriber('chatter', String, callback, transport='udp')

It does not need the rest of this package. The protocol is described in doc/wire_format.md.
"""
from .ending import on_end
from .frame import Frame
from .loss_emulation import emulate_loss
from .registration import registered_together
from .rospy_binding import drop_publisher, refused_requests
from .rpc import race_all_connections
from .starting import init_node
from .topics import Publisher, Subscriber

__all__ = ['Frame', 'Publisher', 'Subscriber', 'drop_publisher', 'emulate_loss', 'init_node', 'on_end',
           'race_all_connections', 'refused_requests', 'registered_together']
