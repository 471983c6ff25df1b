#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Counts messages on the operator's side of a lab: ``lab_counter.py TOPIC ...``; one line of JSON every half second."""
import collections
import json
import sys
import time

import rospy

rospy.init_node('lab_counter', anonymous=True)
counts = collections.Counter()


def count(_, topic):
    counts[topic] += 1


subscribers = [rospy.Subscriber(topic, rospy.AnyMsg, count, topic, queue_size=100) for topic in sys.argv[1:]]
while not rospy.is_shutdown():
    time.sleep(0.5)
    print(json.dumps([time.monotonic(), counts]), flush=True)
