# SPDX-License-Identifier: BSD-3-Clause
import io
from typing import Any

import numpy as np
import pytest
from std_msgs.msg import Header

from smokebot_udp.msg import CloudChunk, GridSegment, ImageSegment, ScanSegment
from smokebot_udp.streams.segments import as_bytes, head_of, room, same_head, stamps_of, write_header
from smokebot_udp.udpros import Frame
from smokebot_udp.udpros.datagram import OVERHEAD


@pytest.mark.parametrize('segment_class, field', [
    (ImageSegment, 'data'), (GridSegment, 'data'), (CloudChunk, 'data'), (ScanSegment, 'ranges')])
def test_a_full_segment_fills_its_datagram_exactly(segment_class, field) -> None:
    left = room(segment_class, 1472, b'frame')
    segment = segment_class(**{field: [0] * left if segment_class is GridSegment else bytes(left)})
    segment.header.frame_id = 'frame'
    buffer = io.BytesIO()
    segment.serialize(buffer)
    assert buffer.tell() + OVERHEAD == 1472


def test_no_room_is_refused() -> None:
    with pytest.raises(ValueError, match='no room'):
        room(ImageSegment, 100, b'x' * 60)


def records(count) -> Any:
    frame = Frame(GridSegment, count, {'header.frame_id': 3, 'data': 2})
    frame.records['header']['frame_id'] = np.frombuffer(b'map', np.uint8)
    frame.records['header']['stamp']['secs'], frame.records['header']['stamp']['nsecs'] = 5, 7
    frame.records['info']['width'], frame.records['depth'] = 4, 2
    return frame.records


def test_a_head_says_what_all_say_alike() -> None:
    head = head_of(records(1)[0], GridSegment, ('info', 'depth'))
    assert (head.stamp, head.frame_id, head.depth) == (5 * 10 ** 9 + 7, 'map', 2)
    assert head.info[2] == 4 and head == head_of(records(1)[0], GridSegment, ('info', 'depth'))


def test_segments_that_say_otherwise_are_found() -> None:
    some = records(4)
    some['depth'][1] = 3
    some['info']['origin']['position']['x'][2] = 1.0
    assert same_head(some, np.arange(4), ('info', 'depth')).tolist() == [True, False, False, True]
    assert stamps_of(some, np.arange(4)).tolist() == [5 * 10 ** 9 + 7] * 4


def test_nan_is_equal_to_itself() -> None:
    some = records(2)
    some['info']['resolution'] = np.nan
    assert same_head(some, np.arange(2), ('info',)).all()


@pytest.mark.parametrize('max_datagram_size', [200, 576, 9000])
def test_room_beside_texts_of_any_letters(max_datagram_size) -> None:
    segment = ImageSegment(encoding='mono16', header=Header(frame_id='k\u00e9p'))
    left = room(ImageSegment, max_datagram_size, segment.header.frame_id.encode(), segment.encoding.encode())
    segment.data = bytes(left)
    buffer = io.BytesIO()
    segment.serialize(buffer)
    assert buffer.tell() + OVERHEAD == max_datagram_size


def test_the_last_byte_of_room() -> None:
    used = 1472 - room(ImageSegment, 1472)
    assert room(ImageSegment, used + 1) == 1
    with pytest.raises(ValueError, match='no room'):
        room(ImageSegment, used)


def image_records(count) -> Any:
    frame = Frame(ImageSegment, count, {'header.frame_id': 4, 'encoding': 5, 'data': 1})
    header = Header(frame_id='k\u00e9p')
    header.stamp.secs, header.stamp.nsecs = 4294967295, 999999999
    write_header(frame.records, header)
    frame.records['encoding'] = as_bytes('mono8')
    return frame.records


def test_a_header_is_written_into_all_records() -> None:
    for record in image_records(2):
        segment = ImageSegment().deserialize(record.tobytes())
        assert (segment.header.frame_id, segment.header.stamp.to_nsec()) == ('k\u00e9p', 4294967295999999999)


def test_texts_are_texts_and_stamps_do_not_overflow() -> None:
    records = image_records(3)
    head = head_of(records[0], ImageSegment, ('encoding', 'height'))
    assert vars(head) == {'stamp': 4294967295999999999, 'frame_id': 'k\u00e9p', 'encoding': 'mono8', 'height': 0}
    assert stamps_of(records, np.array([0, 2])).tolist() == [4294967295999999999] * 2
    records['encoding'][2] = as_bytes('bgra8')
    assert same_head(records, np.arange(3), ('encoding',)).tolist() == [True, True, False]
    assert same_head(records, np.arange(3), ()).all()
    records['header']['frame_id'][1] = as_bytes('lens')
    assert same_head(records, np.arange(3), ()).tolist() == [True, False, True]
    assert same_head(records, np.array([1, 0]), ()).tolist() == [True, False]    # the first of the rows counts


def test_texts_that_are_none_and_texts_of_no_length() -> None:
    records = image_records(1)
    records['encoding'] = as_bytes(b'\xff\xfe' + b'abc')
    assert head_of(records[0], ImageSegment, ('encoding',)).encoding == '\ufffd\ufffdabc'
    empty = Frame(ScanSegment, 2, {}).records
    assert head_of(empty[0], ScanSegment, ()).frame_id == '' and same_head(empty, np.arange(2), ()).all()


def test_whole_arrays_are_tuples() -> None:
    chunks = Frame(CloudChunk, 2, {}).records
    chunks['origin'] = [[1, -2, 3], [1, -2, 4]]
    head = head_of(chunks[0], CloudChunk, ('origin', 'step'))
    assert (head.origin, head.step) == ((1, -2, 3), 0.0) and type(head.step) is float
    assert same_head(chunks, np.arange(2), ('origin',)).tolist() == [True, False]
