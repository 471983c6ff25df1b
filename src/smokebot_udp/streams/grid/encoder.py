# SPDX-License-Identifier: BSD-3-Clause
"""Grid streams: nav_msgs/OccupancyGrid, reduced by max-pooling, in interleaved segments, repeated (D6.3, section 5)."""
import math
import zlib
from typing import Any, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from nav_msgs.msg import OccupancyGrid
from rospy.numpy_msg import numpy_msg

from ...arrays import Records
from ...codecs.wire import grid
from ...congestion.operating_points import OperatingPoint, map_points
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import GridSegment
from ...udpros.datagram import IP_UDP_HEADERS
from ...udpros.frame import Frame
from ..encoder import Encoder
from ..parameters import ROBOT
from ..segments import MAIN_PART, room, size_on_air, write_header
from ..subimages import subimage_frames, write_subimages


class _Requested(NamedTuple):
    """Size of a map on the wire with the requested settings."""
    segments: int
    datagram: int
    """[byte of IP packet]"""


class GridEncoder(Encoder[Any]):
    """Sends a changed map at once, and repeats an unchanged one."""
    MESSAGE, SEGMENTS = numpy_msg(OccupancyGrid), {MAIN_PART: GridSegment}
    STEADY, STAMPED = False, False
    KEEPS = REENCODES = True    # a map may be published only once
    PARAMETERS = {
        **ROBOT,
        'repeat_rate': Parameter(0.2, 'Hz', 'rate at which an unchanged map is repeated, for lost datagrams and late '
                                 'subscribers', above=0.0, most=100.0, live=True),
        'max_cells': Parameter(1300, '', 'maximum number of cells in a segment', least=1, most=65000, live=True),
        'max_segments': Parameter(256, '', 'maximum number of segments of a map, which is reduced until it fits',
                                  least=1, most=65536, live=True),
    }

    def __init__(self, settings: Mapping[str, Any]) -> None:
        super().__init__(settings)
        self._content: Optional[Tuple[Any, ...]] = None     # what distinguishes the frames' map from others
        self._frames: List[Frame] = []
        self._header: Any = None                            # of the last message
        self._requested: Optional[_Requested] = None

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        return map_points(settings.requested['repeat_rate'], *self._requested) if self._requested else []

    def encode(self, message: Any, settings: Settings, max_datagram_size: int) -> List[Frame]:
        info = message.info
        cells = grid.as_cells(message.data, info.height, info.width, info.resolution)
        check_origin(info.origin)
        frame_id = message.header.frame_id.encode()
        (factor, cut, per_segment), (_, requested_cut, requested_per_segment) = (grid.fit(
            info.height, info.width, room(GridSegment, max_datagram_size, frame_id),
            values['max_cells'], values['max_segments']) for values in (settings, settings.requested))
        cells = grid.reduce_by(cells, factor)
        content = frame_id, str(info.origin), info.resolution, factor, cut, per_segment, zlib.crc32(cells.tobytes())
        self._header = message.header
        if content == self._content:
            return []
        subimages = cut.split(cells).reshape(len(cut), -1)
        parts = subimage_frames(GridSegment, subimages, per_segment, {'header.frame_id': len(frame_id)})
        for part, frame in parts:
            write_header(frame.records, message.header)
            write_subimages(frame.records, cut, part, subimages)
            write_info(frame.records['info'], info, cut, factor)
        frames = [frame for _, frame in parts]
        self._content, self._frames = content, frames
        self._requested = _Requested(-(-len(requested_cut) // requested_per_segment),
                                     frames[0].datagram_size + IP_UDP_HEADERS)
        self.message_size = size_on_air(frames)
        return list(frames)

    def repeat_period(self, settings: Settings) -> Optional[float]:
        return 1.0 / float(settings['repeat_rate'])

    def repeat(self, settings: Settings, max_datagram_size: int) -> Sequence[Frame]:
        """The same frames, with the stamp of the last message."""
        for frame in self._frames:
            write_header(frame.records, self._header)
        return self._frames


def check_origin(origin: Any) -> None:
    """:raises ValueError: naming the coordinate of a geometry_msgs/Pose that is not finite"""
    for part in (origin.position, origin.orientation):
        for axis in part.__slots__:
            if not math.isfinite(getattr(part, axis)):
                raise ValueError('origin.%s is %r' % (axis, getattr(part, axis)))


def write_info(records: Records, info: Any, cut: Any, factor: int) -> None:
    """Write the MapMetaData of the reduced map into the `info` of all segments.

    :param info: nav_msgs/MapMetaData of the whole map
    :param cut: interleave.Interleave of the reduced map
    :param factor: by which it is reduced
    """
    for unit in ('secs', 'nsecs'):
        records['map_load_time'][unit] = getattr(info.map_load_time, unit)
    records['resolution'], records['width'], records['height'] = info.resolution * factor, cut.width, cut.height
    for part in ('position', 'orientation'):
        values = getattr(info.origin, part)
        for axis in values.__slots__:
            records['origin'][part][axis] = getattr(values, axis)
