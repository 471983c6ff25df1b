# SPDX-License-Identifier: BSD-3-Clause
"""Rotations as ROS has them."""
import numpy as np

from .arrays import FloatArray


def rotation(x: float, y: float, z: float, w: float) -> FloatArray:
    """(3, 3) rotation matrix of a quaternion of any length.

    All zeros, as careless publishers leave it, are no rotation.
    """
    s = 2 / (x * x + y * y + z * z + w * w or 1.0)
    return np.array([[1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
                     [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
                     [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)]])
