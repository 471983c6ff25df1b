#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Small messages as they are through robot_sender and operator_receiver: real nodes, sockets and master."""
import pathlib
import random
import string
import sys
import threading
import time
from typing import Any

import rospy
import rostest
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from tf2_msgs.msg import TFMessage

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from streams_case import LOSSES, StreamsCase
from waiting import Collector, stamps, undisturbed, wait_for


def transform(parent, child, x=0.0, stamp=None) -> Any:
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, stamp or rospy.Time.now()
    message.transform.translation.x, message.transform.rotation.w = x, 1.0
    return message


class Transforms:
    """What came on a tf topic: {(parent, child): [(when, transform), ...]}, and how many messages."""

    def __init__(self, topic) -> None:
        self.got, self.messages = {}, 0
        self._lock = threading.Lock()
        self.subscriber = rospy.Subscriber(topic, TFMessage, self._take, queue_size=100)

    def _take(self, message) -> None:
        with self._lock:
            self.messages += 1
            for one in message.transforms:
                self.got.setdefault((one.header.frame_id, one.child_frame_id), []).append((time.monotonic(), one))


class RelayStreams(StreamsCase):

    @classmethod
    def setUpClass(cls) -> Any:
        rospy.init_node('relay_streams')
        cls.warnings = []
        cls.warned = rospy.Subscriber('/rosout', Log, lambda log: cls.warnings.append(log.msg)
                                      if log.level == Log.WARN else None)
        cls.odometry = rospy.Publisher('/odom', Odometry, queue_size=5)
        cls.tf = rospy.Publisher('/tf', TFMessage, queue_size=50)
        cls.out = {loss: Collector(where + '/odom', Odometry) for loss, where in LOSSES.items()}
        cls.listen('odom', 'tf', 'tf_static')
        for publisher in (cls.odometry, cls.tf):
            wait_for(publisher.get_num_connections, what='robot_sender')
        for collector in cls.out.values():
            collector.wait_connected()

    @undisturbed()
    def test_messages_arrive_as_they_are_at_their_rate(self) -> None:
        for collector in self.out.values():
            collector.clear()
        sent = {}
        for stamp in stamps(100, 50.0):
            message = Odometry(child_frame_id='base_link')
            message.header.stamp, message.header.frame_id = stamp, 'odom'
            message.twist.covariance[3] = 0.1 + len(sent)
            self.odometry.publish(message)
            sent[stamp] = message
        out = self.out[0]
        wait_for(lambda: max(list(out.messages), default=rospy.Time()) > stamp - rospy.Duration(0.1), 5, 'the newest')
        for stamp, got in list(out.messages.items()):
            got.header.seq = sent[stamp].header.seq
            self.assertEqual(got, sent[stamp])
        arrivals = sorted(out.arrivals.values())
        self.assertAlmostEqual((len(arrivals) - 1) / (arrivals[-1] - arrivals[0]), 10.0, delta=1.5)   # of 50 Hz
        self.assertGreater(len(self.out[50].messages), 3)

    @undisturbed()
    def test_transforms_are_merged_and_throttled_by_pair(self) -> None:
        watch = Transforms('/operator/tf')
        wait_for(watch.subscriber.get_num_connections, what='operator_receiver')
        count = 0
        for stamp in stamps(200, 100.0):
            count += 1
            # as of several publishers, one transform each
            for k in range(4):
                self.tf.publish(TFMessage([transform('map', 'frame%d' % k, float(count), stamp)]))
        pairs = [('map', 'frame%d' % k) for k in range(4)]
        wait_for(lambda: all(pair in watch.got and watch.got[pair][-1][1].transform.translation.x == count
                             for pair in pairs), 5, 'the newest of every pair')
        for came in watch.got.values():
            times = [when for when, _ in came]
            self.assertAlmostEqual((len(times) - 1) / (times[-1] - times[0]), 20.0, delta=3.0)
        self.assertLess(watch.messages, 1.5 * max(map(len, watch.got.values())))

    def test_many_transforms_stay_in_single_datagrams(self) -> None:
        watch = Transforms('/operator/tf')

        def is_connected() -> bool:
            """Whether messages come: rospy's publisher adds a connection after the subscriber counts it."""
            self.tf.publish(TFMessage([transform('map', 'first')]))
            return ('map', 'first') in watch.got

        wait_for(is_connected, what='operator_receiver')
        before = watch.messages
        self.tf.publish(TFMessage([transform('map', 'one_of_many_%d' % k) for k in range(60)]))
        wait_for(lambda: sum('one_of_many' in child for _, child in watch.got) == 60, 5, 'all of them')
        self.assertGreater(watch.messages - before, 3)
        self.assertFalse([text for text in self.warnings if "'tf'" in text])

    def test_static_transforms_reach_everybody(self) -> None:
        """Latched by two nodes, lost nine times of ten, and asked for late."""
        first = rospy.Publisher('/tf_static', TFMessage, queue_size=5, latch=True)
        first.publish(TFMessage([transform('base_link', 'velodyne', 1.0)]))
        wait_for(first.get_num_connections, what='robot_sender')
        first.publish(TFMessage([transform('base_link', 'laser', 2.0)]))
        for where in LOSSES.values():
            late = Transforms(where + '/tf_static')
            wait_for(lambda got=late.got: {('base_link', 'velodyne'), ('base_link', 'laser')} <= set(got), 60,
                     'both at ' + where)
            self.assertEqual(late.got['base_link', 'laser'][-1][1].transform.translation.x, 2.0)

    def test_a_message_of_several_datagrams_is_warned_of(self) -> None:
        text = ''.join(random.Random(1).choices(string.ascii_letters + string.digits, k=4500))    # 3.4 kB compressed
        message = Odometry(child_frame_id=text)
        message.header.stamp = rospy.Time.now()
        self.odometry.publish(message)
        wait_for(lambda: any("stream 'odom'" in text and '3 datagrams' in text for text in self.warnings), 5,
                 'a warning')
        wait_for(lambda: message.header.stamp in self.out[0].messages, 5, 'the message')

    def test_an_unknown_type_leaves_the_others(self) -> None:
        published = {topic for topic, _ in rospy.get_published_topics('/smokebot_udp')}
        self.assertIn('/smokebot_udp/odom/segments', published)
        self.assertFalse([topic for topic in published if 'unknown_type' in topic])


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'relay_streams', RelayStreams)
