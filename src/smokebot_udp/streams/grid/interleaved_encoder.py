# SPDX-License-Identifier: BSD-3-Clause
"""Maps reduced by max-pooling, in interleaved segments, repeated (D6.3, section 5)."""
import zlib
from typing import Any, List, NamedTuple, Optional, Tuple

from ...arrays import Array
from ...codecs.wire import grid
from ...congestion.operating_points import OperatingPoint, map_points
from ...mission.settings import Settings
from ...msg import GridSegment
from ...udpros.datagram import IP_UDP_HEADERS
from ...udpros.frame import Frame
from ..segments import room, write_header
from ..subimages import subimage_frames, write_subimages
from .map_info import write_info


class _Requested(NamedTuple):
    """Size of a map on the wire with the requested settings."""
    segments: int
    datagram: int
    """[byte of IP packet]"""


class InterleavedMaps:
    """Sends a changed map at once, and repeats an unchanged one. Methods are as Encoder's of the same name."""

    def __init__(self) -> None:
        self._content: Optional[Tuple[Any, ...]] = None     # what distinguishes the frames' map from others
        self._frames: List[Frame] = []
        self._header: Any = None                            # of the last message
        self._requested: Optional[_Requested] = None

    def operating_points(self, settings: Settings) -> List[OperatingPoint]:
        return map_points(settings.requested['repeat_rate'], *self._requested) if self._requested else []

    def encode(self, message: Any, cells: Array, settings: Settings, max_datagram_size: int) -> List[Frame]:
        """
        :param cells: (height, width) int8: the map's
        """
        info = message.info
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
            write_info(frame.records['info'], info, info.resolution * factor, (cut.height, cut.width))
        frames = [frame for _, frame in parts]
        self._content, self._frames = content, frames
        self._requested = _Requested(-(-len(requested_cut) // requested_per_segment),
                                     frames[0].datagram_size + IP_UDP_HEADERS)
        return list(frames)

    def repeat_period(self, settings: Settings) -> float:
        return 1.0 / float(settings['repeat_rate'])

    def repeat(self) -> List[Frame]:
        """The same frames, with the stamp of the last message."""
        for frame in self._frames:
            write_header(frame.records, self._header)
        return self._frames
