# SPDX-License-Identifier: BSD-3-Clause
"""What a person who drives by the keyboard reads in the terminal."""
from typing import List

from .keyboard import STOP, Keyboard

HELP = """\
Drives the robot: {topic}
---------------------------------------------------------
Moving around:            Holonomic (with shift):
   u    i    o               U    I    O
   j    k    l               J    K    L
   m    ,    .               M    <    >
t/b : up/down             any other key, such as k or space: stop

q/z : both speeds +/- 10 %     w/x : linear speed     e/c : turn rate

s : EMERGENCY STOP        R : release the emergency stop
T : take control          G : give control back
Ctrl-C: stop and quit
---------------------------------------------------------"""
"""Printed once; {topic} is that of the commands."""

NOBODY = 'NOBODY RECEIVES {topic}: is operator_receiver running in this namespace?'


def status_lines(keyboard: Keyboard, topic: str, receivers: int, control: str, note: str, width: int) -> List[str]:
    """Three lines that change: motion, control, note.

    :param topic: of the commands
    :param receivers: number of its subscribers
    :param control: what operator_receiver says of who drives; empty: it says nothing
    :param note: the last thing that happened
    :param width: of the terminal [characters]
    """
    motion = keyboard.motion
    moving = 'standing' if motion == STOP else 'x %+.2f  y %+.2f  z %+.2f  turn %+.2f' % motion
    speeds = 'speed %.2f m/s  turn %.2f rad/s | %s' % (keyboard.speed, keyboard.turn, moving)
    state = control or 'who drives is not known: operator_receiver does not say'
    state = state if receivers else NOBODY.format(topic=topic)
    return [line[:max(0, width - 1)] for line in (speeds, state, note)]
