# SPDX-License-Identifier: BSD-3-Clause
"""When the robot publishes what a command stream gives on a timeout, such as zero speed. Decided on the robot.

=========  ==============================  =====================================================
state      published                       ends
=========  ==============================  =====================================================
IDLE       nothing: others may publish     with a command: DRIVING
DRIVING    commands, as they come          `timeout` after the newest one was made: STOPPING
STOPPING   on_timeout at `rate`            after `hold`: IDLE; with a command: DRIVING
ESTOP      on_timeout at `rate`            with the release of the emergency stop: IDLE
=========  ==============================  =====================================================

The timeout runs from when the command was made, so that the way of a slow link is no excuse, but for half of it at
least from when the command took effect: otherwise a command that is older than the timeout would never do. A clock
that steps back ends DRIVING at once: nobody knows for how long it would have lasted.
"""
import enum
from typing import Optional

from .steady import STEP


class State(enum.Enum):
    """State of a command stream. The value is its name in diagnostics."""
    IDLE = 'idle'
    DRIVING = 'driving'
    STOPPING = 'stopping'
    ESTOP = 'emergency stop'


class CommandTimeout:
    """Decides when on_timeout is published. All times `now` are the robot's steady clock [s].

    The parameters may be changed at any time and have effect at once.

    :param timeout: of a command [s]
    :param rate: at which on_timeout is published [Hz]
    :param hold: for how long it is published [s]; at least once
    """

    def __init__(self, timeout: float, rate: float, hold: float) -> None:
        self.timeout, self.rate, self.hold = timeout, rate, hold
        self.state = State.IDLE
        self.timeouts = 0
        """How often DRIVING ended without a newer command."""
        self._made = self._took_effect = 0.0    # of the newest command
        self._since = 0.0                       # of STOPPING
        self._published: Optional[float] = None     # on_timeout, in this STOPPING or ESTOP
        self._latest = 0.0

    def accepted(self, now: float, age: float) -> None:
        """A command took effect and is published. In ESTOP, none does.

        :param age: of the command [s]
        """
        self._notice(now)
        if self.state is not State.ESTOP:
            self.state, self._took_effect, self._made = State.DRIVING, now, now - max(0.0, age)

    def interrupt(self, now: float) -> None:
        """Its driver is replaced or gone, or the stream is switched off: stop if DRIVING, without waiting."""
        self._notice(now)
        if self.state is State.DRIVING:
            self._stop(State.STOPPING, now)

    def set_estop(self, engaged: bool, now: float) -> None:
        """The emergency stop is engaged, or released; may be repeated."""
        self._notice(now)
        if engaged and self.state is not State.ESTOP:
            self._stop(State.ESTOP, now)
        elif not engaged and self.state is State.ESTOP:
            self.state = State.IDLE

    def poll(self, now: float) -> bool:
        """Whether to publish on_timeout now."""
        self._notice(now)
        if self.state is State.DRIVING and now >= self._ends():
            self.timeouts += 1
            self._stop(State.STOPPING, now)
        if self.state not in (State.STOPPING, State.ESTOP) or now < self._due():
            return False
        self._published = now
        if self.state is State.STOPPING and self._due() > self._since + self.hold:
            self.state = State.IDLE
        return True

    def deadline(self) -> Optional[float]:
        """When to call `poll` [s]; None: not before the next command."""
        if self.state is State.IDLE:
            return None
        return self._ends() if self.state is State.DRIVING else self._due()

    def _ends(self) -> float:
        """When DRIVING ends without another command [s]."""
        return max(self._made + self.timeout, self._took_effect + self.timeout / 2)

    def _due(self) -> float:
        """When on_timeout is published next in STOPPING and ESTOP [s]."""
        return self._since if self._published is None else self._published + 1 / self.rate

    def _stop(self, state: State, now: float) -> None:
        self.state, self._since, self._published = state, now, None

    def _notice(self, now: float) -> None:
        """Treat a clock that steps back."""
        if now < self._latest - STEP:
            self._latest = now
            self._since = min(self._since, now)
            self._published = None      # the next one is due at once
            if self.state is State.DRIVING:
                self.timeouts += 1
                self._stop(State.STOPPING, now)
        self._latest = max(self._latest, now)
