#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What is wrong with sources: one line in the log within 10 s, and the reason in all that shows the link."""
import json
import pathlib
import subprocess
import sys
import threading
import time
import unittest
from typing import Any, Dict, List, Set, Tuple

import actionlib
import numpy as np
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from move_base_msgs.msg import MoveBaseAction
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import CompressedImage, Image, Imu, LaserScan, PointCloud2, PointField
from std_msgs.msg import String
from std_srvs.srv import SetBool, SetBoolResponse

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, is_sent_here, ticks, wait_for

from smokebot_udp.codecs.display.overlay import ATTENTION, HEIGHT, TILE_COLOURS
from smokebot_udp.msg import RobotStatus

HERE = pathlib.Path(__file__).resolve().parent

LIMIT = 10.0
"""[s]"""

REASONS = {
    'misspelled': 'nobody publishes /front/image_raw/compresed; similar: /front/image_raw/compressed',
    'stopped': 'nobody publishes /sick',
    'hangs': '/wrong_streams publishes /wheels, but nothing comes',
    'wrong_type': '/fix is published as std_msgs/String, must be sensor_msgs/NavSatFix',
    'deaf': 'nobody on the robot listens to /base/cmdd; similar: /base/cmd',
    'lamp': 'the robot has no service /lmap; similar: /lamp',
    'dock': 'the robot has no action server /dok; similar: /dock'}
"""{stream: what is wrong with its source, or how that begins}"""

OTHERS = {'no_tf': "tf knows no transform from 'mast' to 'body'", 'bad': 'rate is -5'}
"""Likewise, of what is no source."""


class Sources(threading.Thread):
    """Publishes what there is on the robot; a topic stops when it is removed."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        points = np.random.RandomState(0).uniform(1, 5, (300, 3)).astype('<f4')
        self.messages: Dict[str, Any] = {
            '/imu': Imu(), '/front/image_raw/compressed': CompressedImage(format='jpeg'), '/fix': String(),
            '/sick': LaserScan(angle_min=-1.0, angle_increment=0.01, angle_max=1.0, range_max=30.0, ranges=[2.0] * 201),
            '/wheels': Odometry(),
            '/points': PointCloud2(height=1, width=300, point_step=12, row_step=3600, is_dense=True, fields=[
                PointField(name, 4 * place, PointField.FLOAT32, 1) for place, name in enumerate('xyz')],
                data=points.tobytes())}
        self.publishers = {topic: rospy.Publisher(topic, type(message), queue_size=1)
                           for topic, message in self.messages.items()}

    def run(self) -> None:
        for _ in ticks(10.0):
            for topic, message in list(self.messages.items()):
                if hasattr(message, 'header'):
                    message.header.stamp, message.header.frame_id = rospy.Time.now(), 'mast'
                self.publishers[topic].publish(message)


class WrongStreams(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('wrong_streams')
        cls.lines: List[Tuple[float, str]] = []
        cls.statuses: Dict[str, Any] = {}
        rospy.Subscriber('/rosout', Log, lambda log: cls.lines.append((time.monotonic(), log.msg))
                         if log.name == '/robot_sender' and log.level >= Log.INFO else None)
        rospy.Subscriber('/diagnostics', DiagnosticArray, lambda message: cls.statuses.update(
            (status.name, status) for status in message.status), queue_size=20)
        cls.status = Collector('/operator/status', RobotStatus)
        cls.overlays: List[Any] = []
        rospy.Subscriber('/operator/overlay', Image, cls.overlays.append)
        rospy.Subscriber('/base/cmd', Twist, lambda message: None)
        rospy.Service('/lamp', SetBool, lambda request: SetBoolResponse(True, ''))
        cls.dock = actionlib.SimpleActionServer('/dock', MoveBaseAction, lambda goal: None, auto_start=False)
        cls.dock.start()
        cls.sources = Sources()
        wait_for(lambda: is_sent_here('/rosout', '/robot_sender'), what="the robot's log")
        cls.sources.start()
        wait_for(lambda: 'robot_sender: good' in cls.statuses, 30, 'the diagnostics')

    def logged(self, stream: str, reason: str) -> List[float]:
        """When lines about a stream were logged."""
        return [when for when, text in list(self.lines) if text.startswith("stream '%s': %s" % (stream, reason))]

    def shown(self) -> Set[str]:
        """The streams whose reason is in diagnostics, and in RobotStatus."""
        told = self.status.newest().problems if self.status.messages else []
        return {stream for stream, reason in {**REASONS, **OTHERS}.items()
                if any(problem.startswith('%s: %s' % (stream, reason)) for problem in told) and any(
                    reason in status.message for name, status in list(self.statuses.items())
                    if name in ('robot_sender: ' + stream, 'robot_sender: refused streams'))}

    def test_each_reason_is_known_within_ten_seconds(self) -> None:
        begun = time.monotonic()
        for topic in ('/sick', '/wheels'):
            del self.sources.messages[topic]
        self.sources.publishers['/sick'].unregister()
        for stream, reason in REASONS.items():
            when = wait_for(lambda name=stream, why=reason: self.logged(name, why), LIMIT + 2, reason)
            self.assertLess(when[0] - begun, LIMIT, stream)
        # of nine problems six are in the status, which crosses the link
        wait_for(lambda: len(self.shown()) >= 6, 30, 'the reasons: %s' % self.shown())
        tree = json.loads(subprocess.run(['rosrun', 'smokebot_udp', 'link_top', '--once', '--json'],
                                         stdout=subprocess.PIPE, check=True, timeout=60).stdout)
        problems = {stream['stream']: ' '.join(stream['problems']) for stream in tree['streams']}
        for stream, reason in {**REASONS, 'no_tf': OTHERS['no_tf']}.items():
            self.assertIn(reason, problems[stream])
        self.assertIn('bad: rate is -5', ' '.join(tree['robots'][0]['problems']))
        self.assertFalse([text for _, text in self.lines if "stream 'good'" in text])
        self.assertEqual({stream: len(self.logged(stream, reason)) for stream, reason in REASONS.items()},
                         dict.fromkeys(REASONS, 1))
        self.check_overlay()
        self.check_that_it_ends()
        self.check_beforehand()

    def check_beforehand(self) -> None:
        """`check` says the same, with an exit code."""
        done = subprocess.run(['rosrun', 'smokebot_udp', 'check', str(HERE / 'wrong_streams.yaml'), '--seconds', '2',
                               '--link', '2'], stdout=subprocess.PIPE, timeout=100)
        said = done.stdout.decode()
        self.assertEqual(done.returncode, 1, said)
        reasons = {**REASONS, **OTHERS}
        for stream in ('misspelled', 'stopped', 'wrong_type', 'lamp', 'dock'):
            self.assertIn('ERROR  %s: %s' % (stream, reasons[stream]), said)
        self.assertIn("ERROR  streams: stream 'bad': rate is -5", said)
        self.assertIn('it carries 2 Mbit/s', said)
        self.assertNotIn('good:', said)
        right = HERE / 'right_streams.yaml'
        done = subprocess.run(['rosrun', 'smokebot_udp', 'check', str(right), '--seconds', '2'], stdout=subprocess.PIPE,
                              timeout=100)
        self.assertEqual(done.returncode, 0, done.stdout.decode())

    def check_overlay(self) -> None:
        """It has lines in the colour that asks for attention, below its tiles."""
        def yellow() -> bool:
            newest = self.overlays[-1] if self.overlays else None
            if newest is None or newest.height <= HEIGHT:
                return False
            pixels = np.frombuffer(newest.data, np.uint8).reshape(newest.height, newest.width, 3)
            return bool((pixels[HEIGHT:] == TILE_COLOURS[ATTENTION]).all(axis=2).any())
        wait_for(yellow, 20, 'lines of problems')

    def check_that_it_ends(self) -> None:
        """A source that comes back is no problem any more."""
        self.sources.messages['/wheels'] = Odometry()
        wait_for(lambda: any(text.startswith("stream 'hangs': this is over: ") for _, text in self.lines), 20,
                 'its end')
        wait_for(lambda: self.statuses['robot_sender: hangs'].message == 'fine', 20, 'fine')
        wait_for(lambda: not any(text.startswith('hangs') for text in self.status.newest().problems), 30, 'the status')


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'wrong_streams', WrongStreams)
