# SPDX-License-Identifier: BSD-3-Clause
"""Maps in tiles on the operator's side: segments in, the map as it is known at one moment out.

A datagram of 60 bytes may be a tile that takes ten milliseconds to decode. So `receive`, which others wait for, only
reads segments; `work` sorts them, and what has to be decoded is decoded without the lock.
"""
import collections
import math
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, Callable, Counter, Deque, Dict, List, NamedTuple, Optional

import numpy as np

from ...arrays import Array, BoolArray, Records, UInt8Array
from ..assembler import Work
from ..held import Holding
from .ages import age_message
from .identified_map import Candidates, IdentifiedMap
from .snapshot import GridSnapshot
from .tile_segment import TileSegment, read
from .tiled_map import TiledMap

BURST = 0.05
"""A map is shown this long after its first new segment: a change is in several of them [s]."""


MAX_WAITING = 4096
"""Segments that wait to be sorted: as many as a map has tiles. Further ones are dropped, and sent again."""

MAX_DECODED = 32
"""Segments that are decoded before what is held is reported."""

Decode = Callable[[UInt8Array, int, int], Array]
"""f(data, height, width) -> (height, width) int8; raises ValueError where the data is broken."""


def decode(data: UInt8Array, height: int, width: int) -> Array:
    """See codecs.tiles.coder.decode."""
    from ...codecs.tiles import coder  # compiled: it takes 1 s and 100 MB to import

    return coder.decode(data, height, width)


class _Received(NamedTuple):
    segment: TileSegment
    at: float
    """When it was received [s]."""


@dataclass
class _Decoding:
    """The work of decoding some segments of the present map, see Work."""
    received: List[_Received]
    decode: Decode
    take: Callable[[_Received, Optional[Array]], None]
    """f(received, values), called for each of them; None: it is broken"""
    values: List[Optional[Array]] = field(default_factory=list)

    def do(self) -> None:
        for segment, _ in self.received:
            try:
                self.values.append(self.decode(segment.data, segment.place.height, segment.place.width))
            except ValueError:
                self.values.append(None)

    def done(self) -> None:
        for received, values in zip(self.received, self.values):
            self.take(received, values)


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
        self._waiting: Deque[_Received] = collections.deque()
        self._candidates = Candidates(dropped)
        self._identity: Optional[IdentifiedMap] = None
        self._map: Any = None           # TiledMap, once there is an identity; and the newest of its segments
        self._newest: Any = None
        self._since: Optional[float] = None     # when the first segment was received that is not shown [s]
        self._shown = -math.inf                 # when a map was shown last [s]

    def receive(self, records: Records, mask: BoolArray, now: float) -> None:
        for row in np.flatnonzero(mask):
            if len(self._waiting) >= MAX_WAITING:
                self._dropped['too many'] += 1
                continue
            try:
                self._waiting.append(_Received(read(records[row]), now))
            except ValueError:
                self._dropped['impossible head'] += 1

    @property
    def waiting(self) -> bool:
        """Whether `work` has something."""
        return bool(self._waiting)

    def work(self) -> Optional[Work]:
        """Sort the segments that wait, in their order; what is to be decoded, and reported, then."""
        if not self._waiting:
            return None
        wanted: Dict[Any, _Received] = {}
        while self._waiting and len(wanted) < MAX_DECODED:
            segment, at = self._waiting[0]
            # what is decoded is of the map that there is now
            if wanted and (segment.is_beat or not self._is_present(segment)):
                break
            self._waiting.popleft()
            try:
                segments = self._proven(segment, at)
            except ValueError:
                self._dropped['impossible head'] += 1
                continue
            for one in segments:
                key = one.revision, one.shift, one.place, one.data.tobytes()
                if key in wanted:
                    self._dropped['not needed'] += 1
                elif self._sort(one, at):
                    wanted[key] = _Received(one, at)
        return _Decoding(list(wanted.values()), self._decode, self._take)

    def _is_present(self, segment: TileSegment) -> bool:
        """Whether a segment is of the present map."""
        try:
            return self._identity is not None and self._identity.has(segment)
        except ValueError:
            return False

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
            self._map, self._since = TiledMap(segment.area, self._dropped), None
            return
        if former.session != segment.session:
            self._map.begin_session(segment.area.column - former.area.column - way[0],
                                    segment.area.row - former.area.row - way[1])
        if former.area != segment.area:
            self._map.move(segment.area)
        self.show(now)

    def _sort(self, segment: TileSegment, now: float) -> bool:
        """Note a segment of the present map; whether it is to be decoded."""
        self.heard, self._newest = now, segment
        if not segment.is_beat:
            return bool(self._map.is_wanted(segment, now))
        if self._map.confirm(segment, now):
            self.show(now)
        return False

    def _take(self, received: _Received, values: Optional[Array]) -> None:
        if self._map.put(received.segment, values, received.at):
            self.show(received.at)

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
        return GridSnapshot(head, self._map.shown)

    def holding(self) -> Optional[Holding]:
        if self._identity is not None:
            return Holding.of(self._identity.session, self._map.canvas.held)
        session = self._candidates.session
        return None if session is None else Holding(session, ())

    def ages(self, now: float) -> Optional[Any]:
        if self._map is None or self._map.empty:
            return None
        return age_message(self._newest, self._newest.area, self._map.ages.seconds(now))
