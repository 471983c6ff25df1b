#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""States of two nodes that come faster than the link carries them: the newest of each arrives."""
import pathlib
import random
import sys
import unittest
from typing import List

import rospy
import rostest
from std_msgs.msg import String

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import is_silent, ticks, wait_for

START = 60.0
"""Time for nodes to start on a busy machine [s]."""

SIZE = 30000
"""Size of a state as text: 50 of them a second are ten times what all reliable messages of a node may take [byte]."""


class NewestRelay(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('newest_relay')
        cls.states: List[str] = []
        rospy.Subscriber('/operator/states', String, lambda message: cls.states.append(message.data))
        cls.publisher = rospy.Publisher('/test/states', String, queue_size=1)
        wait_for(cls.publisher.get_num_connections, START, 'the relay')
        wait_for(lambda: cls.states, START, "the other node's state")

    def test_the_last_state_of_each_node_arrives_and_nothing_piles_up(self) -> None:
        chance, last = random.Random(1), 100
        for _, number in zip(ticks(50.0), range(1, last + 1)):
            noise = '%0*x' % (SIZE, chance.getrandbits(4 * SIZE))
            self.publisher.publish('%d %s' % (number, noise))
        wait_for(lambda: any(state.startswith('%d ' % last) for state in self.states), 10, 'the last state')
        own = [int(state.split()[0]) for state in self.states if state != 'other']
        self.assertEqual(own, sorted(set(own)))
        self.assertLess(len(own), last)
        self.assertGreaterEqual(self.states.count('other'), len(own) - 1)

    def test_it_is_switched_off_on_the_robot(self) -> None:
        rospy.set_param('/robot_sender/states/enabled', False)
        wait_for(lambda: is_silent(self.states), what='silence')     # some is on its way
        del self.states[:]
        rospy.set_param('/robot_sender/states/enabled', True)
        wait_for(lambda: self.states, what="the other node's state")


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'newest_relay', NewestRelay)
