#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS when peers die, restart, freeze or are not notified of each other."""
import errno
import gc
import os
import pathlib
import signal
import socket
import subprocess
import sys
import threading
import time
import unittest
import unittest.mock
import xmlrpc.client
from typing import Any

import rosgraph
import rospy
import rostest
from rospy.impl.registration import RegManager, get_registration_listeners
from std_msgs.msg import Header

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import wait_for

from smokebot_udp import udpros
from smokebot_udp.srv import SetFocus, SetFocusResponse
from smokebot_udp.udpros import acceptor, connector, master, presence
from smokebot_udp.udpros.admission import MAX_PER_HOST, SETTLED
from smokebot_udp.udpros.negotiation import Request
from smokebot_udp.udpros.rospy_transports import PublisherTransport
from smokebot_udp.udpros.silence import SILENCE_TIMEOUT

HERE = pathlib.Path(__file__).resolve().parent
NODE = '/udpros_life'

def start(script, topic, name, *arguments) -> Any:
    return subprocess.Popen([sys.executable, str(HERE / script), topic, *arguments, '__name:=' + name],
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def end(process) -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGCONT)
        process.kill()
        process.wait(10)


def open_files() -> Any:
    return len(os.listdir('/proc/self/fd'))


class Life(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> Any:
        rospy.init_node('udpros_life')

    def run_script(self, script, topic, name, *arguments) -> Any:
        process = start(script, topic, name, *arguments)
        self.addCleanup(end, process)
        return process

    def publisher(self, topic) -> Any:
        publisher = udpros.Publisher(topic, Header, queue_size=10)
        self.addCleanup(publisher.unregister)
        return publisher

    def published_until(self, publisher, condition, what) -> Any:
        def publish() -> Any:
            publisher.publish(Header(frame_id='x'))
            return condition()
        return wait_for(publish, 20, what)

    def test_a_killed_subscriber_is_dropped(self) -> None:
        publisher = self.publisher('/killed')
        process = self.run_script('udpros_listener.py', '/killed', 'killed_listener')
        wait_for(publisher.get_num_connections, what='the subscriber')
        process.kill()
        process.wait(10)
        self.published_until(publisher, lambda: publisher.get_num_connections() == 0, 'the end of its connection')

    def test_silent_topics_leave_nothing_of_killed_subscribers(self) -> None:
        """Nothing is sent, so nothing is refused; each one has another name, so nothing replaces it."""
        with unittest.mock.patch.object(presence, 'HURRIED_PERIOD', 1.0), \
                unittest.mock.patch.object(acceptor, 'SETTLED', 1.0):
            silent, plain = self.publisher('/silent'), rospy.Publisher('/silent_plain', Header, queue_size=1)
            self.addCleanup(plain.unregister)
            files = open_files()
            for number in range(3):
                killed = [self.run_script('udpros_listener.py', publisher.name, 'silent_%d_%d' % (number, which))
                          for which, publisher in enumerate((silent, plain))]
                wait_for(lambda one=number: all(
                    any('_%d_' % one in c.endpoint_id for c in publisher.impl.connections)
                    for publisher in (silent, plain)), what='the subscribers')
                for process in killed:
                    process.kill()
                    process.wait(10)
            living = self.run_script('udpros_listener.py', '/silent', 'silent_living')
            wait_for(lambda: '/silent_living' in [c.endpoint_id for c in silent.impl.connections], what='another one')
            wait_for(lambda: (silent.get_num_connections(), plain.get_num_connections()) == (1, 0), 15, 'their end')
            # of six that were killed; the living one has one, and two may be of calls at this moment
            wait_for(lambda: open_files() <= files + 3, what='the end of their sockets')
            self.assertIsNone(living.poll())

    def test_a_frozen_subscriber_blocks_nobody(self) -> None:
        publisher = self.publisher('/frozen')
        process = self.run_script('udpros_listener.py', '/frozen', 'frozen_listener')
        wait_for(publisher.get_num_connections, what='the subscriber')
        process.send_signal(signal.SIGSTOP)
        longest, message = 0.0, Header(frame_id='x' * 20000)
        for _ in range(2000):     # 40 MB: far beyond any buffer
            before = time.monotonic()
            publisher.publish(message)
            longest = max(longest, time.monotonic() - before)
        self.assertLess(longest, 5.0)
        self.assertEqual(publisher.get_num_connections(), 1)

    def test_a_restarted_subscriber_leaves_no_ghost(self) -> None:
        publisher = self.publisher('/restarted')
        for _ in range(3):
            process = self.run_script('udpros_listener.py', '/restarted', 'restarted_listener')
            before = publisher.connections()
            wait_for(lambda old=before: publisher.connections() and publisher.connections() != old, what='it')
            wait_for(lambda: publisher.get_num_connections() == 1, 5, 'the end of the one before')
            process.kill()
            process.wait(10)

    def test_a_restarted_publisher_is_heard_again(self) -> None:
        times = []
        subscriber = udpros.Subscriber('/talked', Header, lambda _: times.append(time.monotonic()), transport='udp')
        self.addCleanup(subscriber.unregister)
        for how in (signal.SIGINT, signal.SIGKILL, signal.SIGKILL):
            process = self.run_script('udpros_talker.py', '/talked', 'talker')
            uri = wait_for(lambda: rosgraph_uri('/talker'), what='the talker at the master')
            wait_for(lambda new=uri: new in subscriber.impl.publishers, what="the master's word")
            told = time.monotonic()
            del times[:]
            wait_for(lambda: times, 10, 'a message of the talker')
            print('heard again %.2f s after the notification of the master' % (times[0] - told))
            self.assertLess(times[0] - told, SILENCE_TIMEOUT, 'found by the watch of silent topics only')
            wait_for(lambda: len(subscriber.connections()) == 1, 5, 'the end of the connection to the one before')
            process.send_signal(how)
            process.wait(60)

    def test_a_killed_publisher_among_others_leaves_nothing_behind(self) -> None:
        """It cannot unregister, and the topic is not silent."""
        self.run_script('udpros_talker.py', '/outlived', 'survivor')
        killed = self.run_script('udpros_talker.py', '/outlived', 'killed_talker')
        subscriber = udpros.Subscriber('/outlived', Header, transport='udp')
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: len(subscriber.connections()) == 2, what='both publishers')
        end(killed)
        wait_for(lambda: [thread.name for thread in threading.enumerate()].count('UDPROS /outlived') == 1,
                 SILENCE_TIMEOUT + 10, 'the end of the connection')
        self.assertEqual([one['peer'] for one in subscriber.connections()], ['/survivor'])

    def test_the_masters_lost_word_is_asked_for(self) -> None:
        """The talker dies and another one starts, and nobody notifies us."""
        first = self.run_script('udpros_talker.py', '/unheard', 'unheard_talker')
        times = []
        subscriber = udpros.Subscriber('/unheard', Header, lambda _: times.append(time.monotonic()), transport='udp')
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: times, what='the talker')
        handler = next(x for x in get_registration_listeners().listeners if isinstance(x, RegManager)).handler
        with unittest.mock.patch.object(handler, 'publisherUpdate', lambda *_: (1, '', 0)):
            end(first)
            self.run_script('udpros_talker.py', '/unheard', 'unheard_talker')
            del times[:]
            wait_for(lambda: times, SILENCE_TIMEOUT + 10, 'the talker again')
        wait_for(lambda: len(subscriber.connections()) == 1, what='the end of the connection to the first one')

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
        ended = time.monotonic() + 2
        while time.monotonic() < ended:
            self.assertEqual(subscriber.impl.connections, before)
            self.assertLess(time.monotonic() - times[-1], 1)
            time.sleep(0.05)
        uri = rosgraph_uri('/steady_talker')
        wait_for(lambda: subscriber.impl.publishers == (uri,), 10, 'the end of the attempts to connect to others')

    def test_a_stranger_takes_no_stream_away(self) -> None:
        """By requests in the subscriber's name for another port, its own port, or another host."""
        publisher = self.publisher('/wanted')
        self.run_script('udpros_listener.py', '/wanted', 'victim')
        wait_for(publisher.connections, what='the subscriber')
        before = publisher.connections()
        time.sleep(SETTLED + 0.5)
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
            self.assertEqual(request_topic('/plain_wanted', NODE, *other.getsockname())[0], 1)
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
            header = {'callerid': NODE}
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

    def test_a_publisher_that_unregisters_is_disconnected(self) -> None:
        self.run_script('udpros_talker.py', '/ended', 'ended_talker')
        got = []
        subscriber = udpros.Subscriber('/ended', Header, got.append, transport='udp')
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: got, what='the talker')
        rosgraph.Master('/ended_talker').unregisterPublisher('/ended', rosgraph_uri('/ended_talker'))
        wait_for(lambda: not subscriber.connections(), 5, 'the end of the connection')

    def test_a_publisher_that_forgot_us_is_asked_again(self) -> None:
        """Its side of the connection is closed, ours is open: only the silence reveals it."""
        publisher = self.publisher('/forgot')
        got = []
        subscriber = udpros.Subscriber('/forgot', Header, got.append, transport='udp')
        self.addCleanup(subscriber.unregister)
        self.published_until(publisher, lambda: got, 'a message')
        for connection in publisher.impl.connections:
            connection.close()
        del got[:]
        wait_for(lambda: publisher.get_num_connections(), SILENCE_TIMEOUT + 10, 'a new connection')
        self.published_until(publisher, lambda: got, 'a message again')

    def test_a_refusal_does_not_make_a_stream_tcp_for_ever(self) -> None:
        """Here the publisher has no route to the subscriber for a moment."""
        publisher, got = self.publisher('/fell_back'), []
        error = OSError(errno.ENETUNREACH, 'Network is unreachable')
        with unittest.mock.patch.object(acceptor, 'path_payload', side_effect=error):
            subscriber = udpros.Subscriber('/fell_back', Header, got.append)
            self.addCleanup(subscriber.unregister)
            self.published_until(publisher, lambda: got, 'a message by TCP')
            self.assertFalse(subscriber.connections())
        wait_for(subscriber.connections, 10, 'UDPROS')
        del got[:]
        self.published_until(publisher, lambda: got, 'a message by UDP')
        wait_for(lambda: (publisher.get_num_connections(), len(publisher.connections()),
                          subscriber.get_num_connections()) == (1, 1, 1), 5, 'one connection on each side')

    def test_no_file_descriptor_for_a_moment(self) -> None:
        """The attempt to connect is repeated, long before the watch of silent topics asks again."""
        open_receiver = connector.open_receiver
        results = [OSError(errno.EMFILE, 'Too many open files')]

        def fail_once(*args) -> Any:
            if results:
                raise results.pop()
            return open_receiver(*args)

        publisher = self.publisher('/no_file')
        with unittest.mock.patch.object(connector, 'open_receiver', fail_once):
            self.addCleanup(udpros.Subscriber('/no_file', Header).unregister)
            wait_for(publisher.connections, 3, 'the connection')
        self.assertFalse(results)

    def test_unregistering_frees_sockets_and_threads(self) -> None:
        def use() -> None:
            publisher = udpros.Publisher('/used', Header, queue_size=10)
            got = []
            subscriber = udpros.Subscriber('/used', Header, got.append, transport='udp')
            self.published_until(publisher, lambda: got, 'a message')
            subscriber.unregister(), publisher.unregister()

        def in_use() -> Any:
            gc.collect()     # rospy's poller of a topic holds itself: its epoll is closed by the collector alone
            return open_files(), sum(thread.name.startswith('UDPROS /used') for thread in threading.enumerate())
        use()
        wait_for(lambda: in_use()[1] == 0, what="the first use's end")
        before = in_use()[0]
        for _ in range(5):
            use()
        wait_for(lambda: in_use() <= (before + 1, 0), what='everything freed: at most %d files, no thread' % before)

    def registered(self) -> Any:
        """Our registrations at the master: a set of (kind, name)."""
        state = rosgraph.Master('/test').getSystemState()
        return {(kind, name) for kind, names in zip(('pub', 'sub', 'srv'), state)
                for name, nodes in names if NODE in nodes and 'together' in name}

    def check_registering_together(self) -> None:
        """All are registered at the end, except those that ended before; then they connect to each other."""
        got = []
        with udpros.registered_together():
            publisher, plain = self.publisher('/together'), rospy.Publisher('/together_plain', Header, queue_size=1)
            subscriber = udpros.Subscriber('/together', Header, got.append, transport='udp')
            with udpros.registered_together():
                listener = rospy.Subscriber('/together_plain', Header, got.append)
            service = rospy.Service('/together_asked', SetFocus, lambda _: SetFocusResponse(True, 'here'))
            rospy.Publisher('/together_never', Header, queue_size=1).unregister()
            self.assertEqual(self.registered(), set())
        self.assertEqual(self.registered(), {
            ('pub', '/together'), ('sub', '/together'), ('pub', '/together_plain'), ('sub', '/together_plain'),
            ('srv', '/together_asked')})
        self.published_until(publisher, lambda: got, 'a message')
        self.assertEqual(rospy.ServiceProxy('/together_asked', SetFocus)('').message, 'here')
        for one in (subscriber, publisher, listener, plain):
            one.unregister()
        service.shutdown()
        wait_for(lambda: not self.registered(), what='the end of all')

    def test_topics_and_services_are_registered_together(self) -> None:
        self.check_registering_together()

    def test_subscribers_hear_of_their_only_publisher_from_itself(self) -> None:
        """The master notifies them one topic after the other, over the link if that is between them."""
        told = []

        def call(uri, *args) -> Any:
            told.append((uri, *args))
            return []
        one, two = (rospy.Subscriber(topic, Header) for topic in ('/of_one', '/of_two'))
        self.run_script('udpros_talker.py', '/of_two', 'the_other')
        wait_for(two.get_num_connections, what='the other publisher')
        with unittest.mock.patch.object(master.rpc, 'call', call):
            with udpros.registered_together():
                publishers = [rospy.Publisher(topic, Header, queue_size=1) for topic in ('/of_one', '/of_two')]
            here = rospy.core.get_node_uri()
            told_of = wait_for(lambda: [word for word in told if word[1] == 'publisherUpdate'], what='its word')
            self.assertEqual(told_of, [(here, 'publisherUpdate', '/of_one', [here])])
        for topic in (one, two, *publishers):
            topic.unregister()

    def test_a_late_word_of_one_publisher_ends_no_connection_to_another(self) -> None:
        for name in ('partial_one', 'partial_two'):
            self.run_script('udpros_talker.py', '/partial', name)
        subscriber = udpros.Subscriber('/partial', Header, transport='udp')
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: len(subscriber.connections()) == 2, what='both publishers')
        before = set(subscriber.impl.connections)
        with xmlrpc.client.ServerProxy(rospy.get_node_uri()) as proxy:
            proxy.publisherUpdate('/partial_one', '/partial', [rosgraph_uri('/partial_one')])
        ended = time.monotonic() + 2
        while time.monotonic() < ended:
            self.assertEqual(set(subscriber.impl.connections), before)
            time.sleep(0.05)

    def test_a_late_word_of_ours_is_corrected_by_the_master(self) -> None:
        """The subscriber may be roscpp's, which believes it."""
        told = []

        def call(_, method, *args) -> Any:
            told.append((method, *args))
            return [[['/of_two_soon', [NODE, '/another']]], [], []] if method == 'getSystemState' else []
        listener = rospy.Subscriber('/of_two_soon', Header)
        here = rospy.core.get_node_uri()
        with unittest.mock.patch.object(master.rpc, 'call', call):
            with udpros.registered_together():
                publisher = rospy.Publisher('/of_two_soon', Header, queue_size=1)
            wanted = [('publisherUpdate', '/of_two_soon', [here]), ('getSystemState',),
                      ('registerPublisher', '/of_two_soon', Header._type, here)]
            wait_for(lambda: len(told) >= 3, what='the correction')
        self.assertEqual(told, wanted)
        publisher.unregister(), listener.unregister()

    def test_what_the_master_does_not_take_together_is_registered_one_by_one(self) -> None:
        with unittest.mock.patch.dict(master.CALLS, pub='noSuchMethod', srv='noSuchMethod'):
            self.check_registering_together()

    def test_an_outage_leaves_no_backlog(self) -> None:
        """A subscriber that was blocked for a while continues with fresh messages, not with all it missed."""
        got = []
        subscriber = udpros.Subscriber('/fresh', Header, got.append, transport='udp', queue_size=5,
                                       receive_buffer=1 << 22)
        self.addCleanup(subscriber.unregister)
        publisher = self.publisher('/fresh')
        self.published_until(publisher, lambda: got, 'a message')
        entered, leave = threading.Event(), threading.Event()

        def busy(_) -> None:
            entered.set()
            leave.wait(20)
        subscriber.impl.add_callback(busy, None)
        self.published_until(publisher, entered.is_set, 'the busy callback')
        for _ in range(500):
            publisher.publish(Header(frame_id='missed'))
        publisher.publish(Header(frame_id='fresh'))
        subscriber.impl.remove_callback(busy, None)
        del got[:]
        leave.set()
        wait_for(lambda: got and got[-1].frame_id == 'fresh', what='the fresh message')
        self.assertLess(len(got), 30)


def request_topic(topic, caller, host, port, size=1472) -> Any:
    """A request to this node, as anybody could make it; returns the answer's code and text."""
    header = {'topic': topic, 'md5sum': Header._md5sum, 'type': Header._type, 'callerid': caller}
    with xmlrpc.client.ServerProxy(rospy.get_node_uri()) as proxy:
        return proxy.requestTopic(caller, topic, [Request(host, port, header, size).params()])[:2]


def rosgraph_uri(node) -> Any:
    try:
        return rosgraph.Master(NODE).lookupNode(node)
    except rosgraph.MasterError:
        return None


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'udpros_life', Life)
