#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Joining over heavy loss, paths that drop long datagrams, and a cut: the nodes in network namespaces of their own."""
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest
from typing import Any, Set

import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import give_time, undisturbed, wait_for

from evaluation.joins import HEAVY, PARTS, with_relays
from evaluation.listener import Listener
from evaluation.own_masters import OwnMasters
from evaluation.stack import Stack
from smokebot_udp.link_lab.lab import LabError

HOLE, NO_HOLE = {'longest': 1228.0}, {'longest': 0.0}
"""Packets of up to 1200 bytes of UDP payload pass."""

PROBLEM = 'datagrams above 1172 bytes do not pass'

IMAGES, CLOUD = '/operator/camera/image_raw', '/operator/lidar/points'
START = 60.0
"""For nodes to start and to find each other on a busy machine [s]."""

SOON = 10.0
"""After a join all is there within 5 s in 19 of 20 cases, see `experiments joins`: this is for the one that is not
[s]."""

NOTICED, FOLLOWS = 3.0, 2.0
"""A hole is shown 1.4 to 1.6 s after it came, and images, clouds and the diagnostics follow within a second [s]."""

GONE = 9.0
"""Longer datagrams are tried each 3 s, two lengths in turns, and what is found is shown up to 0.5 s later [s]."""

CUT = 20.0
"""Longer than a call to the master waits; diagnostics come once a second [s]."""

SIMULATED = '_width:=160', '_height:=120'


class Joining(unittest.TestCase):

    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.log = self.folder / 'log'
        self.addCleanup(lambda: print(self.written(0)[-3000:], file=sys.stderr))    # where it failed, it says why

    def start(self, make: Any, **options: Any) -> Any:
        """A link lab with the simulated robot."""
        try:
            stack = make(log=self.log, **options)
        except LabError as error:
            raise unittest.SkipTest(str(error)) from None
        self.addCleanup(stack.close)
        stack.start_node('robot', 'simulated_robot', *SIMULATED)
        return stack

    def own_masters(self) -> Any:
        return self.start(OwnMasters)

    def written(self, since: int) -> str:
        """What the nodes have written to the log from a place on."""
        return self.log.read_bytes()[since:].decode(errors='replace')

    def test_layers_and_tiles_cross_soon_after_a_join_over_80_percent_loss(self) -> None:
        streams = with_relays(self.folder / 'streams.yaml')
        stack = self.own_masters()
        listener = Listener(stack)
        listener.subscribe([['/diagnostics', 'parts', 'TCPROS']])
        stack.lab.set(HEAVY)
        stack.start_sender(streams)
        stack.wait_for_port()
        for _ in range(3):
            begun, heard = self.log.stat().st_size, len(listener.heard)
            receiver = stack.start_receiver(streams)
            wait_for(lambda begun=begun: '/robot_sender' in self.written(begun) and 'has joined from' in
                     self.written(begun), START, 'the join')
            joined = time.monotonic()

            def came(heard: int = heard) -> Set[str]:
                return {name for message in listener.heard[heard:] for name, count in message.amount.items() if count}
            wait_for(lambda: came() >= set(PARTS), SOON, 'layers and tiles')
            print('layers and tiles %.1f s after the join' % (time.monotonic() - joined), file=sys.stderr)
            self.assertNotIn('python3-av', self.written(begun))
            stack.end(receiver)

    def check_a_hole(self, stack: Any) -> None:
        listener = Listener(stack)
        listener.subscribe([[IMAGES, 'any', 'TCPROS'], [CLOUD, 'any', 'TCPROS'],
                            ['/operator/diagnostics', 'diagnostics', 'TCPROS'],
                            ['/operator/link', 'longest', 'TCPROS']])
        wait_for(lambda: {IMAGES, CLOUD} <= {message.topic for message in listener.heard}, START, 'the first messages')
        give_time(5.0)      # all is sent at full length

        def shown() -> int:
            """The longest datagram that passes, as the operator is told last."""
            return int([message.amount for message in listener.heard if message.topic == '/operator/link'][-1])
        self.assertEqual(shown(), 0)
        stack.lab.set(HOLE)
        begun = time.monotonic()
        wait_for(lambda: 0 < shown() <= 1200, NOTICED, 'that the hole is noticed')
        print('noticed after %.1f s' % (time.monotonic() - begun), file=sys.stderr)
        count = len(listener.heard)
        wait_for(lambda: {IMAGES, CLOUD} <= {message.topic for message in listener.heard[count:]}, FOLLOWS,
                 'images and clouds')
        wait_for(lambda: shown() == 1172, FOLLOWS, 'the longest that passes')
        wait_for(lambda: any(PROBLEM in message.amount for message in listener.heard[count:]
                             if message.topic == '/operator/diagnostics'), FOLLOWS, 'the diagnostics')
        if isinstance(stack, OwnMasters):       # a shared master's TCP, which link_top uses, does not pass the hole
            self.assertIn(PROBLEM, stack.lab.run(
                'operator', ['rosrun', 'smokebot_udp', 'link_top', '--once'], env=stack.environment('operator'),
                stdout=subprocess.PIPE, timeout=START).stdout.decode())
        stack.lab.set(NO_HOLE)
        wait_for(lambda: shown() == 0, GONE, 'that the hole has gone')

    def test_a_hole_between_own_masters(self) -> None:
        stack = self.own_masters()
        stack.start_sender()
        stack.wait_for_port()
        stack.start_receiver()
        self.check_a_hole(stack)

    def test_a_hole_under_a_shared_master(self) -> None:
        stack = self.start(Stack)
        stack.start_node('robot', 'robot_sender')
        stack.start_node('operator', 'operator_receiver')
        self.check_a_hole(stack)

    @undisturbed()
    def test_the_operators_diagnostics_go_on_in_a_cut_between_own_masters(self) -> None:
        stack = self.own_masters()
        stack.start_sender()
        stack.wait_for_port()
        self.check_diagnostics_in_a_cut(stack)

    @undisturbed()
    def test_the_operators_diagnostics_go_on_in_a_cut_from_a_shared_master(self) -> None:
        stack = self.start(Stack)
        stack.start_sender()
        self.check_diagnostics_in_a_cut(stack)

    def check_diagnostics_in_a_cut(self, stack: Any) -> None:
        stack.start_receiver()
        listener = Listener(stack)
        listener.subscribe([[IMAGES, 'any', 'TCPROS'], ['/diagnostics', 'any', 'TCPROS']])
        wait_for(lambda: {IMAGES, '/diagnostics'} <= {message.topic for message in listener.heard}, START,
                 'the first messages')
        stack.lab.set({'loss': 1.0})
        give_time(2.0)      # what was on its way has come: what comes now is the operator's own
        times = [message.arrival for message in listener.during(CUT) if message.topic == '/diagnostics']
        longest = max((after - before for before, after in zip(times, times[1:])), default=CUT)
        print('%d diagnostics in %g s of a cut, longest gap %.2f s' % (len(times), CUT, longest), file=sys.stderr)
        self.assertGreaterEqual(len(times), CUT - 2)
        self.assertLess(longest, 2.0)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'joining', Joining)
