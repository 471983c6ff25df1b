#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Driving by the page in a real browser: touch and keys, their end by whatever cause, goals and the emergency stop."""
import math
import pathlib
import sys
import time
from typing import Any, List

import rospy
import rostest
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import String

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from browser_case import PHONE, SECONDS, TABLET, BrowserCase
from waiting import is_sent_here, undisturbed, wait_for

STOP_TIME = 0.55
"""From the end of a touch, by whatever cause, to the last command that moves the robot [s]."""


class Driving(BrowserCase):

    def drive(self, size: Any = TABLET) -> Any:
        """A page with a finger that drives forward."""
        browser = self.driving_page(size)
        self.hold(browser)
        return browser

    def hold(self, browser: Any) -> None:
        """Put the finger on the stick, and wait until the robot is told to drive."""
        browser.touch('#stick', (0, 0), (0, -60))
        wait_for(self.moves, SECONDS, 'a command that moves')

    def stops(self, begun: float) -> None:
        """The robot is told to stop, and stays so.

        :param begun: when the touch ended, by the steady clock [s]
        """
        wait_for(lambda: not self.moves() and time.monotonic() > begun + 2 * STOP_TIME, SECONDS, 'the stop')
        self.assertLess(self.last_motion() - begun, STOP_TIME)

    @undisturbed()
    def test_a_touch_drives_and_its_release_stops(self) -> None:
        browser = self.drive(PHONE)
        command = self.commands[-1][1]
        self.assertGreater(command.linear.x, 0.05)
        self.assertAlmostEqual(command.linear.y, 0.0)
        time.sleep(1.0)     # a finger that rests keeps driving
        self.assertTrue(self.moves())
        begun = time.monotonic()
        browser.lift()
        self.stops(begun)
        self.assertRegex(browser.text('#page-latency'), r'^\d+ ms$')

    @undisturbed()
    def test_a_tab_that_is_hidden_stops(self) -> None:
        browser = self.drive()
        begun = time.monotonic()
        browser.driver.switch_to.new_window('tab')
        self.stops(begun)

    @undisturbed()
    def test_a_device_that_is_turned_stops_until_the_finger_is_lifted(self) -> None:
        browser = self.drive(PHONE)
        begun = time.monotonic()
        browser.resize(PHONE[::-1])
        self.stops(begun)
        browser.lift()
        self.hold(browser)

    @undisturbed()
    def test_a_browser_that_hangs_stops(self) -> None:
        browser = self.drive()
        begun = time.monotonic()
        with self.stopped(*(process.pid for process in browser.processes())):
            self.stops(begun)

    @undisturbed()
    def test_a_socket_that_is_lost_stops_and_the_finger_does_not_go_on(self) -> None:
        browser = self.drive()
        begun = time.monotonic()
        browser.run('smokebot.page.connection.socket.close()')
        self.stops(begun)
        wait_for(lambda: self.live(browser), SECONDS, 'the page again')
        self.stops(begun)

    @undisturbed()
    def test_another_desk_that_hangs_stops(self) -> None:
        browser = self.drive()
        begun = time.monotonic()
        with self.stopped(self.pid('/operator_web')):
            self.stops(begun)
        self.assertEqual(browser.run('return document.querySelector("#stick").dataset.allowed'), 'false')

    @undisturbed()
    def test_a_key_drives_as_in_a_terminal(self) -> None:
        from selenium.webdriver import ActionChains
        browser = self.driving_page()
        browser.run('document.querySelector("#stick").focus()')
        ActionChains(browser.driver).key_down('i').perform()
        begun = time.monotonic()
        wait_for(self.moves, SECONDS, 'a command that moves')
        # the key is held, but does not repeat: it counts as held for 0.7 s
        wait_for(lambda: not self.moves() and time.monotonic() > begun + 1.5, SECONDS, 'the stop')
        self.assertLess(self.last_motion() - begun, 0.7 + STOP_TIME)
        ActionChains(browser.driver).key_up('i').key_down('j').perform()
        wait_for(lambda: self.moves() and self.commands[-1][1].angular.z > 0, SECONDS, 'a turn')
        begun = time.monotonic()
        ActionChains(browser.driver).key_up('j').perform()
        self.stops(begun)

    @undisturbed()
    def test_a_key_that_is_held_over_a_stop_does_not_drive_again(self) -> None:
        from selenium.webdriver import ActionChains
        browser = self.driving_page()
        browser.run('document.querySelector("#stick").focus()')
        ActionChains(browser.driver).key_down('i').perform()
        wait_for(self.moves, SECONDS, 'a command that moves')
        browser.run('window.dispatchEvent(new Event("blur"))')
        begun = time.monotonic()
        for _ in range(10):
            browser.run('document.querySelector("#stick").dispatchEvent(new KeyboardEvent('
                        '"keydown", {key: "i", code: "KeyI", repeat: true, bubbles: true}))')
            time.sleep(0.05)
        self.stops(begun)

    def test_a_goal_reaches_the_robot(self) -> None:
        goals: List[Any] = []
        subscriber = rospy.Subscriber('/move_base_simple/goal', PoseStamped, goals.append)
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: is_sent_here('/move_base_simple/goal'), SECONDS, 'the publisher of goals')
        browser = self.driving_page()
        wait_for(lambda: browser.run('return smokebot.page.map.view.pose !== null'), SECONDS, 'the pose')
        browser.click('#map-goal')
        browser.run('smokebot.page.map.view.camera.follows = false')
        x, y = browser.run('const camera = smokebot.page.map.view.camera; '
                           'return camera.toGround(camera.width / 2 - 60, camera.height / 2 + 30)')
        browser.touch('#map', (-60, 30), (-60, 0), (-60, -30))
        browser.lift()
        self.assertEqual(goals, [])     # it has to be confirmed
        browser.click('#goal-send')
        goal = wait_for(lambda: goals, SECONDS, 'the goal')[-1].pose
        self.assertAlmostEqual(goal.position.x, x, delta=0.1)
        self.assertAlmostEqual(goal.position.y, y, delta=0.1)
        self.assertAlmostEqual(2 * math.atan2(goal.orientation.z, goal.orientation.w), math.pi / 2, delta=0.1)

    def test_the_emergency_stop_and_its_release(self) -> None:
        states: List[str] = []
        subscriber = rospy.Subscriber('/operator/control', String, lambda state: states.append(state.data))
        self.addCleanup(subscriber.unregister)
        browser = self.driving_page()
        self.addCleanup(browser.run, 'smokebot.page.requests.ask({type: "estop", engage: false})')
        browser.touch('#estop', (0, 0))
        browser.lift()
        wait_for(lambda: states and states[-1] == 'EMERGENCY STOP', SECONDS, 'the stop')
        wait_for(lambda: browser.text('#estop-state') == 'engaged', SECONDS, 'its display')
        self.assertEqual(browser.text('#stick-text'), 'EMERGENCY STOP')
        browser.click('#estop-release')
        browser.click('#estop-keep')
        self.assertFalse(browser.shown('#estop-question'))
        self.assertEqual(states[-1], 'EMERGENCY STOP')
        browser.click('#estop-release')
        browser.click('#estop-confirm')
        wait_for(lambda: states[-1] != 'EMERGENCY STOP', SECONDS, 'its release')


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'browser_driving', Driving)
