#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The demo over a bad link, as ./smokebot demo link:=bad starts it where there is no display."""
import pathlib
import re
import subprocess
import sys
import unittest

import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import undisturbed

from smokebot_udp.link_lab.lab import Lab, LabError

STREAMS = 'thermal', 'lidar', 'scan', 'tf', 'odom'


class DemoLink(unittest.TestCase):

    @undisturbed()
    def test_all_streams_cross_and_it_ends_by_itself(self) -> None:
        try:
            Lab().close()
        except LabError as error:
            raise unittest.SkipTest(str(error)) from None
        run = subprocess.run(['rosrun', 'smokebot_udp', 'demo_link', 'link:=loss=0.2,rate=2e6', 'rviz:=false',
                              'seconds:=30'], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=300)
        text = run.stdout.decode(errors='replace')
        self.assertEqual(run.returncode, 0, text)
        self.assertIn('the link loses 20 %, carries 2 Mbit/s', text)
        self.assertNotIn('REQUIRED process', text)
        self.assertRegex(text, r'OK +/operator_receiver with \S+ at 10\.77\.0\.1:\d+ ')
        for stream in STREAMS:
            rates = re.search(r'OK +%s +\S+ +\S+ +\S+ +(\S+)' % stream, text)
            assert rates is not None, 'no %s in\n%s' % (stream, text)
            self.assertGreater(float(rates.group(1)), 2.0, 'shown of %s [Hz] in\n%s' % (stream, text))


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'demo_link', DemoLink)
