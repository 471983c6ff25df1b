# SPDX-License-Identifier: BSD-3-Clause
"""The emergency stop: a convenience, not a certified safety function.

It errs towards the stop. To engage it needs no clock, no place among the operators and no right to drive. A release has
to be made on purpose, by an operator that is present, after the stop was engaged last, and has to come within MAX_AGE
(requests.py). One release by anybody ends the stop for all: whoever engages it after that engages it again.

A latch that is made anew, as the robot's node is restarted, is not engaged: its runner has to keep that. The operators
that engaged the stop engage it again, then.

A topic of std_msgs/Bool engages it by True, and False does nothing. Many joystick nodes publish the state of a button
all the time. To let go of it is no decision to go on, so a False releases nothing: a release is an act of its own, a
call of the service. A publisher that repeats True holds the button, or presses it again: each is a press, as somebody
may have released the stop in between, unheard. So the stop stays in force for as long as the button is held.
"""
import math
from typing import Optional

from ..newest import Newest
from .records import Status, Wish
from .requests import RequestClient, untimely

MIN_PRESS_INTERVAL = 0.1
"""No person presses a button twice within this time, but a node may publish it at any rate [s]."""

MAX_SOURCES = 16
"""Publishers that are remembered."""


class EstopLatch:
    """The robot's half. Times are by the robot's steady clock [s]."""

    def __init__(self) -> None:
        self.engaged = False
        self.by = ''
        """Who engaged it last."""
        self.releases = 0
        """How often it was released."""
        self._since = 0.0

    def engage(self, by: str, now: float) -> None:
        """Engage it, or engage it once more."""
        self.engaged, self.by, self._since = True, by, now

    def release(self, made: float, now: float) -> Optional[str]:
        """An operator releases it; returns None, or why it stays engaged.

        :param made: when the release was asked
        """
        reason = untimely(made, now)
        if reason is None and self.engaged and made <= self._since:
            reason = '%s engaged it after that' % self.by
        if reason is None:
            self._end()
        return reason

    def set_locally(self, engaged: bool, by: str, now: float) -> None:
        """A person at the robot engages or releases it."""
        if engaged:
            self.engage(by, now)
        else:
            self._end()

    def _end(self) -> None:
        self.releases += self.engaged
        self.engaged = False


class EstopClient:
    """The operator's half: engages it again at a robot that was restarted, until somebody has released it on purpose.

    An operator's node that was restarted itself knows from the robot what it engaged before.

    :param requests: by which it asks the robot
    """

    def __init__(self, requests: RequestClient) -> None:
        self.wanted = False
        """Whether this operator has engaged it and nobody has released it since."""
        self._requests = requests
        self._held_by = 0       # session of the robot's node that has the stop of this operator; 0: none has

    def engage(self, now: float) -> int:
        """Engage it, or once more; returns the request's id."""
        self.wanted, self._held_by = True, 0
        return self._requests.ask(Wish.ENGAGE_ESTOP, 0, 0.0, now)

    def answered(self, wish: Wish, refusal: str, robot: int) -> None:
        """The robot has answered a request."""
        if wish == Wish.ENGAGE_ESTOP:
            self._held_by = robot
        elif wish == Wish.RELEASE_ESTOP and not refusal:
            self.wanted = False

    def heard(self, status: Status, name: str, now: float) -> None:
        """The robot's newest status came; an answer in it was given to `answered` before.

        :param name: this operator's name as the robot knows it; empty: it does not know it
        """
        if not self.wanted:
            if status.estop and name and status.estop_by == name:
                self.wanted, self._held_by = True, status.session
        elif self._held_by == status.session:
            self.wanted = status.estop      # somebody else has released it, otherwise
        elif not self._engaging():
            self.engage(now)

    def _engaging(self) -> bool:
        pending = self._requests.pending
        return pending is not None and pending.wish == Wish.ENGAGE_ESTOP


class EstopInput:
    """Reads the topic of std_msgs/Bool of all its publishers."""

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
        if now - self._pressed.get(source, -math.inf) < MIN_PRESS_INTERVAL:
            return False
        self._pressed[source] = now
        return True
