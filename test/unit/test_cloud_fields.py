# SPDX-License-Identifier: BSD-3-Clause
"""Further fields of clouds, such as rgb and ring: both sides, and what is forged."""
from typing import Any, List, Tuple

import numpy as np
import pytest
from genpy import Time
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import PointCloud2, PointField

from evaluation.linked_encoder import LinkedEncoder
from evaluation.offline_link import Sender, assemble_all, operator_side
from smokebot_udp.codecs.wire.cloud import MAX_BYTES, MAX_POINTS, CloudParts, deal, plain
from smokebot_udp.codecs.wire.cloud_fields import CloudField, bytes_dtype, names_of, read_fields, write_fields
from smokebot_udp.codecs.wire.points import DATATYPES
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import CloudChunk
from smokebot_udp.streams.cloud.encoder import CloudEncoder
from smokebot_udp.udpros.records import record_dtype

pytestmark = pytest.mark.filterwarnings('error')
NAMES = ['f%d' % datatype for datatype in DATATYPES]
ALL = ', '.join(NAMES)


def cloud_of(columns: Any, order: str = '<', rows: int = 1, stamp: int = 1) -> PointCloud2:
    """A PointCloud2 of {name: (datatype, (n,) array)}, with a byte between fields."""
    count = len(next(iter(columns.values()))[1])
    kinds = {name: np.dtype(DATATYPES[datatype]).newbyteorder(order) for name, (datatype, _) in columns.items()}
    offsets, step = [], 0
    for kind in kinds.values():
        offsets.append(step)
        step += kind.itemsize + 1
    points: Any = np.zeros(count, np.dtype({'names': list(kinds), 'formats': list(kinds.values()), 'offsets': offsets,
                                            'itemsize': step}))
    for name, (_, values) in columns.items():
        points[name] = values
    message = PointCloud2(
        height=rows, width=count // rows, point_step=step, row_step=step * (count // rows), is_bigendian=order == '>',
        data=points.tobytes(),
        fields=[PointField(name, at, columns[name][0], 1) for name, at in zip(columns, offsets)])
    message.header.stamp, message.header.frame_id = Time(stamp, 0), 'camera'
    return message


def xyz(points: Any) -> Any:
    return {name: (7, np.float32(points)[:, axis]) for axis, name in enumerate('xyz')}


def random_cloud(count: int = 500, seed: int = 0, **options: Any) -> Tuple[PointCloud2, Any]:
    """A cloud with a field of random bytes of each datatype, and its columns."""
    random = np.random.RandomState(seed)
    columns = xyz(random.rand(count, 3) * 9)
    for name, (datatype, kind) in zip(NAMES, DATATYPES.items()):
        size = np.dtype(kind).itemsize
        raw = np.frombuffer(random.bytes(count * size), kind)
        columns[name] = datatype, np.nan_to_num(raw) if kind[0] == 'f' else raw
    return cloud_of(columns, **options), columns


def crossed(message: PointCloud2, came: Any = None, **options: Any) -> PointCloud2:
    """What is shown of a message, of all or of some datagrams of its frame."""
    frame, = Sender('cloud', **{'leaf_size': 0.0, **options}).frames(message)
    assert frame.datagram_size <= 1472
    assembler, values = operator_side('cloud')
    assembled, = assemble_all(assembler, values, [frame.records if came is None else frame.records[came]])
    assert not sum(assembler.dropped.values())
    shown: PointCloud2 = assembled.message
    assert len(shown.data) == shown.width * shown.point_step
    return shown


def columns_in(message: PointCloud2) -> Any:
    """{name: (n,) array} of a message."""
    dtype = np.dtype({'names': [field.name for field in message.fields],
                      'formats': ['<' + DATATYPES[field.datatype] for field in message.fields],
                      'offsets': [field.offset for field in message.fields], 'itemsize': message.point_step})
    points: Any = np.frombuffer(message.data, dtype)
    return {name: points[name] for name in dtype.names}


@pytest.mark.parametrize('encoding', ['float32', 'packed', 'sorted'])
@pytest.mark.parametrize('order, rows', [('<', 1), ('>', 1), ('<', 10)])
def test_fields_of_all_types_cross_bit_by_bit(encoding: str, order: str, rows: int) -> None:
    message, columns = random_cloud(order=order, rows=rows)
    shown = crossed(message, encoding=encoding, fields=ALL)
    assert [(field.name, field.datatype) for field in shown.fields] == [
        ('x', 7), ('y', 7), ('z', 7), *zip(NAMES, DATATYPES)]
    got = columns_in(shown)
    for name, (_, values) in columns.items():
        if name in 'xyz':
            np.testing.assert_allclose(got[name], values, rtol=0, atol=0 if encoding == 'float32' else 0.0125 + 2e-6)
        else:
            np.testing.assert_array_equal(got[name], values)


def test_some_datagrams_show_their_points_with_their_fields() -> None:
    message, columns = random_cloud(2000)
    frame, = Sender('cloud', leaf_size=0.0, fields=ALL).frames(message)
    got = columns_in(crossed(message, slice(0, None, 3), fields=ALL))
    rows = {tuple(row) for row in zip(*(columns[name][1].tolist() for name in columns))}
    shown = list(zip(*(got[name].tolist() for name in columns)))
    assert len(frame) > 30 and 600 < len(shown) < 760 and rows.issuperset(shown)


def test_points_that_are_not_finite_or_cropped_take_their_fields_with_them() -> None:
    points = np.array([[0, 0, 0], [np.nan, 0, 0], [50, 0, 0], [3, 0, 0]])
    message = cloud_of({**xyz(points), 'ring': (4, np.arange(4))})
    got = columns_in(crossed(message, fields='ring', max_x=10.0))
    assert got['ring'].tolist() == [0, 3] and got['x'].tolist() == [0, 3]


def test_the_voxel_filter_averages_colours_and_takes_the_first_of_others() -> None:
    points = [[0.01, 0, 0], [0.03, 0, 0], [5, 0, 0], [0.02, 0, 0]]
    colours = np.array([0xff102030, 0xff304050, 0x00000000, 0xff203041], np.uint32)
    message = cloud_of({**xyz(points), 'rgb': (7, colours.view(np.float32)), 'ring': (2, [7, 8, 9, 6])})
    got = columns_in(crossed(message, leaf_size=0.1, fields='rgb, ring'))
    assert [hex(value) for value in got['rgb'].view(np.uint32)] == ['0xff203040', '0x0']
    assert got['ring'].tolist() == [7, 9] and got['x'].tolist() == pytest.approx([0.02, 5])


def test_intensity_as_a_field_is_exact() -> None:
    message = cloud_of({**xyz(np.eye(3)), 'intensity': (7, [0.1, 1e9, -7.7])})
    got = columns_in(crossed(message, encoding='packed', intensity=True, fields='intensity'))
    assert got['intensity'].tolist() == np.float32([0.1, 1e9, -7.7]).tolist() and len(got) == 4


def robot_side(**options: Any) -> Any:
    """f(message, max_datagram_size) -> the warnings of encoding it."""
    values = Settings(check({'robot_topic': 'unused', **options}, CloudEncoder.PARAMETERS))
    encoder = LinkedEncoder(CloudEncoder(values.requested))

    def encode(message: PointCloud2, size: int = 1472) -> List[str]:
        encoder.warnings.clear()
        encoder.encode(message, values, size)
        return list(encoder.warnings)
    return encode


def test_what_is_not_sent_is_named_once() -> None:
    warnings = robot_side(fields='rgb ring', encoding='sorted')
    message = cloud_of({**xyz(np.eye(3)), 'rgb': (7, np.ones(3)), 'time': (7, np.ones(3)), '_': (2, np.ones(3)),
                        'intensity': (7, np.ones(3))})
    assert warnings(message) == [
        'not sent: time, intensity; see its setting fields',
        'the cloud has no field ring, only x, y, z, rgb, time, intensity',
        'its fields cannot be sorted, encoding packed is used']
    assert warnings(message) == []
    assert robot_side()(cloud_of(xyz(np.eye(3)))) == []


def test_a_field_with_several_values_is_refused() -> None:
    message = cloud_of({**xyz(np.eye(3)), 'normal': (7, np.ones(3))})
    message.fields[3].count = 3
    with pytest.raises(ValueError, match='field normal has 3 values a point, must be one'):
        Sender('cloud', fields='normal').frames(message)
    crossed(message)


def test_a_point_that_does_not_fit_is_refused() -> None:
    columns = xyz(np.eye(3))
    columns.update({'f%02d' % number: (8, np.ones(3)) for number in range(32)})
    with pytest.raises(ValueError, match='a point of 268 bytes does not fit in a datagram'):
        robot_side(fields=' '.join(list(columns)[3:]))(cloud_of(columns), 512)


@pytest.mark.parametrize('text, names', [
    ('', ()), ('rgb', ('rgb',)), ('x, y, t', ('t',)), ('rgb, ring', ('rgb', 'ring')),
    ('ring rgb,ring', ('ring', 'rgb'))])
def test_the_setting(text: str, names: Tuple[str, ...]) -> None:
    assert names_of(text) == names


@pytest.mark.parametrize('text', ['a:b', 'ä', 'a' * 65, ' '.join('f%d' % number for number in range(33))])
def test_bad_settings(text: str) -> None:
    with pytest.raises(ValueError, match='fields has'):
        Sender('cloud', fields=text)


def test_the_text_on_the_wire() -> None:
    fields = CloudField('rgb', 7), CloudField('ring', 4)
    assert write_fields(fields) == b'rgb:7,ring:4' and read_fields('rgb:7,ring:4') == fields and read_fields('') == ()
    assert bytes_dtype(fields).itemsize == 6


@pytest.mark.parametrize('text', [
    'rgb', 'rgb:', ':7', 'rgb:0', 'rgb:9', 'rgb:07', 'rgb:7,', 'rgb:7,rgb:4', 'x:7', 'a b:7', 'a\x1b:7',
    'a' * 65 + ':7',
    ','.join('f%d:7' % number for number in range(33))])
def test_forged_texts_are_refused(text: str) -> None:
    with pytest.raises(ValueError):
        read_fields(text)


def test_the_size_of_a_cloud_is_bounded() -> None:
    CloudParts(MAX_POINTS, 60000, plain(True), 16)
    with pytest.raises(ValueError, match='2097152 points of 33 bytes'):
        CloudParts(MAX_POINTS, 60000, plain(True), 17)
    with pytest.raises(ValueError, match='there are up to %d' % MAX_BYTES):
        deal(np.broadcast_to(np.zeros(33, np.uint8), (MAX_POINTS, 33)), 60000)


TEXTS = ['', 'a:1', 'rgb:7,ring:4', 'intensity:7', 'f:8,g:8', 'x:7', 'a:0', '\x1b:3', 'é',
         ','.join('f%d:8' % n for n in range(32))]


@settings(deadline=None, max_examples=300)
@given(st.integers(0, 2 ** 32 - 1), st.integers(1, 4), st.sampled_from([0, 6, 12, 13, 18, 28, 32, 268, 1280]),
       st.sampled_from([0, 5]), st.sampled_from(TEXTS) | st.text(max_size=9),
       st.sampled_from([1, 2, 3, MAX_POINTS, None]), st.sampled_from([0.0, 0.5, None]))
def test_forged_chunks_raise_nothing(seed: int, count: int, size: int, codes: int, text: str, points: Any,
                                     step: Any) -> None:
    raw = text.encode()
    dtype = record_dtype(CloudChunk, {'fields': len(raw), 'codes': codes, 'data': size})
    records: Any = np.frombuffer(np.random.RandomState(seed).bytes(count * dtype.itemsize), dtype).copy()
    records['fields'], records['header']['stamp'] = np.frombuffer(raw, np.uint8), (1, 2)
    records['chunks'], records['index'], records['bits'] = 1 + seed % 3, np.arange(count) % 3, 8
    for name, value in ('points', points), ('step', step):
        if value is not None:
            records[name] = value
    assembler, values = operator_side('cloud')
    for assembled in assemble_all(assembler, values, [records]):
        columns_in(assembled.message)


def test_points_persist_with_their_fields_among_those_with_the_same() -> None:
    assembler, values = operator_side('cloud', persistence=10.0)
    shown = []
    for number, names in enumerate(('ring', 'ring', 'ring rgb', 'ring rgb')):
        columns = {**xyz([[number, 0, 0]]), 'ring': (4, [number]), 'rgb': (7, [number])}
        frame, = Sender('cloud', leaf_size=0.0, fields=names).frames(cloud_of(columns, stamp=number + 1))
        assembled, = assemble_all(assembler, values, [frame.records], 0.1 * number, True)
        shown.append({name: column.tolist() for name, column in columns_in(assembled.message).items()
                      if name not in 'yz'})
    assert shown == [{'x': [0], 'ring': [0]}, {'x': [0, 1], 'ring': [0, 1]}, {'x': [2], 'ring': [2], 'rgb': [2]},
                     {'x': [2, 3], 'ring': [2, 3], 'rgb': [2, 3]}]


def test_forged_points_that_are_not_finite_are_left_out_with_their_fields() -> None:
    parts = CloudParts(3, 1, plain(False), 1)
    points = np.float32([[0, 0, 0], [np.nan, 0, 0], [2, 0, 0]])
    rows = np.hstack([points.view(np.uint8).reshape(3, 12), np.uint8([[7], [8], [9]])])
    assert parts.add(np.zeros(1, int), rows.reshape(1, -1)).all()
    shown, _, extra = parts.merge_with_fields()
    assert shown[:, 0].tolist() == [0, 2] and extra.tolist() == [[7], [9]]
