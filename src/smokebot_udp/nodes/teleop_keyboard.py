# SPDX-License-Identifier: BSD-3-Clause
"""Drives the robot by the keys of a terminal, as teleop_twist_keyboard does, and shows whether it may.

Parameters: TELEOP_KEYBOARD in nodes/parameters.py. Publishes operator/cmd_vel (Twist) and operator/estop (Bool);
subscribes operator/control (String), which operator_receiver publishes; calls the services of operator_receiver. All
are in the node's namespace: that of the operator.
"""
import argparse
import math
import os
import select
import sys
import threading
import time
from typing import Any, Callable, Dict, List

import rospy
from geometry_msgs.msg import Twist, Vector3
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger

from .. import udpros
from ..monitoring.status import printable
from ..teleop.keyboard import MOVES, STOP, KeyAction, Keyboard, StopKey, Velocity
from ..teleop.keyboard_screen import HELP, status_lines
from ..teleop.keys import Keys
from ..teleop.stall import Stall
from .common import Parameters
from .parameters import TELEOP_KEYBOARD
from .terminal import fail, is_terminal, master_answers, run_node, single_keys

USUAL_WIDTH = 80
"""Width of a terminal that does not report its own [characters]."""

REFRESH_PERIOD = 0.25
"""Maximum interval between two updates of the screen [s]."""

LAST_COMMAND = 0.1
"""Time that the last stop has to leave when the program ends [s]."""

NOTE_DURATION = 10.0
"""Duration for which the last event is shown [s]."""

READ_SIZE = 1024
"""Maximum number of bytes of typed keys that are read at once."""


def twist(velocity: Velocity) -> Any:
    """The geometry_msgs/Twist."""
    x, y, z, turn = velocity
    return Twist(Vector3(x, y, z), Vector3(0.0, 0.0, turn))


class Services:
    """Calls operator_receiver's services, each in a thread: the keys must work meanwhile.

    :param say: f(text), what came of a call; any thread
    """

    NAMES = {KeyAction.TAKE_CONTROL: ('take_control', Trigger, ()),
             KeyAction.RELEASE_CONTROL: ('release_control', Trigger, ()),
             KeyAction.RELEASE_EMERGENCY_STOP: ('estop', SetBool, (False,))}

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._running: Dict[str, threading.Thread] = {}

    def call(self, action: KeyAction) -> None:
        """Call the service that does this, unless it is being called: once more later would count as meant later."""
        name, type_, arguments = self.NAMES[action]
        if name in self._running and self._running[name].is_alive():
            self._say('%s: the last one is not answered yet' % name)
            return
        self._say('%s ...' % name)
        self._running[name] = threading.Thread(target=self._call, args=(name, type_, arguments), daemon=True)
        self._running[name].start()

    def _call(self, name: str, type_: Any, arguments: Any) -> None:
        try:
            answer = rospy.ServiceProxy('operator_receiver/' + name, type_)(*arguments)
            self._say(said(name, answer))
        except (rospy.ServiceException, rospy.ROSException) as error:
            self._say('%s: %s' % (name, error))


def said(name: str, answer: Any) -> str:
    """What a service answered, in words.

    :param answer: response with `success` and `message`
    """
    return '%s: %s' % (name, answer.message or ('done' if answer.success else 'refused'))


class TeleopKeyboard:
    """Reads keys, publishes commands, and draws.

    :param terminal: file descriptor of its keys
    """

    def __init__(self, terminal: int) -> None:
        parameters = Parameters(TELEOP_KEYBOARD)
        self._terminal = terminal
        self._keyboard = Keyboard(parameters['speed'], parameters['turn'], parameters['key_timeout'],
                                  1.0 / parameters['repeat_rate'])
        self._control = ''
        self._note, self._noted = '', -math.inf     # the last event, when [s]
        self._shown: List[str] = []
        self._keys, self._stop_key, self._stall = Keys(), StopKey(), Stall()
        self._services = Services(self._say)
        with udpros.registered_together():
            self._commands = rospy.Publisher('operator/cmd_vel', Twist, queue_size=1, tcp_nodelay=True)
            self._estop = rospy.Publisher('operator/estop', Bool, queue_size=5, tcp_nodelay=True)
            self._states = rospy.Subscriber('operator/control', String, self._take_state, queue_size=5)

    def run(self) -> None:
        """Drive until the terminal is closed or the node shuts down."""
        print(HELP.format(topic=self._commands.resolved_name))
        while not rospy.is_shutdown():
            now = time.monotonic()
            self._stall.look(now)
            self._stop_all(now)
            command = self._keyboard.poll(now)
            if command is not None:
                self._commands.publish(twist(command))
            self._draw()
            due = min(self._stop_key.deadline(), self._keyboard.deadline() or math.inf)
            wait = min(REFRESH_PERIOD, max(0.0, due - now))
            if select.select([self._terminal], [], [], wait)[0] and not self._read():
                return

    def close(self) -> None:
        """Stop the robot."""
        if self._keyboard.poll(time.monotonic()) is not None or self._keyboard.motion != STOP:
            self._commands.publish(twist(STOP))
            time.sleep(LAST_COMMAND)
        print('\n' * len(self._shown), end='')

    def _read(self) -> bool:
        """Take what was typed; returns whether the terminal is open."""
        try:
            typed = os.read(self._terminal, READ_SIZE)
        except OSError:     # it was closed
            return False
        now = time.monotonic()
        waited = bool(self._stall.look(now))
        for key in self._keys.take(typed.decode(errors='replace'), now):
            action = self._keyboard.press(' ' if waited and key in MOVES else key, now)
            if action is KeyAction.EMERGENCY_STOP:
                self._stop_key.press(now)
                self._stop_all(now)
            elif action is not None and not waited:   # what was asked while this program stood still is no longer meant
                if action is KeyAction.RELEASE_EMERGENCY_STOP:
                    self._stop_key.release()
                self._services.call(action)
        return bool(typed)

    def _stop_all(self, now: float) -> None:
        """Engage the emergency stop if it was pressed."""
        receivers = self._estop.get_num_connections()
        if self._stop_key.poll(bool(receivers), now):
            self._estop.publish(True)
            self._commands.publish(twist(STOP))
            self._say('emergency stop' if receivers else
                      'NOBODY RECEIVES the emergency stop, %s, yet' % self._estop.resolved_name)

    def _take_state(self, state: Any) -> None:
        self._control = printable(state.data)

    def _say(self, text: str) -> None:
        self._note, self._noted = printable(text), time.monotonic()

    def _draw(self) -> None:
        """Write the lines again that differ from those on the screen; the cursor stays before the first."""
        control = self._control if self._states.get_num_connections() else ''
        note = self._note if time.monotonic() - self._noted < NOTE_DURATION else ''
        lines = status_lines(self._keyboard, self._commands.resolved_name, self._commands.get_num_connections(),
                             control, note, os.get_terminal_size(sys.stdout.fileno()).columns or USUAL_WIDTH)
        if lines != self._shown:
            self._shown = lines
            text = '\n'.join('\r\x1b[K' + line for line in lines)
            sys.stdout.write('%s\x1b[%dA\r' % (text, len(lines) - 1))
            sys.stdout.flush()


def run() -> int:
    """Drive; returns the exit code."""
    if not is_terminal():
        return fail('teleop_keyboard', 'this is not a terminal')
    if not master_answers():
        return fail('teleop_keyboard', 'no ROS master answers')
    rospy.init_node('teleop_keyboard', disable_signals=True, log_level=rospy.FATAL)
    teleop = TeleopKeyboard(sys.stdin.fileno())
    try:
        with single_keys(sys.stdin.fileno()):
            teleop.run()
    finally:
        teleop.close()
    return 0


def main() -> None:
    argparse.ArgumentParser(prog='teleop_keyboard', description='Drive the robot by the keys of this terminal.',
                            epilog='_speed:=0.3 and other parameters: doc/parameters.md.'
                            ).parse_args(rospy.myargv(sys.argv)[1:])
    udpros.race_all_connections()
    run_node(run)
