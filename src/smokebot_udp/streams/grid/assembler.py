# SPDX-License-Identifier: BSD-3-Clause
"""Segments to nav_msgs/OccupancyGrid: in tiles, or interleaved and as complete as the refresh cycles have made it
(D6.3, section 5). Whichever came last is shown.
"""
import math
import zlib
from types import SimpleNamespace
from typing import Any, Mapping, NamedTuple, Optional

import numpy as np

from ...arrays import BoolArray, Records
from ...codecs.concealment.fill import nearest
from ...codecs.tiles.lattice import Lattice
from ...codecs.tiles.rectangle import Rectangle
from ...codecs.wire.grid import unknown
from ...codecs.wire.partial_image import PartialImage
from ...codecs.wire.pixels import item_type
from ...frame_names import frame_name
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import GridSegment, MapTile
from ..assembler import Assembled, Assembler, Clock, Work, no_clock
from ..carousel import Carousel
from ..held import Holding
from ..parameters import OPERATOR, ROBOT
from ..segments import MAIN_PART, TILES, head_of, same_head, stamps_of
from .ages import age_message, uniform
from .snapshot import MESSAGE, GridSnapshot, grid_message, info_message
from .tiles_assembler import TilesAssembler

CELL = item_type('mono8')
FILLS = {'unknown': unknown, 'nearest': nearest}
"""{`fill`: concealment method}"""

SILENCE = 3.0
"""An interleaved map is shown once no tiles were heard for this long, three statements of the robot: it does not send
both, and a forged segment must not begin a map [s]."""


class _Interleaved(NamedTuple):
    """The interleaved map that is shown."""
    head: SimpleNamespace
    heard: float
    """When a segment of it was received last [s]."""


class _Place:
    """Place of an interleaved map. Maps of one size whose origins are less than a cell apart complete each other: an
    origin may move with each map, and cells that did not come are rather those of the map before than unknown."""

    def __init__(self, head: SimpleNamespace) -> None:
        _, *self._exact = head.info     # not the load time: the same map may be loaded anew
        self._size = frame_name(head.frame_id), head.depth, head.info[2:4]
        try:
            self._lattice: Optional[Lattice] = Lattice.of(head.frame_id, info_message(head.info))
        except ValueError:      # `begin` refuses most of them
            self._lattice = None

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _Place) or self._size != other._size:
            return False
        if self._lattice is None or other._lattice is None:
            return bool(self._exact == other._exact)
        way = self._lattice.to(other._lattice)
        return way is not None and max(map(abs, way)) < 1 and not self._lattice.turned(other._lattice)


class GridAssembler(Assembler[GridSnapshot, Assembled]):
    """Makes a map of the segments; it is latched."""
    MESSAGE, SEGMENTS = MESSAGE, {MAIN_PART: GridSegment, TILES: MapTile}
    COMPILED = frozenset([TILES])
    LATCH, STEADY = True, False
    HEAD = 'info', 'depth'
    PARAMETERS = {
        **OPERATOR,
        'rate': ROBOT['rate'],
        'max_wait': Parameter(0.5, 's', 'interleaved: longest time from the first new segment until the map is '
                              'published', above=0.0, most=60.0, live=True),
        'fill': Parameter('nearest', '', 'interleaved: value of cells that were never received: unknown, or that of '
                          'the nearest received cell', choices=tuple(FILLS), live=True),
        'publish_age': Parameter(True, '', 'whether a map of ages is published once a second, on '
                                 'operator_topic/age: 3..100: seconds since a region was received or confirmed; 0: '
                                 'less than 3; -1: never'),
        'publish_updates': Parameter(False, '', 'whether changes are published on operator_topic_updates, as '
                                     'map_msgs/OccupancyGridUpdate, and the map as a whole only when its size or place '
                                     'changes and to new subscribers'),
    }

    def __init__(self, settings: Mapping[str, Any], clock: Clock = no_clock) -> None:
        super().__init__(settings, clock)
        self._carousel = Carousel(self.begin, settings['max_wait'])
        self.dropped = self._carousel.dropped
        self._tiles = TilesAssembler(settings['rate'], self.dropped)
        self._fill = FILLS[settings['fill']]
        self._interleaved: Optional[_Interleaved] = None    # None: the map in tiles is shown
        self._last: Any = None      # content of the last map published

    @staticmethod
    def begin(head: SimpleNamespace) -> PartialImage:
        """An empty interleaved map.

        :param head: stamp, frame_id and HEAD of its segments, see segments.head_of
        :raises ValueError: the head is impossible
        """
        _, resolution, width, height, (position, orientation) = head.info
        if not (math.isfinite(resolution) and resolution > 0 and all(map(math.isfinite, position + orientation))):
            raise ValueError('a map of resolution %r at %r' % (resolution, position))
        return PartialImage(height, width, head.depth, CELL)

    def configure(self, settings: Settings, changed: Mapping[str, Any]) -> None:
        self._carousel.max_wait, self._fill = settings['max_wait'], FILLS[settings['fill']]
        self._tiles.rate = settings['rate']

    def receive(self, records: Records, mask: BoolArray, now: float, part: str = MAIN_PART) -> None:
        if part == MAIN_PART:
            self._receive_interleaved(records, mask, now)
            return
        self._tiles.receive(records, mask, now)

    def _receive_interleaved(self, records: Records, mask: BoolArray, now: float) -> None:
        rows = np.flatnonzero(mask)
        while len(rows):
            stamps = stamps_of(records, rows)
            same = same_head(records, rows, self.HEAD) & (stamps == stamps[0])
            head = head_of(records[rows[0]], GridSegment, self.HEAD)
            segments = records[rows[same]]
            self._carousel.add(head, _Place(head), (
                segments['index'].astype(int), segments['count'], segments['data'].view(np.uint8)), now)
            rows = rows[~same]

    def deadline(self) -> Optional[float]:
        if self._tiles.waiting:
            return -math.inf
        deadlines = [found for found in (self._tiles.deadline(), self._interleaved_deadline()) if found is not None]
        return min(deadlines, default=None)

    def work(self) -> Optional[Work]:
        heard = self._tiles.heard
        work = self._tiles.work()
        if self._interleaved is not None and self._tiles.heard > heard:
            self._tiles.show(self._tiles.heard)
        return work

    def _interleaved_deadline(self) -> Optional[float]:
        deadline = self._carousel.deadline()
        if deadline is None or self._carousel.latest < self._tiles.heard:
            return None     # the robot went on to tiles
        return max(deadline, self._tiles.heard + SILENCE)

    def poll(self, now: float) -> Optional[GridSnapshot]:
        snapshot = self._tiles.poll(now)
        if snapshot is not None:
            self._interleaved = None
            return snapshot
        deadline = self._interleaved_deadline()
        found = None if deadline is None or now < deadline else self._carousel.poll(now)
        if found is None:
            return None
        self._interleaved = _Interleaved(found[0], self._carousel.latest)
        grid, fill = found[1].copy(), self._fill    # receive() goes on changing the grid
        return GridSnapshot(found[0], lambda: (grid.items(fill).view(np.int8), grid.completeness))

    def assemble(self, finished: GridSnapshot, settings: Settings, still: bool, now: float) -> Optional[Assembled]:
        head = finished.head
        cells, completeness = finished.drawn()
        content = head.frame_id, head.info, zlib.crc32(cells.data)
        if content == self._last:
            return None     # refresh cycles repeat it
        self._last = content
        return Assembled(grid_message(head, cells), head.stamp, completeness)

    def holding(self) -> Optional[Holding]:
        return self._tiles.holding()

    def ages(self, now: float) -> Optional[Any]:
        if self._interleaved is None:
            return self._tiles.ages(now)
        head, heard = self._interleaved
        area = Rectangle(0, 0, *head.info[2:4])     # each cycle brings cells of all regions
        return age_message(head, area, uniform(area, now - heard))
