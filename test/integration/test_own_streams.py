#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A robot with none of the demo's names: each profile of the shipped focus.yaml, with a stream of each type."""
import pathlib
import subprocess
import sys
import tempfile
import threading
import unittest
from typing import Any, Dict, List

import actionlib
import numpy as np
import rospy
import rostest
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Twist
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import OccupancyGrid, Odometry
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import Image, Imu, LaserScan, PointCloud2, PointField
from std_msgs.msg import Header, String
from std_srvs.srv import SetBool, SetBoolResponse
from tf2_msgs.msg import TFMessage

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, is_sent_here, is_silent, ticks, wait_for

from smokebot_udp.msg import RobotStatus
from smokebot_udp.srv import SetFocus
from smokebot_udp.streams import config

RATE = 12.0
"""Rate of all sources [Hz]."""

CONFIGURED = {'nose': 8.0, 'tail': 8.0, 'floor_plan': 4.0, 'spinner': 8.0, 'bumper': 8.0, 'walls': 8.0, 'sick': 8.0,
              'xsens': 8.0}
"""{stream: rate in own_streams.yaml}, of those with an encoder."""

RATES: Dict[str, Dict[str, float]] = {
    'default': CONFIGURED,
    'navigation': {**CONFIGURED, 'tail': 5.0, 'floor_plan': 0.5, 'spinner': 5.0, 'walls': 0.0},
    'inspection': {**CONFIGURED, 'floor_plan': 0.2, 'spinner': 1.0, 'bumper': 5.0, 'sick': 5.0, 'walls': 0.0},
    'mapping': {**CONFIGURED, 'nose': 5.0, 'tail': 2.0, 'floor_plan': 1.0},
    'localization': {**CONFIGURED, 'nose': 2.0, 'tail': 0.0, 'floor_plan': 1.0, 'spinner': 2.0},
    'standby': {**dict.fromkeys(CONFIGURED, 0.0), 'nose': 1.0, 'xsens': 1.0}}
"""{profile: {stream: rate}}; 0: it is not sent."""

SCALES = {'navigation': {'tail': 2}, 'mapping': {'nose': 2, 'tail': 2}, 'localization': {'nose': 2},
          'standby': {'nose': 4}}
LEAVES = {'navigation': 0.2, 'localization': 0.2}
"""Where it is not 0.15 m, as in own_streams.yaml [m]."""

TYPES = {'nose': Image, 'tail': Image, 'plan': OccupancyGrid, 'spinner': PointCloud2, 'bumper': LaserScan,
         'walls': LaserScan, 'sick': LaserScan, 'xsens': Imu}
"""{last part of the operator's topic: message type}"""

WIDTH = 160


def placed(parent: str, child: str) -> TransformStamped:
    return TransformStamped(Header(stamp=rospy.Time.now(), frame_id=parent), child,
                            Transform(rotation=Quaternion(w=1.0)))


class Sources(threading.Thread):
    """Publishes all of the robot's sensors without pause."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        random = np.random.RandomState(0)
        points = random.uniform(1, 5, (300, 3)).astype('<f4')
        self.plan = OccupancyGrid(data=[0] * 2500)
        self.plan.info.width, self.plan.info.height, self.plan.info.resolution = 50, 50, 0.1
        self.messages = {
            '/nose/rgb': Image(height=120, width=WIDTH, encoding='bgr8', step=3 * WIDTH,
                               data=random.bytes(360 * WIDTH)),
            '/tail/rgb': Image(height=120, width=WIDTH, encoding='mono8', step=WIDTH, data=random.bytes(120 * WIDTH)),
            '/plan': self.plan,
            '/spinner': PointCloud2(height=1, width=300, point_step=12, row_step=3600, is_dense=True, fields=[
                PointField(name, 4 * place, PointField.FLOAT32, 1) for place, name in enumerate('xyz')],
                data=points.tobytes()),
            '/sick': LaserScan(angle_min=-1.0, angle_increment=0.01, angle_max=1.0, range_max=30.0, ranges=[2.0] * 201),
            '/xsens': Imu(), '/wheels': Odometry(child_frame_id='rover')}
        self.mounts = rospy.Publisher('/tf_static', TFMessage, queue_size=1, latch=True)
        self.mounts.publish([placed('rover', 'mast')])
        self.transforms = rospy.Publisher('/tf', TFMessage, queue_size=1)
        self.publishers = {topic: rospy.Publisher(topic, type(message), queue_size=1)
                           for topic, message in self.messages.items()}

    def run(self) -> None:
        for number, _ in enumerate(ticks(RATE)):
            self.plan.data[number % 2500] = 100 - self.plan.data[number % 2500]
            for topic, message in self.messages.items():
                message.header.stamp = rospy.Time.now()
                message.header.frame_id = 'odom' if topic in ('/plan', '/wheels') else 'mast'
                self.publishers[topic].publish(message)
            self.transforms.publish([placed('odom', 'rover')])


class OwnStreams(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('own_streams')
        cls.complaints: List[str] = []
        rospy.Subscriber('/rosout', Log, lambda log: cls.complaints.append(log.msg)
                         if log.level >= Log.WARN and ('profile' in log.msg or 'focus' in log.msg) else None)
        cls.out = {name: Collector('/desk/' + name, type_) for name, type_ in TYPES.items()}
        cls.status = Collector('/operator/status', RobotStatus)
        cls.obeyed: List[Any] = []
        rospy.Subscriber('/steer', Twist, cls.obeyed.append)
        rospy.Subscriber('/word', String, cls.obeyed.append)
        cls.steer = rospy.Publisher('/desk/steer', Twist, queue_size=1)
        cls.word = rospy.Publisher('/desk/word', String, queue_size=5)
        rospy.Service('/lamp', SetBool, lambda request: SetBoolResponse(request.data, 'lit'))
        cls.dock = actionlib.SimpleActionServer('/dock', MoveBaseAction, lambda goal: cls.dock.set_succeeded(),
                                                auto_start=False)
        cls.dock.start()
        cls.docking = actionlib.SimpleActionClient('/desk/dock', MoveBaseAction)
        cls.sources = Sources()
        for service in ('/robot_sender/set_focus', '/operator_receiver/set_focus', '/desk/lamp'):
            rospy.wait_for_service(service, 60)
        wait_for(lambda: is_sent_here('/rosout', '/robot_sender'), what="the robot's log")
        cls.sources.start()
        for name, collector in cls.out.items():
            wait_for(lambda found=collector: found.messages, 30, name)
        wait_for(lambda: cls.steer.get_num_connections() and cls.word.get_num_connections(), 30, 'the way back')

    def told(self) -> Dict[str, Any]:
        return {stream.name: stream for stream in self.status.newest().streams}

    def check_streams(self, focus: str) -> None:
        """All that the profile names is in effect, and comes; nothing else does."""
        wait_for(lambda: self.status.messages and self.status.newest().focus == focus, 30, 'the status of ' + focus)
        told = self.told()
        self.assertEqual({name: told[name].rate if told[name].enabled else 0.0 for name in CONFIGURED},
                         {name: np.float32(rate) for name, rate in RATES[focus].items()})
        wait_for(lambda: rospy.get_param('/robot_sender/spinner/leaf_size') == LEAVES.get(focus, 0.15),
                 what='the leaf size of ' + focus)
        for collector in self.out.values():
            collector.clear()
        for name, rate in RATES[focus].items():
            collector = self.out['plan' if name == 'floor_plan' else name]
            if rate:
                wait_for(lambda found=collector: len(found.messages) > 1, 30, '%s in %s' % (name, focus))
            else:
                collector.clear()       # what was on its way
                self.assertTrue(is_silent(collector.arrivals, 0.5), (name, focus))
        for name, scale in SCALES.get(focus, {}).items():
            self.assertEqual(self.out[name].newest().width, WIDTH // scale, (name, focus))

    def check_way_back(self, focus: str) -> None:
        """Commands, words, calls and goals arrive in every focus."""
        del self.obeyed[:]
        self.word.publish(focus)
        wait_for(lambda: self.steer.publish(Twist()) or {type(one) for one in self.obeyed} == {Twist, String}, 20,
                 'a command and a word in ' + focus)
        self.assertTrue(rospy.ServiceProxy('/desk/lamp', SetBool)(True).success)
        self.assertTrue(self.docking.wait_for_server(rospy.Duration(20)))
        goal = MoveBaseGoal()
        goal.target_pose.header.frame_id, goal.target_pose.pose.orientation.w = 'map', 1.0
        self.docking.send_goal(goal)
        self.assertTrue(self.docking.wait_for_result(rospy.Duration(20)), focus)

    def test_each_profile_of_the_shipped_focus_yaml(self) -> None:
        for focus in (*RATES, 'navigation', 'default'):
            answer = rospy.ServiceProxy('/operator_receiver/set_focus', SetFocus)(focus)
            self.assertTrue(answer.success, answer.message)
            self.check_streams(focus)
            self.check_way_back(focus)
        self.assertEqual(self.complaints, [])

    def test_the_answer_names_what_has_changed(self) -> None:
        for node in ('/robot_sender', '/operator_receiver'):
            switch = rospy.ServiceProxy(node + '/set_focus', SetFocus)
            self.assertTrue(switch('default').success)
            self.assertEqual(switch('navigation').message, 'the focus is navigation: nose weight 1 -> 4, min_bitrate '
                             '0 -> 100 kbit/s; tail rate 8 -> 5 Hz, scale 2; floor_plan rate 4 -> 0.5 Hz, weight 1 -> '
                             '0.5, repeat_rate 0.1 Hz; spinner rate 8 -> 5 Hz, leaf_size 0.2 m; bumper weight 1 -> 2, '
                             'min_bitrate 0 -> 60 kbit/s; walls off; sick weight 1 -> 2, min_bitrate 0 -> 60 kbit/s')
            self.assertEqual(switch('navigation').message, 'the focus is navigation: nothing has changed')
            self.assertTrue(switch('default').success)

    def test_proposed_streams_pass_the_check(self) -> None:
        """What make_streams writes is valid, has all sources, and check finds no error in it."""
        text = subprocess.run(['rosrun', 'smokebot_udp', 'make_streams', '--seconds', '2'], stdout=subprocess.PIPE,
                              check=True, timeout=100).stdout.decode()
        streams, problems = config.load(text)
        self.assertEqual(problems, [])
        self.assertEqual(streams.frames, ('odom', 'rover'), text)
        self.assertLessEqual({*self.sources.messages, '/steer'}, {
            settings.get('robot_topic') for settings in streams.values()}, text)
        self.assertEqual(streams['dock']['action_type'], 'move_base_msgs/MoveBaseAction')
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder, 'my_streams.yaml')
            path.write_text(text)
            done = subprocess.run(['rosrun', 'smokebot_udp', 'check', str(path), '--seconds', '2'],
                                  stdout=subprocess.PIPE, timeout=100)
        self.assertEqual(done.returncode, 0, done.stdout.decode())
        self.assertNotIn('tf knows no way', done.stdout.decode())
        self.assertNotIn('it knows no way', done.stdout.decode())


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'own_streams', OwnStreams)
