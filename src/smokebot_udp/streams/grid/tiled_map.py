# SPDX-License-Identifier: BSD-3-Clause
"""One map in tiles, as far as it was received: cells, overview, ages."""
import math
from typing import Callable, Counter, Tuple

from ...arrays import Array, UInt8Array
from ...codecs.tiles.rectangle import Rectangle
from .ages import Ages
from .canvas import Canvas, Identity
from .coarse import Coarse
from .repetitions import Repetitions
from .tile_segment import TileSegment

Decode = Callable[[UInt8Array, int, int], Array]
"""f(data, height, width) -> (height, width) int8; raises ValueError where the data is broken."""

SETTLED = 1.0
"""A statement that comes this long after an overview was made after it, whatever revisions say [s]."""


class TiledMap:
    """Receives the segments of one map, whose session and rectangle may change.

    :param area: the map's rectangle [cell]
    :param dropped: {reason: count} of segments that changed nothing, to be added to
    """

    def __init__(self, area: Rectangle, decode: Decode, dropped: Counter[str]) -> None:
        self.canvas = Canvas(area)
        self.ages = Ages(area)
        self._coarse = Coarse(area)
        self._decode, self._dropped = decode, dropped
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

    def add(self, segment: TileSegment, now: float) -> bool:
        """Take a segment of this map; whether it changed what is shown.

        :param now: by a steady clock [s]
        """
        if segment.is_beat:
            return self._confirm(segment, now)
        if segment.shift:
            return self._add_overview(segment, now)
        return self._add_tile(segment, now)

    def _confirm(self, beat: TileSegment, now: float) -> bool:
        if not beat.current:
            return False
        self.ages.confirm(beat.pending, now)
        if beat.revision >= self._coarse.newest or now - self._overview_at >= SETTLED:
            return self._coarse.settle(beat.pending)
        return False

    def _add_overview(self, segment: TileSegment, now: float) -> bool:
        try:
            values = self._decode(segment.data, segment.place.height, segment.place.width)
        except ValueError:
            self._dropped['overview'] += 1
            return False
        self._overview_at = now
        self._coarse.put(segment.shift, segment.place, segment.revision, values)
        self.ages.received_coarse(_cells_of(segment), now)
        return True

    def _add_tile(self, segment: TileSegment, now: float) -> bool:
        tile = Identity.of(segment.revision, segment.place, segment.data.tobytes())
        if self.canvas.holds(tile):
            self._dropped['not needed'] += 1
            return False
        if self.canvas.disown(tile.revision):
            self._dropped['contradiction'] += 1
        renewed = self.canvas.older(tile)
        if not renewed.all():
            if self._repetitions.proven(tile, now):
                renewed[:] = True
            elif not renewed.any():
                self._dropped['late'] += 1
                return False
        try:
            cells = self._decode(segment.data, segment.place.height, segment.place.width)
        except ValueError:
            self._dropped['tile'] += 1
            return False
        self.canvas.put(tile, cells, renewed)
        self.ages.received(tile.place, now)
        return True


def _cells_of(segment: TileSegment) -> Rectangle:
    """The cells of the map that an overview's piece is of."""
    place = Rectangle(*(number << segment.shift for number in segment.place))
    return place.within(segment.area)
