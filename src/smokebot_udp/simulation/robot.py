# SPDX-License-Identifier: BSD-3-Clause
"""The simulated robot: on its tour, driven by commands, or on its way to a goal.

Its motion is a list of legs, each known to its end when it begins:

    tour ── command ──▶ arc, then it stands ── next command ──▶ arc, ...
    tour ── goal ──▶ course to the goal, then it stands
    it has stood for a while ──▶ course back to where it left the tour, then the tour goes on

A command ends by itself after WATCHDOG, as in the driver of a real base, and at a wall. The robot's pose at a time is
therefore a function of that time, and a clock that steps back makes it stand where it was then.
"""
import collections
import contextlib
import math
from typing import Deque, NamedTuple, Optional, Tuple, Union

from .course import Course
from .drive import Drive
from .motion import Arc, free_duration
from .planner import Planner
from .pose import Pose, twist_of
from .world import World

WATCHDOG = 0.5
"""A command is in force for this time after it came [s]."""

MAX_SPEED, MAX_TURN_RATE = 1.5, 2.0
"""Faster commands are limited to these [m/s, rad/s]."""

HISTORY = 5.0
"""Sensors may ask where the robot was this long ago; older legs are forgotten [s]."""

REACHED = 'reached'
"""Outcome of a goal; any other one says why it was not."""


class _Tour:
    """The tour from a time of it on [s]."""

    def __init__(self, drive: Drive, begin: float) -> None:
        self._drive, self.begin, self.duration = drive, begin, math.inf

    def pose(self, time: float) -> Pose:
        return self._drive.pose(self.begin + time)

    def travelled(self, time: float) -> float:
        return self._drive.travelled(self.begin + time) - self._drive.travelled(self.begin)


LegMotion = Union[Arc, Course, _Tour]
"""It stands still from its `duration` [s] on."""


class _Leg(NamedTuple):
    start: float
    """[s]"""
    travelled: float
    """Before it [m]."""
    motion: LegMotion
    """Its time begins at `start`."""


class _Goal(NamedTuple):
    number: int
    end: float
    """When it is reached [s]."""


class Robot:
    """One robot, whose time begins with its tour. All times are given in seconds and do not decrease by much.

    :param drive: its tour
    :param world: its obstacles
    :param planner: of ways through this world
    :param speed: on the way to a goal [m/s]
    :param pause: from the last command, or the end of a goal, until it goes back to its tour [s]
    """

    def __init__(self, drive: Drive, world: World, planner: Planner, speed: float, pause: float) -> None:
        self._drive, self._world, self._planner = drive, world, planner
        self._speed, self._pause = speed, pause
        self._legs: Deque[_Leg] = collections.deque([_Leg(0.0, 0.0, _Tour(drive, 0.0))])
        self._tour_time = 0.0       # at which the tour was left
        self._idle_since: Optional[float] = None    # None: on the tour, or on the way there
        self._driven = -math.inf, -math.inf     # from, to
        self._goal = _Goal(0, -math.inf)
        self._outcome = REACHED     # of _goal, once it is over

    def pose(self, time: float) -> Pose:
        """The true pose."""
        leg = self._leg(time)
        return leg.motion.pose(time - leg.start)

    def travelled(self, time: float) -> float:
        """The distance travelled [m]."""
        leg = self._leg(time)
        return leg.travelled + leg.motion.travelled(time - leg.start)

    def twist(self, time: float) -> Tuple[float, float]:
        """(forward speed [m/s], turn rate [rad/s])"""
        leg = self._leg(time)
        return twist_of(leg.motion.pose, time - leg.start)

    def command(self, forward: float, turn: float, time: float) -> None:
        """Obey a command, which takes the robot from its tour or its goal; one that is not finite stops the robot.

        :param forward: [m/s]; turn: [rad/s]
        """
        if not (math.isfinite(forward) and math.isfinite(turn)):
            forward = turn = 0.0
        forward, turn = (max(-most, min(value, most)) for value, most in (
            (forward, MAX_SPEED), (turn, MAX_TURN_RATE)))
        self._leave(time, 'it was driven by commands')
        here = self.pose(time)
        free = free_duration(self._world, Arc(here, forward, turn, WATCHDOG))
        arc = Arc(here, forward, turn, free)
        self._begin(time, arc)
        if free < WATCHDOG:     # at a wall it still turns
            self._then(Arc(arc.pose(free), 0.0, turn, WATCHDOG - free))
        self._driven = time, time + WATCHDOG

    def go_to(self, goal: Pose, time: float) -> int:
        """Set out for a goal in place of any other one; returns its number, from 1 on.

        :raises ValueError: where it cannot be reached, or somebody drives by commands: the robot's motion is the same
        """
        if self._driven[0] <= time < self._driven[1]:
            raise ValueError('the robot is driven by commands')
        if not all(map(math.isfinite, goal)):
            raise ValueError('the goal is not finite')
        x, y, yaw = goal
        here = self.pose(time)
        way = self._planner.way(here[:2], (x, y))
        self._leave(time, 'another goal came')
        course = Course(here, [(point, 0.0) for point in way], yaw, self._speed)
        self._begin(time, course)
        self._goal = _Goal(self._goal.number + 1, time + course.duration)
        self._outcome = REACHED
        self._idle_since = self._goal.end
        return self._goal.number

    def cancel(self, number: int, time: float) -> None:
        """Stop on the way to a goal, unless it is over."""
        if self.outcome(number, time) is None:
            self._leave(time, 'it was cancelled')
            self._begin(time, Arc(self.pose(time), 0.0, 0.0, 0.0))

    def outcome(self, number: int, time: float) -> Optional[str]:
        """REACHED, or why a goal was given up; None: the robot is on its way.

        :param number: of go_to
        """
        if number != self._goal.number:
            return 'another goal came'
        return None if time < self._goal.end else self._outcome

    def _leg(self, time: float) -> _Leg:
        """The leg at a time; the first one that is remembered if that is earlier."""
        self._go_on(time)
        return next((leg for leg in reversed(self._legs) if leg.start <= time), self._legs[0])

    def _leave(self, time: float, why: str) -> None:
        """End the tour, or give the goal up."""
        leg = self._leg(time)
        if isinstance(leg.motion, _Tour):
            self._tour_time = leg.motion.begin + time - leg.start
        if time < self._goal.end:
            self._goal, self._outcome = self._goal._replace(end=time), why
        self._idle_since = time

    def _go_on(self, time: float) -> None:
        """Set out for where the tour was left, once the robot has stood for long enough."""
        if self._idle_since is None or time < self._idle_since + self._pause:
            return
        self._idle_since = time     # it is tried again later if no way leads there
        here, there = self.pose(time), self._drive.pose(self._tour_time)
        with contextlib.suppress(ValueError):
            way = self._planner.way(here[:2], there[:2])
            course = Course(here, [(point, 0.0) for point in way], there[2], self._speed)
            self._begin(time, course)
            self._then(_Tour(self._drive, self._tour_time))
            self._idle_since = None

    def _begin(self, time: float, motion: LegMotion) -> None:
        """Begin a leg in place of all later ones."""
        leg = _Leg(time, self.travelled(time), motion)
        while self._legs and self._legs[-1].start >= time:
            self._legs.pop()
        self._legs.append(leg)
        while len(self._legs) > 1 and self._legs[1].start < time - HISTORY:
            self._legs.popleft()

    def _then(self, motion: LegMotion) -> None:
        """Begin a leg at the end of the last one."""
        last = self._legs[-1]
        duration = last.motion.duration
        self._legs.append(_Leg(last.start + duration, last.travelled + last.motion.travelled(duration), motion))
