#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Reports of what cannot be: more came than was sent, before it left, of streams and datagrams that never were."""
import contextlib

import rospy

from smokebot_udp import udpros, version
from smokebot_udp.msg import ArrivalMark, LinkReport, StreamArrivals

MOST = (1 << 32) - 1

FORGED = (
    LinkReport(session=1, clock=10 ** 15, streams=[StreamArrivals('thermal', MOST, MOST, 1 << 40)]),
    LinkReport(session=1, clock=0, streams=[StreamArrivals('thermal', 0, 0, 0)], marks=[ArrivalMark(7, 0, 0)]),
    LinkReport(session=2, clock=5, streams=[StreamArrivals('thermal', 1, 1, 1)], marks=[ArrivalMark(0, MOST, MOST)]),
    LinkReport(session=3, clock=5, streams=[StreamArrivals('no such stream', 1, 1, 1)]),
    LinkReport(),
)


def main() -> None:
    rospy.init_node('forger')
    publisher = udpros.Publisher('/smokebot_udp/link/report', LinkReport, queue_size=10, headers=version.headers())
    rate = rospy.Rate(50)
    while not rospy.is_shutdown():
        for report in FORGED:
            publisher.publish(report)
        rate.sleep()


if __name__ == '__main__':
    with contextlib.suppress(rospy.ROSInterruptException):
        main()
