# SPDX-License-Identifier: BSD-3-Clause
"""The outline of a robot, as parameters have it: a text such as '[[0.3, 0.2], [-0.3, 0.2], [0, -0.2]]'."""
import json
import math
from typing import Any, Tuple

DEFAULT_FOOTPRINT = '[[0.35, 0.25], [-0.35, 0.25], [-0.35, -0.25], [0.35, -0.25]]'
MAX_POINTS, MAX_DISTANCE = 64, 100.0
"""Maximum number of points, and limit of a point's distance from the robot's origin [m]."""

Footprint = Tuple[Tuple[float, float], ...]
"""(x, y) of each corner [m]"""


def read_footprint(text: str) -> Footprint:
    """The footprint of a text; () where it is '[]'.

    :raises ValueError: where it is none
    """
    try:
        points = json.loads(text)
    except (ValueError, RecursionError):
        points = None
    if points == []:
        return ()
    if not isinstance(points, list) or not 3 <= len(points) <= MAX_POINTS or not all(map(_is_point, points)):
        raise ValueError('footprint is %r, must be 3 to %d points [[x, y], ...], each less than %g m away' % (
            text[:200], MAX_POINTS, MAX_DISTANCE))
    return tuple((float(x), float(y)) for x, y in points)


def _is_point(point: Any) -> bool:
    return (isinstance(point, list) and len(point) == 2
            and all(type(value) in (int, float) and abs(value) < MAX_DISTANCE for value in point)
            and math.hypot(*point) < MAX_DISTANCE)
