# SPDX-License-Identifier: BSD-3-Clause
"""What a topic of std_msgs/Bool asks of the emergency stop: True engages it, and False does nothing.

Many joystick nodes publish the state of a button all the time. To let go of it is no decision to go on, so a False
releases nothing: a release is an act of its own, a call of the service.

A publisher that repeats True holds the button, or presses it again: each is a press, as somebody may have released the
stop in between, unheard. So the stop stays in force for as long as the button is held.
"""
import math

from ..newest import Newest

MIN_INTERVAL = 0.1
"""No person presses a button twice within this time, but a node may publish it at any rate [s]."""

MAX_SOURCES = 16
"""Publishers that are remembered."""


class EstopInput:
    """Reads the topic of all its publishers."""

    def __init__(self) -> None:
        self._pressed: Newest[str, float] = Newest(MAX_SOURCES)
        """{publisher: when its last press began, while it publishes True}"""

    def is_press(self, source: str, pressed: bool, now: float) -> bool:
        """Take a message; returns whether the stop is to be engaged, or once more.

        :param source: name of the publishing node
        :param now: by a steady clock [s]
        """
        if not pressed:
            self._pressed.pop(source, None)
            return False
        if now - self._pressed.get(source, -math.inf) < MIN_INTERVAL:
            return False
        self._pressed[source] = now
        return True
