# SPDX-License-Identifier: BSD-3-Clause
"""Grid streams: nav_msgs/OccupancyGrid, in tiles or interleaved."""
import collections
import os
from typing import Any, Callable, Deque, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import Header

from ...arrays import Array
from ...codecs.tiles.lattice import Lattice
from ...codecs.wire import grid
from ...congestion.operating_points import OperatingPoint
from ...frame_names import BASE_FRAME, unknown_transform
from ...mission.parameters import Parameter
from ...mission.settings import Settings
from ...msg import GridSegment, MapTile
from ...numpy_messages import numpy_msg
from ...udpros.frame import Frame
from ..codec import Codec, ImportedCodec
from ..encoder import Encoded, Encoder, LinkView, Traits
from ..held import Holding
from ..parameters import ROBOT
from ..segments import MAIN_PART, TILES
from .interleaved_encoder import InterleavedMaps
from .map_info import cell_at, check_origin, check_values
from .map_updates import same_place, updated, with_legal_values

FALLBACK = 2.0
"""A new operator has this time to subscribe to the tiles, before the map crosses interleaved for all [s]."""

WAIT = 0.5
"""While it waits for that, it looks this often; and while there is no operator [s]."""

MAX_REPORTS = 64
"""Reports that wait to be taken into account; the oldest ones give way."""

LOOKUP_PERIOD = 1.0
"""The robot's place is looked up this often [s]."""

LAST_CHANGE = 'the surroundings of the last change are sent first'

TILES_BACKLOG = 0.1
"""The rest of the tiles that leave is waited for this long at most before more are made [s]."""

SILENT = ''
"""Stands for subscribers without a name, such as recorders: they never report."""

Lookup = Callable[[str, Any], Optional[Tuple[Any, Any]]]
"""f(frame, std_msgs/Header) -> (rotation, (3,) translation [m]) into the frame from the header's, or None."""


class _Map(NamedTuple):
    message: Any
    cells: Array
    """(height, width) int8"""


class GridEncoder(Encoder[Any]):
    """Sends a changed map at once; an unchanged one until operators hold it (tiles), or again and again (interleaved).

    Without operators, maps are only kept.

    :param codec: of tiles
    :param clock: steady [s]
    :param lookup: of transforms; None: there is no tf
    :param session: makes random numbers, uint32
    """
    MESSAGE, SEGMENTS = numpy_msg(OccupancyGrid), {MAIN_PART: GridSegment, TILES: MapTile}
    UPDATE = numpy_msg(OccupancyGridUpdate)
    # a map may be published only once: it is kept
    traits = Traits(steady=False, stamped=False, keeps=True, reencodes=True, foresees=True)
    PARAMETERS = {
        **ROBOT,
        'coding': Parameter('tiles', '', 'tiles: at full resolution, compressed, only what operators lack; '
                            'interleaved: reduced to max_segments, uncompressed, repeated as a whole',
                            choices=('interleaved', 'tiles'), live=True),
        'max_bitrate': Parameter(1000.0, 'kbit/s', 'tiles: maximum bitrate', least=8.0, most=1e6, live=True),
        'repeat_rate': Parameter(0.2, 'Hz', 'interleaved: rate at which an unchanged map is repeated, for lost '
                                 'datagrams and late subscribers; tiles: rate at which the map is repeated for '
                                 'operators who do not report what they hold', above=0.0, most=100.0, live=True),
        'robot_frame': Parameter(BASE_FRAME, '', 'tiles: tf frame of the robot, whose surroundings are sent first; '
                                 'default: base of frames; empty: the surroundings of the last change are'),
        'updates_topic': Parameter('', '', 'topic of map_msgs/OccupancyGridUpdate with changes of parts of the map; '
                                   'empty: robot_topic with _updates appended'),
        'max_cells': Parameter(1300, '', 'interleaved: maximum number of cells in a segment', least=1, most=65000,
                               live=True),
        'max_segments': Parameter(256, '', 'interleaved: maximum number of segments of a map, which is reduced until '
                                  'it fits', least=1, most=65536, live=True),
    }

    def __init__(self, settings: Mapping[str, Any], codec: Optional[Codec] = None,
                 clock: Callable[[], float] = lambda: 0.0, lookup: Optional[Lookup] = None,
                 session: Callable[[], int] = lambda: int.from_bytes(os.urandom(4), 'little')) -> None:
        super().__init__(settings)
        self._codec, self._clock, self._lookup, self._session = codec or ImportedCodec(), clock, lookup, session
        self._robot_frame = settings['robot_frame']
        self._interleaved, self._tiled = InterleavedMaps(), None    # type: InterleavedMaps, Any
        self._used: Union[InterleavedMaps, Any, None] = None        # what sent last
        self._newest: Any = None                    # message, of the thread that merges
        self._legal_only = settings['coding'] == 'tiles'    # other values, and places far away, cannot be sent
        self._map: Optional[_Map] = None
        self._taken = False                         # whether self._used has the map
        self._fallback_at: Optional[float] = None   # when it is interleaved, as an operator does not receive tiles
        self._reports: Deque[Tuple[str, Holding]] = collections.deque(maxlen=MAX_REPORTS)    # new ones
        self._joined = False                        # whether somebody came since tiles left last
        self._robot: Optional[Tuple[float, ...]] = None    # in the map's frame [m]
        self._looked_up: Optional[float] = None

    def sources(self, settings: Mapping[str, Any]) -> Dict[str, Any]:
        return {settings['updates_topic'] or settings['robot_topic'] + '_updates': self.UPDATE}

    def parts(self, settings: Settings) -> Sequence[str]:
        return [MAIN_PART] if settings['coding'] == 'interleaved' else [MAIN_PART, TILES]

    def merge(self, waiting: Optional[Any], message: Any) -> Optional[Any]:
        """Updates change the newest map; before the first map they say nothing. What is wrong does not get into it, as
        later updates would be of a map that cannot be sent.

        :raises ValueError: a map or an update that cannot be sent, or an update that is not of the newest map
        """
        if message._type == self.MESSAGE._type:
            self._newest, fault = self._basis(message)
            if fault is not None:
                raise fault
        elif self._newest is not None:
            newest = updated(self._newest, message)
            if self._legal_only:
                check_values(message.data)
            self._newest = newest
        return self._newest

    def _basis(self, message: Any) -> Tuple[Any, Optional[ValueError]]:
        """What updates change after a map, None: nothing; and what is wrong with the map, None: nothing."""
        try:
            cells = self._cells(message)
        except ValueError as error:
            same = self._newest is not None and same_place(self._newest, message)
            return self._newest if same else None, error
        try:
            if self._legal_only:
                check_values(cells)
        except ValueError as error:
            return with_legal_values(message), error
        return message, None

    def refine(self, point: Mapping[str, Any], spare: float) -> Dict[str, Any]:
        # the coding may have changed since the point was made
        if 'max_bitrate' not in point or self._tiled is None:
            return dict(point)
        refined: Dict[str, Any] = self._tiled.refine(point, spare)
        return refined

    def operating_points(self, rate: float, settings: Settings) -> List[OperatingPoint]:
        points: List[OperatingPoint] = [] if self._used is None else self._used.operating_points(settings)
        return points

    def joined(self) -> None:
        self._joined = True

    def held(self, operator: str, holding: Holding) -> None:
        self._reports.append((operator, holding))

    def repeat_period(self, settings: Settings, link: LinkView) -> Optional[float]:
        if self._used is None or not _wanted(settings, link):
            return WAIT
        if self._used is self._interleaved:
            return self._interleaved.repeat_period(settings)
        period: float = self._tiled.period(self._clock(), bool(self._reports))
        return period

    def encode(self, message: Any, settings: Settings, link: LinkView) -> Encoded:
        self._legal_only = settings['coding'] == 'tiles'
        cells = self._cells(message)
        if self._legal_only:
            check_values(cells)
            self._codec.ready()     # it is loaded when the first operator comes
        self._map, self._taken = _Map(message, cells), False
        if not _anyone(link):
            self._fallback_at = None
        return self._encoded(self._frames(settings, link) if _wanted(settings, link) else ())

    def _cells(self, message: Any) -> Array:
        """(height, width) int8: the cells of a nav_msgs/OccupancyGrid.

        :raises ValueError: naming what is wrong with the map, but for values
        """
        info = message.info
        cells = grid.as_cells(message.data, info.height, info.width, info.resolution)
        check_origin(info.origin)
        if self._legal_only:
            Lattice.of(message.header.frame_id, info)
        return cells

    def repeat(self, settings: Settings, link: LinkView) -> Encoded:
        if self._map is None:
            return Encoded()
        frames = self._frames(settings, link)
        return self._encoded(self._interleaved.repeat() if not frames and self._used is self._interleaved else frames)

    def _encoded(self, frames: Sequence[Frame]) -> Encoded:
        tiled = self._tiled is not None and self._used is self._tiled
        return Encoded(frames, backlog=TILES_BACKLOG if tiled else None)

    def _frames(self, settings: Settings, link: LinkView) -> List[Frame]:
        """What is new, by the way of coding that is possible now."""
        now = self._clock()
        chosen = self._chosen(settings, link, now)
        if chosen is None:
            return []
        if chosen is not self._used:
            self._used, self._taken = chosen, False
        tiled, taken, self._taken = chosen is self._tiled, self._taken, True
        assert self._map is not None
        message, cells = self._map
        if not tiled:
            return [] if taken else self._interleaved.encode(message, cells, settings, link.datagram_size)
        if not taken:
            self._tiled.take(message, cells, link.datagram_size)
        if self._joined:
            self._joined = False    # first: who comes from now on is for the next time
            self._reports.clear()
            self._tiled.forget_operators(now)
        frames: List[Frame] = self._tiled.frames(
            self._conditions(message, link, now), settings, link.datagram_size, now)
        return frames

    def _chosen(self, settings: Settings, link: LinkView, now: float) -> Union[InterleavedMaps, Any, None]:
        """What sends now; None: nothing does, as an operator is about to subscribe."""
        if settings['coding'] == 'interleaved' or not self._codec.ready():
            return self._interleaved
        if link.heard(TILES):
            self._fallback_at = None
            if self._tiled is None:
                from .tiles_encoder import TiledMaps  # compiled
                self._tiled = TiledMaps(self._session)
            return self._tiled
        if self._fallback_at is None:
            self._fallback_at = now + FALLBACK
        return self._used if now < self._fallback_at else self._interleaved

    def _conditions(self, message: Any, link: LinkView, now: float) -> Any:
        from .tiles_encoder import Conditions
        reports = dict(self._reports.popleft() for _ in range(len(self._reports)))
        return Conditions(link.operators(TILES) or (SILENT,), reports, link.outlook.loss(0.5),
                          self._robot_at(message, now))

    def _robot_at(self, message: Any, now: float) -> Optional[Tuple[float, float]]:
        """Where the robot is, in columns and rows of the map; None: not known."""
        if not self._robot_frame or self._lookup is None:
            return None
        if self._looked_up is None or now - self._looked_up >= LOOKUP_PERIOD:
            self._looked_up = now
            found = self._lookup(message.header.frame_id, Header(frame_id=self._robot_frame))
            self._robot = None if found is None else tuple(found[1].tolist())
            self.problem = None if found is not None else unknown_transform(
                self._robot_frame, message.header.frame_id, LAST_CHANGE)
            self.warnings.extend(filter(None, [self.problem]))
        return None if self._robot is None else cell_at(message.info, *self._robot)


def _anyone(link: LinkView) -> bool:
    """Whether there is any operator."""
    return link.heard(TILES) or link.heard(MAIN_PART)


def _wanted(settings: Settings, link: LinkView) -> bool:
    """Whether anything may be sent. What is not must not count as sent."""
    return settings['enabled'] and not settings.paused and _anyone(link)
