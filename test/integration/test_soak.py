#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The soak's short version: each kind of fault once, over a link that loses 5 %."""
import itertools
import pathlib
import sys
import tempfile
import unittest

import psutil
import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import waiting  # noqa: F401  (it reports skipped tests)

from evaluation.soak import KINDS, faults
from evaluation.soak_run import Soak
from smokebot_udp.link_lab.lab import LabError

SEED = 2
LONGEST = 2.0
"""Limit of the duration of a fault [s]."""

PATIENCE = 10.0
"""Every stream is to be fresh within this time after the last part's registration; it takes some 2 s [s]."""


class ShortSoak(unittest.TestCase):

    def test_everything_comes_back_after_each_fault(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            try:
                soak = Soak(pathlib.Path(folder), SEED)
            except (LabError, FileNotFoundError) as error:
                raise unittest.SkipTest(str(error)) from None
            with soak:
                for fault in itertools.islice(faults(SEED, LONGEST), len(KINDS)):
                    with self.subTest(fault=fault):
                        found = soak.round(fault)
                        print('%s: all streams fresh after %s s, load %.1f' % (
                            fault.kind, found.wait if found.wait is None else round(found.wait, 2), found.load),
                            file=sys.stderr)
                        self.assertIsNotNone(found.wait, 'these do not come back: %s' % found.slowest)
                        self.assertLess(found.wait, PATIENCE, found.slowest)
                        self.assertEqual(found.unequal, '')
                        self.assertEqual(found.died, [])
        self.assertEqual(psutil.Process().children(recursive=True), [])


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'soak', ShortSoak)
