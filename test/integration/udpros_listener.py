#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A subscriber process for the tests: Headers of a topic by UDPROS. udpros_listener.py TOPIC"""
import sys

import rospy
from std_msgs.msg import Header

from smokebot_udp import udpros

rospy.init_node('listener')
udpros.Subscriber(rospy.myargv(sys.argv)[1], Header, lambda message: None, transport='udp')
rospy.spin()
