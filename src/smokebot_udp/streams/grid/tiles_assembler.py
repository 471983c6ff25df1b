# SPDX-License-Identifier: BSD-3-Clause
"""Maps in tiles on the operator's side: segments in, the map as it is known at one moment out."""
import math
from types import SimpleNamespace
from typing import Any, Counter, List, Optional

import numpy as np

from ...arrays import Array, BoolArray, Records, UInt8Array
from ..held import Holding
from .ages import age_message
from .identified_map import Candidates, IdentifiedMap
from .snapshot import GridSnapshot
from .tile_segment import TileSegment, read
from .tiled_map import Decode, TiledMap

BURST = 0.05
"""A map is shown this long after its first new segment: a change is in several of them [s]."""


def decode(data: UInt8Array, height: int, width: int) -> Array:
    """See codecs.tiles.coder.decode."""
    from ...codecs.tiles import coder  # compiled: it takes 1 s and 100 MB to import

    return coder.decode(data, height, width)


class TilesAssembler:
    """Receives the tiles of a stream. Methods are as those of Assembler with the same names.

    :param rate: maps a second that are shown, at most; may be changed at any time [Hz]
    :param dropped: {reason: count} of segments that changed nothing, to be added to
    """

    def __init__(self, rate: float, dropped: Counter[str], decoded: Decode = decode) -> None:
        self.rate = rate
        self.heard = -math.inf
        """When a segment of the present map was received [s]."""
        self._dropped, self._decode = dropped, decoded
        self._candidates = Candidates(dropped)
        self._identity: Optional[IdentifiedMap] = None
        self._map: Any = None           # TiledMap, once there is an identity; and the newest of its segments
        self._newest: Any = None
        self._since: Optional[float] = None     # when the first segment was received that is not shown [s]
        self._shown = -math.inf                 # when a map was shown last [s]

    def receive(self, records: Records, mask: BoolArray, now: float) -> None:
        for row in np.flatnonzero(mask):
            try:
                segment = read(records[row])
                segments = self._proven(segment, now)
            except ValueError:
                self._dropped['impossible head'] += 1
                continue
            for one in segments:
                self._add(one, now)

    def _proven(self, segment: TileSegment, now: float) -> List[TileSegment]:
        """The segments of the present map that there are with this one; it may be another map from now on.

        :raises ValueError: its map is impossible
        """
        if self._identity is not None and self._identity.has(segment):
            self._candidates.clear()
            return [segment]
        segments = self._candidates.add(segment, now)
        if segments:
            self._begin(segment, now)
        return segments

    def _begin(self, segment: TileSegment, now: float) -> None:
        former, self._identity = self._identity, IdentifiedMap(segment)
        way = None if former is None else former.way(segment)
        if former is None or way is None:
            self._map, self._since = TiledMap(segment.area, self._decode, self._dropped), None
            return
        if former.session != segment.session:
            self._map.begin_session(segment.area.column - former.area.column - way[0],
                                    segment.area.row - former.area.row - way[1])
        if former.area != segment.area:
            self._map.move(segment.area)
        self.show(now)

    def _add(self, segment: TileSegment, now: float) -> None:
        self.heard, self._newest = now, segment
        if self._map.add(segment, now):
            self.show(now)

    def show(self, now: float) -> None:
        """Show the present map soon, if anything is known of it."""
        if self._since is None and self._map is not None and not self._map.empty:
            self._since = now

    def deadline(self) -> Optional[float]:
        return None if self._since is None else max(self._since + BURST, self._shown + 1.0 / self.rate)

    def poll(self, now: float) -> Optional[GridSnapshot]:
        deadline = self.deadline()
        if deadline is None or now < deadline:
            return None
        self._since, self._shown = None, now
        head = SimpleNamespace(stamp=self._newest.stamp, frame_id=self._newest.frame_id, info=self._newest.info)
        return GridSnapshot(head, *self._map.shown())

    def holding(self) -> Optional[Holding]:
        if self._identity is not None:
            return Holding.of(self._identity.session, self._map.canvas.held)
        session = self._candidates.session
        return None if session is None else Holding(session, ())

    def ages(self, now: float) -> Optional[Any]:
        if self._map is None or self._map.empty:
            return None
        return age_message(self._newest, self._newest.area, self._map.ages.seconds(now))
