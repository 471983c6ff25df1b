#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Two operators of one robot, at one master: each has its own topics, settings and link."""
import contextlib
import os
import pathlib
import signal
import subprocess
import sys
import threading
import unittest
import xmlrpc.client
from typing import Any, Dict, List, Set

import numpy as np
import rosgraph
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image
from tf2_msgs.msg import TFMessage

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, give_time, pid_at, wait_for

from smokebot_udp.msg import RobotStatus
from smokebot_udp.srv import SetFocus

OPERATORS = '', '/desk2'
SHARED = ('/smokebot_udp/', '/diagnostics', '/rosout')
"""Topics that have no namespace; /cmd_vel is the robot's."""


class Sources(threading.Thread):
    """Publishes two cameras, odometry and transforms without pause."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        noise = np.random.RandomState(0).bytes(160 * 120 * 3)
        self.messages = {
            '/thermal/image_raw': Image(height=120, width=160, encoding='mono16', step=320, data=noise[:120 * 320]),
            '/camera/image_raw': Image(height=120, width=160, encoding='bgr8', step=480, data=noise),
            '/odom': Odometry(child_frame_id='base_link')}
        for topic, message in self.messages.items():
            message.header.frame_id = topic.split('/')[1] + '_frame'
        self.publishers = {topic: rospy.Publisher(topic, type(message), queue_size=1)
                           for topic, message in self.messages.items()}
        self.tf = rospy.Publisher('/tf', TFMessage, queue_size=1)

    def run(self) -> None:
        rate = rospy.Rate(10)
        transform = TransformStamped(child_frame_id='base_link')
        transform.header.frame_id, transform.transform.rotation.w = 'map', 1.0
        while not rospy.is_shutdown():
            with contextlib.suppress(rospy.ROSException):   # at the end
                for topic, message in self.messages.items():
                    message.header.stamp = transform.header.stamp = rospy.Time.now()
                    self.publishers[topic].publish(message)
                self.tf.publish(TFMessage([transform]))
                rate.sleep()


def registered(node: str) -> Dict[str, Set[str]]:
    """{publishers, subscribers, services: what a node has registered}"""
    state = rosgraph.Master('/test').getSystemState()
    return {kind: {name for name, nodes in names if node in nodes}
            for kind, names in zip(('publishers', 'subscribers', 'services'), state)}


def pid_of(node: str) -> int:
    """0: it is not there, or does not answer."""
    try:
        return pid_at(rosgraph.Master('/test').lookupNode(node))
    except rosgraph.MasterException:
        return 0


class Operators(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('operators')
        cls.collectors = {(operator, topic): Collector('%s/operator/%s' % (operator, topic), message_class)
                          for operator in OPERATORS for topic, message_class in (
                              ('thermal/image_raw', Image), ('thermal/mask', Image), ('thermal/view', Image),
                              ('camera/image_raw', Image), ('odom', Odometry), ('status', RobotStatus))}
        cls.transforms: Dict[str, List[Any]] = {operator: [] for operator in OPERATORS}
        cls.subscribers = [rospy.Subscriber(operator + '/operator/tf', TFMessage, cls.transforms[operator].append)
                           for operator in OPERATORS]
        cls.levels: Dict[str, Any] = {}
        rospy.Subscriber('/diagnostics', DiagnosticArray, lambda message: cls.levels.update(
            (status.name, status) for status in message.status))
        Sources().start()
        for (operator, topic), collector in cls.collectors.items():
            wait_for(lambda out=collector: out.messages, 40, '%s of %s' % (topic, operator or 'the first operator'))

    def test_each_has_the_streams_with_their_frames(self) -> None:
        for operator in OPERATORS:
            for topic, frame in (('thermal/image_raw', 'thermal_frame'), ('thermal/mask', 'thermal_frame'),
                                 ('camera/image_raw', 'camera_frame'), ('odom', 'odom_frame')):
                out = self.collectors[operator, topic]
                out.clear()
                wait_for(lambda out=out: len(out.messages) > 5, 20, '%s/operator/%s' % (operator, topic))
                self.assertEqual({message.header.frame_id for message in list(out.messages.values())}, {frame})
            wait_for(lambda name=operator: self.transforms[name], 10, 'the transforms')
            transform = self.transforms[operator][-1].transforms[0]
            self.assertEqual((transform.header.frame_id, transform.child_frame_id), ('map', 'base_link'))

    def test_every_name_is_in_the_operators_namespace(self) -> None:
        for operator in OPERATORS:
            found = registered(operator + '/operator_receiver')
            for kind in ('publishers', 'subscribers'):
                own = {name for name in found[kind] if not name.startswith(SHARED) and name != '/cmd_vel'}
                other = {name for name in own if not name.startswith((operator + '/operator/',
                                                                      operator + '/operator_receiver/'))}
                self.assertFalse(other, '%s of %s' % (kind, operator))
            self.assertIn(operator + '/operator/stale', found['publishers'])
            self.assertIn(operator + '/operator/odom', found['subscribers'])
            self.assertIn(operator + '/operator_receiver/set_focus', found['services'])
            self.assertIn('/smokebot_udp/link/report', found['publishers'])
            self.assertLessEqual({'/smokebot_udp/thermal/segments', '/smokebot_udp/status/segments'},
                                 found['subscribers'])
        self.assertFalse(any(name.startswith('/desk2') for kind in registered('/operator_receiver').values()
                             for name in kind))

    def test_what_operators_send_reaches_the_robot(self) -> None:
        uris = sorted(rosgraph.Master('/test').lookupNode(operator + '/operator_receiver') for operator in OPERATORS)

        def heard(topic: str) -> List[str]:
            with xmlrpc.client.ServerProxy(rosgraph.Master('/test').lookupNode('/robot_sender')) as node:
                robot: Any = node
                return sorted(entry[1] for entry in robot.getBusInfo('/test')[2]
                              if entry[2:5] == ['i', 'UDPROS', '/smokebot_udp/' + topic])
        for topic in ('link/report', 'clock/ask', 'reliable/to_robot'):
            wait_for(lambda topic=topic: heard(topic) == uris, what='both operators at ' + topic)

    def test_their_diagnostics_have_different_names(self) -> None:
        for name in ('operator_receiver', 'desk2/operator_receiver'):
            wait_for(lambda name=name: self.levels.get(name + ': clock') and self.levels[name + ': clock'].level == 0,
                     20, 'the clock of ' + name)
        def loss(name: str) -> float:
            values = {pair.key: pair.value for pair in self.levels[name + ': thermal'].values}
            return float(values.get('loss [%]', 'nan'))
        wait_for(lambda: loss('operator_receiver') < 5, 20, 'no loss at the first')
        wait_for(lambda: 10 < loss('desk2/operator_receiver') < 30, 20, 'a fifth lost at the second')

    def test_a_live_setting_is_one_operators(self) -> None:
        one, other = (operator + '/operator_receiver/thermal/max_wait' for operator in OPERATORS)
        wait_for(lambda: rospy.has_param(one) and rospy.has_param(other), 10, 'the settings')
        before = rospy.get_param(one)
        rospy.set_param(other, 0.07)
        shown = ['rosrun', 'dynamic_reconfigure', 'dynparam', 'get', '/desk2/operator_receiver/thermal']
        wait_for(lambda: b"'max_wait': 0.07" in subprocess.run(shown, stdout=subprocess.PIPE, check=True).stdout, 10,
                 'the setting')
        shown[-1] = '/operator_receiver/thermal'
        self.assertIn(b"'max_wait': %g" % before, subprocess.run(shown, stdout=subprocess.PIPE, check=True).stdout)
        self.assertEqual((rospy.get_param(one), rospy.get_param(other)), (before, 0.07))

    def test_of_two_requests_for_a_focus_the_last_stands_and_both_operators_are_told(self) -> None:
        """Both are repeated until they are answered; the focus is switched once for each."""
        for first, second in (('navigation', 'inspection'), ('inspection', 'navigation')):
            switches: List[str] = []
            log = rospy.Subscriber('/robot_sender/status', RobotStatus, lambda status, out=switches: out.append(
                status.focus))
            wait_for(lambda out=switches: out, 10, 'the status')
            answers: Dict[str, Any] = {}

            def ask(operator: str, focus: str, out: Dict[str, Any] = answers) -> None:
                out[operator] = rospy.ServiceProxy(operator + '/operator_receiver/set_focus', SetFocus)(focus)
            threads = [threading.Thread(target=ask, args=request) for request in zip(OPERATORS, (first, second))]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join(60)
            self.assertEqual(set(answers), set(OPERATORS))
            give_time(1.0)      # what would go on switching would do so now
            log.unregister()
            changes = [focus for at, focus in enumerate(switches) if at == 0 or focus != switches[at - 1]]
            self.assertLessEqual(len(changes), 3, changes)
            final = rospy.get_param('/robot_sender/focus')
            self.assertEqual(final, changes[-1])
            for operator, asked in zip(OPERATORS, (first, second)):
                answer = answers[operator]
                self.assertIn(asked, answer.message)
                self.assertTrue(answer.success or 'a later request switched it to ' + final in answer.message)
                status = self.collectors[operator, 'status']
                wait_for(lambda out=status, focus=final: out.newest().focus == focus, 5, 'the focus at each operator')

    def test_zz_a_further_one_of_the_same_name_waits(self) -> None:
        """And it takes over when the first has ended: nobody is in each other's way."""
        first = wait_for(lambda: pid_of('/operator_receiver'), what='the first one')
        streams = str(pathlib.Path(__file__).resolve().parent / 'operators.yaml')
        third = subprocess.Popen(['rosrun', 'smokebot_udp', 'operator_receiver', '_streams_file:=' + streams],
                                 stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
        self.addCleanup(third.wait, 20)
        self.addCleanup(third.kill)
        # rosrun may say before that rosdep has no sources
        line = next((line for line in third.stdout or () if 'already runs' in line), '')
        self.assertRegex(line, r'/operator_receiver already runs on \S+ \(pid %d\)' % first)
        self.assertIn('operator.launch name:=desk2', line)
        self.assertEqual(pid_of('/operator_receiver'), first)
        for _ in range(2):      # the respawned first one and the third: who comes first stays, the other one waits
            os.kill(first, signal.SIGKILL)
            first = wait_for(lambda old=first: {pid_of('/operator_receiver')} - {0, old}, 60, 'the next one').pop()
            out = self.collectors['', 'thermal/image_raw']
            out.clear()
            wait_for(lambda out=out: len(out.messages) > 20, 30, 'its images')
            self.assertEqual(pid_of('/operator_receiver'), first)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'operators', Operators)
