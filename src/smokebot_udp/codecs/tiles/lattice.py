# SPDX-License-Identifier: BSD-3-Clause
"""Numbers of a map's cells that do not change when the map grows or its origin moves by whole cells."""
import math
from typing import Any, NamedTuple, Optional, Tuple

MAX_NUMBER = 1 << 30
"""Largest column and row of a map's first cell, either way."""
SAME_RESOLUTION = 1e-6
"""Largest difference between the resolutions of one lattice, relative."""
SAME_PHASE = 0.01
"""Largest difference between the phases of one lattice [cell]."""
SAME_ORIENTATION = 1e-6
"""Largest difference between parts of the quaternions of one lattice; and of heights [m]."""


class Lattice(NamedTuple):
    """Where the cells of a map may lie. Columns go along the x axis of the map's origin, rows along its y axis."""
    frame_id: str
    resolution: float
    """[m/cell]"""
    orientation: Tuple[float, float, float, float]
    """Of the map's origin: x, y, z, w; of length 1, with w >= 0."""
    height: float
    """Of the origin above the cells' plane through the frame's zero, along the plane's normal [m]."""
    phase: Tuple[float, float]
    """Of the corners of cells along x and y, -0.5..0.5 [cell]."""

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
        x, y, height = _turned_back(orientation, info.origin.position)
        columns, rows = x / resolution, y / resolution
        if not (abs(columns) <= MAX_NUMBER and abs(rows) <= MAX_NUMBER and math.isfinite(height)):
            raise ValueError('origin.position is (%r, %r, %r) m, more than %d cells away' % (
                info.origin.position.x, info.origin.position.y, info.origin.position.z, MAX_NUMBER))
        return cls(frame_id, resolution, orientation, height, (columns - round(columns), rows - round(rows)))

    def corner(self, info: Any) -> Optional[Tuple[int, int]]:
        """Column and row of the first cell of a map in the same frame; None: its cells are not on this lattice.

        :raises ValueError: as `of`
        """
        other = Lattice.of(self.frame_id, info)
        if not self._like(other):
            return None
        x, y, _ = _turned_back(other.orientation, info.origin.position)
        # by this lattice's phase: at a phase of 0.5, rounding errors would else make a cell of difference
        return (round(x / other.resolution - self.phase[0]), round(y / other.resolution - self.phase[1]))

    def _like(self, other: 'Lattice') -> bool:
        return (abs(other.resolution - self.resolution) <= SAME_RESOLUTION * self.resolution
                and abs(other.height - self.height) <= SAME_ORIENTATION
                and all(abs(a - b) <= SAME_ORIENTATION for a, b in zip(other.orientation, self.orientation))
                and all(abs(math.remainder(a - b, 1.0)) <= SAME_PHASE for a, b in zip(other.phase, self.phase)))


def _orientation(quaternion: Any) -> Tuple[float, float, float, float]:
    """Of length 1 and with w >= 0; all zeros, as careless publishers leave them, are no rotation."""
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
