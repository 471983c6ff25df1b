# SPDX-License-Identifier: BSD-3-Clause
"""One map in tiles, as far as it was received: cells, overview, ages.

Decoding takes time, and is done elsewhere: `is_wanted` before it, `put` after it.
"""
import collections
import math
from typing import Counter, Deque, Optional, Tuple

from ...arrays import Array
from ...codecs.tiles.rectangle import Rectangle
from .ages import Ages
from .canvas import Canvas, Identity
from .coarse import Coarse
from .tile_segment import TileSegment

LATENESS = 1.0
"""No link and no queue delays a datagram by as much behind those sent after it [s]."""

FORGOTTEN = 30.0
"""[s]"""

MAX_REMEMBERED = 256


class Repetitions:
    """Remembers the last tiles that contradict what is held: of an older revision, or of the same one with other cells.

    Mostly they are late. But the robot repeats the tiles of its present map as long as they are not reported as held:
    one that is received again after LATENESS is right, and what is held was forged. So no forged tile stays.
    """

    def __init__(self) -> None:
        self._seen: Deque[Tuple[Identity, float]] = collections.deque(maxlen=MAX_REMEMBERED)

    def clear(self) -> None:
        self._seen.clear()

    def proven(self, tile: Identity, now: float) -> bool:
        """Note a tile; whether it was noted already, LATENESS ago.

        :param now: by any steady clock [s]
        """
        while self._seen and now - self._seen[0][1] > FORGOTTEN:
            self._seen.popleft()
        first = next((since for known, since in self._seen if known == tile), None)
        if first is None:
            self._seen.append((tile, now))
        return first is not None and now - first >= LATENESS


SETTLED = 1.0
"""A statement that comes this long after an overview was made after it, whatever revisions say [s]."""


class TiledMap:
    """Receives the segments of one map, whose session and rectangle may change.

    :param area: the map's rectangle [cell]
    :param dropped: {reason: count} of segments that changed nothing, to be added to
    """

    def __init__(self, area: Rectangle, dropped: Counter[str]) -> None:
        self.canvas = Canvas(area)
        self.ages = Ages(area)
        self._coarse = Coarse(area)
        self._dropped = dropped
        self._repetitions = Repetitions()
        self._overview_at = -math.inf       # when the last piece of an overview was received [s]

    @property
    def empty(self) -> bool:
        """Whether nothing of the map is known."""
        return not self.canvas.known and self._coarse.empty

    def begin_session(self, columns: int, rows: int) -> None:
        """Number tiles anew, and cells by as many more; what is known stays until it is replaced."""
        for part in (self.canvas, self.ages, self._coarse):
            part.renumber(columns, rows)
        self.canvas.begin_session()
        self._coarse.begin_session()
        self._repetitions.clear()

    def move(self, area: Rectangle) -> None:
        """Change the rectangle; what is in both stays."""
        for part in (self.canvas, self.ages, self._coarse):
            part.move(area)

    def shown(self) -> Tuple[Array, float]:
        """(height, width) int8: the map; and the received share of its cells, 0..1."""
        return self._coarse.shown(self.canvas), self.canvas.known / self.canvas.cells.size

    def is_wanted(self, segment: TileSegment, now: float) -> bool:
        """Whether a tile or a piece of an overview of this map is to be decoded.

        :param now: by a steady clock [s], here and below
        """
        if segment.shift:
            return True
        tile = _identity(segment)
        if self.canvas.holds(tile):
            self._dropped['not needed'] += 1
            return False
        if self.canvas.disown(tile.revision):
            self._dropped['contradiction'] += 1
        renewed = self.canvas.older(tile)
        proven = not renewed.all() and self._repetitions.proven(tile, now)
        if not renewed.any() and not proven:
            self._dropped['late'] += 1
            return False
        return True

    def put(self, segment: TileSegment, values: Optional[Array], now: float) -> bool:
        """Take a segment that is wanted; whether it changed what is shown.

        :param values: (height, width) int8; None: it cannot be decoded
        """
        if values is None:
            self._dropped['overview' if segment.shift else 'tile'] += 1
            return False
        if segment.shift:
            self._put_overview(segment, values, now)
        else:
            self._put_tile(segment, values, now)
        return True

    def confirm(self, beat: TileSegment, now: float) -> bool:
        """Take a statement about this map; whether it changed what is shown."""
        if not beat.current:
            return False
        self.ages.confirm(beat.pending, now)
        if beat.revision >= self._coarse.newest or now - self._overview_at >= SETTLED:
            return self._coarse.settle(beat.pending)
        return False

    def _put_overview(self, segment: TileSegment, values: Array, now: float) -> None:
        self._overview_at = now
        self._coarse.put(segment.shift, segment.place, segment.revision, values)
        self.ages.received_coarse(_cells_of(segment), now)

    def _put_tile(self, segment: TileSegment, values: Array, now: float) -> None:
        tile = _identity(segment)
        renewed = self.canvas.older(tile)
        if not renewed.all() and self._repetitions.proven(tile, now):
            renewed[:] = True
        self.canvas.put(tile, values, renewed)
        self.ages.received(tile.place, now)


def _identity(segment: TileSegment) -> Identity:
    return Identity.of(segment.revision, segment.place, segment.data.tobytes())


def _cells_of(segment: TileSegment) -> Rectangle:
    """The cells of the map that an overview's piece is of."""
    place = Rectangle(*(number << segment.shift for number in segment.place))
    return place.within(segment.area)
