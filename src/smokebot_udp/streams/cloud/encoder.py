# SPDX-License-Identifier: BSD-3-Clause
"""Cloud streams: sensor_msgs/PointCloud2 of any layout, reduced by a voxel grid filter, in chunks (D6.3, section 6.1).
"""
from typing import Any, List, Mapping, Optional, Tuple

import numpy as np
from sensor_msgs.msg import PointCloud2

from ...arrays import BoolArray, Float32Array
from ...codecs.perception.voxel import voxel_filter
from ...codecs.wire import cloud
from ...codecs.wire.points import as_points
from ...congestion.operating_points import OperatingPoint, cloud_points
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import CloudChunk
from ...udpros.frame import Frame
from ..encoder import Encoder
from ..parameters import ROBOT
from ..segments import MAIN_PART, room, size_on_air, write_header

FAR = 1000.0
"""The crop box does not crop at this distance [m]."""

SIDES = tuple((side, axis) for axis in 'xyz' for side in ('min', 'max'))


class CloudEncoder(Encoder[Any]):
    """Reduces each cloud, and deals its points to datagrams so that each shows all of it."""
    MESSAGE, SEGMENTS = PointCloud2, {MAIN_PART: CloudChunk}
    PARAMETERS = {
        **ROBOT,
        'leaf_size': Parameter(0.1, 'm', 'edge length of the voxel grid filter: the points of a voxel are replaced by '
                               'their centroid; 0: no filter', least=0.0, most=100.0, live=True),
        'encoding': Parameter('float32', '', 'coordinates on the wire: exact (float32) or quantised (packed)',
                              choices=('float32', 'packed'), live=True),
        'error_bound': Parameter(0.0125, 'm', 'with encoding packed: maximum error of a coordinate', above=0.0,
                                 most=1.0, live=True),
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
        packed = settings['encoding'] == 'packed' and len(points)
        point_format = (cloud.packed(points, settings['error_bound'], intensity) if packed
                        else cloud.plain(intensity is not None))
        frame_id = message.header.frame_id.encode()
        per_chunk = room(CloudChunk, max_datagram_size, frame_id) // point_format.size
        if not point_format.step:
            per_chunk = min(per_chunk, settings['points_per_chunk'])
        dealt = cloud.deal(point_format.write(points, intensity), max(1, -(-len(points) // per_chunk)))
        order = cloud.sending_order(len(dealt))
        frame = Frame(CloudChunk, len(dealt), {'header.frame_id': len(frame_id), 'data': dealt[0].size})
        records = frame.records
        write_header(records, message.header)
        records['points'], records['chunks'], records['index'] = len(points), len(dealt), order
        records['has_intensity'] = point_format.has_intensity
        for field in ('step', 'origin', 'bits', 'intensity_min', 'intensity_step'):
            records[field] = getattr(point_format, field)
        records['data'] = dealt[order].reshape(len(dealt), -1)
        # of a cloud at the requested leaf size: a LiDAR sees surfaces, so points are as many as 1 / leaf_size ** 2
        leaf, requested = settings['leaf_size'], settings.requested['leaf_size']
        self.message_size = size_on_air([frame]) * ((leaf / requested) ** 2 if requested else 1.0)
        return [frame]


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
