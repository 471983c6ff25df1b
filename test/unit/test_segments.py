# SPDX-License-Identifier: BSD-3-Clause
import io

import numpy as np
import pytest

from smokebot_udp.msg import CloudChunk, GridSegment, ImageSegment, ScanSegment
from smokebot_udp.streams.segments import head_of, room, same_head, stamps_of
from smokebot_udp.udpros import Frame
from smokebot_udp.udpros.datagram import OVERHEAD


@pytest.mark.parametrize('segment_class, field', [
    (ImageSegment, 'data'), (GridSegment, 'data'), (CloudChunk, 'data'), (ScanSegment, 'ranges')])
def test_a_full_segment_fills_its_datagram_exactly(segment_class, field):
    left = room(segment_class, 1472, b'frame')
    segment = segment_class(**{field: [0] * left if segment_class is GridSegment else bytes(left)})
    segment.header.frame_id = 'frame'
    buffer = io.BytesIO()
    segment.serialize(buffer)
    assert buffer.tell() + OVERHEAD == 1472


def test_no_room_is_refused():
    with pytest.raises(ValueError, match='no room'):
        room(ImageSegment, 100, b'x' * 60)


def records(count):
    frame = Frame(GridSegment, count, {'header.frame_id': 3, 'data': 2})
    frame.records['header']['frame_id'] = np.frombuffer(b'map', np.uint8)
    frame.records['header']['stamp']['secs'], frame.records['header']['stamp']['nsecs'] = 5, 7
    frame.records['info']['width'], frame.records['depth'] = 4, 2
    return frame.records


def test_a_head_says_what_all_say_alike():
    head = head_of(records(1)[0], GridSegment, ('info', 'depth'))
    assert (head.stamp, head.frame_id, head.depth) == (5 * 10 ** 9 + 7, 'map', 2)
    assert head.info[2] == 4 and head == head_of(records(1)[0], GridSegment, ('info', 'depth'))


def test_segments_that_say_otherwise_are_found():
    some = records(4)
    some['depth'][1] = 3
    some['info']['origin']['position']['x'][2] = 1.0
    assert same_head(some, np.arange(4), ('info', 'depth')).tolist() == [True, False, False, True]
    assert stamps_of(some, np.arange(4)).tolist() == [5 * 10 ** 9 + 7] * 4


def test_nan_is_equal_to_itself():
    some = records(2)
    some['info']['resolution'] = np.nan
    assert same_head(some, np.arange(2), ('info',)).all()
