# SPDX-License-Identifier: BSD-3-Clause
"""Steers a robot to a point by what its operator sees: its pose, and the distances around it."""
import math
from typing import Tuple

import numpy as np

from smokebot_udp.arrays import FloatArray
from smokebot_udp.simulation.pose import Point, Pose

SPEED, TURN_RATE = 0.6, 1.0
"""At most [m/s, rad/s]."""

GAIN = 1.5
"""Turn rate for each radian that the target is beside the heading [1/s]."""

AHEAD = 0.5
"""The robot drives forward while the target is within this angle of its heading [rad]."""

REACHED = 0.3
"""From a target [m]."""

HALF_WIDTH, CLEARANCE, FREE = 0.4, 0.5, 1.0
"""An obstacle this far beside the way counts; at CLEARANCE ahead the robot stops, at CLEARANCE + FREE it is fast [m].
"""


def nearest_ahead(ranges: FloatArray, angles: FloatArray) -> float:
    """The distance along the way of the nearest obstacle on it; infinite: there is none [m].

    :param ranges: (n,) float [m]; NaN and infinite ones are no obstacle
    :param angles: (n,) float, 0 is ahead [rad]
    """
    with np.errstate(invalid='ignore'):
        along, beside = ranges * np.cos(angles), ranges * np.sin(angles)
        on_way = np.isfinite(ranges) & (along > 0) & (np.abs(beside) < HALF_WIDTH)
    return float(along[on_way].min(initial=math.inf))


def steer(pose: Pose, target: Point, obstacle: float) -> Tuple[float, float]:
    """(forward speed [m/s], turn rate [rad/s])

    :param obstacle: see nearest_ahead
    """
    x, y, yaw = pose
    away, beside = math.hypot(target[0] - x, target[1] - y), math.atan2(target[1] - y, target[0] - x) - yaw
    beside = math.remainder(beside, 2 * math.pi)
    turn = max(-TURN_RATE, min(GAIN * beside, TURN_RATE))
    if abs(beside) > AHEAD:
        return 0.0, turn
    share = min(away, (obstacle - CLEARANCE) / FREE, 1.0)
    return SPEED * max(share, 0.0) * math.cos(beside), turn


def is_reached(pose: Pose, target: Point) -> bool:
    """Whether the robot is at its target."""
    return math.hypot(target[0] - pose[0], target[1] - pose[1]) < REACHED
