#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A robot with a service that counts its calls, and an action server. Goals with x < 0 are never reached."""
from typing import Any

import actionlib
import rospy
from move_base_msgs.msg import MoveBaseAction, MoveBaseFeedback, MoveBaseResult
from std_srvs.srv import Trigger, TriggerResponse


class Robot:
    def __init__(self) -> None:
        self._calls = 0
        self._server = actionlib.SimpleActionServer('/move_base', MoveBaseAction, self._execute, auto_start=False)
        self._server.start()
        self._service = rospy.Service('/count', Trigger, self._count)

    def _count(self, request: Any) -> Any:
        self._calls += 1
        return TriggerResponse(True, '%d' % self._calls)

    def _execute(self, goal: Any) -> None:
        feedback = MoveBaseFeedback()
        feedback.base_position.header.frame_id = goal.target_pose.header.frame_id
        rate, x = rospy.Rate(50), goal.target_pose.pose.position.x
        while x < 0.0 or feedback.base_position.pose.position.x < x:
            if self._server.is_preempt_requested() or rospy.is_shutdown():
                self._server.set_preempted()
                return
            feedback.base_position.pose.position.x += 0.02
            self._server.publish_feedback(feedback)
            rate.sleep()
        self._server.set_succeeded(MoveBaseResult())


if __name__ == '__main__':
    rospy.init_node('remote_calls_robot')
    robot = Robot()
    rospy.spin()
