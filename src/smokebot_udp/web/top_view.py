# SPDX-License-Identifier: BSD-3-Clause
"""Scans and clouds from above, in the fixed frame."""
import math
from typing import Any, Mapping, NamedTuple, Optional, Tuple

import cv2
import numpy as np

from ..arrays import Array, Float32Array, FloatArray, UInt8Array
from ..rotation import rotation
from .png import encoded

MAX_SCAN_POINTS = 2048
"""Number of points; of a longer scan every second, third, ... point is shown."""

CELL, SPAN = 0.1, 40.0
"""Pixel of a cloud's image, and its side around the robot [m]."""

LOWEST, HIGHEST = -1.2, 2.4
"""Heights of the colours' ends, relative to the robot's base, as in rviz [m]."""


class Pose(NamedTuple):
    """A frame in another one."""
    rotation: FloatArray
    """(3, 3)"""
    translation: FloatArray
    """(3,) [m]"""
    age: Optional[float] = None
    """Age of the transform [s]; None: it does not move."""

    @property
    def yaw(self) -> float:
        return math.atan2(self.rotation[1, 0], self.rotation[0, 0])

    def apply(self, points: Array) -> FloatArray:
        """:param points: (n, 3)"""
        moved: FloatArray = points @ self.rotation.T + self.translation
        return moved


def pose_of(pose: Any) -> Pose:
    """The Pose of a geometry_msgs/Pose."""
    position, q = pose.position, pose.orientation
    return Pose(rotation(q.x, q.y, q.z, q.w), np.array([position.x, position.y, position.z]))


def scan_points(ranges: Array, angle_min: float, angle_increment: float, limits: Tuple[float, float], pose: Pose
                ) -> Float32Array:
    """The ends of a LaserScan's beams.

    :param ranges: (n,) [m]; what is not within limits is left out
    :return: (m, 2) float32 x, y
    """
    ranges = np.asarray(ranges, np.float32)
    angles = angle_min + angle_increment * np.arange(len(ranges))
    good = np.isfinite(ranges) & (ranges >= limits[0]) & (ranges <= limits[1])
    ranges, angles = ranges[good].astype(float), angles[good]
    every = max(1, -(-len(ranges) // MAX_SCAN_POINTS))
    ranges, angles = ranges[::every], angles[::every]
    points = np.stack([ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(len(ranges))], axis=1)
    found: Float32Array = pose.apply(points)[:, :2].astype('<f4')
    return found


class TopView(NamedTuple):
    """A cloud from above."""
    png: bytes
    """RGBA, the first line at the top."""
    x: float
    y: float
    """Place of its lower left corner [m]."""


def cloud_from_above(points: Array, pose: Pose, base: Pose) -> TopView:
    """A cloud around the robot; the highest point of each pixel counts.

    :param points: (n, 3) [m], finite
    :param pose: of the cloud's frame in the fixed one
    :param base: of the robot's base in the fixed frame
    """
    side = round(SPAN / CELL)
    x, y = (math.floor((value - SPAN / 2) / CELL) * CELL for value in base.translation[:2].tolist())
    found = pose.apply(points)
    with np.errstate(invalid='ignore'):
        columns = np.floor((found[:, 0] - x) / CELL)
        rows = np.floor((found[:, 1] - y) / CELL)
    inside = (columns >= 0) & (columns < side) & (rows >= 0) & (rows < side)
    columns, rows = columns[inside].astype(int), rows[inside].astype(int)
    shade = np.clip((found[inside, 2] - base.translation[2] - LOWEST) / (HIGHEST - LOWEST), 0.0, 1.0) * 254 + 1
    heights: UInt8Array = np.zeros((side, side), np.uint8)
    np.maximum.at(heights, (rows, columns), shade.astype(np.uint8))
    pixels: UInt8Array = np.dstack([cv2.applyColorMap(heights, cv2.COLORMAP_RAINBOW),
                                    np.where(heights > 0, np.uint8(255), np.uint8(0))])
    return TopView(encoded(pixels[::-1]), x, y)


def ages_image(cells: Array) -> bytes:
    """The ages of a map's regions as PNG.

    :param cells: (height, width) int8, -1 unknown, 0..100 [s]
    """
    pixels: UInt8Array = np.where(cells < 0, 255, np.clip(cells, 0, 100)).astype(np.uint8)
    return encoded(pixels[::-1])


def path_points(positions: FloatArray, most: int) -> FloatArray:
    """At most `most` points of a path, the first and the last one among them.

    :param positions: (n, 2)
    """
    if len(positions) <= most:
        return positions
    chosen: FloatArray = positions[np.linspace(0, len(positions) - 1, most).round().astype(int)]
    return chosen


def goal_fields(pose: Optional[Tuple[float, float, float, float]]) -> Mapping[str, Optional[float]]:
    """The fields x, y, yaw and age; None: there is no goal."""
    return dict(zip(('x', 'y', 'yaw', 'age'), pose or (None,) * 4))
