# SPDX-License-Identifier: BSD-3-Clause
"""The wire records of maps in tiles, byte by byte."""
import io
import struct
from typing import Any

import needs_numba  # noqa: F401
import pytest
from map_receiver import segments_of
from nav_msgs.msg import MapMetaData
from std_msgs.msg import Header

from smokebot_udp.codecs.tiles.tiling import Rectangle
from smokebot_udp.msg import Held
from smokebot_udp.streams.grid.tile_frames import Source
from smokebot_udp.streams.held import Holding, to_message
from smokebot_udp.udpros.datagram import OVERHEAD

HEAD = (struct.pack('<III', 0, 5, 7) + b'\3\0\0\0map'              # Header: seq, stamp, frame_id
        + struct.pack('<II', 3, 4)                                  # map_load_time
        + struct.pack('<fII', 0.05, 70, 90)                         # resolution, width, height
        + struct.pack('<7d', -12.5, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0)   # origin
        + struct.pack('<ii', -250, 40) + struct.pack('<I', 0xfedcba98))


def source() -> Source:
    header, info = Header(frame_id='map'), MapMetaData(resolution=0.05, width=70, height=90)
    header.stamp.secs, header.stamp.nsecs = 5, 7
    info.map_load_time.secs, info.map_load_time.nsecs = 3, 4
    info.origin.position.x, info.origin.position.y, info.origin.orientation.w = -12.5, 2.0, 1.0
    return Source(header, info, (-250, 40), 0xfedcba98)


def wire(frame: Any) -> bytes:
    assert len(frame) == 1
    data: bytes = frame.rows[0, OVERHEAD:].tobytes()
    return data


def test_a_tile() -> None:
    frame = source().cells(258, 0, Rectangle(-240, 50, 20, 30), b'\x66\x01\x02')
    assert wire(frame) == HEAD + struct.pack('<IBiiHHBI', 258, 0, -240, 50, 20, 30, 0, 0) + b'\3\0\0\0\x66\x01\x02'


def test_a_part_of_an_overview() -> None:
    frame = source().cells(300, 3, Rectangle(-32, 5, 10, 12), b'\x65')
    assert wire(frame) == HEAD + struct.pack('<IBiiHHBI', 300, 3, -32, 5, 10, 12, 0, 0) + b'\1\0\0\0\x65'


def test_a_beat_lists_what_is_lacking() -> None:
    frame = source().beat(300, [Rectangle(-240, 50, 20, 30), Rectangle(1, 2, 3, 4)], 1472)
    assert wire(frame) == (HEAD + struct.pack('<IBiiHHBI', 300, 0, 0, 0, 0, 0, 1, 8)
                           + struct.pack('<8i', -240, 50, 20, 30, 1, 2, 3, 4) + struct.pack('<I', 0))
    assert wire(source().beat(300, [], 1472)) == HEAD + struct.pack('<IBiiHHBI', 300, 0, 0, 0, 0, 0, 1, 0) + bytes(4)


@pytest.mark.parametrize('size', [300, 736, 1472])
def test_a_beat_that_has_no_room_for_the_list_says_nothing_of_it(size: int) -> None:
    places = [Rectangle(0, 0, 1, 1)] * (source().data_room(size) // 16)
    full, = segments_of([source().beat(1, places, size)])
    assert full.current and len(full.pending) == 4 * len(places)
    frame = source().beat(1, places * 2, size)
    segment, = segments_of([frame])
    assert not segment.current and segment.pending == () and frame.datagram_size <= size


def test_what_has_room_fits() -> None:
    room = source().data_room(1472)
    assert source().cells(1, 0, Rectangle(0, 0, 9, 9), bytes(room)).datagram_size == 1472


def test_a_report() -> None:
    message, data = to_message(Holding(0xfedcba98, ((3, 2), (9, 1))), 'map', 1472), io.BytesIO()
    message.serialize(data)
    assert data.getvalue() == (b'\3\0\0\0map' + struct.pack('<I', 0xfedcba98)
                               + struct.pack('<III', 2, 3, 9) + struct.pack('<IHH', 2, 2, 1) + struct.pack('<I', 0))
    assert Held().deserialize(data.getvalue()) == message
