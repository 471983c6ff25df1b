#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A robot with two addresses: the desk goes on over the other one where one is cut, and comes back.

evaluation/path_cuts.py measures how fast; bounds are wide here.
"""
import pathlib
import sys
import unittest

import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import give_time, undisturbed, wait_for

from evaluation.listener import Listener
from evaluation.path_cuts import ADDRESSES, COMMAND, SETTLED, TOPICS, PathCuts, longest_gap
from smokebot_udp.link_lab.lab import LabError
from smokebot_udp.link_lab.second_link import SECOND_DEVICE

CUT = 3.0
"""[s]"""

MAX_GAP, MAX_COMMAND_GAP = 1.0, 0.3
"""With one address they are CUT at least. Commands go by both paths, so nothing has to be noticed first [s]."""

MAX_IDLE, MAX_DRIVEN = 2000.0, 12000.0
"""What a metered path carries: probes; and commands twenty times a second with their repetitions [byte/s]."""


MIN_SHARED = 10000.0
"""Images [byte/s]."""


class TwoPaths(unittest.TestCase):

    def start(self, *sender: str) -> None:
        """Start the nodes, robot_sender with these arguments."""
        try:
            self.run_ = PathCuts(sender=sender)
        except LabError as error:
            raise unittest.SkipTest(str(error)) from None
        self.addCleanup(self.run_.close)
        self.diagnostics = Listener(self.run_.stack)
        self.diagnostics.subscribe([['/diagnostics', 'link transport', 'TCPROS']])

    def used(self) -> str:
        """Which address of the robot diagnostics say that is used; '': none were heard."""
        said = [heard.amount['connected to'] for heard in self.diagnostics.heard if heard.amount]
        return said[-1].split(' at ')[1].split(' ')[0] if said and ' at ' in said[-1] else ''

    @undisturbed()
    def test_a_cut_of_the_preferred_path_is_hardly_seen(self) -> None:
        self.start('_metered:=' + SECOND_DEVICE)
        wait_for(lambda: self.used() == ADDRESSES[0], 30, 'the preferred path')
        give_time(SETTLED)
        self.assertLess(self.run_.idle_rate(3.0), MAX_IDLE)
        self.run_.drive()
        self.assertLess(self.run_.idle_rate(3.0), MAX_DRIVEN)
        for topic, heard in self.run_.cut(CUT).items():
            self.assertLess(longest_gap(heard), MAX_COMMAND_GAP if topic == COMMAND else MAX_GAP, topic)
        self.assertEqual(self.used(), ADDRESSES[1])
        wait_for(lambda: self.used() == ADDRESSES[0], 30, 'the preferred path again')
        self.assertEqual(set(TOPICS), set(self.run_.operator.first(TOPICS, 10.0)))

    @undisturbed()
    def test_streams_are_spread_over_both_paths(self) -> None:
        self.start()
        wait_for(lambda: self.used() == ADDRESSES[0], 30, 'the preferred path')
        wait_for(lambda: self.run_.idle_rate(1.0) > MIN_SHARED, 30, 'streams on the second path')
        for topic, heard in self.run_.cut(CUT).items():
            if topic != COMMAND:
                self.assertLess(longest_gap(heard), MAX_GAP, topic)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'two_paths', TwoPaths)
