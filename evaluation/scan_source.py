# SPDX-License-Identifier: BSD-3-Clause
"""A node that publishes the scans of a Hokuyo UTM-30LX in rooms: `python3 -m evaluation.scan_source`."""
import rospy
from sensor_msgs.msg import LaserScan

from .rooms import rooms, scan_message

RATE = 10.0
"""[Hz]"""

SCAN = '/scan'
NOISE = 0.01
"""Noise of the ranges, from the datasheet [m]."""

SCANS = 20
"""Number of scans that are published in turn."""


def main() -> None:
    """Run the node."""
    rospy.init_node('scan_source')
    messages = [scan_message(ranges) for ranges in rooms(NOISE, SCANS, 1)]
    publisher = rospy.Publisher(SCAN, LaserScan, queue_size=2, tcp_nodelay=True)
    rate, number = rospy.Rate(RATE), 0
    while not rospy.is_shutdown():
        message = messages[number % SCANS]
        message.header.stamp, message.header.frame_id = rospy.Time.now(), 'base_link'
        publisher.publish(message)
        number += 1
        rate.sleep()


if __name__ == '__main__':
    main()
