# SPDX-License-Identifier: BSD-3-Clause
"""Chunks to sensor_msgs/PointCloud2, of the points that were received (D6.3, section 6.1)."""
import collections
from types import SimpleNamespace
from typing import Any, Deque, Mapping, NamedTuple, Optional, Tuple, Union

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from ...arrays import Float32Array, Records
from ...codecs.wire.cloud import CloudParts, PointFormat
from ...codecs.wire.sorted_parts import SortedParts
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import CloudChunk
from ..assembler import Assembled, Clock, no_clock
from ..frame_assembler import Frame
from ..segments import MAIN_PART
from ..stamped_assembler import StampedAssembler, header_of

MAX_PERSISTENT_POINTS = 1000000
"""Of all clouds that are kept and the newest one together; the oldest clouds go first. The newest is always whole."""


class Points(NamedTuple):
    """Points that were published."""
    received: float
    """[s]"""
    frame_id: str
    xyz: Float32Array
    """(n, 3) [m]"""
    intensity: Optional[Float32Array]
    """(n,)"""


Content = Union[CloudParts, SortedParts]


class CloudAssembler(StampedAssembler[Content, Assembled]):
    """Makes one cloud of each stamp's chunks."""
    MESSAGE, SEGMENTS = PointCloud2, {MAIN_PART: CloudChunk}
    HEADS = {MAIN_PART: ('points', 'chunks', 'has_intensity', 'step', 'origin', 'bits', 'intensity_min',
                         'intensity_step', 'codes')}
    PARAMETERS = {
        **StampedAssembler.PARAMETERS,
        'persistence': Parameter(0.0, 's', 'how long the points of earlier clouds are kept while the robot stands '
                                 'still; %d points at most, the newest' % MAX_PERSISTENT_POINTS, least=0.0,
                                 most=3600.0, live=True),
    }

    def __init__(self, settings: Mapping[str, Any], clock: Clock = no_clock) -> None:
        super().__init__(settings, clock)
        self._earlier: Deque[Points] = collections.deque()

    def begin(self, head: SimpleNamespace) -> Content:
        point_format = PointFormat(bool(head.has_intensity), head.step, head.origin, head.bits, head.intensity_min,
                                   head.intensity_step)
        if head.codes:
            return SortedParts(head.points, head.chunks, point_format, bytes(head.codes))
        return CloudParts(head.points, head.chunks, point_format)

    def parts(self, records: Records, part: str) -> Tuple[Any, ...]:
        return records['index'].astype(int), records['data']

    def assemble(self, finished: Frame[Content], settings: Settings, still: bool, now: float) -> Optional[Assembled]:
        head, cloud = finished.head, finished.content
        points = Points(now, head.frame_id, *cloud.merge())
        if isinstance(cloud, SortedParts):
            self.dropped['broken'] += cloud.broken
        if not cloud.have.any():    # nothing can be read
            return None
        persistence = settings['persistence']
        if persistence:
            points = self._with_earlier(points, persistence, still)
        else:
            self._earlier.clear()
        return Assembled(_message(head, points), head.stamp, cloud.completeness)

    def _with_earlier(self, points: Points, persistence: float, still: bool) -> Points:
        """The points, and those of earlier clouds that are still valid."""
        earlier = self._earlier
        if not still:
            earlier.clear()
        while earlier and (points.received - earlier[0].received > persistence
                           or earlier[0].frame_id != points.frame_id
                           or (earlier[0].intensity is None) != (points.intensity is None)):
            earlier.popleft()
        earlier.append(points)
        while len(earlier) > 1 and sum(len(kept.xyz) for kept in earlier) > MAX_PERSISTENT_POINTS:
            earlier.popleft()
        intensities = [kept.intensity for kept in earlier if kept.intensity is not None]
        return points._replace(xyz=np.concatenate([kept.xyz for kept in earlier]),
                               intensity=np.concatenate(intensities) if intensities else None)


def _message(head: SimpleNamespace, points: Points) -> PointCloud2:
    names = ['x', 'y', 'z'] + ['intensity'] * (points.intensity is not None)
    values = points.xyz if points.intensity is None else np.column_stack([points.xyz, points.intensity])
    step = 4 * len(names)
    return PointCloud2(
        header=header_of(head), height=1, width=len(values), point_step=step, row_step=step * len(values),
        is_dense=True, fields=[PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate(names)],
        data=np.ascontiguousarray(values, '<f4').tobytes())
