#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Topics and services that are registered together."""
import pathlib
import sys
import unittest.mock
from typing import Any

import rosgraph
import rospy
import rostest
from std_msgs.msg import Header

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from udpros_case import UdprosCase
from waiting import wait_for

from smokebot_udp import udpros
from smokebot_udp.srv import SetFocus, SetFocusResponse
from smokebot_udp.udpros import master


class Registering(UdprosCase):
    NODE = '/udpros_registration'

    def registered(self) -> Any:
        """Our registrations at the master: a set of (kind, name)."""
        state = rosgraph.Master('/test').getSystemState()
        return {(kind, name) for kind, names in zip(('pub', 'sub', 'srv'), state)
                for name, nodes in names if self.NODE in nodes and 'together' in name}

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

        def call(uri, *args, **_) -> Any:
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

    def test_a_late_word_of_ours_is_corrected_by_the_master(self) -> None:
        """The subscriber may be roscpp's, which believes it."""
        told = []

        def call(uri, method, *args, **_) -> Any:
            told.append((method, *args))
            return [[['/of_two_soon', [self.NODE, '/another']]], [], []] if method == 'getSystemState' else []
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


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'udpros_registration', Registering)
