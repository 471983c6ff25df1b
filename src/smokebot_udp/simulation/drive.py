# SPDX-License-Identifier: BSD-3-Clause
"""The robot's endless tour: along the corridor and into the rooms, with halts."""
from typing import List, Tuple

import numpy as np

from .pose import Pose
from .world import DOORS, room_centre

CORRIDOR = 7.0
"""y of the corridor's centre line [m]."""

TURN_RATE = 0.7
"""[rad/s]"""

HALT = 4.0
"""How long the robot stands still in each room [s]."""


def way_points() -> List[Tuple[Tuple[float, float], bool]]:
    """[((x, y) [m], whether the robot halts there)]: a closed tour through every room."""
    points = [((1.5, CORRIDOR), False)]
    for column, x in enumerate(DOORS):
        for row in (0, 1):
            points += [((x, CORRIDOR), False), (room_centre((column, row)), True), ((x, CORRIDOR), False)]
    return points + [((19.5, CORRIDOR), True)]


class Drive:
    """The robot's pose at any time: it drives straight, turns on the spot and halts, then starts the tour again.

    :param speed: [m/s], > 0
    """

    def __init__(self, speed: float = 0.7) -> None:
        points = way_points()
        heading = 0.0
        times, poses = [0.0], [points[0][0] + (heading,)]

        def append(duration: float, position: Tuple[float, float]) -> None:
            if duration > 0:
                times.append(times[-1] + duration)
                poses.append(position + (heading,))

        for (here, _), (there, halt) in zip(points, points[1:] + points[:1]):
            step = np.subtract(there, here)
            length = float(np.hypot(*step))
            if length < 1e-9:
                continue
            turn = _wrapped(np.arctan2(step[1], step[0]) - heading)
            heading += turn
            append(abs(turn) / TURN_RATE, here)
            append(length / speed, there)
            if halt:
                append(HALT, there)
        turn = _wrapped(-heading)
        heading += turn
        append(abs(turn) / TURN_RATE, points[0][0])
        self._times, self._poses = np.array(times), np.array(poses)
        self._distances = np.append(0.0, np.hypot(*np.diff(self._poses[:, :2], axis=0).T).cumsum())
        self._turned = self._poses[-1, 2] - self._poses[0, 2]   # in a tour [rad]

    @property
    def period(self) -> float:
        """Duration of a tour [s]."""
        return float(self._times[-1])

    def pose(self, time: float) -> Pose:
        """The pose at a time [s]; yaw continues beyond pi without a jump."""
        tours, time = divmod(time, self.period)
        x, y, yaw = (float(np.interp(time, self._times, self._poses[:, i])) for i in range(3))
        return x, y, yaw + tours * self._turned

    def travelled(self, time: float) -> float:
        """The distance travelled until a time [s]; [m]."""
        tours, time = divmod(time, self.period)
        return float(tours * self._distances[-1] + np.interp(time, self._times, self._distances))

    def twist(self, time: float, step: float = 1e-3) -> Tuple[float, float]:
        """(forward speed [m/s], turn rate [rad/s]) at a time [s].

        :param step: of the numerical derivative [s]
        """
        x0, y0, yaw0 = self.pose(time)
        x1, y1, yaw1 = self.pose(time + step)
        return ((x1 - x0) * np.cos(yaw0) + (y1 - y0) * np.sin(yaw0)) / step, (yaw1 - yaw0) / step


def _wrapped(angle: float) -> float:
    return (angle + np.pi) % (2 * np.pi) - np.pi
