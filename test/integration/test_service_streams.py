#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Service streams: both runners over real sockets, with services and callers at a real master."""
import pathlib
import sys
import threading
import time
import unittest
from concurrent.futures import ThreadPoolExecutor
from typing import Any, List

import rospy
import rostest
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan, GetPlanResponse
from std_srvs.srv import SetBool, SetBoolResponse, Trigger, TriggerResponse

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from reliable_pair import ReliablePair
from waiting import stays, undisturbed, wait_for

from smokebot_udp.nodes.operator_service import OperatorService
from smokebot_udp.nodes.robot_service import RobotService

COUNT = {'service_type': 'std_srvs/Trigger', 'robot_service': '/count', 'operator_service': '/operator/count',
         'timeout': 10.0}
PLAN = {'service_type': 'nav_msgs/GetPlan', 'robot_service': '/plan', 'operator_service': '/operator/plan',
        'timeout': 10.0}


class Counter:
    """A service that says how often it was called."""

    def __init__(self) -> None:
        self.calls = 0
        self._lock = threading.Lock()

    def __call__(self, request: Any) -> Any:
        with self._lock:
            self.calls += 1
            return TriggerResponse(True, '%d' % self.calls)


class ServiceStreams(unittest.TestCase):

    def pair(self, loss: float = 0.0) -> ReliablePair:
        made = ReliablePair(loss)
        self.addCleanup(made.close)
        return made

    def serve(self, name: str, service_class: Any, handler: Any) -> Any:
        service = rospy.Service(name, service_class, handler)
        self.addCleanup(service.shutdown)
        return service

    def setUp(self) -> None:
        self.streams: List[Any] = []

    def start(self, stream: Any) -> Any:
        stream.start()
        self.streams.append(stream)
        self.addCleanup(stream.close)
        return stream

    def both(self, pair: ReliablePair, settings: Any, name: str = 'count') -> Any:
        """Start both sides of a stream; the caller's proxy."""
        self.start(RobotService(name, settings, pair.robot))
        self.start(OperatorService(name, settings, pair.operator))
        return rospy.ServiceProxy(settings['operator_service'], self.class_of(settings))

    @staticmethod
    def class_of(settings: Any) -> Any:
        return {'std_srvs/Trigger': Trigger, 'nav_msgs/GetPlan': GetPlan, 'std_srvs/SetBool': SetBool}[
            settings['service_type']]

    def fails(self, call: Any, words: str) -> None:
        with self.assertRaises(rospy.ServiceException) as caught:
            call()
        self.assertIn(words, str(caught.exception))

    def test_calls_one_after_the_other_and_at_the_same_time(self) -> None:
        counter = Counter()
        self.serve('/count', Trigger, counter)
        call = self.both(self.pair(), COUNT)
        self.assertEqual([call().message for _ in range(20)], ['%d' % number for number in range(1, 21)])
        with ThreadPoolExecutor(20) as pool:
            answers = list(pool.map(lambda _: rospy.ServiceProxy('/operator/count', Trigger)().message, range(20)))
        self.assertEqual(sorted(map(int, answers)), list(range(21, 41)))
        self.assertEqual(counter.calls, 40)
        stats = self.streams[-1].stats()
        self.assertEqual((stats.messages_in, stats.messages_out), (40, 40))

    def test_half_of_the_datagrams_are_lost(self) -> None:
        counter = Counter()
        self.serve('/count', Trigger, counter)
        call = self.both(self.pair(0.5), COUNT)
        times = []
        for number in range(1, 101):
            begun = time.monotonic()
            self.assertEqual(call().message, '%d' % number)
            times.append(time.monotonic() - begun)
        self.assertEqual(counter.calls, 100)
        print('call at 50 %% loss: p50 %.0f ms, p99 %.0f ms' % (1e3 * sorted(times)[50], 1e3 * sorted(times)[99]))

    def test_long_answers_and_frames(self) -> None:
        """The robot's service sees the robot's frames, the operator those with its prefix."""
        frames: List[str] = []

        def plan(request: Any) -> Any:
            frames.append(request.start.header.frame_id)
            response = GetPlanResponse()
            response.plan.header.frame_id = 'map'
            response.plan.poses = [PoseStamped() for _ in range(500)]
            response.plan.poses[499].pose.position.x = 7.5
            response.plan.poses[499].header.frame_id = 'map'
            return response
        self.serve('/plan', GetPlan, plan)
        pair = self.pair(0.2)
        pair.prefix_frames('ugv1/')
        call = self.both(pair, PLAN, 'plan')
        start = PoseStamped()
        start.header.frame_id = 'ugv1/map'
        answer = call(start=start, goal=start, tolerance=0.5).plan
        self.assertEqual(frames, ['map'])
        self.assertEqual((answer.header.frame_id, answer.poses[499].header.frame_id), ('ugv1/map', 'ugv1/map'))
        self.assertEqual((len(answer.poses), answer.poses[499].pose.position.x), (500, 7.5))

    def test_why_a_call_fails_on_the_robot(self) -> None:
        call = self.both(self.pair(), COUNT)
        self.fails(call, 'service [/count] unavailable')

        def broken(request: Any) -> Any:
            raise rospy.ServiceException('the arm is stowed')
        service = rospy.Service('/count', Trigger, broken)
        self.fails(call, 'on the robot /count failed: service cannot process request: the arm is stowed')
        service.shutdown()
        service = rospy.Service('/count', SetBool, lambda request: SetBoolResponse(True, ''))
        self.fails(call, 'md5sums do not match')
        service.shutdown()
        self.serve('/count', Trigger, Counter())    # its node has come back
        self.assertEqual(call().message, '1')

    def test_another_type_on_the_other_side(self) -> None:
        pair = self.pair()
        self.start(RobotService('count', {**COUNT, 'service_type': 'std_srvs/SetBool'}, pair.robot))
        self.start(OperatorService('count', COUNT, pair.operator))
        self.fails(rospy.ServiceProxy('/operator/count', Trigger),
                   'the service is of another type on the robot: std_srvs/SetBool')

    def test_without_a_robot_and_without_its_stream(self) -> None:
        pair = self.pair()
        self.start(OperatorService('count', {**COUNT, 'timeout': 3.0}, pair.operator))
        call = rospy.ServiceProxy('/operator/count', Trigger)
        self.fails(call, "the robot has no stream 'count' of type service: it was not called")
        pair.end_robot()
        self.fails(call, 'the service was not called')

    @undisturbed()
    def test_a_service_that_hangs_delays_no_other(self) -> None:
        ended = threading.Event()
        self.addCleanup(ended.set)

        def hang(request: Any) -> Any:
            ended.wait()
            return TriggerResponse(True, 'late')
        self.serve('/hang', Trigger, hang)
        self.serve('/count', Trigger, Counter())
        pair = self.pair()
        hanging = {**COUNT, 'robot_service': '/hang', 'operator_service': '/operator/hang', 'timeout': 2.0}
        slow, fast = self.both(pair, hanging, 'hang'), self.both(pair, COUNT)
        robot = self.streams[0]
        with ThreadPoolExecutor(8) as pool:
            calls = [pool.submit(self.fails, slow, 'no answer within 2 s') for _ in range(8)]
            wait_for(lambda: fast().message == '5', 10)
            self.assertFalse(any(call.done() for call in calls))
            for done in calls:
                done.result()
        # the robot took them a little later than the callers sent them
        wait_for(lambda: robot.stats().problem == '8 calls of /hang hang', 5, 'all calls hang')
        ended.set()
        wait_for(lambda: robot.stats().problem is None)
        wait_for(lambda: slow().message == 'late', 10)

    def test_a_restart_of_the_robots_node_during_a_call(self) -> None:
        counter, go_on = Counter(), threading.Event()
        self.addCleanup(go_on.set)

        def slow(request: Any) -> Any:
            answer = counter(request)
            go_on.wait()
            return answer
        self.serve('/count', Trigger, slow)
        pair = self.pair()
        stream = RobotService('count', COUNT, pair.robot)
        stream.start()
        self.start(OperatorService('count', COUNT, pair.operator))
        call = rospy.ServiceProxy('/operator/count', Trigger)
        with ThreadPoolExecutor(1) as pool:
            failed = pool.submit(self.fails, call, "the robot's node restarted during the call")
            wait_for(lambda: counter.calls == 1)
            stream.close()
            pair.restart_robot()
            self.start(RobotService('count', COUNT, pair.robot))
            failed.result()
        go_on.set()
        stays(lambda: counter.calls == 1, 1.5, 'the one call')
        self.assertEqual(call().message, '2')


if __name__ == '__main__':
    rospy.init_node('service_streams')
    rostest.rosrun('smokebot_udp', 'service_streams', ServiceStreams)
