#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS when the master is killed and started again: on a master of this test's own."""
import contextlib
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time
import unittest
import xmlrpc.client
from typing import Any

import rospy
import rostest
from std_msgs.msg import Header

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import free_port, give_time, stays, undisturbed, wait_for

from smokebot_udp import udpros
from smokebot_udp.mission.parameters import Parameter
from smokebot_udp.mission.settings import SettingsStore
from smokebot_udp.nodes.live import LiveSettings
from smokebot_udp.nodes.parameter_watch import ParameterWatch
from smokebot_udp.srv import SetFocus, SetFocusResponse
from smokebot_udp.udpros.silence import SILENCE_TIMEOUT

HERE = pathlib.Path(__file__).resolve().parent
NODE = '/udpros_master'


class OwnMaster:
    """A master that can be killed."""

    def __init__(self) -> None:
        self.port = free_port()
        self.uri = 'http://localhost:%d' % self.port
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(['rosmaster', '--core', '-p', str(self.port)], stdout=subprocess.DEVNULL,
                                        stderr=subprocess.DEVNULL)
        wait_for(self.answers, what='the master')

    def answers(self) -> bool:
        with contextlib.suppress(OSError):
            return bool(self.call('getPid'))
        return False

    def end(self) -> None:
        self.process.kill()
        self.process.wait(10)

    def restart(self) -> None:
        self.end()
        self.start()

    def call(self, method, *args) -> Any:
        with xmlrpc.client.ServerProxy(self.uri) as proxy:
            return getattr(proxy, method)('/test', *args)[2]

    def registered(self, node) -> Any:
        """What a node has registered: a set of (kind, name)."""
        state = self.call('getSystemState')
        return {(kind, name) for kind, names in zip(('pub', 'sub', 'srv'), state)
                for name, nodes in names if node in nodes}


class Master(unittest.TestCase):
    master: OwnMaster

    @classmethod
    def setUpClass(cls) -> Any:
        cls.master = OwnMaster()
        os.environ['ROS_MASTER_URI'] = cls.master.uri
        rospy.init_node('udpros_master')

    @classmethod
    def tearDownClass(cls) -> Any:
        rospy.signal_shutdown('the tests have ended')
        cls.master.end()

    def talker(self, topic, name, before='') -> Any:
        script = str(HERE / 'udpros_talker.py')
        code = before + '\nimport runpy\nrunpy.run_path(%r, run_name="__main__")' % script
        process = subprocess.Popen([sys.executable, '-c', code, topic, '__name:=' + name],
                                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.addCleanup(process.wait, 10)
        self.addCleanup(process.kill)
        return process

    def subscriber(self, topic) -> Any:
        """A Subscriber, and the times of its messages."""
        times = []
        subscriber = udpros.Subscriber(topic, Header, lambda _: times.append(time.monotonic()), transport='udp')
        self.addCleanup(subscriber.unregister)
        return subscriber, times

    def test_a_node_is_registered_at_a_new_master(self) -> None:
        rospy.set_param('~value', 1)
        self.assertEqual(rospy.get_param_cached('~')['value'], 1)
        publisher = udpros.Publisher('/made', Header, queue_size=1)
        plain = rospy.Publisher('/plain', Header, queue_size=1)
        service = rospy.Service('/asked', SetFocus, lambda _: SetFocusResponse(True, 'here'))
        _, times = self.subscriber('/taken')
        ours = {('pub', '/made'), ('pub', '/plain'), ('srv', '/asked'), ('sub', '/taken')}
        self.assertLessEqual(ours, self.master.registered(NODE))
        self.talker('/taken', 'taken_talker')
        wait_for(lambda: times, what='the talker')
        for _ in range(2):
            self.master.restart()
            begun = time.monotonic()
            wait_for(lambda: ours <= self.master.registered(NODE), 6, 'our registrations')
            wait_for(lambda: ('pub', '/taken') in self.master.registered('/taken_talker'), 6, "the talker's")
            print('registered again %.2f s after the start of the master' % (time.monotonic() - begun))
        self.assertEqual(rospy.ServiceProxy('/asked', SetFocus)('').message, 'here')
        self.master.call('setParam', NODE + '/value', 2)
        wait_for(lambda: rospy.get_param_cached('~value') == 2, 5, 'the notification of the parameter')
        publisher.unregister(), plain.unregister(), service.shutdown()
        self.assertFalse(self.master.registered(NODE) & {('pub', '/made'), ('pub', '/plain'), ('srv', '/asked')})

    def test_log_messages_do_not_wait_for_the_master(self) -> None:
        udpros.Publisher('/logging', Header, queue_size=1)
        self.master.process.send_signal(signal.SIGSTOP)     # it accepts connections, but answers nothing
        try:
            logged = threading.Thread(target=rospy.loginfo, args=('the master is silent',), daemon=True)
            logged.start()
            logged.join(5)
            self.assertFalse(logged.is_alive())
        finally:
            self.master.process.send_signal(signal.SIGCONT)
        logged.join(5)

    def test_live_settings_begin_when_the_master_comes(self) -> None:
        store = SettingsStore({'rate': Parameter(1.0, 'Hz', 'how often', live=True)}, {'rate': 2.0}, lambda _: None)
        self.master.end()
        try:
            watch = ParameterWatch([LiveSettings('late', store, self.fail)], background=False)
        finally:
            self.master.start()
        wait_for(lambda: ('srv', NODE + '/late/set_parameters') in self.master.registered(NODE), 10, 'the service')
        self.assertEqual(self.master.call('getParam', NODE + '/late/rate'), 2.0)
        self.master.call('setParam', NODE + '/late/rate', 3.0)
        wait_for(lambda: store.current.requested['rate'] == 3.0, 5, 'the change')
        watch.close()

    @undisturbed()
    def test_a_working_connection_outlives_the_master(self) -> None:
        """Also to a publisher that does not register again."""
        deaf = 'from smokebot_udp.udpros.watch import Watch; Watch.start = lambda self: None'
        self.talker('/both', 'deaf_talker', deaf), self.talker('/both', 'both_talker')
        subscriber, times = self.subscriber('/both')
        wait_for(lambda: times and len(subscriber.connections()) == 2, what='both talkers')
        before = list(subscriber.impl.connections)
        self.master.restart()
        ended = time.monotonic() + SILENCE_TIMEOUT + 3
        wait_for(lambda: ('pub', '/both') in self.master.registered('/both_talker'), 6, "the one's registration")
        stays(lambda: set(subscriber.impl.connections) == set(before) and time.monotonic() - times[-1] < 2,
              ended - time.monotonic(), 'both connections')

    def test_a_silent_connection_outlives_the_master(self) -> None:
        """As long as its publisher answers: then it is renewed if the publisher has forgotten it."""
        code = 'import rospy; from rospy.impl.registration import RegManager as R; from smokebot_udp import udpros; ' \
            'from std_msgs.msg import Header; from smokebot_udp.udpros.watch import Watch; ' \
            'Watch.start = lambda self: None; rospy.init_node("silent"); ' \
            'p = udpros.Publisher("/silent", Header, queue_size=1); ' \
            's = rospy.Subscriber("/speak", Header, p.publish); ' \
            'c = rospy.Subscriber("/forget", Header, lambda _: p.impl.connections[0].close()); rospy.spin()'
        process = subprocess.Popen([sys.executable, '-c', code])
        self.addCleanup(process.wait, 10)
        self.addCleanup(process.kill)
        subscriber, times = self.subscriber('/silent')
        speak, forget = (rospy.Publisher(topic, Header, queue_size=1) for topic in ('/speak', '/forget'))
        wait_for(lambda: all(p.get_num_connections() for p in (speak, forget, subscriber)), what='the connections')
        self.master.restart()
        for renewed in (False, True):
            before = list(subscriber.impl.connections)
            if renewed:
                forget.publish(Header())
            asked = time.monotonic()
            wait_for(lambda old=asked: subscriber.impl.silence.asked_at > old, 20, 'the watch')
            wait_for(lambda: len(subscriber.impl.connections) == 1, 5, 'the connection')
            give_time(2)        # what is not renewed stays
            self.assertEqual(list(subscriber.impl.connections) == before, not renewed)
        del times[:]
        speak.publish(Header())
        wait_for(lambda: times, 5, 'a message')
        process.kill()
        wait_for(lambda: not subscriber.connections(), 10, 'its end')    # one message has no usual pause


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'udpros_master', Master)
