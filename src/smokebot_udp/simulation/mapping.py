# SPDX-License-Identifier: BSD-3-Clause
"""The map that the robot makes of the building while it explores it: a SLAM's result, without its errors."""
import numpy as np

from .lidar import COLUMNS
from .rays import ranges

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
RESOLUTION = 0.05
"""Side of a cell [m]."""

STEP = 5.0
"""The map grows by so much [m]: whoever shows it sees its size and origin change now and then, not always."""

LEVEL = 0.4
"""Height of the slice through the building that is mapped [m]: what stands lower is not in a robot's way."""

REACH = 8.0
"""What is farther is mapped when the robot comes nearer [m]."""

INTO = 0.002
"""So far behind its face a surface is noted [m]: on a cell's border, rounding would choose the cell."""


class Mapper:
    """Notes what the LiDAR's directions see at LEVEL.

    cells: (rows, columns) int8, UNKNOWN, FREE or OCCUPIED; rows go north, columns east
    origin: (x, y) of the outer corner of cells[0, 0] [m], whole STEPs
    """

    def __init__(self, world):
        self.world = world
        self.cells, self.origin = np.empty((0, 0), np.int8), (0.0, 0.0)
        self._azimuths = np.arange(COLUMNS) * (2 * np.pi / COLUMNS)

    def update(self, pose):
        """Look around at a pose (x, y, yaw); returns whether the map is another one now."""
        azimuths = self._azimuths + pose[2]
        distance, surface = (value[:, 0] for value in ranges(
            self.world, pose[:2], LEVEL, azimuths, np.array([0.0]), floor=False))
        hit, distance = distance < REACH, np.minimum(distance, REACH).astype(float)
        ends = np.asarray(pose[:2]) + distance[:, np.newaxis] * np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
        ends[hit] -= INTO * self._faces(ends[hit], surface[hit])
        grown = self._grow(ends.min(axis=0), ends.max(axis=0))
        seen = self._seen(pose, distance)
        self.cells[seen] = FREE
        columns, rows = np.floor((ends[hit] - self.origin) / RESOLUTION).astype(int).T
        new = self.cells[rows, columns] != OCCUPIED
        self.cells[rows, columns] = OCCUPIED
        return bool(grown or len(seen[0]) or new.any())

    def _faces(self, points, surface):
        """(n, 2) outward normals of the prisms' sides on which the points lie."""
        normals = self.world.normals[surface]
        outside = np.einsum('nij,nj->ni', normals, points) - self.world.offsets[surface]
        return normals[np.arange(len(points)), outside.argmax(axis=1)]

    def _grow(self, low, high):
        """Make the map hold two corners [m]; returns whether it had to grow."""
        low, high = np.floor(low / STEP), np.floor(high / STEP) + 1
        per_step = round(STEP / RESOLUTION)
        if self.cells.size:
            was = np.array(self.origin) / STEP
            low, high = np.minimum(low, was), np.maximum(high, was + np.array(self.cells.shape[::-1]) / per_step)
        columns, rows = ((high - low) * per_step).round().astype(int)
        if (rows, columns) == self.cells.shape:
            return False
        before, self.cells = self.cells, np.full((rows, columns), UNKNOWN, np.int8)
        if before.size:
            column, row = ((was - low) * per_step).round().astype(int)
            self.cells[row:row + before.shape[0], column:column + before.shape[1]] = before
        self.origin = tuple(low * STEP)
        return True

    def _seen(self, pose, distance):
        """Indexes (rows, columns) of the unknown cells whose centre lies before what both rays beside it meet."""
        rows, columns = np.nonzero(self.cells == UNKNOWN)
        x = self.origin[0] + (columns + 0.5) * RESOLUTION - pose[0]
        y = self.origin[1] + (rows + 0.5) * RESOLUTION - pose[1]
        ray = np.floor((np.arctan2(y, x) - pose[2]) * (COLUMNS / (2 * np.pi))).astype(int) % COLUMNS
        seen = np.hypot(x, y) < np.minimum(distance, np.roll(distance, -1))[ray]
        return rows[seen], columns[seen]
