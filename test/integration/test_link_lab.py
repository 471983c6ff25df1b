#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Own masters over the link lab: behind firewalls, after restarts and a new address, two robots, a stranger."""
import pathlib
import shutil
import sys
import tempfile
import unittest
from typing import Any, Dict

import rostest
import yaml

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import give_time, undisturbed  # it reports skipped tests, too

from evaluation import TOP
from evaluation.hostile_link import FLOODS, REFUSAL, HostileLink
from evaluation.kept_memory import QUICK_KEPT
from evaluation.link_run import ATTEMPTS, MAX_LATENESS
from evaluation.listener import Listener
from evaluation.own_masters import OwnMasters
from evaluation.two_robots import NAMES, TwoRobots
from smokebot_udp.link_lab.lab import LabError
from smokebot_udp.streams import classified

STREAMS: Dict[str, Dict[str, Any]] = classified(
    yaml.safe_load((TOP / 'config' / 'streams.yaml').read_text())['streams']).streams
TOPICS = {name: stream['operator_topic'] for name, stream in STREAMS.items()}
IMAGES = TOPICS['thermal'], TOPICS['camera']
SOURCE = '_width:=160', '_height:=120', '_lidar_rate:=5'

GOOD = {'loss': 0.0, 'delay': 0.01}
BAD = {'loss': 0.2, 'delay': 0.05}

UNCHANGED = 'tf_static', 'map'
"""A lasting operator does not show these again."""

TIMEOUT = 60.0
"""It takes some 2 s; a busy machine needs longer [s]."""

MAX_GROWTH = 20e6
"""In each phase: 500 bytes for each forged datagram, or 20 kB for each handshake. What nodes keep for QUICK_KEPT
varies by 13 MB by itself [byte]."""

FRESH = 2.0
"""A younger image shows the present; one of before an event is older [s]."""


def make_stack(case: Any, kind: Any, *arguments: Any) -> Any:
    """A stack until the test's end; skips the test where there can be no lab."""
    try:
        stack = kind(*arguments)
    except LabError as error:
        raise unittest.SkipTest(str(error)) from None
    case.addCleanup(stack.close)
    return stack


class LinkLab(unittest.TestCase):

    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def assert_comes(self, listener: Listener, event: str, unchanged=()) -> None:
        """Something new of all streams, and images that show the present."""
        topics = {topic for name, topic in TOPICS.items() if name not in unchanged}
        found = listener.first(topics, TIMEOUT, lambda heard: heard.topic not in IMAGES or heard.age < FRESH)
        self.assertEqual(topics - set(found), set(), 'after %s nothing comes of these' % event)
        print('%s: first image after %.1f s, all streams after %.1f s' % (
            event, min(found[topic] for topic in IMAGES), max(found.values())), file=sys.stderr)

    def test_one_port_is_all_that_crosses_whatever_happens(self) -> None:
        if shutil.which('nft') is None:
            self.skipTest('nftables is not installed')
        stack = make_stack(self, OwnMasters, 5, self.folder / 'nodes.log')
        walls = stack.firewalls()
        stack.start_node('robot', 'simulated_robot', *SOURCE)
        listener = Listener(stack)
        listener.subscribe([[topic, 'any', 'TCPROS'] for topic in TOPICS.values()])
        stack.lab.set(BAD)
        sender, receiver = stack.start_sender(), stack.start_receiver()
        self.assert_comes(listener, 'the start')
        stack.end(sender)
        give_time(1.0)      # what was on its way has come
        stack.start_sender()
        self.assert_comes(listener, "a restart of the robot's side", UNCHANGED)
        stack.end(receiver)
        give_time(1.0)
        stack.start_receiver()
        self.assert_comes(listener, "a restart of the operator's side")
        stack.change_address()
        self.assert_comes(listener, 'a change of the address', UNCHANGED)
        for side in ('robot', 'operator'):
            stack.end(stack.masters[side])
            stack.masters[side] = stack.start_master(side)
            give_time(FRESH)    # older images do not count
            self.assert_comes(listener, "a restart of the %s's master" % side, UNCHANGED)
        for side, wall in walls.items():
            print('%s: %s' % (side, wall.counts()), file=sys.stderr)
            self.assertEqual((wall.tried(), wall.counts()['refused']), ([], 0), side)
            self.assertGreater(wall.counts()['passed'], 1000, side)

    @undisturbed()
    def test_a_stranger_changes_nothing(self) -> None:
        link = make_stack(self, HostileLink, self.folder, 40000, 10000.0, 1000, 1, QUICK_KEPT)
        self.assertEqual(set(link.replayed), {'replayed handshake'})
        phases = {phase.name: phase for phase in link.phases()}
        for phase in phases.values():
            print(phase, file=sys.stderr)
            self.assertLess(max(phase.growth.values()), MAX_GROWTH, phase)
        quiet = min(phases[name].rate for name in ('quiet', 'quiet again'))
        for name in ('half-open handshakes', *FLOODS):      # a busy machine has less than 10 Hz without them
            self.assertGreater(phases[name].rate, 0.6 * quiet, name)
        for name, reasons in (('half-open handshakes', {'refused: wrong key'}),
                              *((name, {'forged', 'replayed data', 'malformed'}) for name in FLOODS),
                              ('uninvited operator', {REFUSAL})):
            self.assertLessEqual(reasons, set(phases[name].dropped), name)
        sent = phases['half-open handshakes'].sent
        self.assertEqual(sent['HELLO'], 1000)
        self.assertNotIn('INIT', sent, 'who has a wrong key gets no cookie')

    @undisturbed()
    def test_a_bad_link_to_one_robot_leaves_the_other_as_it_was(self) -> None:
        two = make_stack(self, TwoRobots, 7, self.folder / 'nodes.log')
        topics = {name: '/%s%s' % (name, TOPICS['thermal']) for name in NAMES}
        for name, stack in two.stacks.items():
            stack.lab.set(GOOD)
            stack.start_node('robot', 'simulated_robot', *SOURCE)
            stack.start_sender()
            two.start_receiver(name)
        listener = Listener(two.desk)
        listener.subscribe([[topic, 'any', 'TCPROS'] for topic in topics.values()])
        self.assertEqual(set(listener.first(topics.values(), TIMEOUT)), set(topics.values()))
        before = self.heard(two, listener, topics)
        two.stacks['ugv2'].lab.set({**GOOD, 'loss': 0.2})
        give_time(2.0)      # the rate has followed
        after = self.heard(two, listener, topics)
        for name in NAMES:
            print('%s: %.1f Hz, %.3f s old; then %.1f Hz, %.3f s' % (name, *before[name], *after[name]),
                  file=sys.stderr)
        self.assertGreater(after['ugv1'][0], 0.8 * before['ugv1'][0])
        self.assertLess(after['ugv1'][1], before['ugv1'][1] + 0.05)
        self.assertGreater(after['ugv2'][0], 0.5 * before['ugv2'][0])

    def heard(self, two: TwoRobots, listener: Listener, topics: Dict[str, str]) -> Dict[str, Any]:
        """{robot: (rate [Hz], median age [s]) of its images}; again where the machine was too busy for the lab."""
        for _ in range(ATTEMPTS):
            for stack in two.stacks.values():
                stack.lab.counts()
            found = listener.during(10.0)
            if all(stack.lab.counts()['late'].get('p99', 0.0) < MAX_LATENESS for stack in two.stacks.values()):
                break
        ages = {name: sorted(heard.age for heard in found if heard.topic == topic) for name, topic in topics.items()}
        return {name: (len(each) / 10.0, each[len(each) // 2]) for name, each in ages.items()}


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'link_lab', LinkLab)
