#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Reliable relays through robot_sender and operator_receiver, which loses half of what it receives."""
import itertools
import os
import pathlib
import signal
import sys
import unittest
from typing import Any, Callable, List

import rosgraph
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rosgraph_msgs.msg import Log
from std_msgs.msg import String, UInt32MultiArray
from std_srvs.srv import SetBool

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import pid_at, stays, ticks, wait_for

OPERATOR = '/operator_receiver'
START = 60.0
"""For nodes to start on a busy machine [s]."""

FIRST_PROBE = 1000000
PROBES = itertools.count(FIRST_PROBE)
"""Numbers that tests do not send."""


class Inbox:
    """All messages of a topic, in the order in which they came."""

    def __init__(self, topic: str, class_: Any) -> None:
        self.messages: List[Any] = []
        self.subscriber = rospy.Subscriber(topic, class_, self.messages.append, queue_size=1000)

    def wait_connected(self) -> None:
        wait_for(self.subscriber.get_num_connections, START, self.subscriber.name)

    def wait_for_relay(self, publish: Callable[[int], None], number: Callable[[Any], float]) -> None:
        """Publish probes until one arrives, and wait for the last: nodes connect topic by topic, in any order."""
        count = len(self.messages)
        for probe, _ in zip(itertools.islice(PROBES, int(50.0 * START)), ticks(50.0)):
            publish(probe)
            if len(self.messages) > count:
                break
        wait_for(lambda: probe in map(number, self.messages), what='a probe of %s' % self.subscriber.name)


def goal_at(x: float) -> PoseStamped:
    goal = PoseStamped()
    goal.header.frame_id, goal.pose.position.x = 'ugv1/map', x
    return goal


def place(goal: PoseStamped) -> float:
    return float(goal.pose.position.x)


def operator_pid() -> int:
    try:
        return pid_at(rosgraph.Master('/test').lookupNode(OPERATOR))
    except rosgraph.MasterError:
        return 0


class ReliableRelay(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('reliable_relay')
        cls.goals, cls.numbers = Inbox('/test/goal', PoseStamped), Inbox('/operator/numbers', UInt32MultiArray)
        cls.plans, cls.logs = Inbox('/operator/plan', String), Inbox('/operator/rosout', Log)
        cls.diagnostics, cls.own_log = Inbox('/diagnostics', DiagnosticArray), Inbox('/rosout', Log)
        cls.beats = Inbox('/operator/beat', String)
        cls.beat = rospy.Publisher('/test/beat', String, queue_size=10)
        cls.moves = Inbox('/test/move', PoseStamped)
        cls.move = rospy.Publisher('/operator/move', PoseStamped, queue_size=10)
        cls.goal = rospy.Publisher('/operator/goal', PoseStamped, queue_size=100)
        cls.number = rospy.Publisher('/test/numbers', UInt32MultiArray, queue_size=1000)
        cls.plan = rospy.Publisher('/test/plan', String, queue_size=1, latch=True)
        cls.log = rospy.Publisher('/rosout_agg', Log, queue_size=10)
        for inbox in (cls.goals, cls.moves, cls.numbers, cls.plans, cls.logs, cls.beats):
            inbox.wait_connected()
        for publisher in (cls.goal, cls.move, cls.number, cls.plan, cls.beat, cls.log):
            wait_for(publisher.get_num_connections, START, publisher.name)
        cls.count = 0
        cls.plan.publish('first')
        wait_for(lambda: cls.plans.messages, START, 'the latched message')
        cls.wait_for_relays()

    @classmethod
    def wait_for_relays(cls) -> None:
        cls.numbers.wait_for_relay(lambda probe: cls.number.publish(UInt32MultiArray(data=[probe])),
                                   lambda numbers: numbers.data[0])
        cls.beats.wait_for_relay(lambda probe: cls.beat.publish(str(probe)), lambda beat: int(beat.data))
        cls.logs.wait_for_relay(lambda probe: cls.log.publish(Log(level=Log.ERROR, line=probe)), lambda log: log.line)
        cls.goals.wait_for_relay(lambda probe: cls.goal.publish(goal_at(probe)), place)
        cls.moves.wait_for_relay(lambda probe: cls.move.publish(goal_at(probe)), place)

    def send(self, count: int) -> None:
        """Publish the next numbers, 50 a second; each message takes several datagrams now and then."""
        for _, number in zip(ticks(50.0), range(self.count, self.count + count)):
            self.number.publish(UInt32MultiArray(data=[number] * (1 if number % 50 else 500)))
        type(self).count += count

    def received(self) -> List[int]:
        return [message.data[0] for message in self.numbers.messages if message.data[0] < FIRST_PROBE]

    def test_all_messages_come_once_and_in_order(self) -> None:
        first = self.count
        del self.numbers.messages[:]
        self.send(500)
        expected = list(range(first, self.count))
        wait_for(lambda: len(self.numbers.messages) >= 500, what='all numbers')
        stays(lambda: self.received() == expected, 1.0)
        self.assertEqual({len(message.data) for message in self.numbers.messages}, {1, 500})

    def test_goals_reach_the_robot_without_the_prefix_of_its_frames(self) -> None:
        del self.goals.messages[:]
        for number in range(20):
            self.goal.publish(goal_at(number))
        wait_for(lambda: len(self.goals.messages) >= 20, what='all goals')
        self.assertEqual(list(map(place, self.goals.messages)), list(range(20)))
        self.assertEqual({goal.header.frame_id for goal in self.goals.messages}, {'map'})

    def test_an_emergency_stop_refuses_what_needs_control(self) -> None:
        del self.moves.messages[:]
        engage = rospy.ServiceProxy('/robot_sender/set_estop', SetBool)
        self.addCleanup(engage, False)
        self.assertTrue(engage(True).success)
        self.move.publish(PoseStamped())
        wait_for(lambda: {'dropped, refused': '1'}.items() <= {
            value.key: value.value for value in self.newest_status('robot_sender: move').values}.items(),
            what='a count')
        self.assertTrue(engage(False).success)
        self.move.publish(goal_at(7.0))
        wait_for(lambda: self.moves.messages, what='the goal after it')
        self.assertEqual(list(map(place, self.moves.messages)), [7.0])

    def test_what_a_disabled_relay_drops_is_counted(self) -> None:
        rospy.set_param('/robot_sender/goal/enabled', False)
        wait_for(lambda: self.newest_status('robot_sender: goal').message == 'off', what='a disabled relay')
        goals = len(self.goals.messages)
        self.goal.publish(PoseStamped())
        wait_for(lambda: 'dropped, disabled' in {
            value.key for value in self.newest_status('robot_sender: goal').values}, what='a count')
        self.assertEqual(len(self.goals.messages), goals)
        rospy.set_param('/robot_sender/goal/enabled', True)
        wait_for(lambda: self.newest_status('robot_sender: goal').message != 'off', what='an enabled relay')

    def newest_status(self, name: str) -> Any:
        return wait_for(lambda: [status for message in self.diagnostics.messages for status in message.status
                                 if status.name == name], what='a status of ' + name)[-1]

    def test_logs_from_a_level_on(self) -> None:
        self.log.publish(Log(level=Log.FATAL, msg='the pump: a message of the operator', name=OPERATOR))
        for level in (Log.DEBUG, Log.INFO, Log.WARN, Log.ERROR):
            self.log.publish(Log(level=level, msg='the pump: %d' % level))
        wait_for(lambda: self.logged()[-1:] == ['the pump: 8'], what='the error')
        self.assertEqual(self.logged(), ['the pump: 4', 'the pump: 8'])

    def logged(self) -> List[str]:
        return [log.msg for log in self.logs.messages if log.msg.startswith('the pump')]

    def test_restarts_of_the_operator_repeat_nothing_but_what_is_latched(self) -> None:
        del self.numbers.messages[:]
        self.plan.publish('second')
        wait_for(lambda: self.plans.messages[-1].data == 'second', what='the latched message')
        plans = len(self.plans.messages)
        self.send(100)
        pid = wait_for(operator_pid, START, 'operator_receiver')
        os.kill(pid, signal.SIGKILL)
        wait_for(lambda: operator_pid() not in (0, pid), START, 'operator_receiver')
        wait_for(lambda: len(self.plans.messages) > plans, START, 'the latched message')
        self.assertEqual(self.plans.messages[-1].data, 'second')
        self.wait_for_relays()
        self.send(100)
        wait_for(lambda: self.received()[-1:] == [self.count - 1], what='the last number')
        received = self.received()
        self.assertEqual(received, sorted(set(received)))
        self.assertEqual(received[-100:], list(range(self.count - 100, self.count)))

    def test_at_a_cut_messages_are_given_up_and_that_is_said_once(self) -> None:
        beats = rospy.Timer(rospy.Duration(0.1), lambda _: self.beat.publish('0'))
        wait_for(lambda: self.beats.messages, what='a message')
        pid = wait_for(operator_pid, START, 'operator_receiver')
        os.kill(pid, signal.SIGSTOP)
        try:
            wait_for(self.said, what='a warning')
            stays(lambda: len(self.said()) == 1, 2.0)
        finally:
            os.kill(pid, signal.SIGCONT)
        self.assertIn('given up: not acknowledged in time', self.said()[0])
        del self.beats.messages[:]
        wait_for(lambda: self.beats.messages, what='a message after the cut')
        beats.shutdown()
        status = wait_for(lambda: [status for message in self.diagnostics.messages for status in message.status
                                   if status.name == 'robot_sender: beat' and 'given up' in status.message],
                          what='a status that says so')[0]
        self.assertEqual(status.level, DiagnosticStatus.WARN)

    def said(self) -> List[str]:
        return [log.msg for log in self.own_log.messages if log.msg.startswith("stream 'beat': messages to ")]


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'reliable_relay', ReliableRelay)
