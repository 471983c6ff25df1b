# SPDX-License-Identifier: BSD-3-Clause
"""A way that the robot drives: straight lines, turns on the spot and halts, one after the other."""
from typing import Iterable, Optional, Tuple

import numpy as np

from .pose import Point, Pose, wrapped

TURN_RATE = 0.7
"""[rad/s]"""

MIN_STEP = 1e-9
"""Points that are closer than this are the same [m]."""


class Course:
    """The pose at each time from the start of a way; before and after it the robot stands still.

    :param start: the pose from which it leads
    :param points: ((x, y) [m], how long the robot halts there [s]) of each point, in order
    :param yaw: to turn to at the end [rad]; None: the robot stays as it came
    :param speed: [m/s], > 0
    """

    def __init__(self, start: Pose, points: Iterable[Tuple[Point, float]], yaw: Optional[float], speed: float) -> None:
        self._speed = speed
        self._time_list, self._pose_list = [0.0], [start]
        for point, halt in points:
            self._drive_to(point)
            self._hold(halt)
        if yaw is not None:
            self._turn_to(yaw)
        self._times, self._poses = np.array(self._time_list), np.array(self._pose_list, float)
        self._distances = np.append(0.0, np.hypot(*np.diff(self._poses[:, :2], axis=0).T).cumsum())

    def _append(self, duration: float, pose: Pose) -> None:
        if duration > 0:
            self._time_list.append(self._time_list[-1] + duration)
            self._pose_list.append(pose)

    def _drive_to(self, point: Point) -> None:
        x, y, _ = self._pose_list[-1]
        step = np.subtract(point, (x, y))
        length = float(np.hypot(*step))
        if length >= MIN_STEP:
            self._turn_to(float(np.arctan2(step[1], step[0])))
            self._append(length / self._speed, (point[0], point[1], self._pose_list[-1][2]))

    def _turn_to(self, yaw: float) -> None:
        x, y, heading = self._pose_list[-1]
        turn = wrapped(yaw - heading)
        self._append(abs(turn) / TURN_RATE, (x, y, heading + turn))

    def _hold(self, duration: float) -> None:
        self._append(duration, self._pose_list[-1])

    @property
    def duration(self) -> float:
        """[s]"""
        return float(self._times[-1])

    @property
    def length(self) -> float:
        """[m]"""
        return float(self._distances[-1])

    @property
    def turned(self) -> float:
        """All turns together, those to the left positive [rad]."""
        return float(self._poses[-1, 2] - self._poses[0, 2])

    def pose(self, time: float) -> Pose:
        """The pose at a time from the start [s]; yaw continues beyond pi without a jump."""
        x, y, yaw = (float(np.interp(time, self._times, self._poses[:, i])) for i in range(3))
        return x, y, yaw

    def travelled(self, time: float) -> float:
        """The distance travelled until a time from the start [s]; [m]."""
        return float(np.interp(time, self._times, self._distances))
