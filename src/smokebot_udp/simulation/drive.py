# SPDX-License-Identifier: BSD-3-Clause
"""The robot's endless round: along the corridor, into the rooms, with halts."""
import numpy as np

from .world import DOORS, room_centre

CORRIDOR = 7.0
TURN_RATE = 0.7
"""[rad/s]"""
HALT = 4.0
"""How long the robot stands in each room [s]."""


def way_points():
    """[((x, y), halt there or not), ...]: a closed way through every room."""
    points = [((1.5, CORRIDOR), False)]
    for column, x in enumerate(DOORS):
        for row in (0, 1):
            points += [((x, CORRIDOR), False), (room_centre((column, row)), True), ((x, CORRIDOR), False)]
    return points + [((19.5, CORRIDOR), True)]


class Drive:
    """Where the robot is at any time. Straight on, turns on the spot, halts; then the same again.

    :param speed: [m/s], > 0
    """

    def __init__(self, speed=0.7):
        self._times, self._poses = [0.0], []
        points = way_points()
        heading = 0.0
        self._poses.append(points[0][0] + (heading,))
        for (here, _), (there, halt) in zip(points, points[1:] + points[:1]):
            step = np.subtract(there, here)
            length = np.hypot(*step)
            if length < 1e-9:
                continue
            turn = _wrapped(np.arctan2(step[1], step[0]) - heading)
            heading += turn
            self._append(abs(turn) / TURN_RATE, here + (heading,))
            self._append(length / speed, tuple(there) + (heading,))
            if halt:
                self._append(HALT, tuple(there) + (heading,))
        turn = _wrapped(-heading)
        self._append(abs(turn) / TURN_RATE, points[0][0] + (heading + turn,))
        self._poses = np.array(self._poses)
        self._times = np.array(self._times)
        self._ways = np.append(0.0, np.hypot(*np.diff(self._poses[:, :2], axis=0).T).cumsum())
        self._winding = self._poses[-1, 2] - self._poses[0, 2]

    def _append(self, duration, pose):
        if duration > 0:
            self._times.append(self._times[-1] + duration)
            self._poses.append(pose)

    @property
    def period(self):
        """How long one round takes [s]."""
        return self._times[-1]

    def pose(self, time):
        """(x, y, yaw) at a time [s]; yaw goes on beyond pi, without a jump."""
        rounds, time = divmod(time, self.period)
        x, y, yaw = (np.interp(time, self._times, self._poses[:, i]) for i in range(3))
        return x, y, yaw + rounds * self._winding

    def travelled(self, time):
        """The length of the way until a time [m]."""
        rounds, time = divmod(time, self.period)
        return rounds * self._ways[-1] + np.interp(time, self._times, self._ways)

    def twist(self, time, step=1e-3):
        """(speed ahead [m/s], turn rate [rad/s]) at a time."""
        x0, y0, yaw0 = self.pose(time)
        x1, y1, yaw1 = self.pose(time + step)
        return ((x1 - x0) * np.cos(yaw0) + (y1 - y0) * np.sin(yaw0)) / step, (yaw1 - yaw0) / step


def _wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi
