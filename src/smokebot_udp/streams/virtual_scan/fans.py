# SPDX-License-Identifier: BSD-3-Clause
"""Point clouds without their ground, computed once for all virtual scans of one cloud."""
import math
import threading
from typing import Any, Callable, List, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import FloatArray
from ...codecs.perception import virtual_scan
from ...codecs.perception.ground import GroundFinder
from ...codecs.wire.points import read_cloud
from ...frame_names import frame_name, unknown_transform
from ...rotation import rotation
from ..codec import Codec, ImportedCodec

FAN_SETTINGS = ('base_frame', 'mount_height', 'mount_roll', 'mount_pitch', 'min_height', 'slope', 'range_min',
                'range_max')
"""Streams that agree in these settings share the result."""

BY_THE_MOUNT = 'mount_height, mount_roll and mount_pitch are used'

Lookup = Callable[[str, Any], Optional[Tuple[FloatArray, FloatArray]]]
"""f(frame, header): (3, 3) rotation and (3,) translation [m] into a frame, from that of a std_msgs/Header at its stamp;
None where they are unknown."""


class Levelled(NamedTuple):
    """A cloud without its ground."""
    fan: virtual_scan.Fan
    frame: str
    """Frame that the cloud is in."""
    problems: Tuple[str, ...]
    """Problems of the cloud, and of tf."""


def mounting(roll: float, pitch: float) -> FloatArray:
    """(3, 3) rotation from the axes of a tilted sensor to level ones (REP 103: pitch > 0 looks down) [rad]."""
    about_y = rotation(0, math.sin(pitch / 2), 0, math.cos(pitch / 2))
    about_x = rotation(math.sin(roll / 2), 0, 0, math.cos(roll / 2))
    turn: FloatArray = about_y @ about_x
    return turn


class FanCache:
    """The last cloud of a topic as a virtual_scan.Fan, shared by the streams of that topic; any thread may call it.

    :param lookup: transforms clouds to `base_frame`; where it knows none, the settings of the mount are used; None:
        there is no tf
    :param codec: of the ground's plane
    """

    def __init__(self, lookup: Optional[Lookup] = None, codec: Optional[Codec] = None) -> None:
        self._lookup, self._codec = lookup, codec or ImportedCodec()
        self._lock = threading.Lock()
        self._message: Any = None
        self._settings: List[Any] = []
        self._result: Optional[Levelled] = None
        self._place: Optional[Tuple[str, float]] = None     # frame and height of its origin above the ground [m]
        self._finder: Any = None                            # the GroundFinder for that place

    def fan(self, message: Any, settings: Mapping[str, Any]) -> Levelled:
        """The fan of a PointCloud2.

        :raises ValueError: saying what is wrong with the cloud
        """
        mine = [settings[name] for name in FAN_SETTINGS]
        with self._lock:
            if self._result is None or message is not self._message or mine != self._settings:
                self._result = self._compute(message, settings)
                self._message, self._settings = message, mine
            return self._result

    def _compute(self, message: Any, settings: Mapping[str, Any]) -> Levelled:
        cloud = read_cloud(message)
        points, datum, problems = cloud.points, np.zeros(3) if cloud.datum is None else cloud.datum, cloud.problems
        if cloud.datum is None and not points[:, 0].all():      # drivers write missing returns as (0, 0, 0)
            points = points[points.any(axis=1)]
        frame, height, base_frame = message.header.frame_id, settings['mount_height'], settings['base_frame']
        turn, shift = mounting(settings['mount_roll'], settings['mount_pitch']), np.zeros(3)
        if base_frame and self._lookup is not None:
            known = self._lookup(base_frame, message.header)
            if known is not None:
                (turn, shift), frame, height = known, base_frame, 0.0
            else:
                problems += unknown_transform(message.header.frame_id, base_frame, BY_THE_MOUNT),
        shift = turn @ datum + shift
        if shift.any() or (turn != np.eye(3)).any():
            points = points @ turn.T.astype(np.float32) + shift.astype(np.float32)
        place = frame_name(frame), height
        if place != self._place:
            self._place, self._finder = place, GroundFinder(height)
        plane = self._finder.find(points, self._codec.ready())
        fan = virtual_scan.fan(points, plane, tolerance=settings['min_height'], slope=settings['slope'],
                               range_min=settings['range_min'], range_max=settings['range_max'])
        return Levelled(fan, frame, problems)
