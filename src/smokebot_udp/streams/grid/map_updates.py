# SPDX-License-Identifier: BSD-3-Clause
"""Updates of parts of a map, as costmaps publish them: map_msgs/OccupancyGridUpdate."""
import copy
from typing import Any

import numpy as np


def updated(grid: Any, update: Any) -> Any:
    """A map with an update in it, as a new message.

    :param grid: nav_msgs/OccupancyGrid
    :param update: map_msgs/OccupancyGridUpdate
    :raises ValueError: it is not of this map
    """
    height, width = grid.info.height, grid.info.width
    if update.header.frame_id != grid.header.frame_id:
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
    result.header, result.data = update.header, cells.reshape(-1)
    return result
