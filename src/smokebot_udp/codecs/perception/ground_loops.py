# SPDX-License-Identifier: BSD-3-Clause
"""The count of RANSAC's inliers as a compiled loop."""
import math
from typing import Any, Tuple

import numpy as np

from ...arrays import Array, Float32Array
from ..layered.loops import compiled, float32, int32


@compiled
def _plane(points: Array, triple: Array, least: float) -> Tuple[float, float, float, float]:
    """The plane through three points: the unit normal and the offset; the former is 0 where they are in a line."""
    ax, ay, az = np.float64(points[0, triple[0]]), np.float64(points[1, triple[0]]), np.float64(points[2, triple[0]])
    bx, by, bz = points[0, triple[1]] - ax, points[1, triple[1]] - ay, points[2, triple[1]] - az
    cx, cy, cz = points[0, triple[2]] - ax, points[1, triple[2]] - ay, points[2, triple[2]] - az
    x, y, z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    length = math.sqrt(x * x + y * y + z * z)
    if not length > least:
        return 0.0, 0.0, 0.0, 0.0
    x, y, z = x / length, y / length, z / length
    return x, y, z, -(x * ax + y * ay + z * az)


@compiled
def _count(points: Array, a: float, b: float, c: float, d: float, threshold: float) -> Any:
    """How many points are nearer to a plane than the threshold; all in float32."""
    count = int32(0)
    for i in range(points.shape[1]):
        count += int32(abs(points[0, i] * a + points[1, i] * b + points[2, i] * c + d) < threshold)
    return count


@compiled
def best_plane(points: Float32Array, triples: Array, threshold: float, least: float) -> Tuple[int, Array, Array]:
    """The plane that most points are on, of the planes through three points each; the first one of equally good ones.

    :param points: (3, n) float32, C-contiguous
    :param triples: (h, 3) int: indexes of points
    :param threshold: distance from the plane up to which a point is on it, float32
    :param least: see ground.LEAST_NORMAL
    :return: points on it, 0: there is no plane; their centre, (3,) float64; and their scatter about it,
        (3, 3) float64
    """
    most, best = 0, np.zeros(4, np.float32)
    for h in range(len(triples)):
        x, y, z, offset = _plane(points, triples[h], least)
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        count = _count(points, float32(x), float32(y), float32(z), float32(offset), threshold)
        if count > most:
            most = count
            best[0], best[1], best[2], best[3] = x, y, z, offset
    centre, scatter = np.zeros(3), np.zeros((3, 3))
    inliers = np.empty((3, most))
    found = 0
    for i in range(points.shape[1] if most else 0):
        if abs(points[0, i] * best[0] + points[1, i] * best[1] + points[2, i] * best[2] + best[3]) < threshold:
            for axis in range(3):
                inliers[axis, found] = points[axis, i]
                centre[axis] += points[axis, i]
            found += 1
    centre /= max(most, 1)
    for i in range(found):
        for row in range(3):
            for column in range(3):
                scatter[row, column] += (inliers[row, i] - centre[row]) * (inliers[column, i] - centre[column])
    return most, centre, scatter
