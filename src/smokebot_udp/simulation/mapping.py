# SPDX-License-Identifier: BSD-3-Clause
"""The map that the robot makes of the building while it explores: the result of an ideal SLAM."""
from typing import Tuple

import numpy as np

from ..arrays import Array, FloatArray, IntArray
from .lidar import COLUMNS
from .pose import Pose
from .rays import ranges
from .world import World

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
RESOLUTION = 0.05
"""Side of a cell [m]."""

STEP = 5.0
"""The map grows in steps of this size, so that its size and origin change from time to time only [m]."""

LEVEL = 0.4
"""Height of the mapped slice through the building: lower things are not obstacles [m]."""

REACH = 8.0
"""Farther surfaces are not mapped before the robot comes nearer [m]."""

INSIDE = 0.002
"""Distance behind a surface at which its cell is marked: on the border of two cells rounding would choose [m]."""


class Mapper:
    """Maps what rays in the LiDAR's directions see at LEVEL.

    cells: (rows, columns) int8, UNKNOWN, FREE or OCCUPIED; rows go north, columns east
    origin: (x, y) of the outer corner of cells[0, 0] [m], multiples of STEP
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.cells: Array = np.empty((0, 0), np.int8)
        self.origin: Tuple[float, float] = (0.0, 0.0)
        self._azimuths = np.arange(COLUMNS) * (2 * np.pi / COLUMNS)

    def update(self, pose: Pose) -> bool:
        """Map what is seen from a pose; returns whether the map has changed."""
        azimuths = self._azimuths + pose[2]
        ray_lengths, surface = (value[:, 0] for value in ranges(
            self.world, pose[:2], LEVEL, azimuths, np.array([0.0]), floor=False))
        hit, distance = ray_lengths < REACH, np.minimum(ray_lengths, REACH).astype(float)
        ends = np.asarray(pose[:2]) + distance[:, np.newaxis] * np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
        ends[hit] -= INSIDE * self._normals(ends[hit], surface[hit])
        grown = self._grow(ends.min(axis=0), ends.max(axis=0))
        seen = self._seen(pose, distance)
        self.cells[seen] = FREE
        columns, rows = np.floor((ends[hit] - self.origin) / RESOLUTION).astype(int).T
        new = self.cells[rows, columns] != OCCUPIED
        self.cells[rows, columns] = OCCUPIED
        return bool(grown or len(seen[0]) or new.any())

    def _normals(self, points: FloatArray, surface: Array) -> FloatArray:
        """(n, 2) outward normals of the prisms' sides on which the (n, 2) points lie."""
        normals = self.world.normals[surface]
        outside = np.einsum('nij,nj->ni', normals, points) - self.world.offsets[surface]
        return np.asarray(normals[np.arange(len(points)), outside.argmax(axis=1)])

    def _grow(self, low: FloatArray, high: FloatArray) -> bool:
        """Make room for two corners (x, y) [m]; returns whether the map has grown."""
        low, high = np.floor(low / STEP), np.floor(high / STEP) + 1
        per_step = round(STEP / RESOLUTION)
        old_low = np.array(self.origin) / STEP
        if self.cells.size:
            low = np.minimum(low, old_low)
            high = np.maximum(high, old_low + np.array(self.cells.shape[::-1]) / per_step)
        columns, rows = ((high - low) * per_step).round().astype(int)
        if (rows, columns) == self.cells.shape:
            return False
        old, self.cells = self.cells, np.full((rows, columns), UNKNOWN, np.int8)
        if old.size:
            column, row = ((old_low - low) * per_step).round().astype(int)
            self.cells[row:row + old.shape[0], column:column + old.shape[1]] = old
        x, y = low * STEP
        self.origin = x, y
        return True

    def _seen(self, pose: Pose, distance: FloatArray) -> Tuple[IntArray, IntArray]:
        """(rows, columns) of the unknown cells whose centre is nearer than the hits of both adjacent rays."""
        rows, columns = np.nonzero(self.cells == UNKNOWN)
        x = self.origin[0] + (columns + 0.5) * RESOLUTION - pose[0]
        y = self.origin[1] + (rows + 0.5) * RESOLUTION - pose[1]
        ray = np.floor((np.arctan2(y, x) - pose[2]) * (COLUMNS / (2 * np.pi))).astype(int) % COLUMNS
        seen = np.hypot(x, y) < np.minimum(distance, np.roll(distance, -1))[ray]
        return rows[seen], columns[seen]
