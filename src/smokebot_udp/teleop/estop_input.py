# SPDX-License-Identifier: BSD-3-Clause
"""What a topic of std_msgs/Bool asks of the emergency stop.

True engages it. False releases it only if the same publisher has sent True before: many joystick nodes publish the
state of a button all the time, and such a False must not release what somebody else has engaged.

A publisher that goes on repeating True while the stop is engaged asks for nothing new: otherwise the last repetition
would come to the robot after the release was made, and void it. A press after a pause always asks.
"""
import collections
from typing import Optional

from .records import Wish

MAX_PAUSE = 0.5
"""Of a publisher that repeats True while a button is held [s]."""

MAX_SOURCES = 16
"""Publishers that are remembered; of others the one that pressed first is forgotten, and cannot release."""


class EstopInput:
    """Reads the topic of all its publishers."""

    def __init__(self) -> None:
        self._pressed: collections.OrderedDict[str, float] = collections.OrderedDict()
        """{publisher: when its last True came}"""

    def update(self, source: str, pressed: bool, engaged: bool, now: float) -> Optional[Wish]:
        """Take a message; returns what it asks, if anything.

        :param source: name of the publishing node
        :param engaged: whether the stop is engaged already, as far as it is known
        :param now: by a steady clock [s]
        """
        if pressed:
            held = source in self._pressed and now - self._pressed[source] <= MAX_PAUSE
            self._pressed[source] = now
            if held and engaged:
                return None
            while len(self._pressed) > MAX_SOURCES:
                self._pressed.popitem(last=False)
            return Wish.ENGAGE_ESTOP
        if source not in self._pressed:
            return None
        del self._pressed[source]
        return Wish.RELEASE_ESTOP
