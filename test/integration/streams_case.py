# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of the streams in world_streams.yaml share."""
import unittest
import xmlrpc.client
from typing import Any, Callable, List

import rosgraph
from waiting import errors_logged, is_sent_here, wait_for

from smokebot_udp import udpros, version

LOSSES = {0: '/operator', 50: '/loss50', 90: '/loss90'}
"""{loss [%]: where a receiver with that loss publishes}"""


class StreamsCase(unittest.TestCase):
    """A test case at the robot's side of receivers with 0, 50 and 90 % loss."""
    errors: List[str]

    @classmethod
    def listen(cls, *streams: str) -> None:
        """Record errors, and wait until those of the robot come, and every stream reaches all three receivers."""
        cls.errors = errors_logged()
        wait_for(lambda: is_sent_here('/rosout', '/robot_sender'), what="the robot's log")
        for stream in streams:
            wait_for(lambda name=stream: cls.receivers(name) == len(LOSSES), what='the receivers of ' + stream)

    @staticmethod
    def receivers(stream: str) -> int:
        """The number of nodes to which robot_sender sends this stream by UDP."""
        try:
            uri = rosgraph.Master('/test').lookupNode('/robot_sender')
        except rosgraph.MasterError:
            return 0
        with xmlrpc.client.ServerProxy(uri) as node:
            return sum(entry[3:5] == ['UDPROS', '/smokebot_udp/%s/segments' % stream]
                       for entry in node.getBusInfo('/test')[2])

    def refused(self, publisher: Any, message: Any, stream: str, words: str) -> None:
        """A bad message is reported with the stream and what is wrong."""
        del self.errors[:]
        publisher.publish(message)
        wait_for(lambda: any("stream '%s'" % stream in error and words in error for error in self.errors), 5, words)

    def flood(self, stream: str, message_class: Any, forge: Callable[[], Any], count: int = 300) -> None:
        """Send forged segments to all receivers of a stream."""
        hostile = udpros.Publisher('/smokebot_udp/%s/segments' % stream, message_class, queue_size=10,
                                   headers=version.headers())
        wait_for(lambda: len(hostile.connections()) == len(LOSSES), what='the receivers')
        for _ in range(count):
            hostile.publish(forge())
        hostile.unregister()
