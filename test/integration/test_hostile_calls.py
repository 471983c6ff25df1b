#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Robot and operator while a stranger calls their XML-RPC and forges reports: 170 calls a second, for 10 s.

With arguments SECONDS CALLS it measures instead, beside running nodes: see evaluation/hostile_flood.py.
"""
import contextlib
import json
import pathlib
import subprocess
import sys
import threading
import unittest
import xmlrpc.client
from typing import Any

import numpy as np
import rosgraph
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image
from std_msgs.msg import Float32

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, give_time, ticks, undisturbed, wait_for

from smokebot_udp.msg import LinkStatus

TOP = pathlib.Path(__file__).resolve().parents[2]
RATE = 10.0
"""Rate of the camera [Hz]."""

SECONDS, CALLS = 10.0, 1700
ROBOT, OPERATOR = '/robot_sender', '/operator_receiver'


def publish() -> None:
    """A camera, and a sensor of gas."""
    images = rospy.Publisher('/thermal/image_raw', Image, queue_size=1)
    gas = rospy.Publisher('/gas', Float32, queue_size=1)
    message = Image(height=240, width=320, encoding='mono16', step=640, data=np.random.RandomState(0).bytes(240 * 640))
    with contextlib.suppress(rospy.ROSException):       # the topics are closed: the test has ended
        for _ in ticks(RATE):
            message.header.stamp = rospy.Time.now()
            images.publish(message)
            gas.publish(0.5)


def connections() -> Any:
    """The UDPROS connections of both nodes: {(node, peer, direction, topic, text)}."""
    found = set()
    for node in (ROBOT, OPERATOR):
        with xmlrpc.client.ServerProxy(rosgraph.Master('/test').lookupNode(node)) as proxy:
            found |= {(node, entry[1], entry[2], entry[4], entry[6])
                      for entry in proxy.getBusInfo('/test')[2] if entry[3] == 'UDPROS'}
    return found


def settled_connections() -> Any:
    """The connections, which begin topic by topic, once there are no more within some seconds."""
    while True:
        found = connections()
        give_time(3.0)
        if connections() == found:
            return found


class HostileCalls(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('test_hostile_calls')
        cls.pictures = Collector('/operator/thermal/image_raw', Image)
        cls.rates, cls.statuses = [], {}
        rospy.Subscriber(ROBOT + '/link', LinkStatus, lambda message: cls.rates.append(message.rate))
        rospy.Subscriber('/diagnostics', DiagnosticArray, lambda message: cls.statuses.update(
            (status.name, status) for status in message.status), queue_size=20)
        threading.Thread(target=publish, daemon=True).start()
        cls.pictures.wait_connected()
        wait_for(lambda: len(cls.pictures.messages) >= 50 and cls.rates, 60, 'pictures, and a rate of the link')
        cls.before = settled_connections()

    def observe(self, seconds) -> Any:
        """(pictures a second, mean and least rate of the link [Mbit/s]) from now on."""
        self.pictures.clear()
        del self.rates[:]
        give_time(seconds)
        return len(self.pictures.messages) / seconds, float(np.mean(self.rates)), min(self.rates)

    @undisturbed()
    def test_strangers_stop_nothing(self) -> None:
        frequency, rate, _ = self.observe(5.0)
        print('before: %.1f Hz, %.1f Mbit/s' % (frequency, rate))
        flood = subprocess.Popen(
            [sys.executable, '-m', 'evaluation.hostile_flood', ROBOT, OPERATOR, '--seconds', str(SECONDS), '--calls',
             str(CALLS), '--seed', '1'], cwd=str(TOP), stdout=subprocess.PIPE, universal_newlines=True)
        self.addCleanup(flood.kill)
        flooded = self.observe(SECONDS)
        counts = json.loads(flood.communicate(timeout=60)[0])
        print('meanwhile: %.1f Hz, %.1f Mbit/s, at least %.1f' % flooded, counts)
        self.assertGreaterEqual(flooded[0], 0.9 * RATE)
        self.assertGreaterEqual(flooded[1], 0.5 * rate)
        self.assertEqual(sum(counts.get(kind, 0) for kind in (
            'request_topic', 'publisher_update', 'bus_info', 'bad_call', 'garbage')), CALLS)
        wait_for(lambda: connections() == self.before, 15, 'the connections as they were')
        for node in (ROBOT, OPERATOR):
            refused = wait_for(lambda name=node[1:]: self.statuses.get(name + ': connection requests'), 5, 'a status')
            values = {pair.key: int(pair.value) for pair in refused.values if pair.key not in ('side', 'kind')}
            self.assertGreater(values['refused requests'], 50)
            self.assertGreater(min(values['refused, ' + reason] for reason in (
                'address', 'unknown node', 'malformed')), 0, values)
        frequency, _, _ = self.observe(5.0)
        self.assertGreaterEqual(frequency, 0.9 * RATE)


if __name__ == '__main__':
    if len(sys.argv) > 2 and sys.argv[1].replace('.', '').isdigit():
        SECONDS, CALLS = float(sys.argv.pop(1)), int(sys.argv.pop(1))
    rostest.rosrun('smokebot_udp', 'hostile_calls', HostileCalls)
