#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The demo over a bad link, as ./smokebot demo link:=bad starts it where there is no display."""
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest
from typing import Any

import cv2
import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import undisturbed

from smokebot_udp.demo.pictures import COLUMNS, OURS, SCREENS, TCP
from smokebot_udp.demo.strip import CAPTION, CELL
from smokebot_udp.link_lab.lab import Lab, LabError

STREAMS = 'thermal', 'lidar', 'scan', 'tf', 'odom'


class DemoLink(unittest.TestCase):

    @undisturbed()
    def test_all_streams_cross_and_it_ends_by_itself(self) -> None:
        try:
            Lab().close()
        except LabError as error:
            raise unittest.SkipTest(str(error)) from None
        with tempfile.TemporaryDirectory() as folder:
            picture = os.path.join(folder, 'demo.png')
            run = subprocess.run(['rosrun', 'smokebot_udp', 'demo_link', 'link:=loss=0.2,rate=2e6', 'rviz:=false',
                                  'seconds:=30', 'picture:=' + picture],
                                 stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=300)
            text = run.stdout.decode(errors='replace')
            self.assertEqual(run.returncode, 0, text)
            self.check_pictures(cv2.imread(picture), text)
        self.assertIn('the link loses 20 %, carries 2 Mbit/s', text)
        self.assertNotRegex(text, r'REQUIRED process|\[ERROR\]|\[FATAL\]|Traceback')
        self.assertRegex(text, r'OK +/operator_receiver with \S+ at 10\.77\.0\.1:\d+ ')
        for stream in STREAMS:
            rates = re.search(r'OK +%s +\S+ +\S+ +\S+ +(\S+)' % stream, text)
            assert rates is not None, 'no %s in\n%s' % (stream, text)
            self.assertGreater(float(rates.group(1)), 2.0, 'shown of %s [Hz] in\n%s' % (stream, text))

    def check_pictures(self, strip: Any, text: str) -> None:
        """The camera and the operator's views are seen at each moment, and the operator saw new ones."""
        row = CELL[1] + 2 * CAPTION
        self.assertEqual(strip.shape, (len(SCREENS) * row, COLUMNS * CELL[0], 3), text)
        for number, title in enumerate(SCREENS):
            cells = strip[number * row + CAPTION:(number + 1) * row - CAPTION].reshape(CELL[1], COLUMNS, CELL[0], 3)
            seen = [int(cells[:, column].max()) > 40 for column in range(COLUMNS)]
            self.assertTrue(title == TCP or all(seen), '%s: %s in\n%s' % (title, seen, text))
        images = re.search(re.escape(OURS) + r': (\d+) images', text)
        assert images is not None, text
        self.assertGreater(int(images.group(1)), 30, text)
        self.assertRegex(text, re.escape(TCP) + r': (no|\d+) image')


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'demo_link', DemoLink)
