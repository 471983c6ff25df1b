# SPDX-License-Identifier: BSD-3-Clause
"""Cloud streams: sensor_msgs/PointCloud2 of any layout, reduced by a voxel grid filter, in chunks (D6.3, section 6.1).
"""
from typing import Any, Iterable, List, Mapping, Optional, Set, Tuple

import numpy as np
from sensor_msgs.msg import PointCloud2

from ...arrays import Array, BoolArray
from ...codecs.perception.voxel import filter_with_fields, pcl, voxel_filter
from ...codecs.wire import cloud, sorted_cloud
from ...codecs.wire.cloud_fields import COORDINATES, CloudField, names_of, write_fields
from ...codecs.wire.points import Cloud, read_cloud
from ...congestion.operating_points import OperatingPoint, cloud_points
from ...copies import copies
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import CloudChunk
from ...udpros.frame import Frame
from ..codec import Codec, ImportedCodec
from ..encoder import Encoded, Encoder, LinkView, Traits
from ..outlook import Outlook
from ..parameters import HISTORY, ROBOT
from ..segments import MAIN_PART, as_bytes, room, size_on_air, write_header

MAX_TOLD = 64
"""Number of warnings that are remembered, so that they are not repeated; further ones are left out."""

PADDING = '_'
"""Name of fields without a meaning, as PCL writes them."""

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
    """Reduces each cloud, and deals its points to datagrams so that each shows all of it.

    :param codec: of the voxel filter where PCL is missing
    """
    MESSAGE, SEGMENTS = PointCloud2, {MAIN_PART: CloudChunk}
    traits = Traits(foresees=True)
    PARAMETERS = {
        **ROBOT,
        **HISTORY,
        'leaf_size': Parameter(0.1, 'm', 'edge length of the voxel grid filter: the points of a voxel are replaced by '
                               'their centroid; 0: no filter', least=0.0, most=100.0, live=True),
        'encoding': Parameter('float32', '', 'coordinates on the wire: exact (float32), quantised (packed), or also '
                              'sorted and entropy-coded (sorted)', choices=('float32', 'packed', 'sorted'), live=True),
        'error_bound': Parameter(0.0125, 'm', 'with encoding packed or sorted: maximum error of a coordinate',
                                 above=0.0, most=1.0, live=True),
        'points_per_chunk': Parameter(80, '', 'with encoding float32: points in a datagram, if it has room for them',
                                      least=1, most=5000),
        'intensity': Parameter(False, '', 'send intensities, where the cloud has them', live=True),
        'fields': Parameter('', '', 'names of further fields that are sent as they are, such as `rgb, ring`, also as a '
                            'list; not sorted', live=True, many=True),
        'min_range': Parameter(0.0, 'm', 'points nearer to the sensor than this are left out', least=0.0, most=FAR,
                               live=True),
        **{'%s_%s' % (side, axis): Parameter({'min': -FAR, 'max': FAR}[side], 'm', "crop box in the cloud's frame: "
                                            '%s %s' % ({'min': 'minimum', 'max': 'maximum'}[side], axis),
                                            least=-FAR, most=FAR, live=True) for side, axis in SIDES},
    }

    def __init__(self, settings: Mapping[str, Any], codec: Optional[Codec] = None) -> None:
        super().__init__(settings)
        self._codec = codec or ImportedCodec()
        self._told: Set[str] = set()

    @staticmethod
    def check(settings: Mapping[str, Any]) -> None:
        names_of(settings['fields'])
        for axis in 'xyz':
            low, high = settings['min_' + axis], settings['max_' + axis]
            if low > high:
                raise ValueError('min_%s is %g, above max_%s, %g' % (axis, low, axis, high))

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        if self.message_size is None or not settings.requested['leaf_size']:
            return super().operating_points(rate, settings)
        return cloud_points(rate, settings.requested['leaf_size'], self.message_size)

    def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
        reduced = _reduced(message, settings, pcl is None and self._codec.ready())
        self.warnings += reduced.problems
        if message.width:
            self._tell(message.fields, reduced, settings)
        fields = tuple(map(CloudField, reduced.extra.dtype.names or (), reduced.datatypes))
        point_format = (cloud.packed(reduced.points, settings['error_bound'], reduced.intensity, reduced.datum)
                        if settings['encoding'] != 'float32' and len(reduced.points)
                        else cloud.plain(reduced.intensity is not None, reduced.datum))
        texts = message.header.frame_id.encode(), write_fields(fields)
        chunks = _chunks(reduced, point_format, settings, room(CloudChunk, link.datagram_size, *texts),
                         _least_chunks(link.outlook))
        frame = _frame(message, texts, len(reduced.points), point_format, chunks)
        # of a cloud at the requested leaf size: a LiDAR sees surfaces, so points are as many as 1 / leaf_size ** 2
        leaf, requested = settings['leaf_size'], settings.requested['leaf_size']
        if not len(reduced.points) and self.message_size is not None:
            return Encoded([frame])     # it says nothing of what a cloud takes
        self.message_size = size_on_air([frame]) * ((leaf / requested) ** 2 if requested else 1.0)
        return Encoded([frame])

    def _tell(self, fields: Iterable[Any], sent: Cloud, settings: Settings) -> None:
        """Warn once of each field that is not sent, or not there, and of an encoding that is not used."""
        present, names = [field.name for field in fields if field.name != PADDING], names_of(settings['fields'])
        crossing = {*COORDINATES, *(sent.extra.dtype.names or ()), *['intensity'] * (sent.intensity is not None)}
        left, missing = ([name for name in some if name not in crossing] for some in (present, names))
        problems = ['not sent: %s; see its setting fields' % ', '.join(left)] * bool(left)
        problems += ['the cloud has no field %s, only %s' % (', '.join(missing), ', '.join(present))] * bool(missing)
        problems += ['its fields cannot be sorted, encoding packed is used'] * bool(
            sent.extra.dtype.names and settings['encoding'] == 'sorted')
        for problem in problems:
            if problem not in self._told and len(self._told) < MAX_TOLD:
                self._told.add(problem)
                self.warnings.append(problem)


def _least_chunks(outlook: Outlook) -> int:
    """In how many datagrams a cloud is sent at least, so that few clouds are lost with all of them."""
    loss = outlook.loss(LIKELY) if outlook.air.known else 0.0
    return max(copies(loss, LOST_CLOUDS, MOST_NEEDED), LEAST_CHUNKS)


def _chunks(reduced: Cloud, point_format: cloud.PointFormat, settings: Settings, left: int, least: int) -> cloud.Chunks:
    """The points in chunks that fit; not sorted where that takes no fewer bytes.

    :param left: in a datagram, for data and codes [byte]
    :param least: number of chunks that are sorted
    :raises ValueError: there are more points or chunks than a receiver accepts
    """
    points, intensity, extra = reduced.points, reduced.intensity, reduced.extra
    if settings['encoding'] == 'sorted' and not extra.dtype.names:
        ordered = sorted_cloud.encode(points, intensity, point_format, left, least)
        if ordered is not None and ordered.size < len(points) * point_format.size:
            return ordered
    data = point_format.write(points, intensity)
    if extra.dtype.names:
        data = np.hstack([data, extra.view(np.uint8).reshape(len(extra), extra.dtype.itemsize)])
    per_chunk = left // data.shape[1]
    if not per_chunk:
        raise ValueError('a point of %d bytes does not fit in a datagram' % data.shape[1])
    if not point_format.step:
        per_chunk = min(per_chunk, settings['points_per_chunk'])
    dealt = cloud.deal(data, max(1, -(-len(points) // per_chunk)))
    return cloud.Chunks(b'', dealt.reshape(len(dealt), -1))


def _frame(message: Any, texts: Tuple[bytes, bytes], points: int, point_format: cloud.PointFormat, chunks: cloud.Chunks
           ) -> Frame:
    """The datagrams of a cloud.

    :param texts: frame_id and fields
    """
    order = cloud.sending_order(len(chunks.data))
    frame = Frame(CloudChunk, len(order), {'header.frame_id': len(texts[0]), 'fields': len(texts[1]),
                                           'codes': len(chunks.codes), 'data': chunks.data.shape[1]})
    records = frame.records
    write_header(records, message.header)
    records['points'], records['chunks'], records['index'] = points, len(order), order
    for field in ('has_intensity', 'is_double', 'step', 'origin', 'bits', 'intensity_min', 'intensity_step'):
        records[field] = getattr(point_format, field)
    records['fields'] = as_bytes(texts[1])
    records['codes'], records['data'] = as_bytes(chunks.codes), chunks.data[order]
    return frame


def _reduced(message: Any, settings: Settings, loaded: bool) -> Cloud:
    """The points of a PointCloud2 within the crop box and beyond min_range, after the voxel grid filter; those of a
    cloud with a datum are float64 and absolute.

    :param loaded: whether compiled loops are loaded
    :raises ValueError: where the layout is wrong
    """
    found = read_cloud(message, settings['intensity'], names_of(settings['fields']))
    points, intensity, extra = found.points, found.intensity, found.extra
    kept = _cropped(points if found.datum is None else points + found.datum, settings)
    if kept is not None:
        points, intensity = points[kept], None if intensity is None else intensity[kept]
        extra = extra[kept]
    leaf = settings['leaf_size']
    if leaf and len(points):
        if extra.dtype.names:
            points, intensity, extra = filter_with_fields(points, leaf, intensity, extra)
        else:
            points, intensity = voxel_filter(points, leaf, intensity, loaded)
    if found.datum is not None:
        points = points + found.datum
    return found._replace(points=points, intensity=intensity, extra=extra)


def _cropped(points: Array, settings: Settings) -> Optional[BoolArray]:
    """(n,) bool: which points are kept; None: all of them."""
    low, high = (np.array([settings['%s_%s' % (side, axis)] for axis in 'xyz'], np.float32) for side in ('min', 'max'))
    near = settings['min_range']
    low[low == -FAR], high[high == FAR] = -np.inf, np.inf
    if near == 0 and np.isinf(low).all() and np.isinf(high).all():
        return None
    inside = ((points >= low) & (points <= high)).all(axis=1)
    kept: BoolArray = inside & (np.einsum('ij,ij->i', points, points) >= np.float32(near) ** 2)
    return kept
