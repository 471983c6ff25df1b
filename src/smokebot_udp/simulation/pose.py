# SPDX-License-Identifier: BSD-3-Clause
"""Poses in the plane.

A pose (x, y, yaw) [m, rad] is also the transform from the coordinates of what has this pose into the coordinates in
which the pose is given.
"""
from typing import Callable, Tuple

import numpy as np

Pose = Tuple[float, float, float]
"""(x, y, yaw) [m, rad]"""

Point = Tuple[float, float]
"""(x, y) [m]"""

TIME_STEP = 1e-3
"""Step of the numerical derivative [s]."""


def compose(outer: Pose, inner: Pose) -> Pose:
    """The pose `inner`, which is given relative to `outer`, in the coordinates in which `outer` is given."""
    x, y, yaw = outer
    return (x + inner[0] * np.cos(yaw) - inner[1] * np.sin(yaw),
            y + inner[0] * np.sin(yaw) + inner[1] * np.cos(yaw), yaw + inner[2])


def inverse(pose: Pose) -> Pose:
    """The pose whose composition with `pose` is (0, 0, 0)."""
    x, y, yaw = pose
    return -x * np.cos(yaw) - y * np.sin(yaw), x * np.sin(yaw) - y * np.cos(yaw), -yaw


def wrapped(angle: float) -> float:
    """The same angle in -pi .. pi [rad]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def twist_of(pose: Callable[[float], Pose], time: float) -> Tuple[float, float]:
    """(forward speed [m/s], turn rate [rad/s]) at a time [s] of a robot that does not move sideways.

    :param pose: f(time [s])
    """
    x0, y0, yaw0 = pose(time)
    x1, y1, yaw1 = pose(time + TIME_STEP)
    return ((x1 - x0) * np.cos(yaw0) + (y1 - y0) * np.sin(yaw0)) / TIME_STEP, (yaw1 - yaw0) / TIME_STEP
