#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Robot and operator in network namespaces of their own, joined by a bad link."""
import json
import os
import pathlib
import subprocess
import sys
import threading
import time
import unittest

import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import waiting  # noqa: F401  (it lets skipped tests be told)

from smokebot_udp.link_lab.lab import ADDRESSES, Lab, LabError, environment

HERE = pathlib.Path(__file__).resolve().parent
TOPICS = '/operator/thermal/image_raw', '/operator/lidar/points'
RATE = 10.0


class Counter:
    """What lab_counter.py says: {topic: count} at times."""

    def __init__(self, process):
        self._latest = (0.0, {})
        self._thread = threading.Thread(target=self._read, args=(process,), daemon=True)
        self._thread.start()

    def _read(self, process):
        for line in process.stdout:
            self._latest = json.loads(line.decode())

    def wait(self, topics, seconds):
        """How long until each topic had a message more than now [s]."""
        begun, before = time.monotonic(), dict(self._latest[1])
        while not all(self._latest[1].get(topic, 0) > before.get(topic, 0) for topic in topics):
            assert time.monotonic() < begun + seconds, 'of %s came %s in %g s' % (topics, self._latest[1], seconds)
            time.sleep(0.05)
        return time.monotonic() - begun

    def rates(self, seconds):
        """{topic: messages a second} over a while."""
        since, before = self._latest
        while self._latest[0] < since + seconds:
            time.sleep(0.05)
        until, after = self._latest
        return {topic: (after.get(topic, 0) - before.get(topic, 0)) / (until - since) for topic in TOPICS}


class LinkLab(unittest.TestCase):

    @classmethod
    def setUpClass(cls):
        try:
            cls.lab = Lab(seed=5)
        except LabError as error:
            raise unittest.SkipTest(str(error)) from None
        cls.processes = []
        cls.addClassCleanup(cls.end)
        cls.lab.set({'delay': 0.02})
        cls.start('robot', 'rosmaster', '--core')   # roscore's own children would outlive it
        cls.until_the_master_answers()
        cls.start('robot', 'rosrun', 'smokebot_udp', 'simulated_robot', '__name:=simulated_robot', '_camera_rate:=0')
        cls.start('robot', 'rosrun', 'smokebot_udp', 'robot_sender', '__name:=robot_sender')
        # the counter connects before there is loss: it counts what the receiver publishes, by TCP on its own side
        cls.counter = Counter(cls.start('operator', sys.executable, str(HERE / 'lab_counter.py'), *TOPICS))
        cls.start('operator', 'rosrun', 'smokebot_udp', 'operator_receiver', '__name:=operator_receiver')
        cls.counter.wait(TOPICS, 60)

    @classmethod
    def start(cls, side, *command):
        process = cls.lab.popen(side, list(command), env=environment(side), stdin=subprocess.DEVNULL,
                                stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True)
        cls.processes.append(process)
        return process

    @classmethod
    def until_the_master_answers(cls):
        for _ in range(100):
            listed = cls.lab.run('robot', ['rosnode', 'list'], env=environment('robot'), stdout=subprocess.PIPE,
                                 stderr=subprocess.DEVNULL)
            if listed.returncode == 0:
                return
            time.sleep(0.2)
        raise AssertionError('no master')

    @classmethod
    def end(cls):
        for process in cls.processes[::-1]:
            if process.poll() is None:
                os.killpg(process.pid, 9)
            process.wait()
            process.stdout.close()
        cls.lab.close()

    def tearDown(self):
        self.lab.set({'loss': 0.0})
        self.assertEqual([self.lab.statistics()[side]['missed'] for side in ADDRESSES], [0, 0])

    def test_the_rates_stay_the_sources_through_loss(self):
        for loss in (0.0, 0.2, 0.5, 0.9):
            self.lab.set({'loss': loss})
            for topic, rate in self.counter.rates(5.0).items():
                # of a cloud's two dozen datagrams at 90 % loss now and then none comes
                self.assertGreater(rate, (0.75 if loss == 0.9 else 0.9) * RATE, (loss, topic))
                self.assertLess(rate, 1.1 * RATE, (loss, topic))

    def test_after_a_cut_the_pictures_come_back(self):
        self.lab.set({'loss': 1.0})
        time.sleep(12.0)     # longer than a silent topic is waited for
        self.lab.set({'loss': 0.0})
        self.assertLess(self.counter.wait(TOPICS, 20), 10.0)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'link_lab', LinkLab)
