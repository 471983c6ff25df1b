# SPDX-License-Identifier: BSD-3-Clause
"""A map as it is at one moment, on the operator's side."""
from types import SimpleNamespace
from typing import Any, Callable, NamedTuple, Tuple

from genpy import Time
from geometry_msgs.msg import Point, Pose, Quaternion
from nav_msgs.msg import MapMetaData, OccupancyGrid

from ...arrays import Array
from ...numpy_messages import numpy_msg
from ..stamped_assembler import header_of

MESSAGE = numpy_msg(OccupancyGrid)


class GridSnapshot(NamedTuple):
    """A map to be shown."""
    head: SimpleNamespace
    """Head of its newest segment: stamp [ns], frame_id and info, see segments.head_of."""
    drawn: Callable[[], Tuple[Array, float]]
    """f() -> (height, width) int8, the cells; and the received share of them, 0..1. It takes time."""


def info_message(info: Tuple[Any, ...]) -> MapMetaData:
    """The message of an `info` as nested tuples, see segments.head_of."""
    load_time, resolution, width, height, (position, orientation) = info
    return MapMetaData(Time(*load_time), resolution, width, height, Pose(Point(*position), Quaternion(*orientation)))


def grid_message(head: Any, cells: Array) -> Any:
    """An OccupancyGrid of a map's place.

    :param head: with stamp [ns], frame_id and info
    :param cells: (height, width) int8
    """
    return MESSAGE(header=header_of(head), info=info_message(head.info), data=cells.reshape(-1))
