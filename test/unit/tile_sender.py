# SPDX-License-Identifier: BSD-3-Clause
"""A robot's side of maps in tiles for tests: every datagram of a map, numbered as a publisher does."""
from typing import Any, List, Tuple

import numpy as np
from nav_msgs.msg import MapMetaData
from std_msgs.msg import Header

from smokebot_udp.codecs.tiles import coder
from smokebot_udp.codecs.tiles.lattice import Lattice
from smokebot_udp.codecs.tiles.overview import overview
from smokebot_udp.codecs.tiles.rectangle import Rectangle
from smokebot_udp.codecs.tiles.tiling import Tiling
from smokebot_udp.streams.grid.tile_frames import Source


def info_of(cells: Any, origin: Tuple[float, float] = (0.0, 0.0), resolution: float = 0.05) -> MapMetaData:
    """The MapMetaData of a map with its first corner at a place [m]."""
    info = MapMetaData(resolution=float(np.float32(resolution)), width=cells.shape[1], height=cells.shape[0])
    info.origin.position.x, info.origin.position.y, info.origin.orientation.w = (*origin, 1.0)
    return info


class TileSender:
    """Sends maps of one session.

    :param room: of data in a datagram [byte]
    """

    def __init__(self, session: int = 5, room: int = 60) -> None:
        self.session, self.room = session, room
        self.revision = 0
        self.source: Any = None
        self._tiling = Tiling(room)
        self._cells: Any = None
        self._seq = 0

    def update(self, cells: Any, info: MapMetaData, frame_id: str = 'map', stamp: float = 1.0) -> List[Any]:
        """Records of the tiles that are new."""
        corner = Lattice.of(frame_id, info).corner
        header = Header(frame_id=frame_id)
        header.stamp.secs = int(stamp)
        self.source = Source(header, info, corner, self.session)
        self._cells = cells
        tiles = self._tiling.update(cells, corner)
        self.revision += len(tiles)
        return [self.tile(tile.revision, tile.place, tile.data) for tile in tiles]

    def move(self, info: MapMetaData) -> None:
        """The map is in another place; its cells, and their numbers, stay."""
        self.source = self.source._replace(info=info)

    def all_tiles(self) -> List[Any]:
        """Records of all tiles of the map, once more."""
        return [self.tile(tile.revision, tile.place, tile.data) for tile in self._tiling.tiles.values()]

    def tile(self, revision: int, place: Rectangle, data: bytes, shift: int = 0) -> Any:
        """The record of any tile."""
        return self._sent(self.source.cells(revision, shift, place, data))

    def cells(self, revision: int, place: Rectangle, value: int) -> Any:
        """The record of a tile of one value."""
        return self.tile(revision, place, coder.encode(np.full((place.height, place.width), value, np.int8), self.room))

    def overview(self) -> List[Any]:
        shift, pieces = overview(self._cells, self.source.corner, self.room, 1)
        return [self.tile(self.revision, Rectangle(*piece[:4]), piece.data, shift) for piece in pieces] if shift else []

    def beat(self, pending: Any = ()) -> Any:
        """The record of a statement."""
        return self._sent(self.source.beat(self.revision, list(pending), 1472))

    def _sent(self, frame: Any) -> Any:
        records = frame.records.copy()
        self._seq += 1
        records['header']['seq'] = self._seq
        return records
