#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The soak's short version: each kind of fault once, over a link that loses 5 %."""
import itertools
import pathlib
import sys
import tempfile
import unittest
from typing import List

import psutil
import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import Lateness  # it reports skipped tests, too

from evaluation.soak import GOES, KINDS, Fault, faults
from evaluation.soak_run import Round, Soak
from smokebot_udp.link_lab.lab import LabError

SEED = 2
LONGEST = 2.0
"""Limit of the duration of a fault [s]."""

TIMEOUT = 10.0
"""Every stream is to be fresh within this time after the last part's registration; it takes some 2 s [s]."""

ATTEMPTS = 3


def problems_of(found: Round) -> List[str]:
    """What a round shows that is not as it should be."""
    print('%s: all streams fresh after %s s, load %.1f' % (
        found.fault.kind, found.wait if found.wait is None else round(found.wait, 2), found.load), file=sys.stderr)
    problems = [found.unequal] if found.unequal else []
    if found.wait is None or found.wait > TIMEOUT:
        problems.append('%s fresh after %s s' % (found.slowest, found.wait))
    problems += ['%s ended by itself' % part for part in found.died]
    return ['%s: %s' % (found.fault.kind, text) for text in problems]


def problems_after(soak: Soak, fault: Fault) -> List[str]:
    """What is not as it should be after a fault, which comes again where the machine does other things."""
    for _ in range(ATTEMPTS):
        with Lateness() as lateness:
            problems = problems_of(soak.round(fault))
        if not problems or not lateness.disturbed() or fault.kind == GOES:       # nobody is there who could go again
            break
    return problems


class ShortSoak(unittest.TestCase):

    def test_everything_comes_back_after_each_fault(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            try:
                soak = Soak(pathlib.Path(folder), SEED)
            except (LabError, FileNotFoundError) as error:
                raise unittest.SkipTest(str(error)) from None
            problems: List[str] = []
            with soak:
                for fault in itertools.islice(faults(SEED, LONGEST), len(KINDS)):
                    problems += problems_after(soak, fault)
        self.assertEqual(problems, [])
        self.assertEqual(psutil.Process().children(recursive=True), [])


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'soak', ShortSoak)
