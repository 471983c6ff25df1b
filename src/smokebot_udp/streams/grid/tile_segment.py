# SPDX-License-Identifier: BSD-3-Clause
"""A datagram of a map in tiles (msg/MapTile), read and checked as far as it can be by itself."""
from typing import Any, NamedTuple, Tuple

import numpy as np

from ...arrays import Array, UInt8Array
from ...codecs.tiles.lattice import MAX_NUMBER
from ...codecs.tiles.rectangle import Rectangle
from ...codecs.wire.interleave import MAX_SIDE
from ...msg import MapTile
from ..segments import head_of
from .canvas import MAX_REVISION

FIELDS = 'info', 'corner', 'session', 'revision', 'shift', 'place', 'size', 'current'

MAX_SHIFT = MAX_SIDE.bit_length() - 1
"""Shift by which the largest map is one value."""

LARGEST_TILE = 512 * 512
"""The encoder's root blocks: whoever forges larger ones would make decoding expensive [cell]."""


class TileSegment(NamedTuple):
    """What a datagram says."""
    seq: int
    """Sequence number on the topic; different for repetitions."""
    stamp: int
    """Stamp of the source map [ns]."""
    frame_id: str
    info: Tuple[Any, ...]
    """MapMetaData as nested tuples, see segments.head_of; its resolution and pose may still be impossible."""
    area: Rectangle
    """The whole map, on the lattice [cell]."""
    session: int
    revision: int
    shift: int
    """0: a tile, or a beat where `place` is empty; n > 0: a piece of an overview, in blocks of 2^n cells."""
    place: Rectangle
    """Rectangle of the values, [cell] or [block]."""
    current: bool
    """Whether `pending` is all that may be missing, as a beat says."""
    pending: Array
    """(n, 4) int: column, row, width, height of rectangles [cell]."""
    data: UInt8Array

    @property
    def is_beat(self) -> bool:
        """Whether it is a statement about the map, without values."""
        return self.place.empty


def read(record: Any) -> TileSegment:
    """Read a MapTile.

    :param record: element of a structured array of segments; valid as long as that is, the segment for longer
    :raises ValueError: it contradicts itself, or exceeds a limit
    """
    if len(record['pending']) % 4:
        raise ValueError('%d numbers of rectangles' % len(record['pending']))
    head = head_of(record, MapTile, FIELDS)
    segment = TileSegment(
        int(record['header']['seq']), head.stamp, head.frame_id, head.info, Rectangle(*head.corner, *head.info[2:4]),
        head.session, head.revision, head.shift, Rectangle(*head.place, *head.size), bool(head.current),
        record['pending'].reshape(-1, 4).astype(np.int64), record['data'].copy())
    _check(segment)
    return segment


def _check(segment: TileSegment) -> None:
    """:raises ValueError: it contradicts itself, or exceeds a limit"""
    area, place = segment.area, segment.place
    if not (1 <= area.width <= MAX_SIDE and 1 <= area.height <= MAX_SIDE):
        raise ValueError('a map of %d x %d cells' % (area.width, area.height))
    if not (abs(area.column) <= MAX_NUMBER and abs(area.row) <= MAX_NUMBER):
        raise ValueError('a map at cell %d, %d' % (area.column, area.row))
    if segment.is_beat:
        if place.width or place.height or len(segment.data):
            raise ValueError('%d x %d values in %d bytes' % (place.width, place.height, len(segment.data)))
    elif not (1 <= segment.revision <= MAX_REVISION and segment.shift <= MAX_SHIFT):
        raise ValueError('revision %d, shift %d' % (segment.revision, segment.shift))
    elif not area.blocks(segment.shift).holds(place):
        raise ValueError('values at %s of a map at %s' % (place, area))
    elif segment.shift == 0 and place.width * place.height > LARGEST_TILE:
        raise ValueError('a tile of %d x %d cells' % (place.width, place.height))
