# SPDX-License-Identifier: BSD-3-Clause
"""The robot's steady clock as an operator knows it.

The robot judges the age of a command by its own clock alone, so the operator stamps commands with the robot's time. It
asks for that time over the link, with its own steady clock as the question, and gets the question back with the
answer. Steady clocks are neither set nor simulated, so the offset changes only when one of the nodes restarts or one
of the machines was suspended:

- A restarted robot has another session. What was known of the old one is forgotten, with the questions that are open:
  a late answer of the old session answers none of the new questions.
- A suspended machine's clock stands still. Commands look too old then, or as if they came from the future, and the
  robot refuses both. With the first answer that contradicts the known offset the time is unknown, until others prove
  the old or a new one.
"""
import collections
from typing import Counter, Deque, NamedTuple, Optional

from ..monitoring.clock_offset import ClockOffset
from .command_copy import MICROSECONDS
from .steady import STEP

MAX_QUESTIONS = 64
"""An answer to a question that precedes this many newer ones is refused. More than a second of them at 50 Hz, which
is as often as an operator asks while it engages the emergency stop."""


class RobotTime(NamedTuple):
    """A time of the robot's clock, as an operator estimates it."""
    robot: int
    """Session of the robot's node."""
    made: int
    """The time [us]."""
    uncertainty: int
    """Its maximum error [us]."""

    @property
    def earliest(self) -> float:
        """What it is at least [s]."""
        return (self.made - self.uncertainty) / MICROSECONDS


class RobotClock:
    """Estimates the robot's steady clock from its answers. All times `now` are the operator's steady clock [s]."""

    def __init__(self) -> None:
        self.session = 0
        """Session of the robot's node; 0: unknown."""
        self.refused: Counter[str] = collections.Counter()
        """Answers without effect, by reason: no session, unasked, and those of ClockOffset."""
        self._questions: Deque[int] = collections.deque(maxlen=MAX_QUESTIONS)
        self._offset = ClockOffset()
        self._came = 0.0        # the newest answer
        self._doubtful = False  # it contradicted the offset

    def ask(self, now: float) -> int:
        """A request is sent to the robot.

        :return: the question: ControlRequest.clock [us]
        """
        self._questions.append(int(MICROSECONDS * now))
        return self._questions[-1]

    def update(self, session: int, echo: int, held: int, clock: int, now: float) -> bool:
        """An answer was received: a ControlStatus with what it has for this operator. Nothing is raised.

        The robot repeats its answer until it hears a newer question. Each repetition is a measurement, since it says
        for how long the question was held.

        :param session: ControlStatus.session
        :param echo: ControlPeer.echo [us]
        :param held: ControlPeer.held [us]
        :param clock: ControlStatus.clock [us]
        :return: whether the answer is used
        """
        if not session or echo not in self._questions:
            self.refused['unasked' if session else 'no session'] += 1
            return False
        if session != self.session:
            self.session, self._offset = session, ClockOffset()
            self._offset.refused = self.refused
            self._questions.clear()
        contradictions = self.refused['contradiction']
        used = self._offset.add(echo / MICROSECONDS, (clock - held) / MICROSECONDS, clock / MICROSECONDS, now, now)
        if used or self.refused['contradiction'] > contradictions:
            self._came, self._doubtful = now, not used
        return used

    def robot_time(self, now: float) -> Optional[RobotTime]:
        """The robot's time; None while it is unknown."""
        estimate = self._offset.estimate(self._came if self._came - STEP < now < self._came else now)
        if estimate is None or self._doubtful:
            return None
        return RobotTime(self.session, int(MICROSECONDS * (now + estimate.offset)),
                         int(MICROSECONDS * estimate.uncertainty))
