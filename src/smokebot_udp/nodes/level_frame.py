# SPDX-License-Identifier: BSD-3-Clause
"""Transforms from tf: of point clouds into a level frame, for streams/virtual_scan, and poses of sensors."""
import threading
from typing import Any, Optional, Sequence, Tuple

import numpy as np
import rospy

from ..arrays import FloatArray
from ..frame_names import frame_name
from ..rotation import rotation


class TransformLookup:
    """Looks transforms up; it listens to tf from the first call on. Any thread may call it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._buffer: Any = None
        self._listener: Any = None

    def __call__(self, frame: str, header: Any) -> Optional[Tuple[FloatArray, FloatArray]]:
        """(3, 3) rotation and (3,) translation [m] into a frame, from a std_msgs/Header's at its stamp, or else the
        latest; None where tf does not know it."""
        import tf2_ros  # takes a second
        self.listen()
        for stamp in (header.stamp, rospy.Time(0)):    # the mount hardly moves, so the latest transform is good too
            try:
                found = self._buffer.lookup_transform(frame_name(frame), frame_name(header.frame_id), stamp).transform
            except tf2_ros.TransformException:
                continue
            q, t = found.rotation, found.translation
            return rotation(q.x, q.y, q.z, q.w), np.array([t.x, t.y, t.z])
        return None

    def prepare(self) -> None:
        """Listen to tf soon: the first call needs what was published before."""
        threading.Thread(target=self.listen, name='tf', daemon=True).start()

    def listen(self) -> None:
        """Listen to tf from now on."""
        import tf2_ros  # takes a second, and not every node needs it
        with self._lock:
            if self._buffer is None:
                self._buffer = tf2_ros.Buffer()
                self._listener = tf2_ros.TransformListener(self._buffer)

    def pose(self, frames: Sequence[str], header: Any) -> Any:
        """The geometry_msgs/TransformStamped of a std_msgs/Header's frame at its stamp in the first of some frames that
        tf knows; None: in none."""
        import tf2_ros  # takes a second
        self.listen()
        for frame in frames:
            try:
                return self._buffer.lookup_transform(frame_name(frame), frame_name(header.frame_id), header.stamp)
            except tf2_ros.TransformException:
                continue
        return None
