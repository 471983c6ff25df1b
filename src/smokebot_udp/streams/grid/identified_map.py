# SPDX-License-Identifier: BSD-3-Clause
"""Which map a segment belongs to, and what it takes for another map to replace the one that is shown.

A datagram can be forged. So another map, another session or another rectangle begins only with PROOF different good
datagrams of it, with none of the present map in between; these are kept, and nothing of the new map is lost.
"""
from typing import Counter, Dict, List, Optional, Tuple

from ...codecs.tiles.lattice import Lattice
from ...frame_names import frame_name
from .snapshot import info_message
from .tile_segment import TileSegment

PROOF = 3
"""Datagrams that begin a map."""

MAX_CANDIDATES = 8
"""Maps that may wait for their proof; the one that waits longest gives way."""

CANDIDATE_TIMEOUT = 30.0
"""A proof takes this long at most: beats come once a second, and most of them may be lost [s]."""


class IdentifiedMap:
    """A map by its session, place and rectangle.

    :param segment: any of its segments
    :raises ValueError: the map is impossible
    """

    def __init__(self, segment: TileSegment) -> None:
        self.session, self.frame, self.area = segment.session, frame_name(segment.frame_id), segment.area
        self._info, self._lattice = segment.info, lattice_of(segment)

    def has(self, segment: TileSegment) -> bool:
        """Whether a segment is of this map.

        :raises ValueError: its map is impossible
        """
        if (segment.session != self.session or segment.area != self.area
                or frame_name(segment.frame_id) != self.frame):
            return False
        # these very numbers; the load time may differ
        return segment.info[1:] == self._info[1:] or self._lattice.same(lattice_of(segment))

    def way(self, segment: TileSegment) -> Optional[Tuple[int, int]]:
        """Columns and rows from this map's first cell to that of a segment's map; None: nothing of it can be kept.

        The cells of one session have one numbering, even where the map was turned.

        :raises ValueError: its map is impossible
        """
        other = lattice_of(segment)
        way = self._lattice.to(other)
        if way is None or (segment.session != self.session and self._lattice.turned(other)):
            return None
        return round(way[0]), round(way[1])


def lattice_of(segment: TileSegment) -> Lattice:
    """Where a segment's map lies.

    :raises ValueError: its map is impossible
    """
    return Lattice.of(segment.frame_id, info_message(segment.info))


class _Candidate:
    """A map that waits for its proof."""

    def __init__(self, segment: TileSegment, now: float) -> None:
        self.map, self.since = IdentifiedMap(segment), now
        self.segments: Dict[int, TileSegment] = {}      # by seq


class Candidates:
    """Maps other than the present one, of which segments are received.

    :param dropped: {reason: count} of segments that began nothing, to be added to
    """

    def __init__(self, dropped: Counter[str]) -> None:
        self._dropped = dropped
        self._waiting: List[_Candidate] = []

    @property
    def session(self) -> Optional[int]:
        """Session of the map that was heard of last; None: no other map was heard of."""
        return self._waiting[-1].map.session if self._waiting else None

    def clear(self) -> None:
        """Note that the present map was heard."""
        self._keep([])

    def add(self, segment: TileSegment, now: float) -> List[TileSegment]:
        """Take a segment that is not of the present map.

        :return: the segments that prove a map, in the order received; empty: the proof is not complete
        :raises ValueError: its map is impossible
        """
        self._keep([candidate for candidate in self._waiting if now - candidate.since <= CANDIDATE_TIMEOUT])
        found = next((candidate for candidate in self._waiting if candidate.map.has(segment)), None)
        if found is None:
            found = _Candidate(segment, now)
            self._keep(self._waiting[1 - MAX_CANDIDATES:])
        else:
            self._waiting.remove(found)
        self._waiting.append(found)     # the one heard of last
        if segment.seq in found.segments:
            self._dropped['unproven'] += 1
        found.segments[segment.seq] = segment
        if len(found.segments) < PROOF:
            return []
        self._waiting.pop()
        self.clear()
        return list(found.segments.values())

    def _keep(self, some: List[_Candidate]) -> None:
        """Give up the others."""
        for candidate in self._waiting:
            if candidate not in some:
                self._dropped['unproven'] += len(candidate.segments)
        self._waiting = list(some)
