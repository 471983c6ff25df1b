# SPDX-License-Identifier: BSD-3-Clause
"""Clouds on the operator's side, and both sides of a stream: an encoder's datagrams to an assembler's message."""
import io
from typing import Any, List, Optional, Tuple

import numpy as np
import pytest
from genpy import Time
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import PointCloud2, PointField

from evaluation.offline_link import Sender, assemble_all, operator_side
from smokebot_udp.codecs.perception.voxel import voxel_filter
from smokebot_udp.codecs.wire.cloud import MAX_POINTS
from smokebot_udp.codecs.wire.points import as_points
from smokebot_udp.msg import CloudChunk
from smokebot_udp.simulation.lidar import POINT, Lidar
from smokebot_udp.simulation.world import building
from smokebot_udp.streams.cloud.assembler import MAX_PERSISTENT_POINTS
from smokebot_udp.udpros.records import record_dtype

pytestmark = pytest.mark.filterwarnings('error')
BOUND, LEAF, DATAGRAM = 0.0125, 0.1, 1472
FIELDS = [PointField(name, POINT.fields[name][1], PointField.FLOAT32, 1) for name in ('x', 'y', 'z', 'intensity')]


def cloud_message(points: Any, stamp: int = 1700000000) -> PointCloud2:
    """A PointCloud2 of an array of lidar.POINT."""
    message = PointCloud2(height=1, width=len(points), point_step=points.itemsize, row_step=points.nbytes,
                          data=points.tobytes(), fields=FIELDS)
    message.header.stamp, message.header.frame_id = Time(stamp, 5), 'velodyne'
    return message


@pytest.fixture(scope='module')
def scan() -> Any:
    points = Lidar(building(1), 0.9, 1).scan((1.5, 7, 0.3), 1.0)
    points['x'][::100] = np.nan
    return points


def frame_of(message: PointCloud2, **options: Any) -> Any:
    frame, = Sender('cloud', **options).frames(message)
    assert frame.datagram_size <= DATAGRAM
    return frame


def received(frame: Any, came: Any = None) -> Any:
    """The Assembled of a frame, or of some of its datagrams."""
    assembler, values = operator_side('cloud')
    assembled, = assemble_all(assembler, values, [frame.records if came is None else frame.records[came]])
    assert not sum(assembler.dropped.values())
    return assembled


def points_in(message: PointCloud2) -> Tuple[Any, Any]:
    """A message's points, and intensities or None."""
    return as_points(message, True)


def thinned(scan: Any, intensity: bool = False, leaf: float = LEAF) -> Tuple[Any, Any]:
    kept = scan[np.isfinite(scan['x'])]
    points = np.stack([kept[name] for name in 'xyz'], axis=1)
    values = kept['intensity'].copy() if intensity else None
    return voxel_filter(points, leaf, values) if leaf else (points, values)


@pytest.mark.parametrize('intensity', [False, True])
@pytest.mark.parametrize('encoding', ['float32', 'packed'])
@pytest.mark.parametrize('leaf', [0.0, LEAF])
def test_both_ends_agree(scan: Any, encoding: str, intensity: bool, leaf: float) -> None:
    assembled = received(frame_of(cloud_message(scan), encoding=encoding, intensity=intensity, leaf_size=leaf))
    message = assembled.message
    points, values = points_in(message)
    expected, expected_values = thinned(scan, intensity, leaf)
    assert message.is_dense and assembled.completeness == 1.0
    assert [field.name for field in message.fields] == ['x', 'y', 'z'] + ['intensity'] * intensity
    if encoding == 'float32':
        np.testing.assert_array_equal(points, expected)
        assert values is None if not intensity else values.tolist() == expected_values.tolist()
    else:
        np.testing.assert_allclose(points, expected, rtol=0, atol=BOUND + 2e-6)
        if intensity:
            half = np.ptp(expected_values) / 255 / 2
            np.testing.assert_allclose(values, expected_values, rtol=0, atol=half + 1e-4)
    assert (message.header.frame_id, message.header.stamp.to_nsec()) == ('velodyne', 1700000000 * 10 ** 9 + 5)
    assert assembled.stamp == 1700000000 * 10 ** 9 + 5


@pytest.mark.parametrize('intensity', [False, True])
@pytest.mark.parametrize('leaf', [0.0, LEAF])
def test_a_sorted_cloud_is_the_packed_one_in_another_order(scan: Any, intensity: bool, leaf: float) -> None:
    packed, ordered = (received(frame_of(cloud_message(scan), encoding=encoding, intensity=intensity, leaf_size=leaf))
                       for encoding in ('packed', 'sorted'))
    rows = [np.frombuffer(assembled.message.data, '<f4').reshape(-1, 3 + intensity) for assembled in (packed, ordered)]
    assert rows[0].tolist() != rows[1].tolist()
    assert sorted(rows[0].tolist()) == sorted(rows[1].tolist())
    assert ordered.completeness == 1.0 and ordered.message.fields == packed.message.fields


def test_broken_chunks_do_not_count_as_received(scan: Any) -> None:
    frame = frame_of(cloud_message(scan), encoding='sorted')
    frame.records['data'][1:3, 1:4] = 255
    assembler, values = operator_side('cloud')
    assembled, = assemble_all(assembler, values, [frame.records])
    assert assembler.dropped['broken'] == 2 and assembled.completeness == 1 - 2 / len(frame)
    frame.records['data'] = 255
    frame.records['header']['stamp']['secs'] += 1
    assert assemble_all(assembler, values, [frame.records]) == []
    assert assembler.dropped['broken'] == 2 + len(frame)


@pytest.mark.parametrize('encoding, deviation', [('float32', 0.25), ('packed', 0.3), ('sorted', 0.3)])
def test_lost_chunks_thin_the_cloud_evenly(scan: Any, encoding: str, deviation: float) -> None:
    frame = frame_of(cloud_message(scan), encoding=encoding)
    whole = points_in(received(frame).message)[0]
    _, block, counts = np.unique(np.floor(whole), axis=0, return_inverse=True, return_counts=True)
    many = counts >= 50
    assert many.sum() > 20

    def worst(came: Any) -> Any:
        """By how much the share kept of a 1 m block with many points is off."""
        there = set(map(tuple, points_in(received(frame, came).message)[0].tolist()))
        kept = np.array([point in there for point in map(tuple, whole.tolist())])
        assert kept.mean() == pytest.approx(came.mean(), abs=0.01)
        return np.abs(np.bincount(block.reshape(-1), kept)[many] / counts[many] - came.mean()).max()

    half = np.arange(len(frame)) < len(frame) // 2
    assert worst(half) < 0.1      # the link breaks half way through
    # were points not dealt but cut into chunks, half a dozen blocks would be gone each time
    for seed in range(10):
        assert worst(np.random.RandomState(seed).permutation(half)) < deviation


UTM = 412345.125, 5401234.5, 312.0625


def doubles(exact: Any) -> PointCloud2:
    return PointCloud2(height=1, width=len(exact), point_step=24, row_step=exact.nbytes, data=exact.tobytes(),
                       fields=[PointField(name, 8 * i, PointField.FLOAT64, 1) for i, name in enumerate('xyz')])


@pytest.mark.parametrize('wild', [None, 1e12])
@pytest.mark.parametrize('encoding, bound', [('float32', 1e-4), ('packed', BOUND + 1e-4), ('sorted', BOUND + 1e-4)])
def test_doubles_in_utm_come_as_doubles(encoding: str, bound: float, wild: Optional[float]) -> None:
    exact = np.random.RandomState(0).uniform(-20, 20, (500, 3)) + UTM
    if wild is not None:
        exact[7, 0] = wild
    message = received(frame_of(doubles(exact), encoding=encoding, leaf_size=0.0)).message
    assert [(field.name, field.offset, field.datatype) for field in message.fields] == [
        ('x', 0, 8), ('y', 8, 8), ('z', 16, 8)]
    points = np.frombuffer(message.data, '<f8').reshape(-1, 3)
    nearest = np.abs(points[:, np.newaxis] - exact).max(axis=2).min(axis=0)
    assert len(points) == 500 and np.delete(nearest, 7).max() <= bound
    assert wild is not None or nearest[7] <= bound


@pytest.mark.parametrize('encoding', ['float32', 'packed', 'sorted'])
def test_the_voxel_filter_and_the_crop_box_work_in_utm(encoding: str) -> None:
    exact = np.repeat(np.random.RandomState(0).randint(-20, 20, (200, 3)) + UTM, 2, axis=0)
    exact[1::2] += 0.02
    message = received(frame_of(doubles(exact), encoding=encoding, leaf_size=0.5, min_z=UTM[2])).message
    points = np.frombuffer(message.data, '<f8').reshape(-1, 3)
    assert points[:, 2].min() > UTM[2] - BOUND and 50 < len(points) < 200
    centres = (exact[::2] + exact[1::2]) / 2
    assert np.abs(points[:, np.newaxis] - centres).max(axis=2).min(axis=1).max() < BOUND + 1e-3


def test_doubles_near_the_origin_come_as_floats_for_rviz() -> None:
    exact = np.random.RandomState(0).uniform(-20, 20, (500, 3))
    message = received(frame_of(doubles(exact), leaf_size=0.0)).message
    assert {field.datatype for field in message.fields} == {PointField.FLOAT32}
    np.testing.assert_array_equal(points_in(message)[0], exact.astype(np.float32))


@pytest.mark.parametrize('encoding', ['float32', 'packed', 'sorted'])
def test_nothing_seen_clears_the_display(scan: Any, encoding: str) -> None:
    nothing = scan[:50].copy()
    nothing['y'] = np.nan
    for points in (nothing, nothing[:0]):
        message = received(frame_of(cloud_message(points), encoding=encoding)).message
        assert (message.height, message.width, message.data) == (1, 0, b'')
        assert [field.name for field in message.fields] == ['x', 'y', 'z']


def test_a_cloud_cropped_to_nothing_comes_as_an_empty_one(scan: Any) -> None:
    for encoding in ('float32', 'packed', 'sorted'):
        frame = frame_of(cloud_message(scan), encoding=encoding, min_x=900.0)
        message = received(frame).message
        assert (len(frame), message.height, message.width, message.data) == (1, 1, 0, b'')


def test_crop_box_and_least_range(scan: Any) -> None:
    frame = frame_of(cloud_message(scan), leaf_size=0.0, min_range=2.0, min_x=-1.0, max_x=5.0, max_z=0.5)
    points, _ = thinned(scan, leaf=0)
    x, _, z = points.T
    kept = (x >= -1) & (x <= 5) & (z <= 0.5) & (np.linalg.norm(points, axis=1) >= 2)
    np.testing.assert_array_equal(points_in(received(frame).message)[0], points[kept])


# points of earlier clouds

def published(times: List[float], still: List[bool], persistence: float = 1.0, intensity: Optional[List[bool]] = None
              ) -> List[int]:
    """How many points clouds of one point each have that come at these times."""
    assembler, values = operator_side('cloud', persistence=persistence)
    counts = []
    for number, (now, stands) in enumerate(zip(times, still)):
        points = np.zeros(1, POINT)
        points['x'] = number + 1
        frame = frame_of(cloud_message(points, stamp=number + 1), leaf_size=0.0,
                         intensity=bool(intensity and intensity[number]))
        assembled, = assemble_all(assembler, values, [frame.records], now, stands)
        counts.append(assembled.message.width)
    return counts


def test_points_persist_while_the_robot_stands_still() -> None:
    assert published([0.0, 0.4, 0.8, 1.1, 3.0], [True] * 5) == [1, 2, 3, 3, 1]
    assert published([0.0, 0.4, 0.8, 1.1], [True, True, False, True]) == [1, 2, 1, 2]
    assert published([0.0, 0.4], [True, True], persistence=0.0) == [1, 1]


def test_points_persist_in_one_frame_with_and_without_a_slash() -> None:
    assembler, values = operator_side('cloud', persistence=1.0)
    shown = []
    for number, frame_id in enumerate(['lidar', '/lidar', 'other']):
        message = cloud_message(np.ones(1, POINT), stamp=number + 1)
        message.header.frame_id = frame_id
        assembled, = assemble_all(assembler, values, [frame_of(message, leaf_size=0.0).records], 0.1 * number, True)
        shown.append((assembled.message.header.frame_id, assembled.message.width))
    assert shown == [('lidar', 1), ('/lidar', 2), ('other', 1)]


def test_persistent_points_are_bounded_and_the_oldest_go_first() -> None:
    count = MAX_PERSISTENT_POINTS // 4
    assembler, values = operator_side('cloud', persistence=3600.0)
    shown = []
    for number in range(6):
        points = np.zeros(count if number < 5 else MAX_POINTS, POINT)
        points['x'] = number
        frames = frame_of(cloud_message(points, stamp=number + 1), leaf_size=0.0)
        assembled, = assemble_all(assembler, values, [frames.records], float(number), True)
        xs = np.frombuffer(assembled.message.data, '<f4')[::assembled.message.point_step // 4]
        shown.append((assembled.message.width // count, xs.min(), xs.max()))
    assert shown == [(1, 0, 0), (2, 0, 1), (3, 0, 2), (4, 0, 3), (4, 1, 4), (MAX_POINTS // count, 5, 5)]


def test_points_without_intensity_do_not_stay_among_those_with_it() -> None:
    assert published([0.0, 0.1, 0.2], [True] * 3, intensity=[False, True, True]) == [1, 1, 2]


# what a hostile sender may send

HOSTILE = {
    'points': [0, 1, 2, 80, 65536, MAX_POINTS, MAX_POINTS + 1, 2 ** 31, 2 ** 32 - 1],
    'chunks': [0, 1, 2, 3, 80, 65535], 'index': [0, 1, 2, 65535], 'has_intensity': [0, 1, 2, 255],
    'step': [0.0, -0.0, 1e-45, 0.025, 3e38, -1.0, np.inf, -np.inf, np.nan],
    'origin': [0, -2 ** 31, 2 ** 31 - 1], 'bits': [0, 1, 8, 20, 21, 255],
    'intensity_min': [0.0, np.nan, np.inf, 3e38], 'intensity_step': [0.0, np.nan, -np.inf, 3e38]}
CODES = [2, 0x11, 3, 0x12, 0x20, 4, 0x22, 0x22]
"""Lengths of the code words of three sequences. The first 5 bytes are those of two."""

SIZES = [0, 1, 5, 6, 8, 12, 16, 24, 32, 80, 384, 512, 960, 1280]
BATCH = st.tuples(st.integers(0, 2 ** 32 - 1), st.integers(1, 4), st.sampled_from(SIZES), st.sampled_from([0, 3, 5, 8]),
                  st.fixed_dictionaries({name: st.sampled_from([None, *values]) for name, values in HOSTILE.items()}),
                  st.sampled_from([None, 0, 1, 2 ** 32 - 1]))


def forged(seed: int, count: int, size: int, codes: int, fields: Any, secs: Optional[int], frame_id: bytes = b''
           ) -> Any:
    """Records of random bytes, where fields do not say otherwise; with a frame_id, of one message."""
    dtype = record_dtype(CloudChunk, {'header.frame_id': len(frame_id) or 3, 'codes': codes, 'data': size})
    records = np.frombuffer(np.random.RandomState(seed).bytes(count * dtype.itemsize), dtype).copy()
    records['codes'] = CODES[:codes]
    for name, value in fields.items():
        if value is not None:
            records[name] = value
    if secs is not None:
        records['header']['stamp'] = secs, seed % 3
    if frame_id:
        records['header']['frame_id'], records['arrival'] = list(frame_id), 0
    return records


@settings(deadline=None, max_examples=400)
@given(st.lists(BATCH, min_size=1, max_size=5))
def test_forged_chunks_raise_nothing(batches: Any) -> None:
    assembler, values = operator_side('cloud')
    for batch in batches:
        for assembled in assemble_all(assembler, values, [forged(*batch)]):
            message = assembled.message
            assert len(message.data) == message.width * message.point_step
            message.serialize(io.BytesIO())
        assert assembler.deadline() is None


def test_forged_chunks_do_get_through() -> None:
    """Else the test above would show little."""
    assembler, values = operator_side('cloud')
    fields = {'points': 4, 'chunks': 2, 'index': 1, 'has_intensity': 255, 'step': 3e38, 'origin': 2 ** 31 - 1,
              'bits': 8, 'intensity_min': np.inf, 'intensity_step': np.nan}
    assembled, = assemble_all(assembler, values, [forged(1, 2, 8, 0, fields, 7, b'lidar')])
    assert assembled.completeness == 0.5


def test_nor_do_those_of_other_frames(scan: Any) -> None:
    frame = frame_of(cloud_message(scan))
    half = np.arange(len(frame)) < len(frame) // 2
    for secs in (None, 1700000000, 1700000001):
        fields = {'points': 50, 'chunks': 7, 'index': 3, 'step': 0.0, 'bits': 0, 'has_intensity': 0, 'is_double': 0}
        batches = [forged(seed, 3, 96, 0, fields, secs) for seed in range(50)]
        assembler, values = operator_side('cloud')
        shown = assemble_all(assembler, values, [frame.records[half], *batches, frame.records[~half]])
        true, = (one for one in shown if one.message.header.frame_id == 'velodyne')
        np.testing.assert_array_equal(points_in(true.message)[0], thinned(scan)[0])
        assert assembler.dropped['too many sources'] > 0


def test_forged_chunks_cost_the_true_cloud_nothing(scan: Any) -> None:
    """Those of its own stamp that contradict it."""
    frame = frame_of(cloud_message(scan))
    half = np.arange(len(frame)) < len(frame) // 2
    batches = [frame.records[half]]
    for seed in range(20):
        fields = {'points': seed, 'chunks': 1 + seed % 3, 'step': 0.0, 'bits': 0, 'has_intensity': 0}
        records = forged(seed, 3, 12 * seed, 0, fields, None, b'velodyne')
        records['header']['stamp'] = frame.records['header']['stamp'][0]
        batches.append(records)
    assembler, values = operator_side('cloud')
    assembled, = assemble_all(assembler, values, [*batches, frame.records[~half]])
    np.testing.assert_array_equal(points_in(assembled.message)[0], thinned(scan)[0])
    assert assembler.dropped['contradiction'] == 60
