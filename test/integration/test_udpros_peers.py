#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS with real peers: roscpp's relay, rospy, rostopic, rosbag."""
import contextlib
import itertools
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import unittest
import unittest.mock
import xmlrpc.client
from typing import Any

import numpy as np
import rosgraph
import rospy
import rostest
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header, String

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import wait_for

from smokebot_udp import udpros
from smokebot_udp.udpros import acceptor, presence

NODE = '/udpros_peers'

LENGTHS_OF_ROSCPPS_BASE64 = 54
"""roscpp's base64 puts a NUL in the XML for 3 header lengths in 54 (ros_comm#2160)."""


def start_relay(source, target, name) -> Any:
    """A roscpp node that requests `source` by UDPROS only, and publishes `target`."""
    return subprocess.Popen(['rosrun', 'topic_tools', 'relay', source, target, '_unreliable:=true', '__name:=' + name],
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def end(processes) -> None:
    for process in processes:
        process.terminate()
    for process in processes:
        process.wait(20)


def bus_info(node) -> Any:
    """[(peer, direction, transport, topic), ...] of a node."""
    master = rosgraph.Master(rospy.get_name())
    with xmlrpc.client.ServerProxy(master.lookupNode(node)) as proxy:
        return [tuple(entry[1:5]) for entry in proxy.getBusInfo(rospy.get_name())[2]]


class Peers(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> Any:
        rospy.init_node('udpros_peers')

    def check_crossing(self, publisher, got, text, seconds=20) -> None:
        """Publish a text until it is received."""
        def crossed() -> Any:
            publisher.publish(String(text))
            return any(message.data == text for message in got)
        wait_for(crossed, seconds, '%d bytes' % len(text))

    def test_a_living_roscpp_subscriber_keeps_its_connection_to_a_silent_topic(self) -> None:
        """It is asked for its ports; it would not ask again for a connection that its publisher ended."""
        publisher = udpros.Publisher('/silent_to_roscpp', String, queue_size=10)
        self.addCleanup(publisher.unregister)
        relay = start_relay('/silent_to_roscpp', '/from_silent', 'silent_relay')
        self.addCleanup(end, [relay])
        wait_for(publisher.connections, what='the subscriber')
        before, answers = publisher.connections(), []

        def answered(_, node, when) -> None:
            answers.append((node.name, when))
        with unittest.mock.patch.multiple(presence, PERIOD=0.5), \
                unittest.mock.patch.object(acceptor, 'SETTLED', 0.0), \
                unittest.mock.patch.object(presence.Presence, 'answered', answered):
            wait_for(lambda: [name for name, _ in answers].count('/silent_relay') >= 3, what='its answers')
            self.assertEqual(publisher.connections(), before)

    def test_both_ways_with_roscpp_small_and_of_many_blocks(self) -> None:
        relay = start_relay('/to_roscpp', '/from_roscpp', 'relay')
        self.addCleanup(end, [relay])
        got = []
        publisher = udpros.Publisher('/to_roscpp', String, queue_size=10)
        subscriber = udpros.Subscriber('/from_roscpp', String, got.append, transport='udp')
        for size in (0, 10, 1456, 1457, 20000, 70000):
            self.check_crossing(publisher, got, 'x' * size)
        self.assertIn((NODE, 'o', 'UDPROS', '/from_roscpp'), bus_info('/relay'))
        self.assertIn(('i', 'UDPROS', '/to_roscpp'), [entry[1:] for entry in bus_info('/relay')])
        self.assertIn(('/relay', 'o', 'UDPROS', '/to_roscpp'), bus_info(NODE))
        subscriber.unregister(), publisher.unregister()

    def test_roscpp_connects_at_every_length_of_names(self) -> None:
        lengths = range(1, LENGTHS_OF_ROSCPPS_BASE64 + 1)
        pairs = [('/in/' + 'x' * n, '/out/' + 'y' * n, 'walk_%02d' % n) for n in lengths]
        got, publishers, subscribers = {}, [], []
        for source, target, _ in pairs:
            publishers.append(udpros.Publisher(source, String, queue_size=10, transport='udp'))
            got[target] = threading.Event()
            subscribers.append(udpros.Subscriber(target, String, lambda _, t=target: got[t].set(), transport='udp'))
        relays = [start_relay(*pair) for pair in pairs]
        self.addCleanup(end, relays)

        def all_crossed() -> Any:
            for publisher in publishers:
                publisher.publish(String('hello'))
            return all(event.is_set() for event in got.values())
        try:
            wait_for(all_crossed, 60, 'all of them')
        except AssertionError:
            self.fail('no connection at %s' % [t for t, event in sorted(got.items()) if not event.is_set()])
        for topic in publishers + subscribers:
            topic.unregister()

    def test_falls_back_to_tcp_or_refuses(self) -> None:
        process = subprocess.Popen(['rostopic', 'pub', '-r', '20', '/plain', 'std_msgs/String', 'tcp'],
                                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.addCleanup(end, [process])
        got = []
        subscriber = udpros.Subscriber('/plain', String, got.append)
        wait_for(lambda: got, what='a message by TCPROS')
        self.assertEqual([entry[2] for entry in bus_info(NODE) if entry[3] == '/plain'], ['TCPROS'])
        subscriber.unregister()
        strict = udpros.Subscriber('/plain', String, got.append, transport='udp')
        del got[:]
        wait_for(lambda: strict.impl.publishers and not strict.impl.connecting, what='the attempt')
        self.assertFalse(strict.impl.has_connections() or got)
        strict.unregister()

    def test_a_topic_may_be_for_udp_or_tcp_alone(self) -> None:
        for transport, offer, refused in (('udp', 'TCPROS', True), ('tcp', 'TCPROS', False)):
            publisher = udpros.Publisher('/alone_' + transport, String, queue_size=1, transport=transport)
            with xmlrpc.client.ServerProxy(rosgraph.Master('/x').lookupNode(NODE)) as proxy:
                code, text, params = proxy.requestTopic('/someone', '/alone_' + transport, [[offer]])
            self.assertEqual(code != 1, refused, text)
            self.assertIn('UDPROS only' if refused else 'ready', text)
            publisher.unregister()
        publisher = udpros.Publisher('/tcp_to_udp', String, queue_size=1, transport='tcp')
        got = []
        subscriber = udpros.Subscriber('/tcp_to_udp', String, got.append)
        self.check_crossing(publisher, got, 'fallback')
        self.assertEqual({entry[2] for entry in bus_info(NODE) if entry[3] == '/tcp_to_udp'}, {'TCPROS'})
        publisher.unregister(), subscriber.unregister()

    def test_latch_and_mixed_subscribers(self) -> None:
        publisher = udpros.Publisher('/latched', String, queue_size=10, latch=True)
        publisher.publish(String('kept'))
        echo = subprocess.Popen(['rostopic', 'echo', '-n', '1', '/latched'], stdout=subprocess.PIPE)
        relay = start_relay('/latched', '/latched_relayed', 'latched_relay')
        self.addCleanup(end, [relay])
        by_udp, relayed = [], []
        subscribers = [udpros.Subscriber('/latched', String, by_udp.append, transport='udp'),
                       udpros.Subscriber('/latched_relayed', String, relayed.append)]
        wait_for(lambda: by_udp, what='the latched message by UDPROS')
        self.assertEqual(by_udp[0].data, 'kept')
        self.assertEqual(by_udp[0]._connection_header['latching'], '1')
        self.assertIn(b'kept', echo.communicate(timeout=60)[0])
        self.check_crossing(publisher, relayed, 'to all')
        wait_for(lambda: by_udp[-1].data == 'to all', what='the other subscriber')
        for topic in [publisher] + subscribers:
            topic.unregister()

    def test_frames_reach_every_kind_of_subscriber(self) -> None:
        publisher = udpros.Publisher('/scans', LaserScan, queue_size=10)
        relay = start_relay('/scans', '/scans_relayed', 'scans_relay')
        self.addCleanup(end, [relay])
        batches, single, relayed, by_tcp = [], [], [], []

        def batch(records, mask) -> None:
            batches.extend(records[mask].copy())
        subscribers = [udpros.Subscriber('/scans', LaserScan, single.append, transport='udp', batch_callback=batch),
                       udpros.Subscriber('/scans_relayed', LaserScan, relayed.append, transport='udp')]
        tcp = subprocess.Popen(['rostopic', 'echo', '-p', '--noarr', '/scans/header/seq'], stdout=subprocess.PIPE,
                               env=dict(os.environ, PYTHONUNBUFFERED='1'))
        self.addCleanup(end, [tcp])
        threading.Thread(target=lambda: by_tcp.extend(iter(tcp.stdout.readline, b'')), daemon=True).start()
        wait_for(lambda: publisher.get_num_connections() == 3, what='three subscribers')

        def through_the_relay() -> Any:    # which advertises only after its first message
            publisher.publish(LaserScan())
            return relayed
        wait_for(through_the_relay, what='a message through the relay')
        marks = itertools.count(1)

        def all_have_the_latest() -> Any:      # so nothing else is on its way
            mark = float(next(marks))
            publisher.publish(LaserScan(scan_time=mark))
            with contextlib.suppress(AssertionError):
                return wait_for(lambda: single and batches and (
                    single[-1].scan_time == relayed[-1].scan_time == batches[-1]['scan_time'] == mark), 2.0)
        wait_for(all_have_the_latest, what='the same by every way')
        begun = single[-1].header.seq
        for got in (batches, single, relayed):
            del got[:]
        frames = [udpros.Frame(LaserScan, count, {'header.frame_id': 5, 'ranges': ranges})
                  for count, ranges in ((30, 340), (1, 7))]
        for frame in frames:
            frame.records['header']['frame_id'] = np.frombuffer(b'laser', np.uint8)
            frame.records['range_max'] = 30.0
            frame.records['ranges'] = np.arange(frame.records['ranges'].shape[1])
        for start in range(0, 28, 2):
            publisher.publish_frames(frames[0].part(start, start + 2))
            # the relay's own queues hold ten messages
            wait_for(lambda count=start + 2: len(relayed) >= count, what='%d messages' % (start + 2))
        publisher.publish_frames(frames[0].part(28, 30), frames[1])
        wait_for(lambda: min(len(batches), len(single), len(relayed)) >= 31, what='31 messages by UDPROS')
        wait_for(lambda: by_tcp and by_tcp[-1].endswith(b',%d\n' % (begun + 31)), what='the last one by TCPROS')
        self.assertEqual([int(record['header']['seq']) for record in batches], list(range(begun + 1, begun + 32)))
        self.assertEqual([message.header.seq for message in single], list(range(begun + 1, begun + 32)))
        self.assertEqual([len(message.ranges) for message in relayed], [340] * 30 + [7])
        for message in single + relayed:
            self.assertEqual((message.header.frame_id, message.range_max), ('laser', 30.0))
            self.assertEqual(list(message.ranges), list(range(len(message.ranges))))
        self.assertEqual(subscribers[0].connections()[0]['lost'], 0)
        for topic in [publisher] + subscribers:
            topic.unregister()

    def test_frames_for_a_subscriber_of_small_datagrams(self) -> None:
        publisher = udpros.Publisher('/narrow', LaserScan, queue_size=10)
        got = []
        subscriber = udpros.Subscriber('/narrow', LaserScan, transport='udp', max_datagram_size=600,
                                       batch_callback=lambda records, mask: got.extend(records[mask].copy()))
        wait_for(publisher.get_num_connections, what='the subscriber')
        self.assertEqual(publisher.connections()[0]['max_datagram_size'], 600)
        frame = udpros.Frame(LaserScan, 5, {'ranges': 300})
        frame.records['ranges'] = np.arange(300)
        publisher.publish_frames(frame)
        wait_for(lambda: len(got) == 5, what='five messages of several blocks')
        self.assertEqual(got[4]['ranges'].tolist(), list(range(300)))
        publisher.unregister(), subscriber.unregister()

    def test_the_tools_work_on_a_udp_topic(self) -> None:
        publisher = udpros.Publisher('/tools', Header, queue_size=10)
        subscriber = udpros.Subscriber('/tools', Header, lambda _: None, transport='udp')
        timer = rospy.Timer(rospy.Duration(0.02), lambda _: publisher.publish(Header(frame_id='t')))
        with tempfile.TemporaryDirectory() as folder:
            commands = {'info': ['rostopic', 'info', '/tools'], 'echo': ['rostopic', 'echo', '-n', '3', '/tools'],
                        'bag': ['rosbag', 'record', '-l', '20', '-O', folder + '/x.bag', '/tools'],
                        'node': ['rosnode', 'info', NODE]}
            out = {name: subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
                   for name, command in commands.items()}
            hz = subprocess.Popen(['rostopic', 'hz', '/tools'], stdout=subprocess.PIPE)
            bandwidth = subprocess.Popen(['rostopic', 'bw', '/tools'], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            self.addCleanup(end, [hz, bandwidth])
            said = {name: process.communicate(timeout=60)[0].decode() for name, process in out.items()}
            self.assertIn(NODE, said['info'])
            self.assertEqual(said['echo'].count('frame_id: "t"'), 3)
            self.assertIn('UDPROS', said['node'][said['node'].index('/tools'):])
            self.assertGreater((pathlib.Path(folder) / 'x.bag').stat().st_size, 4096)
            self.assertTrue(any(b'average rate' in line for line in iter(hz.stdout.readline, b'')))
            self.assertTrue(any(b'average' in line for line in iter(bandwidth.stdout.readline, b'')))
        timer.shutdown()
        timer.join()
        publisher.unregister(), subscriber.unregister()


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'udpros_peers', Peers)
