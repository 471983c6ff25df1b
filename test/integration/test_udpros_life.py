#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS when peers die, restart, freeze or are not notified of each other."""
import errno
import gc
import math
import pathlib
import signal
import sys
import threading
import time
import unittest.mock
from typing import Any, List

import rosgraph
import rospy
import rostest
from rospy.impl.registration import RegManager, get_registration_listeners
from std_msgs.msg import Header

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from udpros_case import UdprosCase, end, open_files, rosgraph_uri
from waiting import undisturbed, wait_for

from smokebot_udp import udpros
from smokebot_udp.udpros import acceptor, connector, presence, silence, watch
from smokebot_udp.udpros.silence import SILENCE_TIMEOUT


class Life(UdprosCase):
    NODE = '/udpros_life'

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

    @undisturbed()
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

    @unittest.mock.patch.object(silence, 'SILENCE_TIMEOUT', math.inf)
    @unittest.mock.patch.object(watch, 'SILENCE_TIMEOUT', math.inf)
    def test_a_restarted_publisher_is_heard_again(self) -> None:
        """By the notification of the master: nobody asks for silent topics here."""
        times = []
        subscriber = udpros.Subscriber('/talked', Header, lambda _: times.append(time.monotonic()), transport='udp')
        self.addCleanup(subscriber.unregister)
        for how in (signal.SIGINT, signal.SIGKILL, signal.SIGKILL):
            before = rosgraph_uri('/talker')     # of a talker that was killed
            process = self.run_script('udpros_talker.py', '/talked', 'talker')
            wait_for(lambda old=before: rosgraph_uri('/talker') not in (None, old), what='the talker at the master')
            uri = rosgraph_uri('/talker')
            wait_for(lambda new=uri: new in subscriber.impl.publishers, what="the master's word")
            told = time.monotonic()
            del times[:]
            wait_for(lambda: times, 10, 'a message of the talker')
            print('heard again %.2f s after the notification of the master' % (times[0] - told))
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

    def test_a_publisher_that_unregisters_is_disconnected(self) -> None:
        self.run_script('udpros_talker.py', '/ended', 'ended_talker')
        got = []
        subscriber = udpros.Subscriber('/ended', Header, got.append, transport='udp')
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: got, what='the talker')
        rosgraph.Master('/ended_talker').unregisterPublisher('/ended', rosgraph_uri('/ended_talker'))
        wait_for(lambda: not subscriber.connections(), 5, 'the end of the connection')

    def test_a_publisher_that_is_not_wanted_is_not_connected_again(self) -> None:
        """By a plain rospy.Subscriber; the others are."""
        self.run_script('udpros_talker.py', '/partly', 'unwanted')
        self.run_script('udpros_talker.py', '/partly', 'wanted')
        heard: List[Any] = []

        def hear(message) -> None:
            heard.append(message._connection_header['callerid'])
            if heard[-1] == '/unwanted':
                udpros.drop_publisher('/partly', '/unwanted')
        subscriber = rospy.Subscriber('/partly', Header, hear)
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: {'/wanted', '/unwanted'} <= set(heard), 20, 'both talkers')
        wait_for(lambda: subscriber.get_num_connections() == 1, what='the end of the connection')
        self.run_script('udpros_talker.py', '/partly', 'late')      # the master notifies of all three
        wait_for(lambda: '/late' in heard, 20, 'another talker')
        heard.clear()
        wait_for(lambda: heard.count('/late') > 5 and heard.count('/wanted') > 5, 20, 'the others')
        self.assertNotIn('/unwanted', heard)
        self.assertEqual(subscriber.get_num_connections(), 2)

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

    @undisturbed()
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
            self.assertEqual(publisher.connections() + subscriber.connections(), [])

        def in_use() -> Any:
            gc.collect()     # rospy's poller of a topic holds itself: its epoll is closed by the collector alone
            return open_files(), sum(thread.name.startswith('UDPROS /used') for thread in threading.enumerate())
        use()
        wait_for(lambda: in_use()[1] == 0, what="the first use's end")
        before = in_use()[0]
        for _ in range(5):
            use()
        wait_for(lambda: in_use() <= (before + 1, 0), what='everything freed: at most %d files, no thread' % before)

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


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'udpros_life', Life)
