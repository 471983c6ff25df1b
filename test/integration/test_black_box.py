#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Both sides record, with a master each: a switch of the focus, a cut of the link, a restart of the robot's master."""
import contextlib
import html
import os
import pathlib
import re
import signal
import sys
import tempfile
import unittest
from typing import Any, List

import psutil
import rosbag
import rospy
import rostest
from sensor_msgs.msg import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from own_masters import Side
from udp_cable import UdpCable
from waiting import Collector, free_port, give_time, wait_for

from smokebot_udp.srv import SetFocus

STREAMS = pathlib.Path(__file__).resolve().parent / 'link_streams.yaml'
START = 60.0
"""For nodes to start on a busy machine [s]."""

CUT = 4.0
"""How long the link is cut [s]."""

DESK = '/desk2'


class BlackBox(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        cls.robot, cls.desk = Side('robot'), Side('desk')
        cls.addClassCleanup(cls.robot.close)
        cls.addClassCleanup(cls.desk.close)
        os.environ['ROS_MASTER_URI'] = cls.desk.master.uri
        rospy.init_node('test_black_box')
        cls.images = Collector(DESK + '/operator/thermal/image_raw', Image)
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)

    def bags(self, pattern: str) -> List[pathlib.Path]:
        return sorted(self.folder.glob(pattern))

    def wait_for_images(self, count: int) -> None:
        """New ones at the desk."""
        self.images.clear()
        wait_for(lambda: len(self.images.messages) >= count, START, 'the images')

    def start(self) -> Any:
        """Both sides, and the cable between them; the robot's first bag and the operator's have begun."""
        port = free_port()
        cable = UdpCable(port)
        self.addCleanup(cable.close)
        record = ('streams:=%s' % STREAMS, 'record:=true', 'record_dir:=%s' % self.folder,
                  'key_file:=%s' % (self.folder / 'link.key'))
        self.robot.start('rosrun', 'smokebot_udp', 'simulated_robot', '_width:=160', '_height:=120', '_lidar_rate:=0',
                         '_camera_rate:=0', '_scan_rate:=0', '_map_rate:=0')
        self.launches = [(self.robot, self.robot.launch('robot.launch', 'link_port:=%d' % port, *record)),
                         (self.desk, self.desk.launch('operator.launch', 'robot:=localhost:%d' % cable.port,
                                                      'rviz:=false', 'name:=' + DESK[1:], *record))]
        wait_for(lambda: self.bags('*robot_2*') and self.bags('*operator_desk2_2*'), START, 'the bags')
        return cable

    def kill_recorder(self) -> None:
        """Kill the operator's rosbag, which cannot close its bag then."""
        for process in psutil.process_iter():
            with contextlib.suppress(psutil.Error):
                if '__name:=operator_black_box_recorder' in process.cmdline() and process.name() == 'record' and any(
                        str(self.folder) in word for word in process.cmdline()):
                    process.send_signal(signal.SIGKILL)

    def test_both_sides_record(self) -> None:
        cable = self.start()
        self.wait_for_images(10)
        self.assertTrue(rospy.ServiceProxy(DESK + '/operator_receiver/set_focus', SetFocus)('inspection').success)
        self.wait_for_images(10)
        cable.is_cut = True
        give_time(CUT)
        cable.is_cut = False
        self.wait_for_images(10)
        self.kill_recorder()
        wait_for(lambda: len(self.bags('*operator_desk2_2*')) == 2, START, "the operator's next bag")
        self.robot.master.restart()
        wait_for(lambda: len(self.bags('*robot_2*')) == 2, START, "the robot's next bag")
        self.wait_for_images(10)
        for side, process in self.launches:
            side.stop(process)
        self.check_bags()
        self.check_report()

    def check_bags(self) -> None:
        """All are closed but the one whose rosbag was killed, and hold what they say."""
        first, second = self.bags('*operator_desk2_2*')
        self.assertEqual((first.suffix, second.suffix), ('.active', '.bag'))
        for path in (second, *self.bags('*robot_2*')):
            with rosbag.Bag(str(path)) as bag:
                topics = bag.get_type_and_topic_info().topics
                self.assertTrue(any(topic.endswith('_black_box/description') for topic in topics), path)
                images = {topic: info.msg_type for topic, info in topics.items() if topic.endswith('/compressed')}
                self.assertEqual(set(images.values()), {'sensor_msgs/CompressedImage'}, path)

    def check_report(self) -> None:
        """All bags make a report that names what happened, also the one that was not closed."""
        path = self.folder / 'report.html'
        output = self.desk.run('rosrun', 'smokebot_udp', 'mission_report', str(self.folder), '-o', str(path))
        self.assertEqual(output.count('reading '), 4)
        text = html.unescape(re.sub(r'<[^>]*>', ' ', path.read_text()))
        self.assertIn("focus 'inspection'", text)
        cuts = [float(seconds) for seconds in re.findall(
            r'no new image of thermal for ([0-9.]+) s \(nothing arrived: the link was cut', text)]
        self.assertTrue(cuts and max(cuts) > 0.9 * CUT, text)
        self.assertIn('thermal: original', text)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'black_box', BlackBox)
