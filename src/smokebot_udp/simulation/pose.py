# SPDX-License-Identifier: BSD-3-Clause
"""Poses in the plane.

A pose (x, y, yaw) [m, rad] is also the transform from the coordinates of what has this pose into the coordinates in
which the pose is given.
"""
from typing import Tuple

import numpy as np

Pose = Tuple[float, float, float]
"""(x, y, yaw) [m, rad]"""


def compose(outer: Pose, inner: Pose) -> Pose:
    """The pose `inner`, which is given relative to `outer`, in the coordinates in which `outer` is given."""
    x, y, yaw = outer
    return (x + inner[0] * np.cos(yaw) - inner[1] * np.sin(yaw),
            y + inner[0] * np.sin(yaw) + inner[1] * np.cos(yaw), yaw + inner[2])


def inverse(pose: Pose) -> Pose:
    """The pose whose composition with `pose` is (0, 0, 0)."""
    x, y, yaw = pose
    return -x * np.cos(yaw) - y * np.sin(yaw), x * np.sin(yaw) - y * np.cos(yaw), -yaw
