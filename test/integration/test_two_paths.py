#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A robot with two addresses: the desk goes on over the other one where one is cut, and comes back.

evaluation/path_cuts.py measures how fast; bounds are wide here.
"""
import pathlib
import sys
import unittest
from typing import Any

import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import give_time, undisturbed, wait_for

from evaluation.listener import Listener
from evaluation.path_cuts import ADDRESSES, COMMAND, SETTLED, TOPICS, PathCuts, longest_gap
from smokebot_udp.link_lab.lab import DEVICE, LabError
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

    def start(self, *sender: str, **options: Any) -> None:
        """Start the nodes, robot_sender with these arguments."""
        try:
            self.run_ = PathCuts(sender=sender, **options)
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
        part, stack = '/robot_sender/path_' + SECOND_DEVICE, self.run_.stack
        stack.set_parameter(part + '/metered', False)
        self.wait_for_spreading()
        stack.lab.run('robot', ['rosrun', 'dynamic_reconfigure', 'dynparam', 'set', part, 'metered', 'true'],
                      env=stack.environment('robot'), check=True)
        wait_for(lambda: self.run_.idle_rate(1.0) < MAX_DRIVEN, 30, 'only commands on the second path')

    @undisturbed()
    def test_a_desk_with_one_address_is_reached_by_both_interfaces(self) -> None:
        """The robot's routes know one of them; it answers by the one by which it was asked."""
        self.start(one_address=True)
        self.wait_for_spreading()
        for topic, heard in self.run_.cut(CUT).items():
            if topic != COMMAND:
                self.assertLess(longest_gap(heard), MAX_GAP, topic)

    @undisturbed()
    def test_one_address_is_asked_by_two_interfaces(self) -> None:
        host, port = ADDRESSES[0].split(':')
        ways = ['%s%%%s:%s' % (host, device, port) for device in (DEVICE, SECOND_DEVICE)]
        self.start(addresses=ways)
        self.wait_for_spreading()
        for topic, heard in self.run_.cut(CUT).items():
            if topic != COMMAND:
                self.assertLess(longest_gap(heard), MAX_GAP, topic)
        said = [heard.amount['connected to'] for heard in self.diagnostics.heard if heard.amount]
        self.assertIn('by ' + DEVICE, said[-1])
        self.assertIn('by ' + SECOND_DEVICE, said[-1])

    def wait_for_spreading(self) -> None:
        wait_for(lambda: self.used() == ADDRESSES[0], 30, 'the preferred path')
        wait_for(lambda: self.run_.idle_rate(1.0) > MIN_SHARED, 30, 'streams on the second path')

    @undisturbed()
    def test_streams_are_spread_over_both_paths(self) -> None:
        self.start()
        self.wait_for_spreading()
        for topic, heard in self.run_.cut(CUT).items():
            if topic != COMMAND:
                self.assertLess(longest_gap(heard), MAX_GAP, topic)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'two_paths', TwoPaths)
