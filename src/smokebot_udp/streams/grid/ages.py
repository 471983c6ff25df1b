# SPDX-License-Identifier: BSD-3-Clause
"""How old the knowledge of each region of a map is: since it was received, or the robot said that it is current."""
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Pose

from ...arrays import Array
from ...codecs.tiles.rectangle import Rectangle
from ...codecs.wire.grid import UNKNOWN
from ...rotation import rotation
from .placed import moved, renumbered
from .snapshot import grid_message

SHIFT = 4
"""A region has 2^SHIFT cells a side: hardly any tile is smaller."""

FRESH = 3.0
"""Smaller ages are shown as 0: statements come once a second, and a lost one should not make the map blink [s]."""

OLDEST = 100
"""Greater ages are shown as this one [s]."""


class Ages:
    """Times of the regions of a map, by any steady clock.

    :param area: the map's rectangle [cell]
    """

    def __init__(self, area: Rectangle) -> None:
        self.area, self.blocks = area, area.blocks(SHIFT)
        shape = self.blocks.height, self.blocks.width
        self._cells: Array = np.full(shape, np.nan)       # when cells were known to be current; NaN: never [s]
        self._coarse: Array = np.full(shape, np.nan)      # likewise an overview of them [s]

    def move(self, area: Rectangle) -> None:
        """Change the map's rectangle."""
        blocks = area.blocks(SHIFT)
        self._cells, self._coarse = (moved(times, self.blocks, blocks, np.nan) for times in (self._cells, self._coarse))
        self.area, self.blocks = area, blocks

    def renumber(self, columns: int, rows: int) -> None:
        """Number the cells by as many more."""
        self._cells, self._coarse = (renumbered(times, self.area, columns, rows, SHIFT)
                                     for times in (self._cells, self._coarse))
        self.area = self.area.moved(columns, rows)
        self.blocks = self.area.blocks(SHIFT)

    def received(self, place: Rectangle, now: float) -> None:
        """Note that cells were received."""
        self._cells[self.blocks.slices(place.blocks(SHIFT))] = now

    def received_coarse(self, place: Rectangle, now: float) -> None:
        """Note that an overview of some cells was received."""
        self._coarse[self.blocks.slices(place.blocks(SHIFT))] = now

    def confirm(self, pending: Array, now: float) -> None:
        """Note that all that was received is current, except for some of it.

        :param pending: (n, 4) int: column, row, width, height of rectangles of tiles that may be missing [cell]
        """
        current = np.where(np.isnan(self._cells), np.nan, now)
        for rectangle in pending.tolist():
            missing = Rectangle(*rectangle).within(self.area)
            if not missing.empty:
                region = self.blocks.slices(missing.blocks(SHIFT))
                current[region] = self._cells[region]
        self._cells = current

    def seconds(self, now: float) -> Array:
        """(rows, columns) int8: the age of each region, 0..OLDEST; UNKNOWN: nothing was received [s]."""
        return _shown(now - np.where(np.isnan(self._cells), self._coarse, self._cells))


def _shown(ages: Array) -> Array:
    """int8: ages as they are shown; NaN: nothing was received [s]."""
    known = ~np.isnan(ages)
    seconds = np.full(ages.shape, UNKNOWN, np.int8)
    seconds[known] = np.where(ages[known] < FRESH, 0, np.minimum(ages[known], OLDEST))
    return seconds


def uniform(area: Rectangle, age: float) -> Array:
    """(rows, columns) int8: one age of a whole map [s]."""
    blocks = area.blocks(SHIFT)
    return _shown(np.full((blocks.height, blocks.width), age))


def age_message(head: Any, area: Rectangle, seconds: Array) -> Any:
    """An OccupancyGrid of ages, one value for each block that the map touches.

    :param head: of the map: stamp [ns], frame_id and info, see segments.head_of
    :param area: the map's rectangle on its lattice [cell]
    :param seconds: (rows, columns) int8
    """
    message = grid_message(head, seconds)
    blocks, info = area.blocks(SHIFT), message.info
    x, y = ((first << SHIFT) - cell for first, cell in ((blocks.column, area.column), (blocks.row, area.row)))
    info.origin = _shifted(info.origin, x * info.resolution, y * info.resolution)
    info.resolution, info.width, info.height = info.resolution * (1 << SHIFT), blocks.width, blocks.height
    return message


def _shifted(pose: Pose, x: float, y: float) -> Pose:
    """A pose moved along its own axes [m]."""
    q = pose.orientation
    at = rotation(q.x, q.y, q.z, q.w) @ (x, y, 0.0) + (pose.position.x, pose.position.y, pose.position.z)
    return Pose(Point(*at.tolist()), q)
