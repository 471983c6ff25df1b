# SPDX-License-Identifier: BSD-3-Clause
"""Where the cells of a map lie in its frame, and by how many cells one map lies beside another."""
import math
from typing import Any, NamedTuple, Optional, Tuple

from ...frame_names import frame_name

MAX_NUMBER = 1 << 30
"""Largest column and row of a map's first cell, either way."""
SAME_RESOLUTION = 1e-6
"""Largest difference between resolutions that are the same, relative."""
SAME_PLACE = 0.01
"""Largest difference between places that are the same, or whole cells apart [cell]."""
SAME_ORIENTATION = 1e-6
"""Largest difference between parts of quaternions that are the same."""


class Lattice(NamedTuple):
    """The place of a map's first cell. Columns go along the x axis of the map's origin, rows along its y axis."""
    frame: str
    """Name of the frame, see frame_names."""
    resolution: float
    """[m/cell]"""
    orientation: Tuple[float, float, float, float]
    """Orientation of the map's origin: a quaternion x, y, z, w of length 1, with w >= 0."""
    column: float
    """Column of the outer corner of the first cell, from the zero of the frame [cell]."""
    row: float
    """Row of the outer corner of the first cell, from the zero of the frame [cell]."""
    height: float
    """Height of the cells' plane above the zero of the frame, along the plane's normal [cell]."""

    @classmethod
    def of(cls, frame_id: str, info: Any) -> 'Lattice':
        """The lattice of a map.

        :param info: nav_msgs/MapMetaData, or what has its fields `resolution` and `origin`
        :raises ValueError: resolution or origin are impossible, or its first cell is beyond MAX_NUMBER
        """
        resolution = float(info.resolution)
        if not (math.isfinite(resolution) and resolution > 0):
            raise ValueError('resolution is %r m, must be above 0' % resolution)
        orientation = _orientation(info.origin.orientation)
        column, row, height = (part / resolution for part in _turned_back(orientation, info.origin.position))
        if not (abs(column) <= MAX_NUMBER and abs(row) <= MAX_NUMBER and math.isfinite(height)):
            raise ValueError('origin.position is (%r, %r, %r) m, more than %d cells away' % (
                info.origin.position.x, info.origin.position.y, info.origin.position.z, MAX_NUMBER))
        return cls(frame_name(frame_id), resolution, orientation, column, row, height)

    @property
    def corner(self) -> Tuple[int, int]:
        """Column and row of the first cell in whole numbers."""
        return round(self.column), round(self.row)

    def to(self, other: 'Lattice') -> Optional[Tuple[float, float]]:
        """Columns and rows from the first cell of this map to that of another one; None: their cells differ in size,
        or they are in different frames."""
        if other.frame != self.frame or abs(other.resolution - self.resolution) > SAME_RESOLUTION * self.resolution:
            return None
        return other.column - self.column, other.row - self.row

    def turned(self, other: 'Lattice') -> bool:
        """Whether another map is turned against this one."""
        return any(abs(a - b) > SAME_ORIENTATION for a, b in zip(other.orientation, self.orientation))

    def same(self, other: 'Lattice') -> bool:
        """Whether another map of this size lies in the same place."""
        moved = self.to(other)
        return (moved is not None and max(map(abs, moved)) <= SAME_PLACE and not self.turned(other)
                and abs(other.height - self.height) <= SAME_PLACE)


def _orientation(quaternion: Any) -> Tuple[float, float, float, float]:
    """The quaternion scaled to length 1, with w >= 0. All zeros, as careless publishers leave them, are no rotation."""
    parts = [float(getattr(quaternion, axis)) for axis in 'xyzw']
    if not all(abs(part) < 1e100 for part in parts):
        raise ValueError('origin.orientation is (%r, %r, %r, %r)' % tuple(parts))
    length = math.sqrt(sum(part * part for part in parts))
    if length == 0.0:
        return 0.0, 0.0, 0.0, 1.0
    # of a turn by half a circle, both quaternions are kept apart: such maps are rare, and only begin anew
    scale = math.copysign(1.0 / length, parts[3])
    x, y, z, w = (part * scale for part in parts)
    return x, y, z, w


def _turned_back(orientation: Tuple[float, float, float, float], position: Any) -> Tuple[float, float, float]:
    """A position in the axes of the origin: by the inverse rotation [m]."""
    x, y, z, w = orientation
    a, b, c = float(position.x), float(position.y), float(position.z)
    return ((1 - 2 * (y * y + z * z)) * a + 2 * (x * y + z * w) * b + 2 * (x * z - y * w) * c,
            2 * (x * y - z * w) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z + x * w) * c,
            2 * (x * z + y * w) * a + 2 * (y * z - x * w) * b + (1 - 2 * (x * x + y * y)) * c)
