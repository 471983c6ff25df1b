#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Robot and operator with a master each, over one UDP port: keys, settings, and restarts of everything."""
import os
import pathlib
import shutil
import signal
import sys
import tempfile
import time
import unittest
from typing import Any, Dict

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image
from std_msgs.msg import Header

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from own_masters import Side
from waiting import Collector, free_port, wait_for

from smokebot_udp import udpros
from smokebot_udp.link.keys import make_key
from smokebot_udp.srv import SetFocus

STREAMS = pathlib.Path(__file__).resolve().parent / 'link_streams.yaml'
ROBOT, OPERATOR = '/robot_sender', '/operator_receiver'
START = 60.0
"""For nodes to start on a busy machine [s]."""


class Link(unittest.TestCase):
    robot: Side
    desk: Side

    @classmethod
    def setUpClass(cls) -> None:
        cls.robot, cls.desk = Side('robot'), Side('desk')
        cls.addClassCleanup(cls.robot.close)
        cls.addClassCleanup(cls.desk.close)
        os.environ['ROS_MASTER_URI'] = cls.desk.master.uri
        rospy.init_node('test_link')
        # registers this node with a restarted master
        cls.own = udpros.Publisher('/test_link/own', Header, queue_size=1)
        cls.images = Collector('/operator/thermal/image_raw', Image)
        cls.statuses: Dict[str, Any] = {}
        rospy.Subscriber('/diagnostics', DiagnosticArray, lambda message: cls.statuses.update(
            {status.name: status for status in message.status}))
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.key, cls.other_key, cls.open_key = (str(pathlib.Path(folder.name) / name) for name in 'abc')
        for path in (cls.other_key, cls.open_key):
            make_key(path)
        os.chmod(cls.open_key, 0o644)
        cls.robot.start('rosrun', 'smokebot_udp', 'simulated_robot', '_width:=160', '_height:=120', '_lidar_rate:=0',
                        '_camera_rate:=0', '_scan_rate:=0', '_map_rate:=0')

    def setUp(self) -> None:
        self.port = free_port()
        for side in (self.robot, self.desk):
            side.forget_output()
        # what another test's robot had: it would pass for the settings of this one's, which replace it when they come
        self.desk.master.call('deleteParam', '/robot_sender')
        self.statuses.clear()
        self.images.clear()

    def start_robot(self, key: str = '', *arguments: str) -> Any:
        """It makes the key, unless there is one."""
        process = self.robot.launch('robot.launch', 'streams:=%s' % STREAMS, 'link_port:=%d' % self.port,
                                    'key_file:=' + (key or self.key), *arguments)
        self.addCleanup(self.robot.stop, process)
        return process

    def start_desk(self, *arguments: str, key: str = '') -> Any:
        process = self.desk.launch('operator.launch', 'streams:=%s' % STREAMS, 'robot:=localhost:%d' % self.port,
                                   'rviz:=false', 'key_file:=' + (key or self.key), *arguments)
        self.addCleanup(self.desk.stop, process)
        return process

    def wait_for_images(self, seconds: float = START) -> float:
        """How long new ones take [s]."""
        self.images.clear()
        begun = time.monotonic()
        wait_for(lambda: len(self.images.messages) >= 3, seconds, 'the images')
        return time.monotonic() - begun

    def transport(self) -> Any:
        """The operator's status of the transport; None: not yet."""
        return self.statuses.get('operator_receiver: link transport')

    def wait_for_setting(self, side: Side, name: str, value: Any) -> None:
        wait_for(lambda: side.parameter(name) == value, 20, '%s = %r' % (name, value))

    def test_settings_at_the_desk_are_the_robots(self) -> None:
        self.start_robot()
        self.start_desk()
        self.wait_for_images()
        for name in ('/robot_sender/thermal', '/robot_sender/odom', '/robot_sender/status'):
            wait_for(lambda name=name: self.desk.parameter(name), 20, name)
            self.assertLessEqual(self.desk.parameter(name).items(), self.robot.parameter(name).items())
        self.assertFalse({ROBOT, '/simulated_robot'} & set(self.desk.nodes()))
        self.assertNotIn(OPERATOR, self.robot.nodes())
        self.check_ways_to_set()
        self.check_refusals()
        self.check_focus()

    def test_a_desk_at_the_robots_master_is_told(self) -> None:
        self.start_robot()
        wait_for(lambda: ROBOT in self.robot.nodes(), START, 'the robot')
        desk = self.robot.launch('operator.launch', 'streams:=%s' % STREAMS, 'robot:=localhost:%d' % self.port,
                                 'rviz:=false', 'key_file:=' + self.key)
        self.addCleanup(self.robot.stop, desk)
        text = "ROS_MASTER_URI is %s, the robot's own master" % self.robot.master.uri
        wait_for(lambda: text in self.robot.output, START, 'a warning')
        self.assertIn('unset ROS_MASTER_URI', self.robot.output)
        self.assertNotIn('ROS_MASTER_URI is', self.desk.output)

    def check_ways_to_set(self) -> None:
        self.desk.set('/robot_sender/thermal/rate', 5)
        self.wait_for_setting(self.robot, '/robot_sender/thermal/rate', 5.0)
        self.wait_for_setting(self.desk, '/robot_sender/thermal/rate', 5.0)
        self.desk.run('rosrun', 'dynamic_reconfigure', 'dynparam', 'set', '/robot_sender/thermal', 'rate', '4')
        self.wait_for_setting(self.robot, '/robot_sender/thermal/rate', 4.0)
        self.wait_for_setting(self.desk, '/robot_sender/thermal/rate', 4.0)
        self.robot.set('/robot_sender/thermal/rate', 6)
        self.wait_for_setting(self.desk, '/robot_sender/thermal/rate', 6.0)
        wait_for(lambda: "'rate': 6.0" in self.desk.run(
            'rosrun', 'dynamic_reconfigure', 'dynparam', 'get', '/robot_sender/thermal'), 20, 'dynamic_reconfigure')

    def check_refusals(self) -> None:
        """What this side can check, and what only the robot can."""
        self.desk.set('/robot_sender/thermal/rate', -5)
        self.wait_for_setting(self.desk, '/robot_sender/thermal/rate', 6.0)
        self.assertIn('/robot_sender/thermal/rate refused, 6.0 stays: rate is -5', self.desk.output)
        self.desk.set('/robot_sender/focus', 'dancing')
        self.wait_for_setting(self.desk, '/robot_sender/focus', 'default')
        self.assertIn("focus is 'dancing', must be one of default, navigation", self.desk.output)
        answer = rospy.ServiceProxy('/robot_sender/set_focus', SetFocus)('dancing')
        self.assertFalse(answer.success)
        self.assertEqual(self.robot.parameter('/robot_sender/focus'), 'default')

    def check_focus(self) -> None:
        self.desk.set('/robot_sender/focus', 'inspection')
        self.wait_for_setting(self.robot, '/robot_sender/focus', 'inspection')
        self.wait_for_setting(self.desk, '/robot_sender/thermal/rate', 10.0)    # set by hand before
        self.assertTrue(rospy.ServiceProxy('/robot_sender/set_focus', SetFocus)('mapping').success)
        self.wait_for_setting(self.desk, '/robot_sender/focus', 'mapping')
        self.assertTrue(rospy.ServiceProxy('/operator_receiver/set_focus', SetFocus)('default').success)
        self.wait_for_setting(self.desk, '/robot_sender/focus', 'default')
        self.desk.run('rosrun', 'dynamic_reconfigure', 'dynparam', 'set', '/robot_sender', 'focus', 'navigation')
        self.wait_for_setting(self.robot, '/robot_sender/focus', 'navigation')

    def test_restarts(self) -> None:
        """Both nodes and both masters are restarted one after the other. The earlier settings are there again."""
        self.start_robot()
        self.start_desk()
        self.wait_for_images()
        wait_for(lambda: self.desk.parameter('/robot_sender/thermal/rate') == 10.0, 20, 'the settings')
        self.desk.set('/robot_sender/thermal/rate', 8)
        self.wait_for_setting(self.robot, '/robot_sender/thermal/rate', 8.0)
        for side in (self.robot, self.desk):
            node = ROBOT if side is self.robot else OPERATOR
            pid = wait_for(lambda side=side, node=node: side.pid(node), START, node)
            os.kill(pid, signal.SIGKILL)
            wait_for(lambda side=side, node=node, pid=pid: side.pid(node) not in (0, pid), START, 'the new ' + node)
            print('images %.1f s after the restart of %s' % (self.wait_for_images(), node))
            self.wait_for_setting(self.desk, '/robot_sender/thermal/rate', 8.0)
        pids = self.robot.pid(ROBOT), self.desk.pid(OPERATOR)
        self.robot.master.restart()
        wait_for(lambda: self.robot.pid(ROBOT) == pids[0], 20, 'the robot at its new master')
        self.desk.master.restart()
        wait_for(lambda: self.desk.pid(OPERATOR) == pids[1], 20, 'the operator at its new master')
        self.wait_for_images()
        for side in (self.robot, self.desk):
            self.wait_for_setting(side, '/robot_sender/thermal/rate', 8.0)
        self.desk.set('/robot_sender/thermal/rate', 7)
        self.wait_for_setting(self.robot, '/robot_sender/thermal/rate', 7.0)

    def value(self, key: str) -> str:
        """A value of the operator's status of the transport."""
        wait_for(self.transport, 20, 'the status')
        return next(pair.value for pair in self.transport().values if pair.key == key)

    def test_settings_of_a_named_operator_are_in_its_namespace(self) -> None:
        self.start_robot()
        self.start_desk('name:=ugv1')
        named = Collector('/ugv1/operator/thermal/image_raw', Image)
        wait_for(lambda: named.messages, START, 'the images')
        self.wait_for_setting(self.desk, '/ugv1/robot_sender/thermal/rate', 10.0)
        self.desk.set('/ugv1/robot_sender/thermal/rate', 5)
        self.wait_for_setting(self.robot, '/robot_sender/thermal/rate', 5.0)
        self.assertTrue(rospy.ServiceProxy('/ugv1/robot_sender/set_focus', SetFocus)('mapping').success)
        self.wait_for_setting(self.desk, '/ugv1/robot_sender/focus', 'mapping')

    def nothing_arrives(self, words: str) -> None:
        """The operator's status has the reason, and there is no image."""
        wait_for(lambda: self.transport() is not None and words in self.transport().message, START, words)
        wait_for(lambda: words in self.desk.output, 20, 'the same in the log')
        self.assertEqual(self.value('connected to'), 'nobody')
        self.assertFalse(self.images.messages)

    def test_another_key(self) -> None:
        self.start_robot()
        self.start_desk(key=self.other_key)
        self.nothing_arrives('another key')
        wait_for(lambda: 'another key' in self.robot.output, 20, 'the same at the robot')

    def test_the_desk_waits_for_the_key_that_the_robot_has_made(self) -> None:
        """The robot shows the command that copies it."""
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        made, copied = (str(pathlib.Path(folder.name) / side / 'link.key') for side in ('robot', 'desk'))
        self.start_desk(key=copied)
        wait_for(lambda: 'this desk has no key of the robot, %s: run' % copied in self.desk.output, START, 'the error')
        self.start_robot(made)
        text = 'the link has a new key, %s; on a desk that lacks it, run: mkdir -p' % made
        wait_for(lambda: text in self.robot.output, START, 'the command')
        os.makedirs(os.path.dirname(copied))
        shutil.copy2(made, copied)
        self.wait_for_images()

    def test_a_key_that_others_can_read_is_not_used_but_waited_for(self) -> None:
        os.chmod(self.open_key, 0o644)
        self.start_robot(self.open_key)
        self.start_desk(key=self.open_key)
        for side in (self.robot, self.desk):
            wait_for(lambda side=side: 'used by others' in side.output, START, 'the error')
        os.chmod(self.open_key, 0o600)
        self.wait_for_images()


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'link', Link)
