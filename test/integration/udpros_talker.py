#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A publisher process for the tests: numbered Headers on a topic, by UDPROS. udpros_talker.py TOPIC [RATE]"""
import sys

import rospy
from std_msgs.msg import Header

from smokebot_udp import udpros

rospy.init_node('talker')
topic, *hertz = rospy.myargv(sys.argv)[1:]
publisher = udpros.Publisher(topic, Header, queue_size=10)
rate = rospy.Rate(float(hertz[0]) if hertz else 50)
while not rospy.is_shutdown():
    publisher.publish(Header(frame_id='talker', stamp=rospy.Time.now()))
    try:
        rate.sleep()
    except rospy.ROSInterruptException:
        break
