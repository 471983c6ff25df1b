# SPDX-License-Identifier: BSD-3-Clause
"""A map's nav_msgs/MapMetaData: checked, and written into segments."""
import math
from typing import Any, Sequence, Tuple, Union

import numpy as np

from ...arrays import Array, Records
from ...rotation import rotation


def check_origin(origin: Any) -> None:
    """:raises ValueError: naming the coordinate of a geometry_msgs/Pose that is not finite"""
    for part in (origin.position, origin.orientation):
        for axis in part.__slots__:
            if not math.isfinite(getattr(part, axis)):
                raise ValueError('origin.%s is %r' % (axis, getattr(part, axis)))


LEAST, MOST = -1, 100
"""Values of an occupancy grid."""


def check_values(cells: Union[Sequence[int], Array]) -> None:
    """:raises ValueError: naming a value that is none of an occupancy grid

    :param cells: int8
    """
    found = np.asarray(cells, np.int8)
    for value in (int(found.min(initial=0)), int(found.max(initial=0))):
        if not LEAST <= value <= MOST:
            raise ValueError('data has the value %d, must be from -1 to 100; coding: interleaved sends any' % value)


def write_info(records: Records, info: Any, resolution: float, shape: Tuple[int, int]) -> None:
    """Write MapMetaData into the `info` of all segments.

    :param info: nav_msgs/MapMetaData: the load time and the origin
    :param resolution: of the map as sent [m]
    :param shape: its rows and columns
    """
    for unit in ('secs', 'nsecs'):
        records['map_load_time'][unit] = getattr(info.map_load_time, unit)
    records['resolution'] = resolution
    records['height'], records['width'] = shape
    for part in ('position', 'orientation'):
        values = getattr(info.origin, part)
        for axis in values.__slots__:
            records['origin'][part][axis] = getattr(values, axis)


def cell_at(info: Any, x: float, y: float, z: float) -> Tuple[float, float]:
    """The place of a point of the map's frame, in columns and rows from the outer corner of the first cell.

    :param info: nav_msgs/MapMetaData
    :param x, y, z: [m]
    """
    at, turn = info.origin.position, info.origin.orientation
    inverse = rotation(turn.x, turn.y, turn.z, turn.w).T
    along, across, _ = inverse @ (x - at.x, y - at.y, z - at.z) / info.resolution
    return float(along), float(across)
