# SPDX-License-Identifier: BSD-3-Clause
"""Point clouds as messages, and how much of one is missing."""
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from sensor_msgs.msg import PointCloud2, PointField

from smokebot_udp.arrays import Array, Float32Array


def message_of(xyz: Float32Array) -> Any:
    """A PointCloud2 of (n, 3) points [m]."""
    fields = [PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate('xyz')]
    message = PointCloud2(height=1, width=len(xyz), fields=fields, point_step=12, row_step=12 * len(xyz),
                          data=xyz.astype('<f4').tobytes())
    message.header.frame_id = 'velodyne'
    return message


def points_of(message: Any) -> Float32Array:
    """The points of such a message: (n, 3) [m]; no points of None."""
    return np.frombuffer(b'' if message is None else message.data, '<f4').reshape(-1, 3)


def distance(whole: Array, arrived: Array) -> float:
    """The 99th percentile of the distance from the points of a cloud to the nearest received one [m]."""
    return float(np.percentile(cKDTree(arrived).query(whole)[0], 99)) if len(arrived) else np.inf
