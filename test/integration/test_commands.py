#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Commands, who drives, and the emergency stop, from an operator's topics to the robot's driver.

Argument: udpros (one master) or link (a master for each side, and a key).
"""
import os
import pathlib
import signal
import sys
import time
from typing import Any, List, Optional

import numpy as np
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped
from sensor_msgs.msg import Image, Joy
from std_msgs.msg import Bool, Empty, String
from std_srvs.srv import SetBool, Trigger

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from commands_case import START, CommandsCase, Drive, Listener, twist
from waiting import stays, undisturbed, wait_for

from smokebot_udp.msg import RobotStatus

TIMEOUT, HOLD, RATE = 0.5, 0.6, 20.0
"""Timeout, hold and rate of cmd_vel in commands_streams.yaml [s, s, Hz]."""

SLACK = 0.5
"""Additional time for a busy machine [s]."""


class Commands(CommandsCase):
    link = 'link' in sys.argv[1:]

    @classmethod
    def setUpClass(cls) -> None:
        super().setUpClass()
        cls.driver = cls.robot_topic('/cmd_vel', Twist)
        cls.arm = cls.robot_topic('/arm', TwistStamped)
        cls.seeing = cls.robot_topic('/seeing', Twist)
        cls.estop = cls.robot_topic('/robot_sender/estop', Bool)
        cls.before = len(cls.driver.came), len(cls.arm.came)
        cls.stick = rospy.Publisher('/operator/cmd_vel', Twist, queue_size=1, tcp_nodelay=True)
        cls.button = rospy.Publisher('/operator/estop', Bool, queue_size=1, tcp_nodelay=True)
        cls.status = Listener('/operator/status', RobotStatus)
        wait_for(cls.stick.get_num_connections, START, 'the operator')
        wait_for(cls.button.get_num_connections, START, 'the operator')
        wait_for(lambda: cls.status.came, START, 'the status')

    def setUp(self) -> None:
        for listener in (self.driver, self.arm, self.seeing):
            listener.clear()

    def let_go(self) -> None:
        """Let go of the stick, so that the robot obeys it again after an emergency stop; it stands then."""
        self.driver.clear()
        with Drive(self.stick, twist(0.0)):
            wait_for(lambda: self.driver.came, START, 'the neutral command')
        self.wait_for_silence()

    def emergency_stop(self) -> Any:
        """The operator's service. The robot obeys again after the test, however that ends: others follow."""
        stop = rospy.ServiceProxy('/operator_receiver/estop', SetBool)
        self.addCleanup(self.let_go)
        self.addCleanup(stop, False)
        return stop

    def drive(self, speed: float, seconds: float = 1.0) -> float:
        """Drive; returns when the last command was given [s]."""
        with Drive(self.stick, twist(speed)):
            wait_for(lambda: any(came == speed for _, came in self.speeds(self.driver)), START, 'the command')
            stays(lambda: True, seconds)
        return time.monotonic()

    def speed(self) -> Optional[float]:
        """Speed of the last command that came; None: none came."""
        return next((speed for _, speed in reversed(self.speeds(self.driver))), None)

    def wait_for_silence(self) -> None:
        """Wait until no more commands come after a stop."""
        wait_for(lambda: self.speed() == 0.0 and
                 time.monotonic() - self.driver.came[-1].when > 3 / RATE + SLACK, 10, 'silence')

    @undisturbed()
    def test_the_robot_is_silent_before_the_first_command_and_after_the_stop(self) -> None:
        self.assertEqual(self.before, (0, 0))
        last = self.drive(0.5)
        self.wait_for_silence()
        speeds = self.speeds(self.driver)
        driven = [when for when, speed in speeds if speed == 0.5]
        stopped = [when for when, speed in speeds if speed == 0.0]
        self.assertEqual([speed for _, speed in speeds], [0.5] * len(driven) + [0.0] * len(stopped))
        self.assertGreater(len(driven), 15)
        self.assertLess(driven[-1] - last, SLACK)
        self.assertLess(stopped[0] - driven[-1], TIMEOUT + SLACK)
        self.assertGreater(stopped[0] - driven[-1], TIMEOUT / 2)
        self.assertLessEqual(len(stopped), HOLD * RATE + 1)
        self.driver.clear()
        stays(lambda: not self.driver.came, 1.0, 'silence')

    @undisturbed()
    def test_on_timeout_may_be_any_message_and_has_a_stamp(self) -> None:
        message = TwistStamped()
        message.twist.linear.x = 0.1
        neutral = TwistStamped()
        neutral.twist.angular.z = 0.25
        publisher = rospy.Publisher('/operator/arm', TwistStamped, queue_size=1)
        wait_for(publisher.get_num_connections, START, 'the operator')
        for command, speed in ((neutral, 0.0), (message, 0.1)):     # after an emergency stop the first is to be neutral
            with Drive(publisher, command):
                wait_for(lambda speed=speed: self.arm.came and self.arm.came[-1].message.twist.linear.x == speed,
                         START, 'the command')
        wait_for(lambda: self.arm.came[-1].message.twist.angular.z == 0.25, 5, 'on_timeout')
        self.assertLess(abs((rospy.Time.now() - self.arm.came[-1].message.header.stamp).to_sec()), 1.0)

    @undisturbed()
    def test_the_robot_stops_when_its_operator_is_not_heard(self) -> None:
        pid = wait_for(lambda: self.desk.pid('/operator_receiver'), START, 'the operator')
        with Drive(self.stick, twist(0.4)):
            wait_for(lambda: self.driver.came, START, 'the command')
            os.kill(pid, signal.SIGSTOP)
            stopped = time.monotonic()
            try:
                wait_for(lambda: self.speed() == 0.0, 5, 'the stop')
                self.assertLess(self.speeds(self.driver)[-1][0] - stopped, TIMEOUT + SLACK)
                self.wait_for_silence()
            finally:
                self.driver.clear()
                os.kill(pid, signal.SIGCONT)
            wait_for(lambda: any(speed == 0.4 for _, speed in self.speeds(self.driver)), 10, 'a fresh command')

    def test_a_command_that_waited_in_a_node_that_stood_still_moves_nothing(self) -> None:
        """Shorter than the lease: the node still believes that it is heard."""
        pid = wait_for(lambda: self.desk.pid('/operator_receiver'), START, 'the operator')
        with Drive(self.stick, twist(0.4)):
            wait_for(lambda: self.driver.came, START, 'the command')
            self.addCleanup(os.kill, pid, signal.SIGCONT)
            os.kill(pid, signal.SIGSTOP)
            stays(lambda: True, 0.3)
        stays(lambda: True, 1.0)        # the stick is silent, its last commands wait
        wait_for(lambda: self.speed() == 0.0, 5, 'the stop')
        self.driver.clear()
        os.kill(pid, signal.SIGCONT)
        stays(lambda: not any(speed for _, speed in self.speeds(self.driver)), 1.0, 'the stop')

    @undisturbed()
    def test_the_robot_stops_when_the_operators_node_is_killed(self) -> None:
        pid = wait_for(lambda: self.desk.pid('/operator_receiver'), START, 'the operator')
        with Drive(self.stick, twist(0.3)):
            wait_for(lambda: self.driver.came, START, 'the command')
            os.kill(pid, signal.SIGKILL)
            killed = time.monotonic()
            wait_for(lambda: self.speed() == 0.0, 5, 'the stop')
            self.assertLess(self.speeds(self.driver)[-1][0] - killed, TIMEOUT + SLACK)
            self.driver.clear()
            # roslaunch starts it again, and a fresh command moves the robot
            wait_for(lambda: any(speed == 0.3 for _, speed in self.speeds(self.driver)), START, 'a fresh command')
        wait_for(self.button.get_num_connections, START, 'the operator')

    @undisturbed()
    def test_a_second_operator_waits_takes_over_and_gives_back(self) -> None:
        desk2 = self.start_desk('name:=desk2')
        self.addCleanup(self.desk.stop, desk2)
        state, stick = Listener('/desk2/operator/control', String), rospy.Publisher(
            '/desk2/operator/cmd_vel', Twist, queue_size=1)
        self.wait_for_state(state, 'NOT IN CONTROL', START)
        wait_for(stick.get_num_connections, START, 'the second operator')
        with Drive(self.stick, twist(0.2)), Drive(stick, twist(-0.2)):
            wait_for(lambda: self.driver.came, START, 'the command')
            stays(lambda: all(speed == 0.2 for _, speed in self.speeds(self.driver)), 0.5, 'the first one drives')
            self.state.clear()
            self.driver.clear()
            answer = rospy.ServiceProxy('/desk2/operator_receiver/take_control', Trigger)()
            self.assertTrue(answer.success, answer.message)
            self.wait_for_state(self.state, 'NOT IN CONTROL: /desk2/operator_receiver')
            wait_for(lambda: self.speed() == -0.2, 5, 'the second one drives')
            speeds = [speed for _, speed in self.speeds(self.driver)]
            self.assertEqual(speeds, sorted(speeds, reverse=True))      # 0.2, a stop, -0.2
            self.assertIn(0.0, speeds)
            wait_for(lambda: self.status.came[-1].message.driver.startswith('/desk2/operator_receiver'), 10, 'driver')
            self.assertEqual(len(self.status.came[-1].message.operators), 2)
            answer = rospy.ServiceProxy('/operator_receiver/release_control', Trigger)()
            self.assertFalse(answer.success)
            self.assertIn('drives', answer.message)
        self.state.clear()
        self.doCleanups()
        self.wait_for_state(self.state, 'LOCKED: seeing', 10)   # the sole one again, without asking
        self.drive(0.2, 0.2)

    def engaged(self) -> bool:
        return bool(self.estop.came and self.estop.came[-1].message.data)

    @undisturbed()
    def test_the_emergency_stop_stays_until_it_is_released(self) -> None:
        stop = self.emergency_stop()
        with Drive(self.stick, twist(0.6)):
            for engage in (lambda: self.button.publish(True), lambda: stop(True)):
                wait_for(lambda: self.speed() == 0.6, START, 'the command')
                self.state.clear()
                begun = time.monotonic()
                engage()
                wait_for(lambda: self.speed() == 0.0, 2, 'the stop')
                self.assertLess(self.speeds(self.driver)[-1][0] - begun, SLACK)
                wait_for(self.engaged, 2, '~estop')
                self.wait_for_state(self.state, 'EMERGENCY STOP')
                self.driver.clear()
                stays(lambda: all(speed == 0.0 for _, speed in self.speeds(self.driver)), 1.0, 'the stop')
                self.assertGreater(len(self.driver.came), 0.5 * RATE)
                wait_for(lambda: self.status.came[-1].message.estop, 10, 'the status')
                released = stop(False)
                self.assertTrue(released.success, released.message)
                wait_for(lambda: not self.engaged(), 2, '~estop')
                self.wait_for_state(self.state, 'release the stick: linear.x is not at rest')
                self.driver.clear()
                stays(lambda: not any(speed for _, speed in self.speeds(self.driver)), 1.0, 'the stick is still pushed')
                self.stick.publish(twist(0.0))
            wait_for(lambda: self.speed() == 0.6, 2, 'the next command')
        self.wait_for_silence()     # the next test begins with a robot that stands

    def test_somebody_at_the_robot_engages_and_releases_it(self) -> None:
        for data in ('true', 'false'):
            self.robot.run('rosservice', 'call', '/robot_sender/set_estop', data)
            wait_for(lambda data=data: self.engaged() == (data == 'true'), 5, '~estop')
            self.wait_for_state(self.state, 'EMERGENCY STOP' if data == 'true' else 'LOCKED: seeing')
            self.state.clear()
        self.let_go()

    @undisturbed()
    def test_to_let_go_of_the_button_releases_nothing_and_each_press_counts(self) -> None:
        stop = self.emergency_stop()
        for _ in range(3):
            with Drive(self.button, Bool(True)):
                stays(lambda: True, 0.3)
            with Drive(self.button, Bool(False)):
                wait_for(self.engaged, 2, '~estop')
                stays(self.engaged, 1.0, 'the stop')
            self.assertTrue(stop(False).success)
            wait_for(lambda: not self.engaged(), 2, '~estop')

    @undisturbed()
    def test_a_release_by_a_topic_is_a_message_of_its_own_that_is_not_latched(self) -> None:
        stop = self.emergency_stop()
        self.assertTrue(stop(True).success)
        latched = rospy.Publisher('/operator/estop_release', Empty, queue_size=1, latch=True)
        wait_for(latched.get_num_connections, START, 'the operator')
        latched.publish()
        stays(self.engaged, 1.0, 'the stop')
        latched.unregister()
        release = rospy.Publisher('/operator/estop_release', Empty, queue_size=1)
        # again and again: rospy may connect twice to the node that has just unregistered the topic, and drops one
        with Drive(release, Empty()):
            wait_for(lambda: not self.engaged(), START, '~estop')

    @undisturbed()
    def test_sticks_that_rest_elsewhere_are_neutral_where_it_was_said_so(self) -> None:
        """A gamepad whose triggers rest at 1, during a stop and after it."""
        neutral, stop = (rospy.ServiceProxy('/operator_receiver/' + name, type_)
                         for name, type_ in (('set_neutral', Trigger), ('estop', SetBool)))
        self.assertFalse(neutral().success)     # nothing waits for it
        pad, came = rospy.Publisher('/operator/pad', Joy, queue_size=1), self.robot_topic('/pad', Joy)
        wait_for(pad.get_num_connections, START, 'the operator')
        self.assertTrue(stop(True).success and stop(False).success)
        self.state.clear()
        with Drive(pad, Joy(axes=[0.0, 0.0, 1.0, 0.0, 0.0, 1.0])):
            self.wait_for_state(self.state, 'pad: release the stick: axes[2] is not at rest')
            answer = neutral()
            self.assertEqual((answer.success, answer.message), (True, 'pad: axes[2] 1.0, axes[5] 1.0'))
            wait_for(lambda: any(one.message.axes[2:3] == (1.0,) for one in came.came), 5, 'the command')
        self.let_go()

    def test_no_command_leaves_while_the_image_is_old_and_the_first_one_is_zero(self) -> None:
        stick = rospy.Publisher('/operator/seeing', Twist, queue_size=1)
        wait_for(stick.get_num_connections, START, 'the operator')
        self.state.clear()
        with Drive(stick, twist(0.7)):
            with Drive(Camera(self.images), None):
                stays(lambda: not self.seeing.came, 2.0, 'the lock: it did not start from zero')
            self.wait_for_state(self.state, 'LOCKED: seeing: thermal is')
            stick.publish(twist(0.0))
            stays(lambda: not self.seeing.came, 0.5, 'the lock: the image is old')
        with Drive(Camera(self.images), None), Drive(stick, twist(0.0)):
            wait_for(lambda: self.seeing.came, START, 'the zero')
            with Drive(stick, twist(0.7)):
                wait_for(lambda: any(came.message.linear.x == 0.7 for came in self.seeing.came), 5, 'the command')

    def test_a_message_of_another_type_is_named(self) -> None:
        statuses: List[Any] = []
        rospy.Subscriber('/diagnostics', DiagnosticArray, lambda message: statuses.extend(message.status))
        wrong = self.robot.master if not self.link else self.desk.master
        wrong.call('registerPublisher', '/operator/arm', 'std_msgs/String', 'http://localhost:1')
        self.addCleanup(wrong.call, 'unregisterPublisher', '/operator/arm', 'http://localhost:1')
        wait_for(lambda: any('must be geometry_msgs/TwistStamped' in status.message for status in statuses), 30,
                 'the problem')

    @undisturbed()
    def test_settings_change_while_it_runs(self) -> None:
        (self.desk if self.link else self.robot).set('/robot_sender/cmd_vel/hold', 0.1)
        wait_for(lambda: self.robot.parameter('/robot_sender/cmd_vel/hold') == 0.1, 20, 'the setting')
        self.addCleanup(self.robot.set, '/robot_sender/cmd_vel/hold', HOLD)
        dynparam = 'rosrun', 'dynamic_reconfigure', 'dynparam', 'set', '/robot_sender/cmd_vel', 'timeout'
        self.robot.run(*dynparam, '0.2')
        self.addCleanup(self.robot.run, *dynparam, str(TIMEOUT))
        self.drive(0.5, 0.3)
        self.wait_for_silence()
        stopped = [when for when, speed in self.speeds(self.driver) if speed == 0.0]
        self.assertLessEqual(len(stopped), 3)

    def restart_robot(self, signal_: int) -> None:
        """End the robot's node, which roslaunch starts again."""
        pid = wait_for(lambda: self.robot.pid('/robot_sender'), START, 'the robot')
        os.kill(pid, signal_)
        wait_for(lambda: self.robot.pid('/robot_sender') not in (0, pid), START, 'the new node')

    @undisturbed()
    def test_zy_the_robots_node_stops_the_robot_when_it_ends(self) -> None:
        with Drive(self.stick, twist(0.5)):
            wait_for(lambda: self.driver.came, START, 'the command')
            ended = time.monotonic()
            self.restart_robot(signal.SIGINT)
        stops = [when for when, speed in self.speeds(self.driver) if speed == 0.0]
        type(self).driver = self.robot_topic('/cmd_vel', Twist)
        self.assertTrue(stops)
        self.assertLess(stops[0] - ended, SLACK)

    def test_zy_the_stop_of_somebody_at_the_robot_outlives_its_node(self) -> None:
        self.robot.run('rosservice', 'call', '/robot_sender/set_estop', 'true')
        wait_for(lambda: self.robot.parameter('/robot_sender/estop_by'), 5, 'the parameter')
        self.restart_robot(signal.SIGKILL)
        estop = self.robot_topic('/robot_sender/estop', Bool)
        wait_for(lambda: estop.came, START, '~estop')
        self.assertTrue(estop.came[-1].message.data)
        type(self).estop, type(self).driver = estop, self.robot_topic('/cmd_vel', Twist)
        self.robot.run('rosservice', 'call', '/robot_sender/set_estop', 'false')
        wait_for(lambda: not self.robot.parameter('/robot_sender/estop_by'), 10, 'the release')
        self.let_go()
        self.drive(0.5, 0.2)

    def test_zz_the_robots_node_is_restarted(self) -> None:
        """The emergency stop stays, and after its release commands work again."""
        stop = rospy.ServiceProxy('/operator_receiver/estop', SetBool)
        wait_for(lambda: stop(True).success, START, 'the stop')
        self.restart_robot(signal.SIGKILL)
        self.driver = self.robot_topic('/cmd_vel', Twist)
        wait_for(lambda: self.driver.came, START, 'the stop')
        self.assertEqual({speed for _, speed in self.speeds(self.driver)}, {0.0})
        wait_for(lambda: stop(False).success, START, 'the release')
        self.let_go()
        self.drive(0.5, 0.2)


class Camera:
    """The publisher of images of now: what it is told to publish is only the prompt."""

    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher

    def publish(self, _: Any) -> None:
        image = Image(height=24, width=32, encoding='mono16', step=64, data=np.zeros(768, np.uint16).tobytes())
        image.header.stamp = rospy.Time.now()
        self._publisher.publish(image)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'commands_link' if Commands.link else 'commands', Commands)
