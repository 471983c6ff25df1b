#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A robot in a simulation that runs at 0.7 of real time: its clock, and a camera with stamps by it."""
import rospy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image
from std_msgs.msg import Header
from waiting import ticks

SPEED, RATE, IMAGES = 0.7, 100.0, 10
"""[1, Hz of the clock, clocks in the time of an image]"""

rospy.init_node('slow_clock_robot')
clock = rospy.Publisher('/clock', Clock, queue_size=10)
camera = rospy.Publisher('/thermal/image_raw', Image, queue_size=2)
for number, _ in enumerate(ticks(RATE)):
    now = rospy.Time.from_sec(1000.0 + number / RATE * SPEED)
    clock.publish(Clock(now))
    if number % IMAGES == 0:
        camera.publish(Image(Header(0, now, 'lens'), 48, 64, 'mono8', 0, 64, bytes(range(64)) * 48))
