#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A camera over a kernel's token bucket of 1 Mbit/s, all settings as shipped: a short cell of ./smokebot bench live.

Bounds are wide: the benchmark measures how sharp and how steady the screen is, beside others.
"""
import math
import pathlib
import statistics
import sys
import tempfile
import unittest
from typing import Any

import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import undisturbed

from evaluation.live_run import Cell, LiveRun
from evaluation.live_score import SETTLED, image_rows, judged
from evaluation.shapers import parse
from smokebot_udp.link_lab.lab import LabError

CELL = Cell(parse('tbf6'), (1e6,), 0.05, 15.0)

LEAST_MEAN, LEAST_WORST, LEAST_SCREEN = 33.0, 25.0, 26.0
"""PSNR of the images, of the worst 5 % of them, and of the screen, on average, of the recorded or the simulated camera
[dB]."""

LEAST_RATE, LONGEST_FREEZE, OLDEST = 6.0, 1.5, 0.6
"""[Hz], [s], [s]"""


class LiveLink(unittest.TestCase):

    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        try:
            self.live = LiveRun(CELL, 'ours', pathlib.Path(folder.name), pathlib.Path(folder.name) / 'nodes.log')
        except LabError as error:
            raise unittest.SkipTest(str(error)) from None
        self.addCleanup(self.live.close)

    @undisturbed()
    def test_the_screen_is_sharp_steady_and_fresh(self) -> None:
        outcome = self.live.measure()
        row = judged(outcome.screen, outcome.samples, outcome.moments[0] + SETTLED, outcome.moments[-1])
        print(row, file=sys.stderr)
        self.assertGreater(row['image mean [dB]'], LEAST_MEAN)
        self.assertGreater(row['image 5 % [dB]'], LEAST_WORST)
        self.assertGreater(row['screen mean [dB]'], LEAST_SCREEN)
        self.assertGreater(row['rate [Hz]'], LEAST_RATE)
        self.assertLess(row['freeze [s]'], LONGEST_FREEZE)
        self.assertLess(row['age p50 [s]'], OLDEST)
        self.assertGreater(row['used'], 0.3)
        self.assertLess(row['used'], 1.05)
        self.both_sides_say_what_an_image_is(outcome)

    def both_sides_say_what_an_image_is(self, outcome: Any) -> None:
        rows = image_rows(outcome.screen, outcome.notes)
        late = [row for row in rows if row['time [s]'] > SETTLED]
        self.assertTrue(all(row['coding'] and int(row['used [byte]']) > 0 for row in late), late)
        errors = [abs(row['estimated PSNR [dB]'] - row['PSNR [dB]']) for row in late
                  if row['coding'] == 'layers' and row['estimated PSNR [dB]'] is not None]
        self.assertLess(statistics.median(errors) if errors else 0.0, 3.0)
        capacities = [one.status['capacity'] for one in outcome.samples if one.status]
        self.assertTrue(capacities and any(math.isfinite(capacity) for capacity in capacities), capacities)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'live_link', LiveLink)
