# SPDX-License-Identifier: BSD-3-Clause
"""Chunks to sensor_msgs/PointCloud2, of the points that were received (D6.3, section 6.1)."""
import collections
from types import SimpleNamespace
from typing import Any, Deque, Mapping, NamedTuple, Optional, Tuple, Union

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from ...arrays import Array, Float32Array, Records, UInt8Array
from ...codecs.wire.cloud import CloudParts, PointFormat
from ...codecs.wire.cloud_fields import COORDINATES, CloudField, Fields, bytes_dtype, read_fields
from ...codecs.wire.sorted_parts import SortedParts
from ...frame_names import frame_name
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import CloudChunk
from ..assembler import Assembled, Clock, no_clock
from ..frame_assembler import Frame
from ..segments import MAIN_PART, MAX_SOURCES
from ..stamped_assembler import StampedAssembler, header_of

MAX_PERSISTENT_POINTS = 1000000
"""Number of points of all clouds that are kept and the newest one together, at most. The oldest clouds go first. The
newest one is always whole."""


class Points(NamedTuple):
    """Points that were published."""
    received: float
    """[s]"""
    frame: str
    """See frame_names."""
    xyz: Array
    """(n, 3) float32 or float64 [m]"""
    intensity: Optional[Float32Array]
    """(n,)"""
    extra: UInt8Array
    """(n, k) bytes of their further fields."""
    fields: Fields
    """The further fields."""


Content = Union[CloudParts, SortedParts]


class CloudAssembler(StampedAssembler[Content, Assembled]):
    """Makes one cloud of each stamp's chunks."""
    MESSAGE, SEGMENTS = PointCloud2, {MAIN_PART: CloudChunk}
    QUEUE_SIZE = MAX_SOURCES
    HEADS = {MAIN_PART: ('points', 'chunks', 'has_intensity', 'is_double', 'step', 'origin', 'bits', 'intensity_min',
                         'intensity_step', 'fields', 'codes')}
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
                                   head.intensity_step, bool(head.is_double))
        fields = read_fields(head.fields)
        if fields and (head.codes or (head.has_intensity and 'intensity' in [field.name for field in fields])):
            raise ValueError('fields of sorted points, or a second intensity')
        if head.codes:
            return SortedParts(head.points, head.chunks, point_format, bytes(head.codes))
        return CloudParts(head.points, head.chunks, point_format, bytes_dtype(fields).itemsize)

    def parts(self, records: Records, part: str) -> Tuple[Any, ...]:
        return records['index'].astype(int), records['data']

    def assemble(self, finished: Frame[Content], settings: Settings, still: bool, now: float) -> Optional[Assembled]:
        head, cloud = finished.head, finished.content
        if isinstance(cloud, SortedParts):
            xyz, intensity = cloud.merge()
            extra = np.zeros((len(xyz), 0), np.uint8)
            self.dropped['broken'] += cloud.broken
        else:
            xyz, intensity, extra = cloud.merge_with_fields()
        points = Points(now, frame_name(head.frame_id), xyz, intensity, extra, read_fields(head.fields))
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
                           or earlier[0].frame != points.frame
                           or (earlier[0].intensity is None) != (points.intensity is None)
                           or earlier[0].fields != points.fields):
            earlier.popleft()
        earlier.append(points)
        while len(earlier) > 1 and sum(len(kept.xyz) for kept in earlier) > MAX_PERSISTENT_POINTS:
            earlier.popleft()
        intensities = [kept.intensity for kept in earlier if kept.intensity is not None]
        return points._replace(xyz=np.concatenate([kept.xyz for kept in earlier]),
                               extra=np.concatenate([kept.extra for kept in earlier]),
                               intensity=np.concatenate(intensities) if intensities else None)


def _message(head: SimpleNamespace, points: Points) -> PointCloud2:
    is_double = points.xyz.dtype == np.float64
    fields, columns, step = [], [_bytes(points.xyz, '<f8' if is_double else '<f4')], 0
    named = [CloudField(name, PointField.FLOAT64 if is_double else PointField.FLOAT32) for name in COORDINATES]
    if points.intensity is not None:
        named.append(CloudField('intensity', PointField.FLOAT32))
        columns.append(_bytes(points.intensity, '<f4'))
    if points.fields:
        columns.append(points.extra)
    for field in (*named, *points.fields):
        fields.append(PointField(field.name, step, field.datatype, 1))
        step += bytes_dtype((field,)).itemsize
    data = columns[0] if len(columns) == 1 else np.hstack(columns)
    return PointCloud2(header=header_of(head), height=1, width=len(data), point_step=step,
                       row_step=step * len(data), is_dense=True, fields=fields, data=data.tobytes())


def _bytes(values: Array, dtype: str) -> UInt8Array:
    """(n, k) uint8: the bytes of each row of (n, ...) values."""
    written = np.ascontiguousarray(values, dtype)
    return written.view(np.uint8).reshape(len(values), written.itemsize * (3 if values.ndim > 1 else 1))
