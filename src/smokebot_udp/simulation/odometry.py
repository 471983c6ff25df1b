# SPDX-License-Identifier: BSD-3-Clause
"""Wheel odometry with a drift that grows with the distance travelled, not with time."""
from typing import Tuple

import numpy as np

from .motion import Motion
from .pose import Pose, compose, inverse, twist_of

DRIFT = (0.30, 45.0), (0.20, 31.0), (0.04, 60.0)
"""For x [m], y [m] and yaw [rad]: the maximum drift, and the distance travelled [m] after which it would be reached at
its initial slope. Real drift is unbounded; this one returns to 0, so that a demonstration of hours stays on the
screen."""


class Odometry:
    """The odometry of a robot: compose(correction(t), pose(t)) is its true pose."""

    def __init__(self, drive: Motion) -> None:
        self._drive = drive

    def correction(self, time: float) -> Pose:
        """The pose of the odometry's origin in the map, as SLAM would find it; (0, 0, 0) at time 0 [s]."""
        distance = self._drive.travelled(time)
        x, y, yaw = (amplitude * np.sin(distance / length) for amplitude, length in DRIFT)
        return x, y, yaw

    def pose(self, time: float) -> Pose:
        """The robot's pose in the odometry's coordinates at a time [s]."""
        return compose(inverse(self.correction(time)), self._drive.pose(time))

    def twist(self, time: float) -> Tuple[float, float]:
        """(forward speed [m/s], turn rate [rad/s]); the drift's contribution, below 1 %, is neglected."""
        return twist_of(self._drive.pose, time)
