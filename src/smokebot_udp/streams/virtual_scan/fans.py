# SPDX-License-Identifier: BSD-3-Clause
"""Point clouds without their ground, computed once for all virtual scans of one cloud."""
import math
import threading
from typing import Any, Callable, List, Mapping, Optional, Tuple

import numpy as np

from ...arrays import Float32Array
from ...codecs.perception import virtual_scan
from ...codecs.perception.ground import GroundFinder
from ...codecs.wire.points import as_points

FAN_SETTINGS = ('base_frame', 'mount_height', 'mount_roll', 'mount_pitch', 'min_height', 'slope', 'range_min',
                'range_max')
"""Streams that agree in these settings share the result."""

Lookup = Callable[[str, Any], Optional[Tuple[Float32Array, Float32Array]]]
"""f(frame, header): (3, 3) rotation and (3,) translation [m] into a frame, from that of a std_msgs/Header at its stamp;
None where they are unknown."""


def rotation(x: float, y: float, z: float, w: float) -> Float32Array:
    """(3, 3) float32 rotation matrix of a unit quaternion."""
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]], np.float32)


def mounting(roll: float, pitch: float) -> Float32Array:
    """(3, 3) float32 rotation from the axes of a tilted sensor to level ones (REP 103: pitch > 0 looks down) [rad]."""
    about_y = rotation(0, math.sin(pitch / 2), 0, math.cos(pitch / 2))
    about_x = rotation(math.sin(roll / 2), 0, 0, math.cos(roll / 2))
    turn: Float32Array = about_y @ about_x
    return turn


class FanCache:
    """The last cloud of a topic as a virtual_scan.Fan, shared by the streams of that topic; any thread may call it.

    :param lookup: transforms clouds to `base_frame`; where it knows none, the settings of the mount are used
    """

    def __init__(self, lookup: Lookup = lambda frame, header: None) -> None:
        self._lookup = lookup
        self._lock = threading.Lock()
        self._message: Any = None
        self._settings: List[Any] = []
        self._result: Any = None
        self._place: Optional[Tuple[str, float]] = None     # frame and height of its origin above the ground [m]
        self._finder: Any = None                            # the GroundFinder for that place

    def fan(self, message: Any, settings: Mapping[str, Any]) -> Tuple[Any, str]:
        """The virtual_scan.Fan of a PointCloud2, and the frame it is in.

        :raises ValueError: saying what is wrong with the cloud
        """
        mine = [settings[name] for name in FAN_SETTINGS]
        with self._lock:
            if message is not self._message or mine != self._settings:
                self._result = self._compute(message, *mine)
                self._message, self._settings = message, mine
            fan, frame = self._result
            return fan, frame

    def _compute(self, message: Any, base_frame: str, mount_height: float, roll: float, pitch: float,
                 min_height: float, slope: float, range_min: float, range_max: float) -> Tuple[Any, str]:
        points, _ = as_points(message.data, message.fields, message.height, message.width, message.point_step,
                              message.row_step, message.is_bigendian)
        if not len(points):
            raise ValueError('none of its %d points is finite' % (message.height * message.width))
        if not points[:, 0].all():      # drivers write missing returns as (0, 0, 0)
            points = points[points.any(axis=1)]
        place = message.header.frame_id, mount_height
        known = self._lookup(base_frame, message.header) if base_frame else None
        if known is not None:
            turn, shift = known
            points, place = points @ turn.T + shift, (base_frame, 0.0)
        elif roll or pitch:
            points = points @ mounting(roll, pitch).T
        if place != self._place:
            self._place, self._finder = place, GroundFinder(place[1])
        return virtual_scan.fan(points, self._finder.find(points), tolerance=min_height, slope=slope,
                                range_min=range_min, range_max=range_max), place[0]
