#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A publisher process for the tests: numbered Headers at 50 Hz on a topic, by UDPROS. udpros_talker.py TOPIC"""
import sys

import rospy
from std_msgs.msg import Header

from smokebot_udp import udpros

rospy.init_node('talker')
publisher = udpros.Publisher(rospy.myargv(sys.argv)[1], Header, queue_size=10)
rate = rospy.Rate(50)
while not rospy.is_shutdown():
    publisher.publish(Header(frame_id='talker', stamp=rospy.Time.now()))
    try:
        rate.sleep()
    except rospy.ROSInterruptException:
        break
