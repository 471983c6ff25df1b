#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""One image stream on a link of 0.3 Mbit/s: all else that crosses takes 3 % of it, and is complete within 10 s."""
import pathlib
import statistics
import sys
import tempfile
import time
import unittest

import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import give_time, undisturbed

from evaluation.listener import Listener
from evaluation.overhead import Overhead
from evaluation.own_masters import PORT, OwnMasters
from smokebot_udp.link.packets import OVERHEAD
from smokebot_udp.link_lab.lab import LabError
from smokebot_udp.udpros.datagram import IP_UDP_HEADERS

RATE = 0.3e6
"""Rate of the link [bit/s]."""

MOST = 0.03
"""Maximum share of the link's rate for all but images."""

OTHERS = '_thermal_rate:=0', '_lidar_rate:=0', '_scan_rate:=0', '_map_rate:=0', '_odom_rate:=0', '_gas_rate:=0', \
    '_battery_rate:=0'
"""Sensors of the simulated robot that are off."""

HEADERS = IP_UDP_HEADERS + OVERHEAD
"""Bytes of each datagram that its connection does not count."""

STATES = '/operator/status', '/operator/link', '/operator/diagnostics'
IMAGE = '/operator/camera/image_raw'

START, COMPLETE = 120.0, 10.0
"""Time for the nodes to start on a busy machine, and for all states to arrive after the first image [s]."""

SETTLE, MEASURE = 30.0, 30.0
"""Time until states are repeated less often, and time over which the traffic is counted [s]."""


class TestOverhead(unittest.TestCase):

    @undisturbed()
    def test_what_nobody_asked_for_takes_3_percent_and_is_complete_soon(self) -> None:
        try:
            stack = OwnMasters(7, pathlib.Path(tempfile.mkdtemp()) / 'nodes.log')
        except LabError as error:
            raise unittest.SkipTest(str(error)) from None
        self.addCleanup(stack.close)
        stack.lab.set({'rate': RATE, 'delay': 0.02, 'queue': 0.2})
        counted, listener = Overhead(stack, PORT), Listener(stack)
        listener.subscribe([[topic, 'any', 'TCPROS'] for topic in (IMAGE, *STATES)])
        images = Listener(stack)
        images.subscribe([['/diagnostics', 'rates of parts', 'TCPROS']])
        stack.start_node('robot', 'simulated_robot', '_width:=320', '_height:=240', *OTHERS)
        stack.start_sender()
        stack.start_receiver()
        first = listener.first({IMAGE}, START)
        self.assertIn(IMAGE, first)
        states = listener.first(set(STATES), COMPLETE)
        self.assertEqual(set(states), set(STATES), 'complete after %g s' % COMPLETE)
        give_time(SETTLE)
        begun = time.time()
        give_time(MEASURE)
        parts = [[rates for name, rates in one.amount.items() if name.startswith('camera')]
                 for one in images.heard if one.amount and one.arrival > begun]
        stream = statistics.mean(sum(size + count * HEADERS for count, size in rates) for rates in parts)
        others = counted.rate(PORT, MEASURE) - stream
        print('images %.1f kbit/s, all else %.2f kbit/s, of %g' % (8e-3 * stream, 8e-3 * others, RATE / 1e3),
              file=sys.stderr)
        self.assertGreater(stream, 0.1 * RATE / 8)
        self.assertLessEqual(8 * others, MOST * RATE)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'overhead', TestOverhead)
