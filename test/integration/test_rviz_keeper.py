#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""rviz_keeper with another roscpp node, a relay, in the place of rviz: a restarted master, a crash, a normal end."""
import contextlib
import os
import pathlib
import signal
import subprocess
import sys
import time
import unittest
from typing import Any, List

import psutil
import rospy
import rostest
from std_msgs.msg import Header

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from test_udpros_master import OwnMaster
from waiting import give_time, pid_at, undisturbed, wait_for

from smokebot_udp import udpros

TALKER = str(pathlib.Path(__file__).resolve().parent / 'udpros_talker.py')
NODE = '/desk/operator_rviz'
RELAYED = {('sub', '/desk/in'), ('pub', '/desk/out')}
CODE = '''
from smokebot_udp.nodes import rviz_keeper
rviz_keeper.find_rviz = lambda: 'rosrun'
rviz_keeper.main()
'''


class RvizKeeper(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        cls.master = OwnMaster()
        cls.addClassCleanup(cls.master.end)
        os.environ['ROS_MASTER_URI'] = cls.master.uri
        rospy.init_node('rviz_keeper_test')
        cls.addClassCleanup(rospy.signal_shutdown, 'the tests have ended')
        cls.times: List[float] = []
        udpros.Subscriber('/desk/out', Header, lambda _: cls.times.append(time.monotonic()))    # registers again

    def start(self, *command: str) -> Any:
        process = subprocess.Popen(command, env={**os.environ, 'ROS_NAMESPACE': '/desk'}, start_new_session=True)
        self.addCleanup(process.wait, 10)
        self.addCleanup(self.kill, process.pid)
        return process

    @staticmethod
    def kill(group: int) -> None:
        """Kill a process with its children, as roslaunch does."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(group, signal.SIGKILL)

    def talk(self) -> Any:
        return self.start(sys.executable, TALKER, 'in')

    def keep(self) -> Any:
        keeper = self.start(sys.executable, '-c', CODE, 'topic_tools', 'relay', 'in', 'out')
        wait_for(lambda: self.relays(keeper), 20, 'the relay')
        return keeper

    @staticmethod
    def relays(keeper: Any) -> List[Any]:
        """The processes that it runs."""
        found = []
        for child in psutil.Process(keeper.pid).children():
            with contextlib.suppress(psutil.NoSuchProcess):     # it has just ended
                if 'relay' in child.name():
                    found.append(child.pid)
        return found

    def relayed(self, seconds: float) -> None:
        """Messages cross the relay."""
        now = time.monotonic()
        wait_for(lambda: self.times and self.times[-1] > now, seconds, 'a message')

    @undisturbed()
    def test_a_restarted_master_knows_it_and_later_publishers(self) -> None:
        talker, keeper = self.talk(), self.keep()
        self.relayed(20)
        before = self.relays(keeper)
        give_time(3)        # the keeper has found it: it looks every second, and does not say so
        for _ in range(2):
            self.master.restart()
            wait_for(lambda: self.master.registered(NODE) >= RELAYED, 10, 'its topics')
            talker.kill()
            talker = self.talk()
            self.relayed(15)
        self.assertEqual(self.relays(keeper), before)
        keeper.send_signal(signal.SIGINT)
        keeper.wait(10)
        self.assertFalse([pid for pid in before if psutil.pid_exists(pid)])

    def test_it_is_started_again_after_a_crash_but_not_after_a_normal_end(self) -> None:
        keeper = self.keep()
        first, = self.relays(keeper)
        os.kill(first, signal.SIGSEGV)
        second, = wait_for(lambda: set(self.relays(keeper)) - {first}, what='the next one')
        wait_for(lambda: pid_at(self.master.call('lookupNode', NODE)) == second, what='its registration')
        os.kill(second, signal.SIGINT)      # it ends with 0, as rviz does when its window is closed
        self.assertEqual(keeper.wait(10), 0)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'rviz_keeper', RvizKeeper)
