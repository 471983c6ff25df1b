#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Two operators press the emergency stop, release it and press it again, over an emulated link that loses half of the
datagrams and is cut, while nodes are killed: no press after the last release is lost."""
import os
import pathlib
import random
import subprocess
import sys
import tempfile
import time
import unittest
from typing import Any, List, Set

import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import give_time, wait_for

from evaluation import teleoperated
from evaluation.listener import Listener
from evaluation.own_masters import OwnMasters
from evaluation.teleoperator import Teleoperator
from smokebot_udp.link_lab.lab import LabError

STREAMS = pathlib.Path(__file__).resolve().parent / 'commands_streams.yaml'
ESTOP = '/robot_sender/estop'
A, B = '/a', '/b'
BAD = {'loss': 0.5, 'delay': 0.05}
ROUNDS = 12

START = 60.0
"""For nodes to start on a busy machine [s]."""

SOON = 10.0
"""What a press has not done by then, over a link that is not cut, it never will [s]."""


def ports(pid: int) -> Set[int]:
    """The UDP ports of a process."""
    inodes = set()
    for name in os.listdir('/proc/%d/fd' % pid):
        target = os.readlink('/proc/%d/fd/%s' % (pid, name))
        if target.startswith('socket:['):
            inodes.add(target[len('socket:['):-1])
    rows = [line.split() for line in pathlib.Path('/proc/%d/net/udp' % pid).read_text().splitlines()[1:]]
    return {int(row[1].split(':')[1], 16) for row in rows if row[9] in inodes}


class TwoEstops(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        log = pathlib.Path(folder.name) / 'nodes.log'
        try:
            cls.stack = OwnMasters(7, log)
        except LabError as error:
            raise unittest.SkipTest(str(error)) from None
        cls.addClassCleanup(cls.stack.close)
        cls.random = random.Random(7)
        cls.listener = Listener(cls.stack, 'robot', teleoperated.MODULE)
        cls.listener.subscribe([[ESTOP, 'flag', 'TCPROS']])
        cls.sender = cls.start_sender()
        cls.receivers = {name: cls.start_receiver(name) for name in (A, B)}
        cls.persons = {name: Teleoperator(cls.stack, 'operator', [], log, name) for name in (A, B)}
        for person in cls.persons.values():
            cls.addClassCleanup(person.close)
        wait_for(lambda: cls.flags(), START, 'the robot')
        for name in (A, B):
            wait_for(lambda name=name: cls.persons[name].release()[0], START, 'operator %s' % name)

    @classmethod
    def start_sender(cls) -> Any:
        return cls.stack.start_sender('_streams_file:=%s' % STREAMS)

    @classmethod
    def start_receiver(cls, name: str) -> Any:
        return cls.stack.start_receiver('__ns:=' + name, '_streams_file:=%s' % STREAMS)

    @classmethod
    def flags(cls, since: int = 0) -> List[bool]:
        """What ~estop has said, but for the first messages."""
        return [heard.amount for heard in list(cls.listener.heard)[since:]]

    def setUp(self) -> None:
        self.stack.lab.set(BAD)

    def tearDown(self) -> None:
        self.stack.lab.set({'loss': 0.0, 'delay': 0.0})
        self.release(B)

    def press(self, name: str) -> None:
        self.persons[name].press()

    def release(self, name: str) -> None:
        """A person releases the stop, and again until it is."""
        wait_for(lambda: self.persons[name].release()[0], START, 'the release')
        wait_for(lambda: not self.flags()[-1], SOON, 'the release')

    def is_engaged(self, what: str) -> None:
        wait_for(lambda: self.flags()[-1], SOON, what)

    def make_deaf(self, name: str) -> None:
        """Let nothing of the robot come to an operator."""
        own = ports(self.receivers[name].pid)
        self.assertTrue(own)
        rules = 'table ip deaf { chain input { type filter hook input priority 0; udp dport { %s } drop; }; }' % (
            ', '.join(map(str, own)))
        try:
            self.stack.lab.run('operator', ['nft', rules], check=True)
        except (FileNotFoundError, subprocess.CalledProcessError) as error:
            self.skipTest('nftables are needed: %s' % error)
        self.addCleanup(self.stack.lab.run, 'operator', ['nft', 'flush', 'ruleset'], check=True)

    def test_the_press_of_an_operator_that_hears_nothing_counts_each_time(self) -> None:
        self.make_deaf(A)
        for number in range(3):
            self.press(A)
            self.is_engaged('press %d' % number)
            self.release(B)
            since = len(self.listener.heard)
            give_time(1.0)      # what still comes of the press is none
            self.assertEqual(self.flags(since), [])

    def test_no_press_after_the_last_release_is_lost(self) -> None:
        for number in range(ROUNDS):
            first, other = self.random.sample([A, B], 2)
            cut = number % 3 == 0
            if cut:
                self.stack.lab.set({'loss': 1.0})
            self.press(first)
            if cut:
                give_time(self.random.uniform(0.2, 1.5))
                self.stack.lab.set(BAD)
            self.is_engaged('round %d: the press of %s' % (number, first))
            self.persons[other].release()       # once: it may be refused, or not be answered
            self.press(first)
            time.sleep(self.random.uniform(0.0, 0.3))
            self.press(self.random.choice([A, B]))
            self.is_engaged('round %d: the press after the release' % number)
            since = len(self.listener.heard)
            give_time(1.5)      # a release that is under way is over then
            self.assertNotIn(False, self.flags(since), 'round %d' % number)
            self.release(self.random.choice([A, B]))

    def test_the_stop_outlives_all_nodes(self) -> None:
        self.press(A)
        self.is_engaged('the press')
        for restarted in (A, 'robot', B, 'robot', A):
            if restarted == 'robot':
                self.stack.end(self.sender)
                since = len(self.listener.heard)
                type(self).sender = self.start_sender()
                wait_for(lambda since=since: self.flags(since), START, '~estop')
                self.assertNotIn(False, self.flags(since))
            else:
                self.stack.end(self.receivers[restarted])
                self.receivers[restarted] = self.start_receiver(restarted)
        self.release(A)
        self.press(B)
        self.is_engaged('the press')


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'two_estops', TwoEstops)
