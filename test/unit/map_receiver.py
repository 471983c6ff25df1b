# SPDX-License-Identifier: BSD-3-Clause
"""A model of an operator's side of maps in tiles: cells by revision; no care for forged segments, or for time."""
from typing import Any, Dict, List, Optional, Tuple

import numpy as np

from smokebot_udp.codecs.tiles import coder
from smokebot_udp.msg import MapTile
from smokebot_udp.streams.held import Holding
from smokebot_udp.udpros.datagram import OVERHEAD


def segments_of(frames: Any) -> List[Any]:
    """The messages of frames."""
    return [MapTile().deserialize(row[OVERHEAD:].tobytes()) for frame in frames for row in frame.rows]


class MapReceiver:
    """Shows what it received."""

    def __init__(self) -> None:
        self.session: Optional[int] = None
        self.head: Any = None
        self.cells: Dict[Tuple[int, int], int] = {}
        self.beats: List[Any] = []
        self.overviews: List[Any] = []
        self.tiles: List[Any] = []
        self._values = self._revisions = np.empty((0, 0), np.int64)

    def receive(self, segment: Any) -> None:
        if segment.session != self.session:
            self.session, self.head = segment.session, None
        if self.head is None or segment.revision >= self.head.revision:
            self._resize(segment)
        if not segment.size[0]:
            self.beats.append(segment)
        elif segment.shift:
            self.overviews.append(segment)
        else:
            self.tiles.append(segment)
            self._show(segment)

    def _resize(self, segment: Any) -> None:
        info, before, old = segment.info, self.head, (self._values, self._revisions)
        self.head = segment
        if before is not None and (before.corner, before.info) == (segment.corner, info):
            return
        self._values = np.full((info.height, info.width), -1, np.int64)
        self._revisions = np.zeros((info.height, info.width), np.int64)
        if before is None:
            return
        column, row = (before.corner[axis] - segment.corner[axis] for axis in (0, 1))
        top, left = max(0, row), max(0, column)
        bottom = min(info.height, row + before.info.height)
        right = min(info.width, column + before.info.width)
        if top < bottom and left < right:
            for new, last in zip((self._values, self._revisions), old):
                new[top:bottom, left:right] = last[top - row:bottom - row, left - column:right - column]

    def _show(self, segment: Any) -> None:
        cells = coder.decode(np.frombuffer(segment.data, np.uint8), segment.size[1], segment.size[0])
        row, column = segment.place[1] - self.head.corner[1], segment.place[0] - self.head.corner[0]
        first, left = max(0, -row), max(0, -column)
        cells = cells[first:, left:]
        row, column = row + first, column + left
        values = self._values[row:row + cells.shape[0], column:column + cells.shape[1]]
        revisions = self._revisions[row:row + cells.shape[0], column:column + cells.shape[1]]
        cells = cells[:values.shape[0], :values.shape[1]]
        newer = revisions < segment.revision
        values[newer], revisions[newer] = cells[newer], segment.revision

    @property
    def map(self) -> Any:
        """(height, width) of the map as shown; -1 where nothing was received."""
        return self._values

    @property
    def complete(self) -> bool:
        """Whether each cell was received."""
        return self.head is not None and bool((self._revisions > 0).all())

    def holding(self) -> Optional[Holding]:
        """What it reports: the revisions of the cells shown."""
        if self.session is None:
            return None
        return Holding.of(self.session, [revision for revision in np.unique(self._revisions).tolist() if revision])
