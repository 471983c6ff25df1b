# SPDX-License-Identifier: BSD-3-Clause
"""Cloud streams: sensor_msgs/PointCloud2 of any layout, reduced by a voxel grid filter, in chunks (D6.3, section 6.1).
"""
import math
from typing import Any, List, Mapping, Optional, Tuple

import numpy as np
from sensor_msgs.msg import PointCloud2

from ...arrays import BoolArray, Float32Array
from ...codecs.perception.voxel import voxel_filter
from ...codecs.wire import cloud, sorted_cloud
from ...codecs.wire.points import as_points
from ...congestion.operating_points import OperatingPoint, cloud_points
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import CloudChunk
from ...udpros.frame import Frame
from ..encoder import Encoder
from ..outlook import Outlook
from ..parameters import ROBOT
from ..segments import MAIN_PART, as_bytes, room, size_on_air, write_header

FAR = 1000.0
"""The crop box does not crop at this distance [m]."""

LEAST_CHUNKS, MOST_NEEDED = 8, 32
"""Sorted clouds are sent in at least so many datagrams, and in more, up to so many, where the loss requires it."""
LOST_CLOUDS = 0.1
"""Ratio of the clouds that may be lost with all their datagrams."""
LIKELY = 0.7
"""Probability that the loss is no higher than expected."""

SIDES = tuple((side, axis) for axis in 'xyz' for side in ('min', 'max'))


class CloudEncoder(Encoder[Any]):
    """Reduces each cloud, and deals its points to datagrams so that each shows all of it."""
    MESSAGE, SEGMENTS = PointCloud2, {MAIN_PART: CloudChunk}
    FORESEES = True
    PARAMETERS = {
        **ROBOT,
        'leaf_size': Parameter(0.1, 'm', 'edge length of the voxel grid filter: the points of a voxel are replaced by '
                               'their centroid; 0: no filter', least=0.0, most=100.0, live=True),
        'encoding': Parameter('float32', '', 'coordinates on the wire: exact (float32), quantised (packed), or also '
                              'sorted and entropy-coded (sorted)', choices=('float32', 'packed', 'sorted'), live=True),
        'error_bound': Parameter(0.0125, 'm', 'with encoding packed or sorted: maximum error of a coordinate',
                                 above=0.0, most=1.0, live=True),
        'points_per_chunk': Parameter(80, '', 'with encoding float32: points in a datagram, if it has room for them',
                                      least=1, most=5000),
        'intensity': Parameter(False, '', 'send intensities, where the cloud has them', live=True),
        'min_range': Parameter(0.0, 'm', 'points nearer to the sensor than this are left out', least=0.0, most=FAR,
                               live=True),
        **{'%s_%s' % (side, axis): Parameter({'min': -FAR, 'max': FAR}[side], 'm', "crop box in the cloud's frame: "
                                            '%s %s' % ({'min': 'minimum', 'max': 'maximum'}[side], axis),
                                            least=-FAR, most=FAR, live=True) for side, axis in SIDES},
    }

    @staticmethod
    def check(settings: Mapping[str, Any]) -> None:
        for axis in 'xyz':
            low, high = settings['min_' + axis], settings['max_' + axis]
            if low > high:
                raise ValueError('min_%s is %g, above max_%s, %g' % (axis, low, axis, high))

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        if self.message_size is None or not settings.requested['leaf_size']:
            return super().operating_points(rate, settings)
        return cloud_points(rate, settings.requested['leaf_size'], self.message_size)

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Frame]:
        points, intensity = _reduced(message, settings)
        point_format = (cloud.packed(points, settings['error_bound'], intensity)
                        if settings['encoding'] != 'float32' and len(points) else cloud.plain(intensity is not None))
        frame_id = message.header.frame_id.encode()
        chunks = _chunks(points, intensity, point_format, settings, room(CloudChunk, max_datagram_size, frame_id),
                         _least_chunks(self.outlook))
        frame = _frame(message, frame_id, len(points), point_format, chunks)
        # of a cloud at the requested leaf size: a LiDAR sees surfaces, so points are as many as 1 / leaf_size ** 2
        leaf, requested = settings['leaf_size'], settings.requested['leaf_size']
        self.message_size = size_on_air([frame]) * ((leaf / requested) ** 2 if requested else 1.0)
        return [frame]


def _least_chunks(outlook: Outlook) -> int:
    """In how many datagrams a cloud is sent at least, so that few clouds are lost with all of them."""
    loss = outlook.loss(LIKELY) if outlook.air.known else 0.0
    if not 0 < loss < 1:
        return MOST_NEEDED if loss else LEAST_CHUNKS
    return min(max(math.ceil(math.log(LOST_CLOUDS) / math.log(loss)), LEAST_CHUNKS), MOST_NEEDED)


def _chunks(points: Float32Array, intensity: Optional[Float32Array], point_format: cloud.PointFormat,
            settings: Settings, left: int, least: int) -> cloud.Chunks:
    """The points in chunks that fit; not sorted where that takes no fewer bytes.

    :param left: in a datagram, for data and codes [byte]
    :param least: number of chunks that are sorted
    :raises ValueError: there are more points or chunks than a receiver accepts
    """
    if settings['encoding'] == 'sorted':
        ordered = sorted_cloud.encode(points, intensity, point_format, left, least)
        if ordered is not None and ordered.size < len(points) * point_format.size:
            return ordered
    per_chunk = left // point_format.size
    if not point_format.step:
        per_chunk = min(per_chunk, settings['points_per_chunk'])
    dealt = cloud.deal(point_format.write(points, intensity), max(1, -(-len(points) // per_chunk)))
    return cloud.Chunks(b'', dealt.reshape(len(dealt), -1))


def _frame(message: Any, frame_id: bytes, points: int, point_format: cloud.PointFormat, chunks: cloud.Chunks) -> Frame:
    """The datagrams of a cloud."""
    order = cloud.sending_order(len(chunks.data))
    frame = Frame(CloudChunk, len(order), {'header.frame_id': len(frame_id), 'codes': len(chunks.codes),
                                           'data': chunks.data.shape[1]})
    records = frame.records
    write_header(records, message.header)
    records['points'], records['chunks'], records['index'] = points, len(order), order
    records['has_intensity'] = point_format.has_intensity
    for field in ('step', 'origin', 'bits', 'intensity_min', 'intensity_step'):
        records[field] = getattr(point_format, field)
    records['codes'], records['data'] = as_bytes(chunks.codes), chunks.data[order]
    return frame


def _reduced(message: Any, settings: Settings) -> Tuple[Float32Array, Optional[Float32Array]]:
    """The points of a PointCloud2 within the crop box and beyond min_range, after the voxel grid filter.

    :return: (n, 3) float32; (n,) float32 intensities, or None
    :raises ValueError: where the layout is wrong, or no point is finite
    """
    points, intensity = as_points(
        message.data, message.fields, message.height, message.width, message.point_step, message.row_step,
        message.is_bigendian, settings['intensity'])
    if not len(points):
        raise ValueError('none of its %d points is finite' % (message.height * message.width))
    kept = _cropped(points, settings)
    if kept is not None:
        points, intensity = points[kept], None if intensity is None else intensity[kept]
    leaf = settings['leaf_size']
    return voxel_filter(points, leaf, intensity) if leaf and len(points) else (points, intensity)


def _cropped(points: Float32Array, settings: Settings) -> Optional[BoolArray]:
    """(n,) bool: which points are kept; None: all of them."""
    low, high = (np.array([settings['%s_%s' % (side, axis)] for axis in 'xyz'], np.float32) for side in ('min', 'max'))
    near = settings['min_range']
    if near == 0 and (low == -FAR).all() and (high == FAR).all():
        return None
    inside = ((points >= low) & (points <= high)).all(axis=1)
    kept: BoolArray = inside & (np.einsum('ij,ij->i', points, points) >= np.float32(near) ** 2)
    return kept
