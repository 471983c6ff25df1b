#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Reliable relays with `latch`: a state arrives after a cut, but the robot is not told what is old."""
import pathlib
import sys
import unittest
from typing import Any, Dict, List

import rospy
import rostest
from std_msgs.msg import String

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from reliable_pair import ReliablePair
from waiting import is_sent_here, stays, wait_for

from smokebot_udp.nodes.way_back import operator_relay, robot_relay
from smokebot_udp.streams.config import load

STREAM = """
streams:
  state: {type: relay, message_type: std_msgs/String, robot_topic: /robot/state, operator_topic: /operator/state,
          reliable: true, latch: true, max_age: 1.0, direction: %s}
"""


def settings(direction: str) -> Dict[str, Any]:
    return load(STREAM % direction)[0]['state']


class LatchedRelay(unittest.TestCase):

    def setUp(self) -> None:
        self.pair = ReliablePair()
        self.addCleanup(self.pair.close)

    def start(self, make: Any, direction: str, way: Any) -> Any:
        relay = make('state', settings(direction), way)
        relay.start()
        self.addCleanup(relay.close)
        return relay

    def both(self, direction: str, source: str, sink: str) -> None:
        """Start both sides, and publish what is relayed."""
        self.robot = self.start(robot_relay, direction, self.pair.robot)
        self.start(operator_relay, direction, self.pair.operator)
        self.got: List[str] = []
        subscriber = rospy.Subscriber(sink, String, lambda message: self.got.append(message.data))
        self.publisher = rospy.Publisher(source, String, queue_size=1)
        for topic in (subscriber, self.publisher):
            self.addCleanup(topic.unregister)
            wait_for(lambda name=topic.name: is_sent_here(name), what=topic.name)
        wait_for(self.pair.operator.reliable.peers)
        wait_for(self.pair.robot.reliable.peers)
        self.publisher.publish('first')
        wait_for(lambda: self.got == ['first'], what='the first state')

    def test_a_state_arrives_after_a_cut(self) -> None:
        self.both('to_operator', '/robot/state', '/operator/state')
        self.pair.cable.is_cut = True
        self.publisher.publish('second')
        stays(lambda: self.got == ['first'], 2.0, 'the cut')
        self.pair.cable.is_cut = False
        wait_for(lambda: self.got == ['first', 'second'], what='the state that was published during the cut')

    def test_a_restarted_robot_is_not_told_what_is_old(self) -> None:
        self.both('to_robot', '/operator/state', '/robot/state')
        stays(lambda: self.got == ['first'], 1.5, 'the one message')
        self.restart()
        stays(lambda: self.got == ['first'], 1.5, 'the one message')
        self.publisher.publish('second')
        wait_for(lambda: self.got == ['first', 'second'], what='a new message')

    def restart(self) -> None:
        """The robot's node is another one now."""
        self.robot.close()
        self.pair.restart_robot()
        self.robot = self.start(robot_relay, 'to_robot', self.pair.robot)
        wait_for(lambda: self.pair.robot.reliable.peers() and self.pair.operator.reliable.peers(), what='the new robot')


if __name__ == '__main__':
    rospy.init_node('latched_relay')
    rostest.rosrun('smokebot_udp', 'latched_relay', LatchedRelay)
