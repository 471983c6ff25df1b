# SPDX-License-Identifier: BSD-3-Clause
"""Maps in tiles: lossless, at full resolution, and no more than operators lack (doc/wire_format.md).

What is new or changed leaves at once, as fast as the stream may; what is reported as held is never sent again.
Importing this module loads the compiled codec.
"""
import math
from typing import Any, Callable, Collection, Dict, List, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import Array
from ...codecs.tiles.lattice import Lattice
from ...codecs.tiles.overview import Piece, overview
from ...codecs.tiles.rectangle import Rectangle
from ...congestion.operating_points import OperatingPoint, tile_points
from ...mission.settings import Settings
from ...udpros.datagram import IP_UDP_HEADERS
from ...udpros.frame import Frame
from ...units import KBIT
from ..held import Holding
from .copies import Pattern, sent_for
from .identified_map import PROOF
from .numbering import Numbering
from .overview_schedule import RESIDUAL, OverviewSchedule, datagrams
from .pace import Pace
from .tile_book import TileBook
from .tile_frames import RECTANGLE_SIZE, Source
from .tile_queue import HEAD, Focus, TileQueue

BEAT_PERIOD = 1.0
"""So often a statement about the map leaves [s]."""

BEAT_PART = 0.25
"""What operators lack takes this part of the bitrate in statements, at most; else they do not say it."""

TICK = 0.02
"""What is due within this time leaves together [s]."""

NEED_TIME = 0.5
"""What operators lack shall leave within this time, if the link allows [s]."""

MOST_LOSS = 0.9
"""A higher packet-loss ratio is not made up for."""


class Conditions(NamedTuple):
    """What sending depends on."""
    operators: Collection[str]
    """Who receives the tiles."""
    reports: Mapping[str, Holding]
    """New ones, by operator."""
    loss: float
    """Packet-loss ratio that is expected."""
    robot: Optional[Tuple[float, float]]
    """Where the robot is, in columns and rows of the map; None: not known."""


class TiledMaps:
    """Sends a map until all operators hold it.

    :param session: makes the numbers of sessions: random, uint32
    """

    def __init__(self, session: Callable[[], int]) -> None:
        self._session = session
        self._numbering = Numbering()
        self._proven: Optional[Lattice] = None      # where the map was when its place was proven last
        self._source: Optional[Source] = None
        self._cells: Array = np.empty((0, 0), np.int8)
        self._book = TileBook(1)
        self._queue, self._overview, self._pace = TileQueue(), OverviewSchedule(), Pace(1.0)
        self._pieces: Tuple[int, List[Piece]] = (0, [])
        self._pieces_of: Any = None             # what they were made of
        self._datagram_size = 0                 # that the tiles are made for
        self._changed: Focus = None             # middle of the last change
        self._beat = -math.inf                  # when the last one left
        self._unproven = 0                      # datagrams that shall follow soon, as proof of the map's size
        self._next = -math.inf                  # when something is due
        self._loss = 0.0
        self._most = math.inf                   # bitrate requested [kbit/s]
        self.need = 0.0
        """What the stream would send now [byte/s]."""

    # -- the map -------------------------------------------------------------------------------------

    def take(self, message: Any, cells: Array, max_datagram_size: int) -> None:
        """Take the next map.

        :param message: nav_msgs/OccupancyGrid
        :param cells: (height, width) int8: its data, -1..100
        :raises ValueError: it lies too far from its frame's origin
        """
        lattice = Lattice.of(message.header.frame_id, message.info)
        corner = self._numbering.corner(lattice, cells)
        if corner is None:
            self._begin()
            corner = self._numbering.corner(lattice, cells)
        assert corner is not None
        before = self._source
        self._source = Source(message.header, message.info, corner, before.session if before else self._session())
        if (before is None or self._proven is None or before.corner != corner or self._cells.shape != cells.shape
                or not self._proven.same(lattice)):
            self._proven = lattice
            self._prove()
        self._cells = cells
        self._update(max_datagram_size)

    def _begin(self) -> None:
        """Begin a session."""
        self._numbering, self._source = Numbering(), None
        self._book, self._queue, self._overview = TileBook(1), TileQueue(), OverviewSchedule()

    def _update(self, max_datagram_size: int) -> None:
        """Make the datagrams of the map anew, where it or their size changed."""
        assert self._source is not None
        self._datagram_size = max_datagram_size
        first = not self._book.revision
        change = self._book.update(self._cells, self._source.corner, self._source.data_room(max_datagram_size))
        self._queue.remove(change.gone)
        self._queue.add(change.made)
        if change.made or change.gone:
            self._pieces_of = None
        if not change.made:
            return
        self._changed = None if first else _middle([item.place for item in change.made])
        self._next = -math.inf
        if first or sum(len(item.data) + HEAD for item in change.made) > self._overview_size:
            self._overview.want()

    # -- sending -------------------------------------------------------------------------------------

    def frames(self, conditions: Conditions, settings: Settings, max_datagram_size: int, now: float) -> List[Frame]:
        """What leaves now, in order.

        :param now: by a steady clock [s]
        """
        if self._source is None:
            return []
        if max_datagram_size != self._datagram_size:
            self._update(max_datagram_size)
        self._attend(conditions, now)
        self._pace.set_rate(settings['max_bitrate'] * KBIT, now)
        pattern = Pattern(conditions.loss, 1.0 / settings['repeat_rate'])
        frames = self._beats(now)
        useful = self._queue.wanted(now) > self._overview_size
        if self._overview_due(useful) <= now and not self._pace.wait(now):
            frames += self._overview_frames(now)
        most = max(1, len(frames)) if useful and self._overview.dense else None
        for item in self._queue.due(now, pattern, self._focus(conditions.robot))[:most]:
            if self._pace.wait(now):
                break
            frames.append(self._charged(self._source.cells(item.revision, 0, item.place, item.data), now))
            self._queue.sent(item, now)
        if self._unproven and not frames and not self._pace.wait(now):
            frames.append(self._made_beat(now))
        self._unproven = max(0, self._unproven - len(frames))
        work = now if self._unproven else min(self._queue.next(now, pattern), self._overview_due(useful))
        self._next = min(max(work, now + self._pace.wait(now)), self._beat + BEAT_PERIOD)
        self.need = self._needed(now)
        return frames

    def forget_operators(self, now: float) -> None:
        """Somebody came, who may have the name of one who has left meanwhile, but holds nothing, and reports nothing
        before it has received something. What goes to it goes to all, so nobody's reports are of use now."""
        self._queue.attend((), now)

    def period(self, now: float, reported: bool = False) -> float:
        """How long after the last call of `frames` the next one is useful [s].

        :param reported: whether there are new reports
        """
        return TICK if reported else min(max(TICK, self._next - now), BEAT_PERIOD)

    def operating_points(self, settings: Settings) -> List[OperatingPoint]:
        """As Encoder.operating_points."""
        self._most = settings.requested['max_bitrate']
        return tile_points(self._most, self.need)

    def refine(self, point: Mapping[str, Any], spare: float) -> Dict[str, Any]:
        """As Encoder.refine."""
        return {**point, 'max_bitrate': min(self._most, point['max_bitrate'] + spare / KBIT)}

    def _attend(self, conditions: Conditions, now: float) -> None:
        """Note who came and went, and what is held."""
        assert self._source is not None
        self._loss = conditions.loss
        if self._queue.attend(conditions.operators, now):
            self._overview.want()
            self._prove()
        for operator, holding in conditions.reports.items():
            self._queue.held(operator, holding if holding.session == self._source.session else None, now)

    def _beats(self, now: float) -> List[Frame]:
        return [] if now < self._beat + BEAT_PERIOD - TICK else [self._made_beat(now)]

    def _made_beat(self, now: float) -> Frame:
        assert self._source is not None
        self._beat = now
        pending = [item.place for item in self._queue.lacking()]
        told = len(pending) * RECTANGLE_SIZE <= BEAT_PART * self._pace.rate * BEAT_PERIOD
        return self._charged(
            self._source.beat(self._book.revision, pending if told else None, self._datagram_size), now)

    def _prove(self) -> None:
        """Have so many datagrams follow soon that the proof is likely to arrive."""
        self._next = -math.inf
        self._unproven = 1 + sent_for(PROOF, self._loss, RESIDUAL)

    def _overview_due(self, useful: bool) -> float:
        """When the overview leaves.

        :param useful: whether it shows what operators lack in fewer bytes than the tiles do
        """
        return min(self._overview.due(), self._overview.refresh_due()) if useful else math.inf

    def _overview_frames(self, now: float) -> List[Frame]:
        shift, pieces = self._made_overview()
        source = self._source
        assert source is not None
        frames = [self._charged(source.cells(self._book.revision, shift, Rectangle(*piece[:4]), piece.data), now)
                  for piece in pieces] if shift else []
        size = sum(frame.datagram_size + IP_UDP_HEADERS for frame in frames)
        self._overview.sent(self._loss, now, size / self._pace.rate)
        return frames

    def _made_overview(self) -> Tuple[int, List[Piece]]:
        assert self._source is not None
        made_of = datagrams(self._loss), self._datagram_size
        if made_of != self._pieces_of:
            self._pieces = overview(self._cells, self._source.corner, self._source.data_room(self._datagram_size),
                                    made_of[0])
            self._pieces_of = made_of
        return self._pieces

    @property
    def _overview_size(self) -> int:
        """On the air, at most [byte]."""
        return datagrams(self._loss) * self._datagram_size

    def _charged(self, frame: Frame, now: float) -> Frame:
        self._pace.take(frame.datagram_size + IP_UDP_HEADERS, now)
        return frame

    def _focus(self, robot: Optional[Tuple[float, float]]) -> Focus:
        """The robot's place, or the middle of the last change."""
        if robot is None:
            return self._changed
        assert self._source is not None
        return self._source.corner[0] + robot[0], self._source.corner[1] + robot[1]

    def _needed(self, now: float) -> float:
        """What it would send [byte/s]: what operators lack, with the copies that replace lost ones."""
        wanted = self._queue.wanted(now)
        return self._pace.average(now) + wanted / (1 - min(self._loss, MOST_LOSS)) / NEED_TIME


def _middle(places: List[Rectangle]) -> Tuple[float, float]:
    """Centre of the smallest rectangle around some places."""
    left, low = min(place.column for place in places), min(place.row for place in places)
    right, high = (max(place.column + place.width for place in places), max(place.row + place.height
                                                                             for place in places))
    return (left + right) / 2, (low + high) / 2
