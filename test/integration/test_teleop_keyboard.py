#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""teleop_keyboard in a terminal: what it publishes, what it shows, and how it leaves the terminal."""
import contextlib
import os
import pathlib
import re
import select
import signal
import subprocess
import sys
import termios
import threading
import unittest
from typing import Any, List

import rospy
import rostest
from geometry_msgs.msg import Twist
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, SetBoolResponse, Trigger, TriggerResponse

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import is_sent_here, is_silent, undisturbed, wait_for

COLOURS_AND_MOVES = re.compile(r'\x1b\[[0-9]*[A-Za-z]|\r')


class Terminal:
    """A pseudo terminal with a program in it."""

    def __init__(self, *command: str) -> None:
        self._person, self._program = os.openpty()
        self.before = termios.tcgetattr(self._program)
        # its controlling terminal, so that Ctrl-C is a signal
        self.process = subprocess.Popen(['setsid', '-c', *command], stdin=self._program, stdout=self._program,
                                        stderr=self._program, env={**os.environ, 'ROS_NAMESPACE': '/desk',
                                                                   'TERM': 'vt100'})
        self._text = b''
        self._closed = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        while not self._closed.is_set():
            if select.select([self._person], [], [], 0.1)[0]:
                self._text += os.read(self._person, 4096)

    @property
    def shown(self) -> str:
        return COLOURS_AND_MOVES.sub('', self._text.decode())

    def forget(self) -> None:
        self._text = b''

    def type(self, keys: str) -> None:
        os.write(self._person, keys.encode())

    def mode(self) -> List[Any]:
        return termios.tcgetattr(self._program)

    def close(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            self.process.kill()
        self.process.wait(10)
        self._closed.set()
        self._reader.join()
        os.close(self._person)
        os.close(self._program)


class TeleopKeyboard(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('teleop_keyboard_test')
        cls.taken, cls.stops = [], []   # type: List[str], List[bool]
        rospy.Service('/desk/operator_receiver/take_control', Trigger,
                      lambda _: cls.taken.append('') or TriggerResponse(True, 'you drive'))
        rospy.Service('/desk/operator_receiver/estop', SetBool,
                      lambda asked: cls.stops.append(asked.data) or SetBoolResponse(True, 'released'))

    def setUp(self) -> None:
        del self.taken[:], self.stops[:]
        self.terminal = Terminal('rosrun', 'smokebot_udp', 'teleop_keyboard', '_repeat_rate:=20.0')
        self.addCleanup(self.terminal.close)
        self.shows('Ctrl-C: stop and quit')

    def shows(self, text: str) -> None:
        wait_for(lambda: text in self.terminal.shown, 20, "'%s' on the screen" % text)

    def listen(self) -> List[Any]:
        """The (x, turn) of each command, once the program is connected."""
        found: List[Any] = []
        subscriber = rospy.Subscriber('/desk/operator/cmd_vel', Twist,
                                      lambda message: found.append((message.linear.x, message.angular.z)))
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: is_sent_here(subscriber.resolved_name), what='the program')
        return found

    def ended(self) -> None:
        """It has ended well, and the terminal is as before."""
        self.assertEqual(self.terminal.process.wait(20), 0)
        self.assertEqual(self.terminal.mode(), self.terminal.before)

    @undisturbed()
    def test_it_drives_stops_and_is_silent(self) -> None:
        commands = self.listen()
        self.terminal.type('i')
        # how many there are depends on how often the machine lets the program run: test_keyboard counts them
        wait_for(lambda: commands.count((0.5, 0.0)) > 1, 10, 'commands')
        wait_for(lambda: commands.count((0.0, 0.0)) > 1, 10, 'stops')
        wait_for(lambda: 'standing' in self.terminal.shown, what='the state')
        wait_for(lambda: is_silent(commands), 10, 'silence')
        driven = commands.count((0.5, 0.0))
        self.assertEqual(commands, driven * [(0.5, 0.0)] + (len(commands) - driven) * [(0.0, 0.0)])
        self.terminal.type('qu')
        wait_for(lambda: (0.5 * 1.1, 1.1) in commands, 10, 'a faster command')

    def test_it_says_who_drives_and_that_nobody_listens(self) -> None:
        self.shows('NOBODY RECEIVES /desk/operator/cmd_vel')
        self.listen()
        self.shows('who drives is not known')
        state = rospy.Publisher('/desk/operator/control', String, queue_size=1, latch=True)
        self.addCleanup(state.unregister)
        state.publish('LOCKED: thermal is 2.3 s old\x1b[2J')
        self.shows('LOCKED: thermal is 2.3 s old?[2J')

    @undisturbed()
    def test_control_is_taken_and_the_emergency_stop_engaged_and_released(self) -> None:
        pressed: List[bool] = []
        subscriber = rospy.Subscriber('/desk/operator/estop', Bool, lambda message: pressed.append(message.data))
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: is_sent_here(subscriber.resolved_name), what='the program')
        self.terminal.type('s')
        wait_for(lambda: len(pressed) >= 3, 10, 'the emergency stop, repeated')
        self.assertEqual(set(pressed), {True})
        self.terminal.type('R')
        self.shows('estop: released')
        self.terminal.type('T')
        self.shows('take_control: you drive')
        self.assertEqual((self.stops[-1], len(self.taken)), (False, 1))
        self.terminal.type('G')
        self.shows('release_control: ')     # there is no such service here, and it says so
        self.terminal.type('\x1bOR')        # F3 releases nothing
        self.terminal.type('k')
        self.assertEqual((len(self.stops), set(pressed)), (1, {True}))

    def test_the_stop_key_counts_whatever_is_read_with_it(self) -> None:
        pressed: List[bool] = []
        subscriber = rospy.Subscriber('/desk/operator/estop', Bool, lambda message: pressed.append(message.data))
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: is_sent_here(subscriber.resolved_name), what='the program')
        for typed in ('s ', '\x1b[As', '\x1b[1;5Csi'):
            del pressed[:]
            self.terminal.type(typed)
            wait_for(lambda: pressed, 10, 'the emergency stop after %r' % typed)
            wait_for(lambda: is_silent(pressed), 10, 'silence')

    def test_the_stop_waits_for_somebody_who_receives_it(self) -> None:
        self.terminal.type('s')
        self.shows('NOBODY RECEIVES the emergency stop, /desk/operator/estop, yet')
        pressed: List[bool] = []
        subscriber = rospy.Subscriber('/desk/operator/estop', Bool, lambda message: pressed.append(message.data))
        self.addCleanup(subscriber.unregister)
        wait_for(lambda: pressed, 10, 'the emergency stop')

    @undisturbed()
    def test_ctrl_c_stops_the_robot_and_restores_the_terminal(self) -> None:
        commands = self.listen()
        self.terminal.type('i')
        wait_for(lambda: (0.5, 0.0) in commands, 10, 'a command')
        self.assertNotEqual(self.terminal.mode(), self.terminal.before)
        self.terminal.type('\x03')
        self.ended()
        wait_for(lambda: commands[-1] == (0.0, 0.0), 5, 'the stop')

    def test_other_ends_restore_the_terminal(self) -> None:
        self.terminal.process.send_signal(signal.SIGTERM)
        self.ended()

    def test_without_a_terminal_it_says_so(self) -> None:
        end = subprocess.run(['rosrun', 'smokebot_udp', 'teleop_keyboard'], stdin=subprocess.DEVNULL,
                             stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=60)
        self.assertEqual((end.returncode, end.stdout), (1, b'teleop_keyboard: this is not a terminal\n'))


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'teleop_keyboard', TeleopKeyboard)
