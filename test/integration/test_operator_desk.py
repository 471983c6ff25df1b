#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A desk with two robots, each with a master and a key of its own: their frames, and what comes after a kill.

The desk's master is that of the test.
"""
import contextlib
import os
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import unittest
from typing import Any, Dict, List

import psutil
import rosgraph
import rospy
import rostest
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import Image, LaserScan, PointCloud2
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from test_udpros_master import OwnMaster
from waiting import pid_at, wait_for

from smokebot_udp.nodes.child_process import end_family, family, new_mark
from smokebot_udp.udpros import rpc

ROBOTS = 'ugv1', 'ugv2'
SIMULATION = ('_width:=64', '_height:=48', '_thermal_rate:=2', '_camera_rate:=2', '_lidar_rate:=2', '_scan_rate:=2',
              '_odom_rate:=10')
THERMAL = 'thermal_optical_frame'
FRAMES = {'thermal/image_raw': (Image, THERMAL), 'thermal/image_color': (Image, THERMAL),
          'map': (OccupancyGrid, 'map'), 'map/age': (OccupancyGrid, 'map'), 'lidar/points': (PointCloud2, 'velodyne'),
          'scan': (LaserScan, 'laser'), 'odom': (Odometry, 'odom')}


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('', 0))
        return int(probe.getsockname()[1])


class Processes:
    """Processes with all that they start."""

    def __init__(self) -> None:
        self.mark = new_mark()

    def start(self, *command: str, master: str = '', **options: Any) -> Any:
        environment = {**os.environ, self.mark: '1', **({'ROS_MASTER_URI': master} if master else {})}
        return subprocess.Popen(command, env=environment, start_new_session=True, **options)

    @property
    def names(self) -> Dict[int, str]:
        """{pid: command line} of those that live."""
        found = {}
        for pid in family(self.mark):
            with contextlib.suppress(psutil.NoSuchProcess):     # it has just ended
                found[pid] = ' '.join(psutil.Process(pid).cmdline())
        return found


class Desk(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('watch_desk')
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        masters = {name: OwnMaster() for name in ROBOTS}
        for master in masters.values():
            cls.addClassCleanup(master.end)
        robots = Processes()
        cls.addClassCleanup(end_family, robots.mark, 10.0)      # before the masters
        cls.simulations: Dict[str, Any] = {}
        lines: List[str] = []
        for name, master in masters.items():
            port = free_udp_port()
            cls.simulations[name] = robots.start('rosrun', 'smokebot_udp', 'simulated_robot', *SIMULATION,
                                                 master=master.uri)
            key = str(pathlib.Path(cls.folder.name, name + '.key'))
            subprocess.run(['rosrun', 'smokebot_udp', 'make_key', key], check=True)
            robots.start('roslaunch', 'smokebot_udp', 'robot.launch', 'link_port:=%d' % port, 'key_file:=' + key,
                         master=master.uri)
            lines.append('%s: {host: localhost, port: %d, key_file: %s.key}' % (name, port, name))
        lines += ['ugv3: {host: no-such-robot.invalid, key_file: ugv1.key}', 'ugv4: {host: localhost, prot: 5}']
        pathlib.Path(cls.folder.name, 'robots.yaml').write_text('\n'.join(lines))

    def setUp(self) -> None:
        self.desk = Processes()
        self.addCleanup(end_family, self.desk.mark, 10.0)
        self.log = pathlib.Path(self.folder.name, 'log')
        with self.log.open('w') as log:
            self.launch = self.desk.start('roslaunch', 'smokebot_udp', 'operator.launch', 'rviz:=false',
                                          'robots:=%s/robots.yaml' % self.folder.name, stdout=log, stderr=log)
        for name in ROBOTS:
            self.receive(name)

    @staticmethod
    def receive(name: str, topic: str = 'thermal/image_raw', class_: Any = Image) -> Any:
        return rospy.wait_for_message('/%s/operator/%s' % (name, topic), class_, 120)

    @staticmethod
    def pid(node: str) -> int:
        """The process of a node; 0: it does not live."""
        try:
            return pid_at(rpc.call(rosgraph.get_master_uri(), 'lookupNode', node))
        except (rpc.Refused, rpc.Unreachable):
            return 0

    def receivers(self) -> Dict[str, int]:
        """{robot: process of its receiver}; empty: one does not answer."""
        found = {name: self.pid('/%s/operator_receiver' % name) for name in ROBOTS}
        return found if all(found.values()) else {}

    def end(self, number: int) -> None:
        """End roslaunch by a signal; nothing may be left."""
        self.launch.send_signal(number)
        self.launch.wait(60)
        wait_for(lambda: not family(self.desk.mark), 30, 'the end of %s' % self.desk.names)

    def test_the_frames_of_the_robots_do_not_clash(self) -> None:
        for name in ROBOTS:
            for topic, (class_, frame) in FRAMES.items():
                message = self.receive(name, topic, class_)
                self.assertEqual((topic, message.header.frame_id), (topic, '%s/%s' % (name, frame)))
            self.assertEqual(self.receive(name, 'odom', Odometry).child_frame_id, name + '/base_link')
            for topic in 'tf', 'tf_static':
                for one in self.receive(name, topic, TFMessage).transforms:
                    self.assertEqual({one.header.frame_id[:5], one.child_frame_id[:5]}, {name + '/'})
        for words in ("robots.yaml: robot 'ugv4': prot: no such setting",
                      "the robot's host 'no-such-robot.invalid' does not resolve"):     # a resolver takes its time
            wait_for(lambda text=words: text in self.log.read_text(), 60, words)
        self.end(signal.SIGINT)
        for name in ROBOTS:
            self.assertFalse(self.pid('/%s/operator_receiver' % name))

    def test_the_marker_of_stale_data_stands_above_its_robot(self) -> None:
        self.addCleanup(self.simulations['ugv2'].send_signal, signal.SIGCONT)
        self.simulations['ugv2'].send_signal(signal.SIGSTOP)

        def warning() -> Any:
            """The marker that is latched may be one that takes away that of a pause while the robot started."""
            found = self.receive('ugv2', 'stale', Marker)
            return found if found.action == Marker.ADD else None
        self.assertEqual(wait_for(warning, 60, 'the marker').header.frame_id, 'ugv2/base_link')
        self.end(signal.SIGTERM)

    def test_what_is_killed_comes_again_and_disturbs_no_other_robot(self) -> None:
        before = wait_for(self.receivers, 60, 'the receivers')
        launch = psutil.Process(before['ugv1']).parent()
        os.kill(launch.pid, signal.SIGKILL)
        wait_for(lambda: self.pid('/ugv1/operator_receiver') not in (0, before['ugv1']), 60, 'the next receiver')
        self.receive('ugv1')
        after = wait_for(self.receivers, 60, 'the receivers')
        self.assertEqual(after['ugv2'], before['ugv2'])
        self.assertNotIn(before['ugv1'], family(self.desk.mark))
        os.kill(wait_for(lambda: self.pid('/operator_desk'), 60, 'the desk'), signal.SIGKILL)
        wait_for(lambda: not set(after.values()) & set(family(self.desk.mark)), 60, 'the end of the receivers')
        wait_for(self.receivers, 60, 'the next receivers')
        for name in ROBOTS:
            self.receive(name)
        self.end(signal.SIGHUP)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'operator_desk', Desk)
