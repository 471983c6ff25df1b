# SPDX-License-Identifier: BSD-3-Clause
"""Segments of maps in tiles: msg/MapTile."""
from typing import Any, List, NamedTuple, Optional, Tuple

import numpy as np

from ...codecs.tiles.rectangle import Rectangle
from ...msg import MapTile
from ...udpros.frame import Frame
from ..segments import room, write_header
from .map_info import write_info

RECTANGLE_SIZE = 16
"""Size of a rectangle in `pending` [byte]."""


class Source(NamedTuple):
    """What all segments of a map say about it."""
    header: Any
    """std_msgs/Header"""
    info: Any
    """nav_msgs/MapMetaData"""
    corner: Tuple[int, int]
    """Column and row of its first cell on the lattice."""
    session: int

    def data_room(self, max_datagram_size: int) -> int:
        """What a segment has room for [byte].

        :param max_datagram_size: [byte of UDP payload]
        :raises ValueError: nothing is left
        """
        return room(MapTile, max_datagram_size, self.header.frame_id.encode())

    def cells(self, revision: int, shift: int, place: Rectangle, data: bytes) -> Frame:
        """The segment of a tile, or of a part of the overview.

        :param place: of an overview: divided by 2^shift
        """
        frame = self._frame(revision, data=len(data))
        records = frame.records
        records['shift'], records['place'], records['size'] = shift, place[:2], place[2:]
        records['data'] = np.frombuffer(data, np.uint8)
        return frame

    def beat(self, revision: int, pending: Optional[List[Rectangle]], max_datagram_size: int) -> Frame:
        """The statement about the map.

        :param pending: all places that an operator may lack; `current` is false where the segment has no room for them,
            and for None
        """
        fits = pending is not None and len(pending) <= self.data_room(max_datagram_size) // RECTANGLE_SIZE
        numbers = np.array(pending if fits else [], np.int32).ravel()
        frame = self._frame(revision, pending=len(numbers))
        frame.records['current'], frame.records['pending'] = fits, numbers
        return frame

    def _frame(self, revision: int, **lengths: int) -> Frame:
        frame = Frame(MapTile, 1, {'header.frame_id': len(self.header.frame_id.encode()), **lengths})
        records = frame.records
        write_header(records, self.header)
        write_info(records['info'], self.info, self.info.resolution, (self.info.height, self.info.width))
        records['corner'], records['session'], records['revision'] = self.corner, self.session, revision
        return frame
