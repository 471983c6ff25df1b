# SPDX-License-Identifier: BSD-3-Clause
"""How the robot moves while a command is in force: on an arc, and no farther than the next wall."""
from typing import Protocol

import numpy as np

from .pose import Pose
from .world import World

RADIUS = 0.3
"""The robot is as wide as a circle of this radius [m]."""

CHECK_PERIOD = 0.01
"""Time between the poses of an arc that are checked for a collision [s]."""

ROUNDING = 1e-9
"""Smaller approaches to an obstacle are none: the robot turns on the spot, or drives along a wall [m]."""

STRAIGHT = 1e-9
"""Slower turns are none: an arc's radius would be infinite [rad/s]."""


class Motion(Protocol):
    """Where a robot is at any time."""

    def pose(self, time: float) -> Pose:
        """The pose at a time [s]."""

    def travelled(self, time: float) -> float:
        """The distance travelled until a time [s]; [m]."""


class Arc:
    """A constant speed and turn rate for a while; before and after it the robot stands still.

    :param start: pose at its start
    :param forward: [m/s]; turn: [rad/s]; duration: [s]
    """

    def __init__(self, start: Pose, forward: float, turn: float, duration: float) -> None:
        self._start, self._forward, self._turn, self.duration = start, forward, turn, duration

    def pose(self, time: float) -> Pose:
        """The pose at a time from the start [s]."""
        x, y, yaw = self._start
        time = min(max(time, 0.0), self.duration)
        turned = yaw + self._turn * time
        if abs(self._turn) < STRAIGHT:
            return x + self._forward * time * float(np.cos(yaw)), y + self._forward * time * float(np.sin(yaw)), turned
        radius = self._forward / self._turn
        return (x + radius * float(np.sin(turned) - np.sin(yaw)), y - radius * float(np.cos(turned) - np.cos(yaw)),
                turned)

    def travelled(self, time: float) -> float:
        """The distance travelled until a time from the start [s]; [m]."""
        return abs(self._forward) * min(max(time, 0.0), self.duration)


def free_duration(world: World, arc: Arc) -> float:
    """How long the robot can move on an arc before it touches an obstacle [s]; it may always move away from one."""
    steps = int(np.ceil(arc.duration / CHECK_PERIOD))
    times = np.linspace(0.0, arc.duration, steps + 1)
    distances = world.distances(np.array([arc.pose(float(time))[:2] for time in times]))
    blocked = (distances[1:] < RADIUS) & (np.diff(distances) < -ROUNDING)
    return float(times[int(blocked.argmax())]) if blocked.any() else arc.duration
