#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The whole stack, robot and operator in network namespaces of their own, joined by a bad link."""
import math
import pathlib
import signal
import statistics
import subprocess
import sys
import tempfile
import unittest
from typing import Any

import psutil
import rostest
import yaml

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import give_time, undisturbed

from evaluation import TOP
from evaluation.link_run import ATTEMPTS, MAX_LATENESS
from evaluation.listener import Listener
from evaluation.stack import Stack
from smokebot_udp.link_lab.lab import ADDRESSES, LabError, environment
from smokebot_udp.streams import classified

STREAMS = TOP / 'config' / 'streams.yaml'
PERFECT = {'loss': 0.0, 'delay': 0.0}
BAD = {'loss': 0.2, 'delay': 0.05}

UNCHANGED = 'tf_static', 'map'
"""The operator's side shows these again only where they changed: a robot's side that restarts has the same."""

TIMEOUT = 60.0
"""A start or a restart over the bad link is to come to its end within this; it takes some 10 s [s]."""

LAST_LINES = 30
"""Number of lines of the nodes' log that a failure repeats."""

DATAGRAMS = {'thermal': 50, 'camera': 50, 'lidar': 8, 'obstacle_scan': 2, 'landmark_scan': 2, 'scan': 2, 'odom': 1,
             'gas': 1}
"""{stream with a steady source: so many datagrams, at least, one message of it takes}"""

HOLD = """
import signal
from evaluation.stack import Stack
stack = Stack()
stack.start('robot', 'sleep', '600')
stack.start_node('operator', 'operator_receiver')
stack.lab.statistics()
print('up', flush=True)
signal.pause()
"""


class LabStreams(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> Any:
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.log = pathlib.Path(cls.folder.name) / 'nodes.log'
        try:
            cls.stack = Stack(seed=5, log=cls.log)
        except LabError as error:
            raise unittest.SkipTest(str(error)) from None
        cls.addClassCleanup(cls.stack.close)
        with open(str(STREAMS)) as file:
            cls.streams = classified(yaml.safe_load(file)['streams']).streams
        cls.streams['thermal']['publish_mask'] = True
        for name in 'thermal', 'camera':
            cls.streams[name]['coding'] = 'interleaved'     # DATAGRAMS are of raw pixels
        cls.file = pathlib.Path(cls.folder.name) / 'streams.yaml'
        cls.file.write_text(yaml.safe_dump({'streams': cls.streams}))
        # it hardly moves: every cloud has as many points
        cls.stack.start_node('robot', 'simulated_robot', '_width:=320', '_height:=240', '_speed:=0.01')
        # who listens subscribes before there is loss: it is to tell what the receiver publishes, on its own side
        cls.listener = Listener(cls.stack)
        cls.topics = {name: stream['operator_topic'] for name, stream in cls.streams.items()}
        cls.listener.subscribe([[topic, 'cloud' if name == 'lidar' else 'any', 'TCPROS'] for name, topic in
                                cls.topics.items()] + [['/operator/thermal/mask', 'mask', 'TCPROS']])
        # a busy machine's sensors are slower: what counts is what they publish
        cls.sources = Listener(cls.stack, 'robot')
        cls.sources.subscribe([[topic, 'any', 'TCPROS'] for topic in {cls.streams[name]['robot_topic']
                                                                      for name in DATAGRAMS}])
        cls.stack.lab.run('robot', ['rostopic', 'echo', '-n', '1', '/battery'], env=environment('robot'), timeout=60,
                          stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
        cls.stack.lab.set(BAD)
        cls.nodes = {side: cls.start(side) for side in ADDRESSES}
        cls.first_start = cls.listener.first(cls.topics.values(), TIMEOUT)

    @classmethod
    def start(cls, side, *arguments) -> Any:
        """Start a node as its launch file does: it starts again where the master has ended it.

        The master does so where a call of a namesake, which was killed, is late: TCP repeats it over the bad link.
        """
        name = {'robot': 'robot_sender', 'operator': 'operator_receiver'}[side]
        return cls.stack.start(side, 'sh', '-c', 'while :; do "$@"; sleep 2; done', 'respawn', 'rosrun', 'smokebot_udp',
                               name, '__name:=' + name, '_streams_file:=%s' % cls.file, *arguments)

    def tearDown(self) -> None:
        self.assertNotIn('Traceback', self.log.read_text(errors='replace'))
        self.stack.lab.set(PERFECT)
        self.assertEqual([self.stack.lab.statistics()[side]['missed'] for side in ADDRESSES], [0, 0])

    def assert_all_come(self, found, but=()) -> None:
        """:param found: {topic: [s]} as Listener.first tells; but: streams that need not come"""
        wanted = {topic for name, topic in self.topics.items() if name not in but}
        self.assertEqual(wanted - set(found), set(), 'nothing came of these in %g s\n%s' % (TIMEOUT, self.said()))
        print('%s: first picture after %.1f s, all streams after %.1f s' % (
            self.id().split('.')[-1], min(found[self.topics[name]] for name in ('thermal', 'camera')),
            max(found[topic] for topic in wanted)), file=sys.stderr)

    def said(self) -> str:
        """What the nodes said last."""
        return '\n'.join(self.log.read_text(errors='replace').splitlines()[-LAST_LINES:])

    def restart(self, side, link, *arguments, but=()) -> None:
        """A side fails at once, and is started again over a link: until all of the streams come."""
        self.stack.lab.set(link)
        self.stack.end(self.nodes[side])
        give_time(1.0)      # what was on its way has come
        self.nodes[side] = self.start(side, *arguments)
        topics = [topic for name, topic in self.topics.items() if name not in but]
        self.assert_all_come(self.listener.first(topics, TIMEOUT), but)

    def test_both_sides_start_over_a_bad_link(self) -> None:
        self.assert_all_come(self.first_start)

    def test_the_robots_side_starts_again_over_a_bad_link(self) -> None:
        self.restart('robot', BAD, but=UNCHANGED)

    def test_the_operators_side_starts_again_over_a_bad_link(self) -> None:
        self.restart('operator', BAD)

    def heard(self, seconds: float) -> Any:
        """What arrives in this time, and what the sources publish.

        It is measured again where the machine was too busy to carry packets in time.
        """
        for _ in range(ATTEMPTS):
            self.listener.during(1.0)
            self.stack.lab.statistics()
            published = len(self.sources.heard)
            found = self.listener.during(seconds)
            if self.stack.lab.statistics()['late'].get('p99', 0.0) < MAX_LATENESS:
                break
        return found, self.sources.heard[published:]

    @undisturbed()
    def test_rates_and_completeness_follow_from_the_loss(self) -> None:
        # all is sent: the rate does not wait for what the operator reports
        self.restart('robot', PERFECT, '_adapt:=false', but=UNCHANGED)
        seconds, points = 5.0, None
        for loss in (0.0, 0.2, 0.5, 0.9):
            self.stack.lab.set({'loss': loss, 'delay': 0.02})
            heard, published = self.heard(seconds)
            for name, datagrams in DATAGRAMS.items():
                sent = min(self.streams[name]['rate'] * seconds,
                           sum(message.topic == self.streams[name]['robot_topic'] for message in published))
                shown = 1 - loss ** datagrams   # of which each datagram alone makes a message
                count = sum(message.topic == self.topics[name] for message in heard)
                # five standard deviations, and a fifth for a machine that does other things, too
                least = 0.8 * sent * shown - 5 * math.sqrt(sent * shown * (1 - shown)) - 1
                self.assertGreaterEqual(count, least, (loss, name))
                self.assertLessEqual(count, 1.2 * sent + 1, (loss, name))
            shares = [message.amount for message in heard if message.topic == '/operator/thermal/mask']
            self.assertAlmostEqual(statistics.mean(shares), 1 - loss, delta=0.05, msg=loss)
            clouds = [message.amount for message in heard if message.topic == self.topics['lidar']]
            points = points or statistics.mean(clouds)
            if loss < 0.9:      # there clouds of which nothing comes would count
                # five standard deviations
                delta = max(0.1, 5 * math.sqrt(loss * (1 - loss) / (len(clouds) * DATAGRAMS['lidar'])))
                self.assertAlmostEqual(statistics.mean(clouds) / points, 1 - loss, delta=delta, msg=loss)

    def test_after_a_cut_the_pictures_come_back(self) -> None:
        topics = [self.topics['thermal'], self.topics['lidar']]
        self.stack.lab.set({'loss': 1.0})
        give_time(12.0)     # longer than a silent topic is waited for
        self.stack.lab.set(PERFECT)
        found = self.listener.first(topics, 20.0)
        self.assertEqual(set(found), set(topics))

    def test_nothing_is_left_of_a_stack_that_ends_in_any_way(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            process = subprocess.Popen([sys.executable, '-c', HOLD], cwd=str(TOP), stdout=subprocess.PIPE,
                                       stderr=subprocess.DEVNULL)
            self.assertEqual(process.stdout.readline(), b'up\n')
            children = psutil.Process(process.pid).children(recursive=True)
            self.assertGreaterEqual(len(children), 4)   # the link, the master, and what was started
            process.send_signal(number)
            process.communicate()
            left = psutil.wait_procs(children, timeout=20)[1]
            self.assertEqual(left, [], number)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'lab_streams', LabStreams)
