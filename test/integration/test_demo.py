#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated robot's images at 20 % loss, and settings that a user changes meanwhile."""
import os
import pathlib
import re
import socket
import subprocess
import sys
import tempfile
import unittest
from typing import Any, List, Tuple

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from dynamic_reconfigure.client import Client
from sensor_msgs.msg import CameraInfo, Image
from skimage.metrics import peak_signal_noise_ratio

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, undisturbed, wait_for

from smokebot_udp.codecs.wire.pixels import as_pixels

TOPICS = {'thermal': 'mono16', 'camera': 'bgr8'}
GAS = 'streams: {gas: {type: relay, message_type: std_msgs/Float32, robot_topic: /gas, operator_topic: /operator/gas}}'
DRIVING = """
streams:
  cmd_vel: {type: command, message_type: geometry_msgs/Twist, operator_topic: /operator/cmd_vel, robot_topic: /cmd_vel}
  goal: {type: relay, message_type: geometry_msgs/PoseStamped, robot_topic: /move_base_simple/goal,
         operator_topic: /operator/goal, direction: to_robot, reliable: true}
"""
DRIVE_SECONDS = 30      # from the farthest place on its tour the robot reaches the goal in 18 s, of 0.7 * 30 s
OBEYED = re.compile(r'goal: reached in \d+\.\d s, commands in force \d+\.\d % \(of \d+\): \w+')


def pixels(message: Any) -> Any:
    return as_pixels(message.data, message.height, message.width, message.step, message.encoding,
                     message.is_bigendian).astype(float)


class Demo(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('watch_demo')
        cls.sent = {name: Collector('/%s/image_raw' % name, Image) for name in TOPICS}
        cls.received = {name: Collector('/operator/%s/image_raw' % name, Image) for name in TOPICS}
        for name in TOPICS:
            wait_for(lambda out=cls.received[name]: len(out.messages) > 2, 60, 'the first images')

    def pairs(self, name: str, count: int) -> List[Tuple[Any, Any]]:
        """At least `count` images of a stream as (sent, received)."""
        def both() -> Any:
            sent, received = dict(self.sent[name].messages), dict(self.received[name].messages)
            common = sorted(set(sent) & set(received))
            return len(common) >= count and [(sent[stamp], received[stamp]) for stamp in common]
        self.sent[name].clear(), self.received[name].clear()
        found: List[Tuple[Any, Any]] = wait_for(both, 20, '%d images of %s' % (count, name))
        return found

    def lost(self, name: str) -> float:
        """The loss of a stream as the operator's diagnostics say [%]."""
        def found() -> Any:
            for status in rospy.wait_for_message('/diagnostics', DiagnosticArray, 60).status:
                values = {one.key: one.value for one in status.values}
                if status.name == 'operator_receiver: ' + name and 'loss [%]' in values:
                    return values['loss [%]']
            return None
        return float(wait_for(found, 20, 'diagnostics of ' + name))

    @undisturbed()
    def test_the_images_look_like_the_scene(self) -> None:
        for name, encoding in TOPICS.items():
            for sent, received in self.pairs(name, 10):
                self.assertEqual((received.encoding, received.height, received.width), (encoding, 480, 640))
                self.assertEqual(received.header.frame_id, name + '_optical_frame')
                was, came = pixels(sent), pixels(received)
                self.assertGreater(peak_signal_noise_ratio(was, came, data_range=was.max() - was.min()), 30.0)
            self.assertAlmostEqual(self.lost(name), 20, delta=8)

    def test_camera_info_goes_with_the_image(self) -> None:
        info = Collector('/thermal/camera_info', CameraInfo)
        # the robot's publishers drop what a busy machine does not take in time
        stamps = wait_for(lambda: set(info.messages) & set(self.sent['thermal'].messages), what='one with its image')
        message = info.messages[stamps.pop()]
        self.assertEqual((message.width, message.height), (640, 480))
        self.assertAlmostEqual(message.K[2], 319.5)

    def test_rosnode_info_shows_udpros(self) -> None:
        for node in ('/robot_sender', '/operator_receiver'):
            info = subprocess.run(['rosnode', 'info', node], stdout=subprocess.PIPE, check=True).stdout.decode()
            segments = info[info.index('Connections:'):].split(' * topic: ')
            for name in TOPICS:
                entry = next(part for part in segments if part.startswith('/smokebot_udp/%s/segments' % name))
                self.assertIn('transport: UDPROS', entry)

    @undisturbed()
    def test_rate_and_enabled_take_effect_while_it_runs(self) -> None:
        client = Client('/robot_sender/thermal', timeout=60)
        client.update_configuration({'rate': 2.0})
        self.addCleanup(client.update_configuration, {'rate': 10.0, 'enabled': True})
        pairs = self.pairs('thermal', 6)
        stamps = [sent.header.stamp.to_sec() for sent, _ in pairs][2:]
        self.assertAlmostEqual((len(stamps) - 1) / (stamps[-1] - stamps[0]), 2.0, delta=0.4)
        client.update_configuration({'enabled': False})
        self.assertFalse(rospy.get_param('/robot_sender/thermal/enabled'))
        # everything sent before is shown by the time the camera has delivered ten more images
        self.pairs('camera', 10)
        self.received['thermal'].clear()
        self.pairs('camera', 10)
        self.assertFalse(self.received['thermal'].messages)
        client.update_configuration({'enabled': True})
        wait_for(lambda: self.received['thermal'].messages, what='the stream again')

    def demo(self, streams: str, *arguments: str) -> str:
        """The output of a demo that has to end cleanly.

        :param streams: the text of its streams.yaml
        """
        with socket.create_server(('', 0)) as free:
            port = free.getsockname()[1]
        with tempfile.NamedTemporaryFile('w', suffix='.yaml') as file:
            file.write(streams)
            file.flush()
            demo = subprocess.run(
                ['roslaunch', '-p', str(port), 'smokebot_udp', 'demo.launch', 'rviz:=false', 'streams:=' + file.name,
                 *arguments], timeout=300, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                env={**os.environ, 'ROS_MASTER_URI': 'http://localhost:%d' % port})
        text = demo.stdout.decode()
        self.assertEqual(demo.returncode, 0, text)
        self.assertNotRegex(text, r'has died|\[ERROR\]|\[FATAL\]|Traceback|python3-av')
        return text

    def test_a_demo_of_some_seconds_ends_cleanly(self) -> None:
        text = self.demo(GAS, 'seconds:=1')
        self.assertIn('Over 1 s, 20 % of the datagrams dropped on purpose', text)
        self.assertNotIn('goal:', text)     # nothing there crosses to the robot

    @undisturbed()
    def test_the_robot_obeys_a_goal_and_commands_over_the_lossy_link(self) -> None:
        text = self.demo(DRIVING, 'seconds:=%d' % DRIVE_SECONDS)
        self.assertEqual(len(OBEYED.findall(text)), 1, text)

    @undisturbed()
    def test_a_demo_of_two_robots_drives_and_reports_each_and_ends_cleanly(self) -> None:
        text = self.demo(DRIVING, 'robots:=2', 'seconds:=%d' % DRIVE_SECONDS)
        for name in 'ugv1', 'ugv2':
            self.assertIn('%s, over %d s, 20 %% of the datagrams' % (name, DRIVE_SECONDS), text)
        self.assertEqual(len(OBEYED.findall(text)), 2, text)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'demo', Demo)
