# SPDX-License-Identifier: BSD-3-Clause
"""Driving by the keys of a terminal: those of teleop_twist_keyboard, and what they mean over time.

A terminal does not say when a key is released. A key that is held repeats, after a while and then often: a motion
therefore lasts for KEY_TIMEOUT after the first press, which spans the time to the first repetition, and for the shorter
REPEAT_TIMEOUT after each repetition. Then the robot is told to stop for STOP_DURATION, and nothing more is sent, so
that others can drive.
"""
import enum
import math
from typing import Dict, NamedTuple, Optional

KEY_TIMEOUT = 0.7
"""From the first press of a key on; terminals repeat a key that is held after 0.25 to 0.66 s [s]."""

REPEAT_TIMEOUT = 0.25
"""From a repetition on; terminals repeat at 10 to 30 Hz [s]."""

STOP_DURATION = 0.5
"""[s]"""

PERIOD = 0.1
"""From one command to the next [s]."""

STEP_UP, STEP_DOWN = 1.1, 0.9
"""Factors of the keys that change the speeds."""

MIN_SPEED, MAX_SPEED = 0.01, 10.0
"""Limits of both speeds [m/s or rad/s]."""


class Velocity(NamedTuple):
    """A geometry_msgs/Twist without its other turns."""
    x: float
    """Forward [m/s]."""
    y: float
    """To the left [m/s]."""
    z: float
    """Up [m/s]."""
    turn: float
    """To the left [rad/s]."""


class KeyAction(enum.Enum):
    """What a key asks for besides a motion."""
    EMERGENCY_STOP = 's'
    RELEASE_EMERGENCY_STOP = 'R'
    TAKE_CONTROL = 'T'
    RELEASE_CONTROL = 'G'


MOVES: Dict[str, Velocity] = {key: Velocity(*factors) for key, factors in {
    'i': (1, 0, 0, 0), 'o': (1, 0, 0, -1), 'j': (0, 0, 0, 1), 'l': (0, 0, 0, -1), 'u': (1, 0, 0, 1),
    ',': (-1, 0, 0, 0), '.': (-1, 0, 0, 1), 'm': (-1, 0, 0, -1),
    'I': (1, 0, 0, 0), 'O': (1, -1, 0, 0), 'J': (0, 1, 0, 0), 'L': (0, -1, 0, 0), 'U': (1, 1, 0, 0),
    '<': (-1, 0, 0, 0), '>': (-1, -1, 0, 0), 'M': (-1, 1, 0, 0), 't': (0, 0, 1, 0), 'b': (0, 0, -1, 0)}.items()}
"""{key: factors of the speeds}"""

SPEEDS = {'q': (STEP_UP, STEP_UP), 'z': (STEP_DOWN, STEP_DOWN), 'w': (STEP_UP, 1.0), 'x': (STEP_DOWN, 1.0),
          'e': (1.0, STEP_UP), 'c': (1.0, STEP_DOWN)}
"""{key: factors of (speed, turn rate)}"""

STOP = Velocity(0.0, 0.0, 0.0, 0.0)


class Keyboard:
    """The command to send, from the keys that were pressed.

    :param speed: [m/s]; turn: [rad/s]
    :param key_timeout: see KEY_TIMEOUT [s]
    :param period: from one command to the next [s]
    """

    def __init__(self, speed: float, turn: float, key_timeout: float = KEY_TIMEOUT, period: float = PERIOD) -> None:
        self.speed, self.turn = speed, turn
        self._key_timeout, self._period = key_timeout, period
        self._key = ''      # of the motion; empty: none
        self._held_until = self._silent_from = self._due = -math.inf

    def press(self, key: str, now: float) -> Optional[KeyAction]:
        """Take a key, see keys.py, in the order and at the time [s] at which it was pressed; returns what it asks for.

        Any key without a meaning stops the robot. That of the emergency stop is never lost: it counts also with Caps
        Lock, and after an escape character that was no beginning of a sequence. No usual key's sequence ends with it.
        """
        if key in SPEEDS:
            speed, turn = SPEEDS[key]
            self.speed, self.turn = _limited(self.speed * speed), _limited(self.turn * turn)
            return None
        if key in MOVES:
            repeated = key == self._key and now < self._held_until
            self._held_until = max(self._held_until, now + REPEAT_TIMEOUT) if repeated else now + self._key_timeout
            if not repeated:
                self._key, self._due = key, now
            return None
        self._stop(now)
        if key == 'S' or key.endswith(KeyAction.EMERGENCY_STOP.value):
            return KeyAction.EMERGENCY_STOP
        return next((action for action in KeyAction if action.value == key), None)

    def poll(self, now: float) -> Optional[Velocity]:
        """The command to send now, if one is due."""
        if self._key and now >= self._held_until:
            self._stop(now)
        if now < self._due or not (self._key or now < self._silent_from):
            return None
        self._due = now + self._period
        return self.motion

    def deadline(self) -> Optional[float]:
        """When `poll` has something to do next [s]; None: not before a key is pressed."""
        if self._key:
            return min(self._due, self._held_until)
        return self._due if self._due < self._silent_from else None

    @property
    def motion(self) -> Velocity:
        """The present command."""
        if not self._key:
            return STOP
        x, y, z, turn = MOVES[self._key]
        return Velocity(x * self.speed, y * self.speed, z * self.speed, turn * self.turn)

    def _stop(self, now: float) -> None:
        self._key, self._held_until = '', -math.inf
        self._due, self._silent_from = now, now + STOP_DURATION


def _limited(speed: float) -> float:
    return max(MIN_SPEED, min(speed, MAX_SPEED))


class StopKey:
    """Repeats the emergency stop until somebody receives it, and for STOP_DURATION after that: a subscriber may be just
    connecting, as a node that is restarted."""

    def __init__(self) -> None:
        self._due = math.inf
        self._until = math.inf

    def press(self, now: float) -> None:
        """The key was pressed [s]."""
        self._due, self._until = now, math.inf

    def release(self) -> None:
        """The stop is released on purpose."""
        self._due = math.inf

    def poll(self, received: bool, now: float) -> bool:
        """Whether to publish the stop now.

        :param received: whether there is a subscriber
        """
        if now < self._due:
            return False
        if received:
            self._until = min(self._until, now + STOP_DURATION)
        self._due = now + PERIOD if now < self._until else math.inf
        return now < self._until

    def deadline(self) -> float:
        """When `poll` has something to do [s]; infinity: not before the key is pressed."""
        return self._due
