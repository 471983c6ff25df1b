# SPDX-License-Identifier: BSD-3-Clause
"""Cloud streams: sensor_msgs/PointCloud2 of any layout, thinned by a voxel grid, in chunks (D6.3, section 6.1)."""
import collections
import time

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from ..codecs.perception.voxel import voxel_filter
from ..codecs.wire import cloud
from ..codecs.wire.points import as_points
from ..congestion.operating_points import cloud_levels, rate_levels
from ..mission.parameters import Parameter
from ..msg import CloudChunk
from ..udpros import Frame
from .base import RobotStream
from .gather import GatheringReceiver
from .outbox import size_of
from .parameters import ROBOT
from .segments import room, write_header

FAR = 1000.0
SIDES = tuple((side, axis) for axis in 'xyz' for side in ('min', 'max'))


class CloudSender(RobotStream):
    """Thins each cloud, and deals its points to datagrams so that each shows all of it."""
    MESSAGE, SEGMENT = PointCloud2, CloudChunk
    PARAMETERS = {
        **ROBOT,
        'leaf_size': Parameter(0.1, 'm', 'points in a box of this side become their centroid; 0: all are sent',
                               least=0.0, most=100.0, live=True),
        'encoding': Parameter('float32', '', 'how coordinates are written: exact, or as short offsets',
                              choices=('float32', 'packed'), live=True),
        'error_bound': Parameter(0.0125, 'm', 'with encoding packed: how far a coordinate may be off', above=0.0,
                                 most=1.0, live=True),
        'points_per_chunk': Parameter(80, '', 'with encoding float32: so many points a datagram, or as many as it has '
                                      'room for', least=1, most=5000),
        'intensity': Parameter(False, '', 'whether intensities are sent, where the cloud has them', live=True),
        'min_range': Parameter(0.0, 'm', "points nearer to the sensor than this are left out", least=0.0, most=FAR,
                               live=True),
        **{'%s_%s' % (side, axis): Parameter({'min': -FAR, 'max': FAR}[side], 'm', 'crop box, in the cloud\'s frame: '
                                            '%s is %s' % (axis, {'min': 'at least', 'max': 'at most'}[side]),
                                            least=-FAR, most=FAR, live=True) for side, axis in SIDES},
    }

    _finest = None  # bytes on the air of a cloud as it is asked for

    def levels(self, rate):
        if self._finest is None:
            return []
        leaf = self.asked['leaf_size']
        return cloud_levels(rate, leaf, self._finest) if leaf else rate_levels(rate, self._finest)

    def prepare(self):
        super().prepare()
        self._low, self._high = (np.array([self.settings['%s_%s' % (side, axis)] for axis in 'xyz'], np.float32)
                                 for side in ('min', 'max'))
        for axis, low, high in zip('xyz', self._low, self._high):
            if low > high:
                raise ValueError('min_%s is %g, above max_%s, %g' % (axis, low, axis, high))

    def frames(self, message):
        points, intensity = self._reduced(message)
        packed = self.settings['encoding'] == 'packed' and len(points)
        point_format = (cloud.packed(points, self.settings['error_bound'], intensity) if packed
                        else cloud.plain(intensity is not None))
        frame_id = message.header.frame_id.encode()
        per_chunk = room(CloudChunk, self.link.datagram_size, frame_id) // point_format.size
        if not point_format.step:
            per_chunk = min(per_chunk, self.settings['points_per_chunk'])
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
        # what a LiDAR sees is surfaces: as many boxes as their side's square has room for
        leaf, asked = self.settings['leaf_size'], self.asked['leaf_size']
        self._finest = size_of([frame]) * ((leaf / asked) ** 2 if asked else 1.0)
        return [frame]

    def _reduced(self, message):
        """The cloud's points within the crop box and beyond the least range, thinned."""
        points, intensity = as_points(
            message.data, message.fields, message.height, message.width, message.point_step, message.row_step,
            message.is_bigendian, self.settings['intensity'])
        if not len(points):
            raise ValueError('none of its %d points is finite' % (message.height * message.width))
        kept = self._kept(points)
        if kept is not None:
            points, intensity = points[kept], None if intensity is None else intensity[kept]
        leaf = self.settings['leaf_size']
        return voxel_filter(points, leaf, intensity) if leaf and len(points) else (points, intensity)

    def _kept(self, points):
        """(n,) bool, or None where all are."""
        near = self.settings['min_range']
        if near == 0 and (self._low == -FAR).all() and (self._high == FAR).all():
            return None
        inside = (points >= self._low) & (points <= self._high)
        return inside.all(axis=1) & (np.einsum('ij,ij->i', points, points) >= np.float32(near) ** 2)


class CloudReceiver(GatheringReceiver):
    """Publishes each stamp's cloud, of the points that came."""
    MESSAGE, SEGMENT = PointCloud2, CloudChunk
    PARAMETERS = {
        **GatheringReceiver.PARAMETERS,
        'persistence': Parameter(0.0, 's', 'while the robot stands, points of earlier clouds stay so long', least=0.0,
                                 most=3600.0, live=True),
    }
    HEAD = 'points', 'chunks', 'has_intensity', 'step', 'origin', 'bits', 'intensity_min', 'intensity_step'

    def __init__(self, name, settings, link):
        self._earlier = collections.deque()     # (when, frame_id, points, intensity)
        super().__init__(name, settings, link)

    def begin(self, head):
        return cloud.CloudParts(head.points, head.chunks, cloud.PointFormat(
            bool(head.has_intensity), head.step, head.origin, head.bits, head.intensity_min, head.intensity_step))

    def parts(self, records):
        return records['index'].astype(int), records['data']

    def message(self, head, picture):
        points, intensity = self._with_earlier(head.frame_id, *picture.merge())
        names = ['x', 'y', 'z'] + ['intensity'] * (intensity is not None)
        values = points if intensity is None else np.column_stack([points, intensity])
        step = 4 * len(names)
        return PointCloud2(
            height=1, width=len(points), point_step=step, row_step=step * len(points), is_dense=True,
            fields=[PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate(names)],
            data=np.ascontiguousarray(values, '<f4').tobytes())

    def _with_earlier(self, frame_id, points, intensity):
        """The points with those of earlier clouds that still stand for something."""
        now, persistence = time.monotonic(), self.settings['persistence']
        earlier = self._earlier
        if not persistence or not self.link.motion.stands():
            earlier.clear()
        while earlier and (now - earlier[0][0] > persistence or earlier[0][1] != frame_id
                           or (earlier[0][3] is None) != (intensity is None)):
            earlier.popleft()
        if persistence:
            earlier.append((now, frame_id, points, intensity))
            points = np.concatenate([kept for _, _, kept, _ in earlier])
            intensity = None if intensity is None else np.concatenate([kept for _, _, _, kept in earlier])
        return points, intensity
