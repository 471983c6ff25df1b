#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The nodes' private parameters when the master is restarted: on a master of this test's own, with the launch files."""
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import unittest
from typing import Any

import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from test_udpros_master import OwnMaster
from waiting import pid_at, wait_for

STREAMS = '''
streams:
  front: {type: scan, robot_topic: /front, operator_topic: /operator/front}
'''
PROFILES = 'profiles: {slow: {streams: {front: {rate: 2.0}}}}'
ROBOT, OPERATOR = '/robot_sender', '/desk2/operator_receiver'

START = 60.0
"""For nodes to start on a busy machine [s]."""


class PrivateParameters(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        cls.master = OwnMaster()
        cls.addClassCleanup(cls.master.end)
        os.environ['ROS_MASTER_URI'] = cls.master.uri
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.streams, cls.profiles = (pathlib.Path(folder.name) / name for name in (
            "Bob's own streams.yaml", 'my focus.yaml'))
        cls.streams.write_text(STREAMS)
        cls.profiles.write_text(PROFILES)
        # one after the other: each roslaunch sets /run_id where there is none
        cls.launch('robot.launch', 'streams:=%s' % cls.streams, 'focus_config:=%s' % cls.profiles, 'max_rate:=7')
        wait_for(lambda: cls.pid(ROBOT), START, 'the robot')
        cls.launch('operator.launch', 'streams:=%s' % cls.streams, 'name:=desk2', 'rviz:=false')
        wait_for(lambda: cls.pid(OPERATOR), START, 'the operator')

    @classmethod
    def launch(cls, *arguments: str) -> None:
        process = subprocess.Popen(['roslaunch', 'smokebot_udp', *arguments])
        cls.addClassCleanup(process.wait, 60)
        cls.addClassCleanup(process.send_signal, signal.SIGINT)

    @classmethod
    def pid(cls, node: str) -> int:
        """0: it is not registered, or does not answer."""
        return pid_at(cls.master.call('lookupNode', node) or '')

    def parameter(self, name: str) -> Any:
        """None: there is none."""
        return self.master.call('getParam', name) if self.master.call('hasParam', name) else None

    def dynamic_reconfigure(self, part: str, name: str, value: str) -> None:
        subprocess.run(['rosrun', 'dynamic_reconfigure', 'dynparam', 'set', part, name, value], check=True,
                       stdout=subprocess.DEVNULL, timeout=60)

    def check_streams(self) -> None:
        """The nodes have the streams of their file, and no others."""
        for node, kind in ((ROBOT, 'pub'), (OPERATOR, 'sub')):
            wait_for(lambda one=(kind, '/smokebot_udp/front/segments'), node=node: one in self.master.registered(node),
                     15, 'the stream of ' + node)
            self.assertNotIn((kind, '/smokebot_udp/thermal/segments'), self.master.registered(node))
            wait_for(lambda node=node: self.parameter(node + '/streams_file') == str(self.streams), 10,
                     'streams_file of ' + node)
        self.assertEqual(self.parameter(ROBOT + '/focus_file'), str(self.profiles))
        self.assertEqual(self.parameter(ROBOT + '/max_rate'), 7)

    def test_living_nodes_write_their_parameters_to_a_new_master(self) -> None:
        self.check_streams()
        self.master.call('setParam', ROBOT + '/focus', 'slow')
        wait_for(lambda: self.parameter(ROBOT + '/front/rate') == 2.0, 10, 'the profile')
        self.master.call('setParam', OPERATOR + '/front/max_wait', 0.07)
        self.dynamic_reconfigure(OPERATOR + '/front', 'max_wait', '0.08')
        before = {node: self.parameter(node) for node in (ROBOT, OPERATOR)}
        pids = [self.pid(node) for node in before]
        for _ in range(2):
            self.master.restart()
            for node, values in before.items():
                wait_for(lambda node=node, values=values: self.parameter(node) == values, 10,
                         'the parameters of ' + node)
            self.check_streams()
        # and both ways to change them go on working
        self.dynamic_reconfigure(OPERATOR + '/front', 'max_wait', '0.09')
        wait_for(lambda: self.parameter(OPERATOR + '/front/max_wait') == 0.09, 10, 'the setting')
        self.master.call('setParam', ROBOT + '/front/rate', -1.0)
        wait_for(lambda: self.parameter(ROBOT + '/front/rate') == 2.0, 10, 'the end of an invalid value')
        self.dynamic_reconfigure(ROBOT, 'focus', 'default')
        wait_for(lambda: self.parameter(ROBOT + '/front/rate') == 10.0, 10, 'the profile')
        self.assertEqual([self.pid(node) for node in before], pids)

    def test_respawned_nodes_have_those_of_their_launch_file(self) -> None:
        self.check_streams()
        pids = {node: wait_for(lambda node=node: self.pid(node), what=node) for node in (ROBOT, OPERATOR)}
        for pid in pids.values():
            os.kill(pid, signal.SIGKILL)
        self.master.restart()
        for node, pid in pids.items():
            wait_for(lambda node=node, pid=pid: self.pid(node) not in (0, pid), START, 'the respawned ' + node)
        self.check_streams()


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'private_parameters', PrivateParameters)
