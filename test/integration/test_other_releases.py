#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Robot and desk of different releases, on a shared master and on their own: they work together as long as the wire
format is the same; otherwise each says so once."""
import os
import pathlib
import sys
import tempfile
import unittest
from typing import Any, List

import rospy
import rostest
from nav_msgs.msg import Odometry

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from own_masters import Side
from waiting import Collector, free_port, stays, wait_for

from smokebot_udp.version import CANNOT_TALK, RELEASE, WIRE_FORMAT

HERE = pathlib.Path(__file__).resolve().parent
STREAMS = '_streams_file:=%s' % (HERE / 'link_streams.yaml')
START = 60.0
"""For nodes to start on a busy machine [s]."""
NEWER = WIRE_FORMAT + 1
ONCE = 12.0
"""Each side would ask again in this time [s]."""


def node(name: str, wire_format: int, *arguments: str) -> List[str]:
    """The command of a node of another release."""
    return [sys.executable, str(HERE / 'other_release.py'), name, str(wire_format), '9.9.9', *arguments]


def sentences(side: Side) -> List[str]:
    """What is said about releases."""
    return [line for line in side.output.splitlines() if CANNOT_TALK in line]


class OtherReleases(unittest.TestCase):
    robot: Side
    desk: Side

    @classmethod
    def setUpClass(cls) -> None:
        cls.robot, cls.desk = Side('robot'), Side('desk')
        cls.addClassCleanup(cls.robot.close)
        cls.addClassCleanup(cls.desk.close)
        os.environ['ROS_MASTER_URI'] = cls.desk.master.uri
        rospy.init_node('test_other_releases')
        cls.odometry = Collector('/operator/odom', Odometry)
        cls.source = rospy.Publisher('/odom', Odometry, queue_size=1)
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.key = '_key_file:=%s/link.key' % folder.name

    def setUp(self) -> None:
        for side in (self.robot, self.desk):
            side.forget_output()
            for name in ('/robot_sender', '/operator_receiver'):
                side.set(name, {})      # nothing of the nodes before

    def start(self, side: Side, *command: str) -> None:
        process = side.start(*command)
        self.addCleanup(side.stop, process)

    def told_once(self, side: Side, count: int, *parts: str) -> None:
        """So many nodes of a side say it, and do not repeat it."""
        wait_for(lambda: len(sentences(side)) >= count, START, 'the sentence; there is: ' + side.output)
        stays(lambda: len(sentences(side)) == count, ONCE, 'the only sentence')
        for sentence in sentences(side):
            for part in (*parts, 'smokebot_udp 9.9.9 (wire format %d)' % NEWER,
                         'smokebot_udp %s (wire format %d)' % (RELEASE, WIRE_FORMAT)):
                self.assertIn(part, sentence)

    def odometry_comes(self) -> Any:
        self.source.publish(Odometry())
        return self.odometry.messages

    def shared(self, robots: List[str], desks: List[str]) -> None:
        for command in (robots, desks):
            self.start(self.desk, *command, STREAMS)

    def test_a_newer_desk_of_the_same_wire_format_at_a_shared_master(self) -> None:
        self.odometry.clear()
        self.shared(['rosrun', 'smokebot_udp', 'robot_sender'], node('operator_receiver', WIRE_FORMAT))
        wait_for(self.odometry_comes, START, 'the odometry; there is: ' + self.desk.output)
        self.assertEqual(sentences(self.desk), [])

    def test_another_wire_format_at_a_shared_master(self) -> None:
        """Each node reports the difference once, although there are more than ten topics in each direction."""
        self.odometry.clear()
        self.shared(['rosrun', 'smokebot_udp', 'robot_sender'], node('operator_receiver', NEWER))
        self.told_once(self.desk, 2, '/robot_sender has', '/operator_receiver has', 'for /robot_sender, too')
        stays(lambda: not self.odometry_comes(), 2, 'the silence')

    def test_a_newer_desk_of_the_same_wire_format_with_own_masters(self) -> None:
        port = free_port()
        self.start(self.robot, 'rosrun', 'smokebot_udp', 'robot_sender', STREAMS, '_link_port:=%d' % port, self.key)
        self.start(self.desk, *node('operator_receiver', WIRE_FORMAT, STREAMS, '_robot:=127.0.0.1:%d' % port,
                               self.key))
        for side in (self.robot, self.desk):
            wait_for(lambda side=side: 'has joined' in side.output, START, 'the join')
            self.assertEqual(sentences(side), [])

    def test_another_wire_format_with_own_masters(self) -> None:
        port = free_port()
        self.start(self.robot, *node('robot_sender', NEWER, STREAMS, '_link_port:=%d' % port, self.key))
        self.start(self.desk, 'rosrun', 'smokebot_udp', 'operator_receiver', STREAMS, '_robot:=127.0.0.1:%d' % port,
                   self.key)
        self.told_once(self.robot, 1, 'refused 127.0.0.1:', 'for it, too')
        self.told_once(self.desk, 1, 'the robot has', 'for this machine, too')


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'other_releases', OtherReleases, sysargs=sys.argv)
