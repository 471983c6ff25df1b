#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS when somebody else asks for connections, or says who publishes."""
import pathlib
import socket
import sys
import threading
import time
import xmlrpc.client

import rosgraph
import rospy
import rostest
from std_msgs.msg import Header

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from udpros_case import UdprosCase, request_topic, rosgraph_uri
from waiting import stays, undisturbed, wait_for

from smokebot_udp import udpros
from smokebot_udp.udpros.admission import MAX_PER_HOST, SETTLED
from smokebot_udp.udpros.negotiation import Request
from smokebot_udp.udpros.rospy_transports import PublisherTransport
from smokebot_udp.udpros.silence import SILENCE_TIMEOUT


class Strangers(UdprosCase):
    NODE = '/udpros_strangers'

    @undisturbed()
    def test_a_stranger_ends_no_connection(self) -> None:
        """By notifications, in its own name and in the master's, that a topic has no publisher, or others."""
        self.run_script('udpros_talker.py', '/steady', 'steady_talker')
        times = []
        subscriber = udpros.Subscriber('/steady', Header, lambda _: times.append(time.monotonic()), transport='udp')
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: times, what='the talker')
        before, threads = subscriber.impl.connections, threading.active_count()
        with xmlrpc.client.ServerProxy(rospy.get_node_uri()) as proxy:
            for number in range(100):
                for name in ('/master', '/stranger'):
                    proxy.publisherUpdate(name, '/steady', [])
                    proxy.publisherUpdate(name, '/steady', ['http://127.0.0.1:%d/' % (1 + number)])
                self.assertLess(threading.active_count(), threads + 10)
        stays(lambda: subscriber.impl.connections == before and time.monotonic() - times[-1] < 1, 2, 'the connection')
        uri = rosgraph_uri('/steady_talker')
        wait_for(lambda: subscriber.impl.publishers == (uri,), 10, 'the end of the attempts to connect to others')

    def test_a_stranger_takes_no_stream_away(self) -> None:
        """By requests in the subscriber's name for another port, its own port, or another host."""
        publisher = self.publisher('/wanted')
        self.run_script('udpros_listener.py', '/wanted', 'victim')
        wait_for(publisher.connections, what='the subscriber')
        before = publisher.connections()
        wait_for(lambda: publisher.impl.connections[0].since < time.monotonic() - SETTLED - 0.5, what='its age')
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(('127.0.0.1', 0))
            port = before[0]['address'][1]
            for place in (('127.0.0.1', other.getsockname()[1]), ('127.0.0.1', port), ('192.0.2.1', port)) * 3:
                request_topic('/wanted', '/victim', *place)
                publisher.publish(Header())
                self.assertEqual(publisher.connections()[0]['connection_id'], before[0]['connection_id'])
                self.assertEqual(len(publisher.connections()), 1)
        reasons = udpros.refused_requests()
        self.assertGreaterEqual(min(reasons['connected already'], reasons['address']), 3)

    def test_a_stranger_ends_no_tcp_connection_of_a_plain_publisher(self) -> None:
        publisher, got = rospy.Publisher('/plain_wanted', Header, queue_size=1), []
        self.addCleanup(publisher.unregister)
        subscriber = rospy.Subscriber('/plain_wanted', Header, got.append)
        self.addCleanup(subscriber.unregister)
        wait_for(publisher.get_num_connections, what='the subscriber')
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(('127.0.0.1', 0))
            self.assertEqual(request_topic('/plain_wanted', self.NODE, *other.getsockname())[0], 1)
            self.published_until(publisher, lambda: got, 'a message')
            self.assertTrue(other.recv(1000))

    def test_connections_are_bounded(self) -> None:
        publisher = self.publisher('/bounded')
        sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(MAX_PER_HOST + 4)]
        codes = []
        for number, one in enumerate(sockets):
            self.addCleanup(one.close)
            one.bind(('127.0.0.1', 0))
            name = '/bounded_%d' % number
            rosgraph.Master(name).registerSubscriber('/other', Header._type, 'http://localhost:%d/' % (1 + number))
            self.addCleanup(rosgraph.Master(name).unregisterSubscriber, '/other', 'http://localhost:%d/' % (1 + number))
            codes.append(request_topic('/bounded', name, *one.getsockname())[0])
        self.assertEqual(codes, MAX_PER_HOST * [1] + 4 * [0])
        self.assertEqual(len(publisher.connections()), MAX_PER_HOST)
        self.assertEqual(udpros.refused_requests()['connections of a host'], 4)

    def test_a_publisher_that_sends_elsewhere_is_asked_again(self) -> None:
        """Its connection has our name and another port: the node's address has changed, or a stranger's request."""
        publisher, got = self.publisher('/elsewhere'), []
        subscriber = udpros.Subscriber('/elsewhere', Header, got.append, transport='udp')
        self.addCleanup(subscriber.unregister)
        self.published_until(publisher, lambda: got, 'a message')
        publisher.impl.connections[0].close()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(('127.0.0.1', 0))
            header = {'callerid': self.NODE}
            publisher.impl.add_connection(
                PublisherTransport('/elsewhere', Request('127.0.0.1', other.getsockname()[1], header), 77, 1472))
            wait_for(lambda: subscriber.connections()[0]['idle'] > 1, 5, 'silence')
            del got[:]
            self.published_until(publisher, lambda: got, 'a message again')
        wait_for(lambda: publisher.get_num_connections() == 1, 5, 'the end of the other connection')

    def test_what_a_node_publishes_is_asked_for_again_when_it_has_another_address(self) -> None:
        """It may have ended its connections; that is known before the topic has been silent for long."""
        self.run_script('udpros_talker.py', '/slow', 'moved', '0.02')
        publisher, got = self.publisher('/to_moved'), []
        subscriber = udpros.Subscriber('/slow', Header, got.append, transport='udp')
        self.addCleanup(subscriber.unregister)
        first = wait_for(subscriber.connections, what='the talker')[0]['address']
        wait_for(lambda: subscriber.connections()[0]['idle'] > 0.5, what='silence')
        publisher.impl.add_connection(PublisherTransport(
            '/to_moved', Request('127.0.0.2', 9, {'callerid': '/moved'}), 77, 1472))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as now:
            now.bind(('127.0.0.1', 0))
            self.assertEqual(request_topic('/to_moved', '/moved', *now.getsockname())[0], 1)
        wait_for(lambda: [c for c in subscriber.connections() if c['address'] != first], SILENCE_TIMEOUT,
                 'another connection')

    def test_a_late_word_of_one_publisher_ends_no_connection_to_another(self) -> None:
        for name in ('partial_one', 'partial_two'):
            self.run_script('udpros_talker.py', '/partial', name)
        subscriber = udpros.Subscriber('/partial', Header, transport='udp')
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: len(subscriber.connections()) == 2, what='both publishers')
        before = set(subscriber.impl.connections)
        with xmlrpc.client.ServerProxy(rospy.get_node_uri()) as proxy:
            proxy.publisherUpdate('/partial_one', '/partial', [rosgraph_uri('/partial_one')])
        stays(lambda: set(subscriber.impl.connections) == before, 2, 'both connections')


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'udpros_strangers', Strangers)
