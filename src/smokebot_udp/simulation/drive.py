# SPDX-License-Identifier: BSD-3-Clause
"""The robot's endless tour: along the corridor and into the rooms, with halts."""
import math
from typing import List, Tuple

from .course import Course
from .pose import Point, Pose, twist_of
from .world import DOORS, SIZE, room_centre

CORRIDOR = 7.0
"""Coordinate y of the corridor's centre line [m]."""

HALT = 4.0
"""How long the robot stands still in each room [s]."""


def way_points() -> List[Tuple[Point, float]]:
    """[((x, y) [m], how long the robot halts there [s])]: a closed tour through every room."""
    points: List[Tuple[Point, float]] = [((1.5, CORRIDOR), 0.0)]
    for column, x in enumerate(DOORS):
        for row in (0, 1):
            points += [((x, CORRIDOR), 0.0), (room_centre((column, row)), HALT), ((x, CORRIDOR), 0.0)]
    return points + [((19.5, CORRIDOR), HALT)]


def ahead(pose: Pose, distance: float) -> Pose:
    """A pose on the tour's way for a robot that is on it: straight to the corridor, and along it to its middle.

    :param distance: from the robot [m]
    """
    x, y, _ = pose
    if abs(y - CORRIDOR) < distance:
        way = math.copysign(distance, SIZE[0] / 2 - x)
        return x + way, CORRIDOR, 0.0 if way > 0 else math.pi
    way = math.copysign(distance, CORRIDOR - y)
    return x, y + way, math.copysign(math.pi / 2, way)


class Drive:
    """The robot's pose at any time: it drives straight, turns on the spot and halts, then starts the tour again.

    :param speed: [m/s], > 0
    """

    def __init__(self, speed: float = 0.7) -> None:
        points = way_points()
        (x, y), _ = points[0]
        self._course = Course((x, y, 0.0), points[1:] + points[:1], 0.0, speed)

    @property
    def period(self) -> float:
        """Duration of a tour [s]."""
        return self._course.duration

    def pose(self, time: float) -> Pose:
        """The pose at a time [s]; yaw continues beyond pi without a jump."""
        tours, time = divmod(time, self.period)
        x, y, yaw = self._course.pose(time)
        return x, y, yaw + tours * self._course.turned

    def travelled(self, time: float) -> float:
        """The distance travelled until a time [s]; [m]."""
        tours, time = divmod(time, self.period)
        return tours * self._course.length + self._course.travelled(time)

    def twist(self, time: float) -> Tuple[float, float]:
        """(forward speed [m/s], turn rate [rad/s]) at a time [s]."""
        return twist_of(self.pose, time)
