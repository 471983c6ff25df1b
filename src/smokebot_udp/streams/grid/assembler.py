# SPDX-License-Identifier: BSD-3-Clause
"""Segments to nav_msgs/OccupancyGrid, as complete as the refresh cycles have made it (D6.3, section 5)."""
import math
import zlib
from types import SimpleNamespace
from typing import Any, Mapping, NamedTuple, Optional

import numpy as np
from genpy import Time
from geometry_msgs.msg import Point, Pose, Quaternion
from nav_msgs.msg import MapMetaData, OccupancyGrid
from rospy.numpy_msg import numpy_msg

from ...arrays import Array, BoolArray, Records
from ...codecs.concealment.fill import nearest
from ...codecs.wire.grid import unknown
from ...codecs.wire.partial_image import PartialImage
from ...codecs.wire.pixels import item_type
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import GridSegment
from ..assembler import Assembled, Assembler, Clock, no_clock
from ..carousel import Carousel
from ..parameters import OPERATOR
from ..segments import MAIN_PART, head_of, same_head, stamps_of
from ..stamped_assembler import header_of

CELL = item_type('mono8')
FILLS = {'unknown': unknown, 'nearest': nearest}
"""{`fill`: concealment method}"""


class GridSnapshot(NamedTuple):
    """A map as it is at one moment."""
    head: SimpleNamespace
    """Of its newest segment."""
    cells: Array
    """(height, width) int8"""
    completeness: float
    """Received share of the cells, 0..1."""


class GridAssembler(Assembler[GridSnapshot, Assembled]):
    """Makes a map of the segments of all cycles; it is latched."""
    MESSAGE, SEGMENTS = numpy_msg(OccupancyGrid), {MAIN_PART: GridSegment}
    LATCH, STEADY = True, False
    HEAD = 'info', 'depth'
    PARAMETERS = {
        **OPERATOR,
        'max_wait': Parameter(0.5, 's', 'longest time from the first new segment until the map is published',
                              above=0.0, most=60.0, live=True),
        'fill': Parameter('nearest', '', 'value of cells that were never received: unknown, or that of the nearest '
                          'received cell', choices=tuple(FILLS), live=True),
    }

    def __init__(self, settings: Mapping[str, Any], clock: Clock = no_clock) -> None:
        super().__init__(settings, clock)
        self._carousel = Carousel(self.begin, settings['max_wait'])
        self.dropped = self._carousel.dropped
        self._fill = FILLS[settings['fill']]
        self._last: Any = None      # content of the last map published

    @staticmethod
    def begin(head: SimpleNamespace) -> PartialImage:
        """An empty map.

        :param head: stamp, frame_id and HEAD of its segments, see segments.head_of
        :raises ValueError: the head is impossible
        """
        _, resolution, width, height, (position, orientation) = head.info
        if not (math.isfinite(resolution) and resolution > 0 and all(map(math.isfinite, position + orientation))):
            raise ValueError('a map of resolution %r at %r' % (resolution, position))
        return PartialImage(height, width, head.depth, CELL)

    def configure(self, settings: Settings, changed: Mapping[str, Any]) -> None:
        self._carousel.max_wait, self._fill = settings['max_wait'], FILLS[settings['fill']]

    def receive(self, records: Records, mask: BoolArray, now: float, part: str = MAIN_PART) -> None:
        rows = np.flatnonzero(mask)
        while len(rows):
            stamps = stamps_of(records, rows)
            same = same_head(records, rows, self.HEAD) & (stamps == stamps[0])
            head = head_of(records[rows[0]], self.SEGMENTS[part], self.HEAD)
            segments = records[rows[same]]
            _, *place = head.info       # not the load time: the same map may be loaded anew
            self._carousel.add(head, (head.frame_id, head.depth, place), (
                segments['index'].astype(int), segments['count'], segments['data'].view(np.uint8)), now)
            rows = rows[~same]

    def deadline(self) -> Optional[float]:
        return self._carousel.deadline()

    def poll(self, now: float) -> Optional[GridSnapshot]:
        found = self._carousel.poll(now)
        if found is None:
            return None
        head, grid = found      # receive() goes on changing the grid
        return GridSnapshot(head, grid.items(self._fill).view(np.int8), grid.completeness)

    def assemble(self, finished: GridSnapshot, settings: Settings, still: bool, now: float) -> Optional[Assembled]:
        head, cells, completeness = finished
        content = head.frame_id, head.info, zlib.crc32(cells.data)
        if content == self._last:
            return None     # refresh cycles repeat it
        self._last = content
        load_time, resolution, width, height, (position, orientation) = head.info
        return Assembled(self.MESSAGE(
            header=header_of(head), info=MapMetaData(Time(*load_time), resolution, width, height,
                                                     Pose(Point(*position), Quaternion(*orientation))),
            data=cells.reshape(-1)), head.stamp, completeness)
