# SPDX-License-Identifier: BSD-3-Clause
"""Driving from browsers: the command to send, who of them may give it, and when it ends.

A touch repeats its command while it lasts; a command holds for HOLD. Then, or where the touch is released or the
browser is gone, the robot is told to stop for STOP_DURATION, and nothing more is sent, so that others can drive
(teleop/keyboard.py does the same with keys).
"""
import math
from typing import Callable, Dict, Hashable, Optional

from ..teleop.keyboard import PERIOD, STOP, STOP_DURATION, Velocity

HOLD = 0.25
"""After a command, without another [s]."""

LEAST_PERIOD = 0.04
"""From one command to the next, where a browser sends them faster [s]."""

LATEST = 0.4
"""A command is refused that was given by what the browser saw longer ago [s]."""

IDLE = 3.0
"""Who has not driven for this long lets another browser drive that gives a command [s]."""


class DeadMan:
    """Decides for one robot; times are by a steady clock [s]."""

    def __init__(self) -> None:
        self._holder: Optional[Hashable] = None
        self._held = -math.inf      # when the holder drove last, or took control
        self._motion, self._owes_stop = STOP, False
        self._until = self._silent_from = self._sent = -math.inf
        self._due = math.inf

    def may_drive(self, browser: Hashable, now: float) -> bool:
        """Whether a command of a browser is taken now."""
        return self._holder in (None, browser) or now >= self._held + IDLE

    def holder(self, now: float) -> Optional[Hashable]:
        """The browser that may drive; None: any may."""
        return self._holder if now < self._held + IDLE else None

    def take(self, browser: Hashable, now: float) -> None:
        """A browser takes over from another one: the robot stops first."""
        if self._holder != browser:
            self._end(now)
        self._holder, self._held = browser, now

    def drive(self, browser: Hashable, motion: Velocity, now: float) -> bool:
        """Take a command; returns whether it counts."""
        if not self.may_drive(browser, now):
            return False
        self.take(browser, now)
        self._motion, self._until = motion, now + HOLD
        self._due = min(self._due, now) if self._owes_stop else max(now, self._sent + LEAST_PERIOD)
        return True

    def halt(self, browser: Hashable, now: float) -> None:
        """The touch was released: a neutral command is sent, also where the stick was at rest before."""
        if browser == self.holder(now):
            self._stop(now)

    def gone(self, browser: Hashable, now: float) -> None:
        """The browser is not there any more, or gave control back."""
        if browser == self._holder:
            self._end(now)
            self._holder = None

    def poll(self, now: float) -> Optional[Velocity]:
        """The command to send now, if one is due."""
        if self._until <= now:
            self._end(now)
        if now < self._due:
            return None
        active = now < self._until or now < self._silent_from
        self._sent = now
        if self._owes_stop:     # also where the next command came meanwhile
            self._owes_stop, self._due = False, now + LEAST_PERIOD
            return STOP
        self._due = now + PERIOD if active else math.inf
        return self._motion if active else None

    def deadline(self) -> float:
        """When `poll` has something to do next [s]; infinity: not before a command."""
        return min(self._due, self._until if self._motion != STOP else math.inf)

    def _end(self, now: float) -> None:
        """Stop, if the robot was told to move."""
        if self._motion != STOP:
            self._stop(now)

    def _stop(self, now: float) -> None:
        self._motion, self._until, self._due, self._silent_from = STOP, -math.inf, now, now + STOP_DURATION
        self._owes_stop = True


class Rest:
    """Who let go of the stick since the last emergency stop: its release must not move the robot (ISO 13850).

    The interlock of operator_receiver asks for a neutral command, too. But where a network stalls, the command that
    ends by HOLD is neutral as well, while the touch still lasts.
    """

    def __init__(self) -> None:
        self._rested: Dict[Hashable, int] = {}

    def may_move(self, browser: Hashable, stops: int) -> bool:
        """Whether a command of a browser may move the robot.

        :param stops: how many emergency stops there were
        """
        return not stops or self._rested.get(browser) == stops

    def rest(self, browser: Hashable, stops: int) -> None:
        """A browser let go of the stick, or gave a neutral command; no emergency stop is engaged."""
        if stops:
            self._rested[browser] = stops

    def gone(self, browser: Hashable) -> None:
        """A browser is not there any more."""
        self._rested.pop(browser, None)


class Ticks:
    """Numbers that browsers get regularly and return with commands: how old is what a command was given by."""

    def __init__(self, kept: int = 32) -> None:
        self.number = 0
        """The newest."""
        self._times = [-math.inf] * kept

    def next(self, now: float) -> int:
        """The next number."""
        self.number += 1
        self._times[self.number % len(self._times)] = now
        return self.number

    def age(self, number: int, now: float) -> float:
        """How long ago a number was given [s]; infinite: too long ago, or never."""
        if not self.number - len(self._times) < number <= self.number:
            return math.inf
        return now - self._times[number % len(self._times)]


Scale = Callable[[float, float, float], Velocity]


def scale_of(speed: float, turn: float, strafe: float) -> Scale:
    """f(x, y, turn), ratios -1..1 -> Velocity; the maximum speeds are m/s and rad/s."""
    return lambda x, y, angular: Velocity(x * speed, y * strafe, 0.0, angular * turn)
