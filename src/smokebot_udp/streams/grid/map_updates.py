# SPDX-License-Identifier: BSD-3-Clause
"""Updates of parts of a map, as costmaps publish them: map_msgs/OccupancyGridUpdate."""
import copy
from typing import Any, List

import numpy as np
from map_msgs.msg import OccupancyGridUpdate
from scipy import ndimage

from ...arrays import Array
from ...codecs.tiles.rectangle import Rectangle
from ...codecs.wire.grid import UNKNOWN
from ...frame_names import frame_name
from ...numpy_messages import numpy_msg
from .map_info import LEAST, MOST

UPDATE = numpy_msg(OccupancyGridUpdate)

BLOCK = 64
"""Side of the blocks that are compared: changes in neighbouring blocks are in one rectangle [cell]."""

MAX_RECTANGLES = 16
"""Where changes need more rectangles, one is around all of them."""


def updated(grid: Any, update: Any) -> Any:
    """A map with an update in it, as a new message.

    :param grid: nav_msgs/OccupancyGrid
    :param update: map_msgs/OccupancyGridUpdate
    :raises ValueError: it is not of this map
    """
    height, width = grid.info.height, grid.info.width
    if frame_name(update.header.frame_id) != frame_name(grid.header.frame_id):
        raise ValueError('an update in frame %r of a map in frame %r' % (update.header.frame_id, grid.header.frame_id))
    if not (0 <= update.x <= update.x + update.width <= width and 0 <= update.y <= update.y + update.height <= height):
        raise ValueError('an update of %d x %d cells at column %d, row %d of a map of %d x %d' % (
            update.width, update.height, update.x, update.y, width, height))
    if len(update.data) != update.width * update.height:
        raise ValueError('an update of %d x %d cells with %d values' % (
            update.width, update.height, len(update.data)))
    if len(grid.data) != width * height:
        raise ValueError('an update of a map of %d x %d cells with %d values' % (width, height, len(grid.data)))
    cells = np.array(grid.data, np.int8).reshape(height, width)
    cells[update.y:update.y + update.height, update.x:update.x + update.width] = np.asarray(
        update.data, np.int8).reshape(update.height, update.width)
    result = copy.copy(grid)
    result.header, result.data = copy.copy(update.header), cells.reshape(-1)
    result.header.frame_id = grid.header.frame_id
    return result


def with_legal_values(grid: Any) -> Any:
    """A map, as a new message, whose cells that have other values than an occupancy grid's are unknown."""
    cells = np.array(grid.data, np.int8)
    cells[(cells < LEAST) | (cells > MOST)] = UNKNOWN
    result = copy.copy(grid)
    result.data = cells
    return result


def same_place(before: Any, after: Any) -> bool:
    """Whether two nav_msgs/OccupancyGrids have the same cells; some mappers change the load time with each map."""
    return bool(frame_name(before.header.frame_id) == frame_name(after.header.frame_id)
                and all(getattr(before.info, name) == getattr(after.info, name)
                        for name in ('resolution', 'width', 'height', 'origin')))


def cells_of(grid: Any) -> Array:
    """(height, width) int8: the cells of a nav_msgs/OccupancyGrid."""
    return np.asarray(grid.data, np.int8).reshape(grid.info.height, grid.info.width)


def changed_rectangles(before: Array, after: Array) -> List[Rectangle]:
    """Rectangles around all cells that differ, as small as their blocks allow; empty: none does.

    :param before, after: (height, width) arrays
    """
    differs = before != after
    whole = Rectangle.around(differs)
    if whole is None:
        return []
    blocks = np.logical_or.reduceat(np.logical_or.reduceat(differs, np.arange(0, differs.shape[0], BLOCK), axis=0),
                                    np.arange(0, differs.shape[1], BLOCK), axis=1)
    labels, count = ndimage.label(blocks, np.ones((3, 3)))
    if count > MAX_RECTANGLES:
        return [whole]
    rectangles = []
    for found in ndimage.find_objects(labels):
        rows, columns = (slice(BLOCK * side.start, BLOCK * side.stop) for side in found)
        part = Rectangle.around(differs[rows, columns])
        if part is not None:
            rectangles.append(part.moved(columns.start, rows.start))
    return rectangles


def update_of(grid: Any, part: Rectangle) -> Any:
    """A part of a nav_msgs/OccupancyGrid as map_msgs/OccupancyGridUpdate."""
    cells = cells_of(grid)[part.row:part.row + part.height, part.column:part.column + part.width]
    return UPDATE(header=grid.header, x=part.column, y=part.row, width=part.width, height=part.height,
                  data=cells.reshape(-1))
