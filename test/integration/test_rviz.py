#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What rviz shows with operator.rviz at 20 % loss: live, in a focus that sends little, stopped, and after a cut."""
import contextlib
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import unittest
from typing import Any, Callable, Iterator

import rosgraph
import rospkg
import rospy
import rostest
from std_srvs.srv import SetBool

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import pid_at, wait_for

from evaluation.screen import RVIZ_SIZE, Screen, operator_rviz
from smokebot_udp.codecs.display.view import COLOURS, FRESH, FROZEN
from smokebot_udp.srv import SetFocus

# Docks differ by some pixels with fonts and styles: regions are within them, or beyond.
STATUS, THERMAL, SCENE = (0, 60, 560, 212), (0, 225, 560, 645), (600, 70, 1260, 865)
AGE = (40, 590, 240, 640)
"""Where the age of the thermal image is written."""

GREEN, RED = COLOURS[FRESH][::-1], COLOURS[FROZEN][::-1]
OBSTACLE, FOOTPRINT, WALL, NO_DATA, WHITE = (255, 40, 40), (51, 255, 77), (0, 190, 255), (255, 26, 26), (255, 255, 255)
TILE = 2000
"""At least this much of a red tile is seen [pixel]."""

SECONDS = 60.0
"""For what has to be shown: rviz draws by software, beside other work."""


class Rviz(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('watch_rviz')
        cls.screen = Screen(RVIZ_SIZE)
        cls.addClassCleanup(cls.screen.close)
        cls.start_rviz()
        for service in ('set_focus', 'estop'):
            rospy.wait_for_service('/operator_receiver/' + service, 60)

    @classmethod
    def start_rviz(cls) -> None:
        """Start it as operator.launch does, but with few frames a second."""
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        rviz = subprocess.Popen(operator_rviz(pathlib.Path(folder.name)),
                                env={**os.environ, **cls.screen.environment}, start_new_session=True)
        cls.addClassCleanup(rviz.wait)
        cls.addClassCleanup(os.killpg, rviz.pid, signal.SIGTERM)

    def shows(self, condition: Callable[[], Any], what: str) -> None:
        """Wait until the screen shows something; otherwise keep it in a file."""
        try:
            wait_for(condition, SECONDS, what)
        except AssertionError:
            path = os.path.join(rospkg.get_log_dir(), self.id() + '.png')
            self.screen.save(path)
            print('the screen: %s' % path, file=sys.stderr)
            raise

    def live(self) -> bool:
        """Whether all is well: fresh images, the LiDAR and obstacles in 3D."""
        count = self.screen.count
        return (count(THERMAL, GREEN) > 2000 and count(STATUS, GREEN) > 300 and count(STATUS, RED) < TILE
                and count(SCENE, OBSTACLE) > 100 and count(SCENE, WALL, 60) > 100)

    def focus(self, name: str) -> None:
        answer = rospy.ServiceProxy('/operator_receiver/set_focus', SetFocus)(name)
        self.assertTrue(answer.success, answer.message)

    def stop(self, engaged: bool) -> None:
        wait_for(lambda: rospy.ServiceProxy('/operator_receiver/estop', SetBool)(engaged).success, what='the answer')

    @contextlib.contextmanager
    def cut(self) -> Iterator[None]:
        """The robot's side is silent meanwhile."""
        pid = pid_at(rosgraph.Master('/watch_rviz').lookupNode('/robot_sender'))
        self.assertTrue(pid)
        os.kill(pid, signal.SIGSTOP)
        try:
            yield
        finally:
            os.kill(pid, signal.SIGCONT)

    def test_live(self) -> None:
        self.shows(self.live, 'the live streams')
        self.shows(lambda: self.screen.count(SCENE, FOOTPRINT, 40) > 50, 'the footprint')
        self.shows(lambda: self.screen.count(AGE, GREEN) > 1000 and self.screen.count(AGE, WHITE, 80) > 30,
                   'the age, white on green')
        self.shows(lambda: not self.screen.count(SCENE, NO_DATA, 8), 'no NO DATA')

    def test_what_a_focus_switches_off_vanishes_and_comes_back(self) -> None:
        self.shows(self.live, 'the live streams')
        self.focus('standby')
        try:
            self.shows(lambda: not self.screen.count(SCENE, OBSTACLE) and not self.screen.count(SCENE, WALL, 60)
                       and self.screen.count(THERMAL, GREEN) > 2000, 'no cloud, no scan, a fresh image')
        finally:
            self.focus('default')
        self.shows(self.live, 'the live streams again')

    def test_the_emergency_stop_is_seen(self) -> None:
        self.shows(self.live, 'the live streams')
        self.stop(True)
        try:
            self.shows(lambda: self.screen.count(STATUS, RED) > TILE, 'a red tile')
        finally:
            self.stop(False)
        self.shows(self.live, 'the live streams again')

    def test_after_a_cut_nothing_looks_live(self) -> None:
        self.shows(self.live, 'the live streams')
        with self.cut():
            self.shows(lambda: self.screen.count(THERMAL, RED) > 2000 and not self.screen.count(THERMAL, GREEN),
                       'a red frame')
            self.shows(lambda: self.screen.count(STATUS, RED) > TILE, 'NO LINK')
            self.shows(lambda: self.screen.count(SCENE, NO_DATA, 10) > 100 and not self.screen.count(SCENE, WALL, 60),
                       'NO DATA in place of the cloud')
        self.shows(self.live, 'the live streams again')


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'rviz', Rviz)
