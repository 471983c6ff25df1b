# SPDX-License-Identifier: BSD-3-Clause
"""What a robot's tf says, as far as it came over the link."""
from typing import Any, Optional, Set

import genpy
import numpy as np

from ..frame_names import frame_name
from ..rotation import rotation
from .top_view import Pose

CACHE = 5.0
"""Only the newest transforms are needed [s]."""

MAX_FRAMES = 512
"""Further frames are left out."""


class Transforms:
    """Any thread may use it."""

    def __init__(self) -> None:
        import tf2_py  # takes a second
        self._error = tf2_py.TransformException
        self._buffer = tf2_py.BufferCore(genpy.Duration(CACHE))
        self._frames: Set[str] = set()

    def take(self, message: Any, static: bool) -> None:
        """Take a TFMessage; what is no transform is left out."""
        for transform in message.transforms:
            child = frame_name(transform.child_frame_id)
            if child not in self._frames and len(self._frames) >= MAX_FRAMES:
                continue
            self._frames.add(child)
            q, t = transform.transform.rotation, transform.transform.translation
            values = np.array([q.x, q.y, q.z, q.w, t.x, t.y, t.z])
            if not np.isfinite(values).all() or not abs(float(values[:4] @ values[:4]) - 1.0) < 1e-2:
                continue
            transform.header.frame_id, transform.child_frame_id = frame_name(transform.header.frame_id), child
            if static:
                self._buffer.set_transform_static(transform, 'robot')
            else:
                self._buffer.set_transform(transform, 'robot')

    def pose(self, target: str, source: str, now: float) -> Optional[Pose]:
        """The newest pose of one frame in another one; None: tf does not know it.

        :param now: by the robot's clock [s]
        """
        if frame_name(target) == frame_name(source):
            return Pose(np.eye(3), np.zeros(3))
        try:
            found = self._buffer.lookup_transform_core(frame_name(target), frame_name(source), genpy.Time(0))
        except self._error:
            return None
        q, t, stamp = found.transform.rotation, found.transform.translation, found.header.stamp.to_sec()
        return Pose(rotation(q.x, q.y, q.z, q.w), np.array([t.x, t.y, t.z]), now - stamp if stamp else None)
