# SPDX-License-Identifier: BSD-3-Clause
"""Where the wheels say that the robot is: off by a drift that comes with the way it travels, not with time.

A pose (x, y, yaw) [m, rad] is also the transform of what is told in its axes into those it is told in.
"""
import numpy as np

DRIFT = (0.30, 45.0), (0.20, 31.0), (0.04, 60.0)
"""Of x [m], y [m] and yaw [rad]: the most, and the way [m] on which it would come if it went on as it begins. A real
drift knows no most; this one comes back, so that a demonstration of hours stays on the screen."""


def compose(outer, inner):
    """The pose `inner`, told in the axes of the pose `outer`, in the axes that this is told in."""
    x, y, yaw = outer
    return (x + inner[0] * np.cos(yaw) - inner[1] * np.sin(yaw),
            y + inner[0] * np.sin(yaw) + inner[1] * np.cos(yaw), yaw + inner[2])


def inverse(pose):
    """What compose() with it makes (0, 0, 0)."""
    x, y, yaw = pose
    return -x * np.cos(yaw) - y * np.sin(yaw), x * np.sin(yaw) - y * np.cos(yaw), -yaw


class Odometry:
    """Of a robot on a drive.Drive; compose(correction(t), pose(t)) is its true pose."""

    def __init__(self, drive):
        self._drive = drive

    def correction(self, time):
        """Where the odometry's origin is in the map, as a SLAM finds it: (x, y, yaw); nowhere else at first."""
        way = self._drive.travelled(time)
        return tuple(most * np.sin(way / length) for most, length in DRIFT)

    def pose(self, time):
        """(x, y, yaw) in the odometry's axes."""
        return compose(inverse(self.correction(time)), self._drive.pose(time))

    def twist(self, time):
        """(speed ahead [m/s], turn rate [rad/s]); the drift's own share, below 1 %, is left out."""
        return self._drive.twist(time)
