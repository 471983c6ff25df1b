# SPDX-License-Identifier: BSD-3-Clause
import importlib
import io
import struct
import tracemalloc
from typing import Any

import genpy
import numpy as np
import pytest
from geometry_msgs.msg import PoseArray, PoseStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from sensor_msgs.msg import Image, JointState, LaserScan, PointCloud2
from std_msgs.msg import ColorRGBA, Empty, Header, String, UInt8MultiArray

from smokebot_udp.udpros.records import (
    LayoutError,
    has_header,
    lengths_of,
    record_dtype,
    same_layout,
    varying_fields,
    write_lengths,
)

PACKAGES = 'geometry_msgs', 'nav_msgs', 'rosgraph_msgs', 'sensor_msgs', 'smokebot_udp', 'std_msgs'


def message_classes() -> Any:
    for package in PACKAGES:
        module = importlib.import_module(package + '.msg')
        yield from (value for _, value in sorted(vars(module).items())
                    if isinstance(value, type) and issubclass(value, genpy.Message))


def has_layout(message_class) -> bool:
    try:
        record_dtype(message_class, {})
    except LayoutError:
        return False
    return True


WITH_LAYOUT = [c for c in message_classes() if has_layout(c)]
WITHOUT_LAYOUT = {c._type for c in message_classes() if not has_layout(c)}

NUMBERS = {'bool': st.booleans(), 'float32': st.floats(width=32), 'float64': st.floats(),
           **{name: st.integers(-1 << bits - 1, (1 << bits - 1) - 1) for name, bits in (
               ('int8', 8), ('byte', 8), ('int16', 16), ('int32', 32), ('int64', 64))},
           **{name: st.integers(0, (1 << bits) - 1) for name, bits in (
               ('uint8', 8), ('char', 8), ('uint16', 16), ('uint32', 32), ('uint64', 64))}}


def values(slot_type) -> Any:
    """What genpy takes for a field of that type."""
    if slot_type == 'string':
        return st.text(st.characters(blacklist_categories=('Cs',)), max_size=5)
    if slot_type in ('time', 'duration'):
        least = 0 if slot_type == 'time' else -1 << 31
        kind = genpy.Time if slot_type == 'time' else genpy.Duration
        return st.builds(kind, st.integers(least, (1 << 31) - 1), st.integers(0, 999999999))
    if slot_type.endswith(']'):
        element, count = slot_type[:-1].split('[')
        length = {'min_size': int(count), 'max_size': int(count)} if count else {'max_size': 3}
        if element in ('uint8', 'char'):
            return st.binary(**length)
        return st.lists(values(element), **length)
    return NUMBERS[slot_type] if slot_type in NUMBERS else messages(genpy.message.get_message_class(slot_type))


@st.composite
def messages(draw, message_class) -> Any:
    message = message_class()
    for name, slot_type in zip(message_class.__slots__, message_class._slot_types):
        setattr(message, name, draw(values(slot_type)))
    return message


def serialised(message) -> Any:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def as_record(value) -> Any:
    """A message's field as it is assigned to a record's."""
    if isinstance(value, str):
        return np.frombuffer(value.encode(), np.uint8)
    if isinstance(value, bytes):
        return np.frombuffer(value, np.uint8)
    if isinstance(value, genpy.TVal):
        return value.secs, value.nsecs
    if isinstance(value, list):
        return [as_record(element) for element in value]
    if isinstance(value, genpy.Message):
        return tuple(as_record(getattr(value, name)) for name in value.__slots__)
    return value


def fill(record, message) -> None:
    for name in message.__slots__:
        value = getattr(message, name)
        if isinstance(value, genpy.Message):
            fill(record[name], value)
        else:
            record[name] = as_record(value)


def as_value(value, slot_type) -> Any:
    """A record's field as genpy takes it."""
    if slot_type == 'string':
        return value.tobytes().decode()
    if slot_type in ('time', 'duration'):
        return (genpy.Time if slot_type == 'time' else genpy.Duration)(*value.tolist())
    if slot_type.endswith(']'):
        element = slot_type.split('[')[0]
        return value.tobytes() if element in ('uint8', 'char') else [as_value(item, element) for item in value]
    return value.item() if slot_type in NUMBERS else as_message(value, genpy.message.get_message_class(slot_type))


def as_message(record, message_class) -> Any:
    return message_class(*(as_value(record[name], slot_type)
                           for name, slot_type in zip(message_class.__slots__, message_class._slot_types)))


@pytest.mark.parametrize('message_class', WITH_LAYOUT, ids=lambda message_class: message_class._type)
@given(st.data())
@settings(max_examples=15, deadline=None)
def test_bytes_equal_genpys(message_class, data) -> None:
    message = data.draw(messages(message_class))
    expected = serialised(message)
    lengths = lengths_of(message_class, expected)
    records = np.zeros(2, record_dtype(message_class, lengths))
    fill(records[1], message)
    write_lengths(records, message_class)
    assert records[1:].tobytes() == expected
    assert serialised(as_message(records[1], message_class)) == expected
    assert same_layout(records, message_class).tolist() == [True, True]
    assert set(lengths) == {'.'.join(path) for path in varying_fields(message_class)}


def test_most_types_have_a_layout() -> None:
    names = {c._type for c in WITH_LAYOUT}
    assert {'std_msgs/Header', 'sensor_msgs/LaserScan', 'sensor_msgs/Image', 'nav_msgs/Odometry', 'std_msgs/Empty',
            'nav_msgs/OccupancyGrid', 'geometry_msgs/PoseArray', 'smokebot_udp/ImageSegment'} <= names
    assert {'sensor_msgs/PointCloud2', 'sensor_msgs/JointState', 'nav_msgs/Path',
            'std_msgs/UInt8MultiArray'} <= WITHOUT_LAYOUT


def test_a_scan_by_hand() -> None:
    dtype = record_dtype(LaserScan, {'header.frame_id': 5, 'ranges': 3, 'intensities': 1})
    assert dtype.itemsize == 4 + 8 + (4 + 5) + 7 * 4 + (4 + 12) + (4 + 4)
    assert dtype.names[-4:] == ('ranges_length', 'ranges', 'intensities_length', 'intensities')
    records = np.zeros(2, dtype)
    write_lengths(records, LaserScan)
    records['header']['frame_id'] = np.frombuffer(b'laser', np.uint8)
    records['header']['stamp']['secs'] = 7
    records['ranges'] = [[1, 2, 3], [4, np.inf, -np.inf]]
    scan = LaserScan().deserialize(records[1].tobytes())
    assert (scan.header.frame_id, scan.header.stamp, scan.ranges) == ('laser', genpy.Time(7), (4, np.inf, -np.inf))
    assert scan.intensities == (0,)


def test_fixed_arrays_and_nested_messages() -> None:
    dtype = record_dtype(Odometry, {'child_frame_id': 2})
    assert dtype['pose']['covariance'].shape == (36,)
    assert dtype['child_frame_id'].shape == (2,)
    assert dtype['header']['frame_id'].shape == (0,)
    assert record_dtype(PoseArray, {'poses': 4})['poses'].base['orientation'].names == ('x', 'y', 'z', 'w')


@pytest.mark.parametrize('message_class', [PointCloud2, JointState, Path, UInt8MultiArray])
def test_elements_that_vary_have_no_layout(message_class) -> None:
    """nav_msgs/Path's elements hide their string one message deeper."""
    message = message_class()
    if message_class is Path:
        message.poses = [PoseStamped()]
    with pytest.raises(LayoutError, match='vary in size'):
        record_dtype(message_class, {})
    with pytest.raises(LayoutError, match='vary in size'):
        lengths_of(message_class, serialised(message))


def test_unknown_names() -> None:
    with pytest.raises(LayoutError, match='frame_id'):
        record_dtype(Image, {'frame_id': 3, 'data': 5})
    with pytest.raises(LayoutError):
        record_dtype(Image, {'height': 3})


def test_impossible_lengths() -> None:
    for length in (-1, 1 << 31, 0xffffffff):
        with pytest.raises(LayoutError):
            record_dtype(Image, {'data': length})


class Clash(genpy.Message):
    """uint8[] data, uint32 data_length"""
    _type = 'somewhere/Clash'
    __slots__ = ['data', 'data_length']
    _slot_types = ['uint8[]', 'uint32']


class NoClash(genpy.Message):
    """uint8 data, uint32 data_length: a length that is none"""
    _type = 'somewhere/NoClash'
    __slots__ = ['data', 'data_length']
    _slot_types = ['uint8', 'uint32']


class Empties(genpy.Message):
    _type = 'somewhere/Empties'
    __slots__ = ['nothing']
    _slot_types = ['std_msgs/Empty[]']


class Unknown(genpy.Message):
    _type = 'somewhere/Unknown'
    __slots__ = ['field']
    _slot_types = ['nowhere/Nothing']


def test_fields_named_like_lengths() -> None:
    with pytest.raises(LayoutError):
        record_dtype(Clash, {'data': 2})
    records = np.zeros(1, record_dtype(NoClash, {}))
    records['data_length'] = 9
    write_lengths(records, NoClash)
    assert records['data_length'] == 9 and same_layout(records, NoClash).all()


def test_endless_nothing() -> None:
    with pytest.raises(LayoutError):
        lengths_of(Empties, b'\xff\xff\xff\xff')


def test_types_that_are_not_installed() -> None:
    with pytest.raises(LayoutError, match='not installed'):
        lengths_of(Unknown, b'')


def test_lengths_of() -> None:
    assert lengths_of(Header, serialised(Header(frame_id='map'))) == {'frame_id': 3}
    assert lengths_of(Empty, b'') == {}
    grid = OccupancyGrid(data=[-1, 0, 100])
    assert lengths_of(OccupancyGrid, serialised(grid)) == {'header.frame_id': 0, 'data': 3}
    assert lengths_of(Image, memoryview(serialised(Image(encoding='mono8', data=b'12')))) == {
        'header.frame_id': 0, 'encoding': 5, 'data': 2}


@pytest.mark.parametrize('message', [Header(frame_id='map'), LaserScan(ranges=[1., 2.]), Image(data=bytes(9)),
                                     ColorRGBA(), String(data='hello')], ids=lambda message: message._type)
def test_every_other_length_is_refused(message) -> None:
    data = serialised(message)
    for end in range(len(data)):
        with pytest.raises(LayoutError):
            lengths_of(type(message), data[:end])
    with pytest.raises(LayoutError):
        lengths_of(type(message), data + b'\0')


@given(st.sampled_from(WITH_LAYOUT), st.binary(max_size=200))
@settings(max_examples=500)
def test_random_bytes_give_a_layout_of_their_size_or_a_layout_error(message_class, data) -> None:
    try:
        lengths = lengths_of(message_class, data)
    except LayoutError:
        return
    assert record_dtype(message_class, lengths).itemsize == len(data)


def test_a_length_field_costs_no_memory() -> None:
    data = bytearray(serialised(Image(data=bytes(100))))
    struct.pack_into('<I', data, len(data) - 104, 0xfffffff0)
    tracemalloc.start()
    try:
        with pytest.raises(LayoutError):
            lengths_of(Image, data)
        assert tracemalloc.get_traced_memory()[1] < 100000
    finally:
        tracemalloc.stop()


def test_same_layout_tells_the_rows_of_other_lengths() -> None:
    """Three messages of 21 bytes: only the first and the last share a layout."""
    rows = [serialised(Header(frame_id='abcde')), b'\0' * 12 + b'\4\0\0\0' + b'abcde',
            serialised(Header(frame_id='vwxyz'))]
    records = np.frombuffer(b''.join(rows), record_dtype(Header, {'frame_id': 5}))
    assert same_layout(records, Header).tolist() == [True, False, True]


def test_same_layout_looks_at_every_length() -> None:
    records = np.zeros(3, record_dtype(Image, {'header.frame_id': 1, 'encoding': 2, 'data': 3}))
    write_lengths(records, Image)
    records['header']['frame_id_length'][0] = 2
    records['encoding_length'][1] = 1
    assert same_layout(records, Image).tolist() == [False, False, True]
    assert same_layout(records[:0], Image).tolist() == []


def test_has_header() -> None:
    assert has_header(Image) and has_header(Odometry)
    assert not has_header(String) and not has_header(Header)
