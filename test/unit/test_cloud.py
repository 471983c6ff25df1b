# SPDX-License-Identifier: BSD-3-Clause
"""The clouds' codec, and that both ends of a stream agree: datagrams from a sender's frames to a receiver's cloud."""
import io
import tracemalloc

import numpy as np
import pytest
from genpy import Time
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import PointCloud2, PointField

from smokebot_udp.codecs.perception.voxel import voxel_filter
from smokebot_udp.codecs.wire.cloud import (
    ENDING,
    MAX_POINTS,
    CloudParts,
    PointFormat,
    deal,
    packed,
    plain,
    sending_order,
)
from smokebot_udp.codecs.wire.points import as_points
from smokebot_udp.mission.parameters import check
from smokebot_udp.msg import CloudChunk
from smokebot_udp.simulation.lidar import POINT, Lidar
from smokebot_udp.simulation.world import building
from smokebot_udp.streams.base import Link
from smokebot_udp.streams.cloud import CloudReceiver, CloudSender
from smokebot_udp.udpros.datagram import OVERHEAD
from smokebot_udp.udpros.records import record_dtype

pytestmark = pytest.mark.filterwarnings('error')
BOUND, LEAF, DATAGRAM = 0.0125, 0.1, 1472
F32 = np.float32


def floats(low, high):
    """Numbers of float32, as hypothesis of Ubuntu 20.04 wants its limits."""
    return st.floats(float(F32(low)), float(F32(high)), width=32)


def points_of(rows):
    return np.array(rows, F32).reshape(-1, 3)


# points as bytes

def test_float32_by_hand():
    assert plain(False).write(points_of([(1, 2, -2)])).tobytes().hex() == '0000803f' '00000040' '000000c0'
    data = plain(True).write(points_of([(1, 2, -2)]), np.array([0.5], F32))
    assert data.tobytes().hex() == '0000803f' '00000040' '000000c0' '0000003f'
    points, intensity = plain(True).read(data)
    assert points.tolist() == [[1, 2, -2]] and intensity.tolist() == [0.5]


def test_offsets_by_hand():
    points = points_of([(-1, 3, 0.5), (0.5, 3.1, 0.5)])
    layout = packed(points, 0.25, np.array([10, 520], F32))
    assert layout == PointFormat(True, 0.5, (-2, 6, 1), (2, 0, 0), 10.0, 2.0)
    data = layout.write(points, np.array([10, 520], F32))
    assert data.tolist() == [[0, 0], [0xff, 0x03]]      # x: 3 in 2 bits; intensity: 255 in the 8 above
    back, intensity = layout.read(data)
    assert back.tolist() == [[-1, 3, 0.5], [0.5, 3, 0.5]] and intensity.tolist() == [10, 520]


@pytest.mark.parametrize('bits, has_intensity, size', [
    ((0, 0, 0), False, 1), ((0, 0, 0), True, 1), ((3, 3, 2), False, 1), ((3, 3, 3), False, 2), ((11, 11, 8), False, 4),
    ((11, 11, 8), True, 5), ((20, 20, 20), False, 8), ((19, 19, 18), True, 8), ((20, 0, 20), True, 6)])
def test_size(bits, has_intensity, size):
    layout = PointFormat(has_intensity, 0.5, (0, 0, 0), bits)
    assert layout.size == size
    nothing = np.zeros((4, 3), F32), np.zeros(4, F32) if has_intensity else None
    assert layout.write(*nothing).shape == (4, size)
    # every axis to its end
    points = np.array([[0.5 * ((1 << axis) - 1) for axis in bits]], F32)
    assert layout.read(layout.write(points, np.zeros(1, F32)))[0].tolist() == points.tolist()


def test_size_of_float32():
    assert plain(False).size == 12 and plain(True).size == 16


def test_an_indoor_cloud_takes_a_third():
    points = np.random.RandomState(0).uniform((-10, -7, -1), (11, 7, 2), (5000, 3)).astype(F32)
    assert packed(points, BOUND).bits == (10, 10, 7) and packed(points, BOUND).size == 4


CLOUDS = st.lists(st.tuples(*[floats(-1000, 1000)] * 3), min_size=1, max_size=30).map(points_of)
ANY_CLOUD = st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False, width=32)] * 3), min_size=1,
                     max_size=10).map(points_of)


@settings(deadline=None)
@given(ANY_CLOUD, st.booleans())
def test_float32_is_exact(points, has_intensity):
    intensity = points[:, 0] if has_intensity else None
    back, values = plain(has_intensity).read(plain(has_intensity).write(points, intensity))
    assert back.tobytes() == points.tobytes()
    assert values is None if intensity is None else values.tolist() == intensity.tolist()


@settings(deadline=None)
@given(st.one_of(CLOUDS, ANY_CLOUD), st.floats(0.0002, 1.0), st.booleans())
def test_no_coordinate_is_off_by_more_than_the_bound(points, bound, with_intensity):
    intensity = points[:, 2].copy() if with_intensity else None
    layout = packed(points, bound, intensity)
    data = layout.write(points, intensity)
    assert data.shape == (len(points), layout.size) and data.dtype == np.uint8
    back, values = layout.read(data)
    if not layout.step:
        span = points.max(axis=0).astype(float) - points.min(axis=0)
        # 2^17 steps an axis always fit
        assert span.max() / (2 * bound) > 1 << 17 or np.abs(points).max() / (2 * bound) > 1 << 30
        assert back.tobytes() == points.tobytes()
        return
    error = np.abs(back.astype(float) - points)
    assert (error <= bound * (1 + 2e-7) + np.spacing(np.abs(points) + F32(bound))).all()
    assert layout.size == max(1, -(-(sum(layout.bits) + 8 * with_intensity) // 8)) <= 8
    assert all(-2 ** 31 <= origin < 2 ** 31 for origin in layout.origin)
    assert (values is None) == (intensity is None)


@settings(deadline=None)
@given(st.lists(st.one_of(floats(-1e38, 1e38), floats(0, 255), st.sampled_from([np.nan, np.inf, -np.inf])), min_size=1,
                max_size=20))
def test_an_intensity_is_off_by_half_a_256th_of_the_span(values):
    intensity = np.array(values, F32)
    points = np.arange(3 * len(values), dtype=F32).reshape(-1, 3)
    layout = packed(points, BOUND, intensity)
    back = layout.read(layout.write(points, intensity))[1]
    finite = np.isfinite(intensity)
    low, high = (intensity[finite].min(), intensity[finite].max()) if finite.any() else (F32(0), F32(0))
    rounding = 2e-7 * max(abs(float(low)), abs(float(high))) + 1e-42
    half = (float(high) - float(low)) / 255 / 2
    assert (np.abs(back[finite].astype(float) - intensity[finite]) <= half + rounding).all()
    for other, instead in ((np.isnan(intensity) | (intensity == -np.inf), low), (intensity == np.inf, high)):
        assert (np.abs(back[other].astype(float) - instead) <= rounding).all()


@pytest.mark.parametrize('points, bound', [
    ([(0, 0, 0), (30000, 0, 0)], 0.0125),                    # 1.2 million steps: 21 bits
    ([(6e7, 0, 0), (6e7, 1, 0)], 0.0125),                    # 2.4 billion steps from the origin
    ([(0, 0, 0), (3e38, -3e38, 0)], 1.0),
    ([(0, 0, 0), (1, 1, 1)], 1e-45),
    ([(0, 0, 0), (1, 1, 1)], 1e-50)])                        # no float32
@pytest.mark.parametrize('with_intensity', [False, True])
def test_what_spans_too_much_is_exact(points, bound, with_intensity):
    points = points_of(points)
    intensity = np.zeros(len(points), F32) if with_intensity else None
    assert packed(points, bound, intensity) == plain(with_intensity)


def test_all_20_bits_of_each_axis_only_without_intensity():
    points = points_of([(0, 0, 0), (2 ** 20 - 1, -(2 ** 20 - 1), 2 ** 20 - 1)])
    layout = packed(points, 0.5)
    assert layout.bits == (20, 20, 20) and layout.read(layout.write(points))[0].tolist() == points.tolist()
    assert packed(points, 0.5, np.zeros(2, F32)) == plain(True)      # 68 bits do not fit in 64
    layout = packed(points_of([(0, 0, 0), (2 ** 19 - 1, 2 ** 19 - 1, 2 ** 18 - 1)]), 0.5, np.zeros(2, F32))
    assert layout.bits == (19, 19, 18) and layout.size == 8


@pytest.mark.parametrize('arguments', [
    (False, -1.0), (False, float('nan')), (False, float('inf')), (False, 1.0, (0, 0, 0), (0, 21, 0)),
    (False, 0.0, (0, 0, 0), (255, 0, 0)), (True, 1.0, (0, 0, 0), (20, 20, 17))])
def test_impossible_formats(arguments):
    with pytest.raises(ValueError, match='step is|bits are'):
        PointFormat(*arguments)


@pytest.mark.parametrize('step', [1e-45, 1.0, 3e38])
def test_any_bytes_can_be_read(step):
    random = np.random.RandomState(7)
    for has_intensity in (False, True):
        layout = PointFormat(has_intensity, step, (-2 ** 31, 2 ** 31 - 1, 0), (20, 15, 20), -np.inf, np.inf)
        data = np.frombuffer(random.bytes(50 * layout.size), np.uint8).reshape(50, -1)
        points, intensity = layout.read(data)
        assert points.shape == (50, 3) and (intensity is None or intensity.shape == (50,))


# dealing

@settings(deadline=None)
@given(st.integers(1, 200), st.data())
def test_points_are_dealt_like_cards(count, data):
    chunks = data.draw(st.integers(1, count))
    dealt = deal(np.arange(2 * count).reshape(count, 2), chunks)
    size = -(-count // chunks)
    assert dealt.shape == (chunks, size, 2)
    expected = [[min(chunk + place * chunks, count - 1) for place in range(size)] for chunk in range(chunks)]
    assert (dealt[:, :, 0] // 2).tolist() == expected and (dealt[:, :, 1] == dealt[:, :, 0] + 1).all()


def test_no_points_are_one_empty_chunk():
    assert deal(np.zeros((0, 12), np.uint8), 1).shape == (1, 0, 12)


def test_more_than_a_receiver_takes_is_not_dealt():
    deal(np.zeros((65535, 1), np.uint8), 65535)
    with pytest.raises(ValueError, match='65536 points in 65536 chunks'):
        deal(np.zeros((65536, 1), np.uint8), 65536)
    with pytest.raises(ValueError, match='2097153 points'):
        deal(np.zeros((MAX_POINTS + 1, 1), np.uint8), 100)


def test_sending_order_by_hand():
    assert sending_order(1).tolist() == [0] and sending_order(2).tolist() == [0, 1]
    assert sending_order(8).tolist() == [0, 4, 2, 6, 1, 5, 3, 7]
    assert sending_order(6).tolist() == [0, 4, 2, 1, 5, 3]      # 6 and 7 are left out


@settings(deadline=None)
@given(st.integers(1, 1100), st.floats(0.0, 1.0))
def test_any_first_chunks_are_spread_evenly(chunks, share):
    order = sending_order(chunks)
    assert sorted(order) == list(range(chunks))
    first = np.sort(order[:max(1, round(share * chunks))])
    assert np.diff(np.append(first, first[0] + chunks)).max() < 2 * chunks / len(first)


def test_the_longest_sending_order():
    assert (np.sort(sending_order(65535)) == np.arange(65535)).all()
    with pytest.raises(ValueError):
        sending_order(5)[0] = 3      # shared


# gathering

def numbered(count):
    """Points that tell their place in the cloud, and intensities."""
    number = np.arange(count, dtype=F32)
    return np.stack([number, number / 4, -number], axis=1), number * 2


def gathered(parts, payloads, batches):
    """Chunks added in batches; which were taken."""
    return [parts.add(np.array(batch, int), payloads[batch]).tolist() for batch in batches]


def written(count, chunks, layout=None):
    """A cloud, its format, the payloads of its chunks, and parts that have none."""
    points, intensity = numbered(count)
    layout = layout or plain(True)
    payloads = deal(layout.write(points, intensity), chunks).reshape(chunks, -1)
    return points, payloads, CloudParts(count, chunks, layout)


@settings(deadline=None)
@given(st.integers(1, 120), st.sampled_from(['float32', 'float32 with intensity', 'offsets', 'offsets with intensity']),
       st.data())
def test_whatever_chunks_come_make_their_points_in_the_clouds_order(count, encoding, data):
    points, intensity = numbered(count)
    given_intensity = intensity if 'with' in encoding else None
    layout = packed(points, BOUND, given_intensity) if 'offsets' in encoding else plain(given_intensity is not None)
    chunks = data.draw(st.integers(1, count))
    _, payloads, parts = written(count, chunks, layout)
    # any of them, in any order, some again, in batches
    came = data.draw(st.lists(st.integers(0, chunks - 1), max_size=2 * chunks))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(came)), max_size=3)))
    batches = [batch for batch in np.split(np.array(came, int), cuts) if len(batch)]
    assert all(map(all, gathered(parts, payloads, batches)))
    kept = np.isin(np.arange(count) % chunks, came)
    back, values = parts.merge()
    expected = layout.read(layout.write(points, given_intensity))
    assert back.tolist() == expected[0][kept].tolist()
    assert values is None if given_intensity is None else values.tolist() == expected[1][kept].tolist()
    assert parts.have.sum() == len(set(came)) and parts.completeness == len(set(came)) / chunks
    assert parts.complete == (len(set(came)) == chunks)


def test_a_cloud_by_hand():
    """Ten points in four chunks of three: 0 4 8 | 1 5 9 | 2 6 (9) | 3 7 (9)."""
    _, payloads, parts = written(10, 4)
    gathered(parts, payloads, [[2], [1]])
    assert parts.merge()[0][:, 0].tolist() == [1, 2, 5, 6, 9]
    gathered(parts, payloads, [[3, 0, 3, 2]])
    points, intensity = parts.merge()
    assert points.tolist() == numbered(10)[0].tolist() and intensity.tolist() == numbered(10)[1].tolist()
    assert parts.complete


def test_no_points():
    for layout in (plain(False), plain(True), PointFormat(True, 0.5)):
        parts = CloudParts(0, 1, layout)
        assert not parts.complete and parts.merge()[0].shape == (0, 3)
        assert parts.add(np.array([0]), np.zeros((1, 12), np.uint8)).tolist() == [False]
        assert parts.add(np.array([0]), np.zeros((1, 0), np.uint8)).tolist() == [True]
        points, intensity = parts.merge()
        assert parts.complete and points.shape == (0, 3) and (intensity is not None) == layout.has_intensity


def test_chunks_that_contradict_the_cloud_are_dropped():
    _, payloads, parts = written(10, 4)
    size = payloads.shape[1]
    assert parts.add(np.array([4, 1, 65535]), payloads[:3]).tolist() == [False, True, False]
    for wrong in (0, 1, size - 1, size + 1, size - 16, size + 16):
        assert parts.add(np.array([0, 2]), np.zeros((2, wrong), np.uint8)).tolist() == [False, False]
    assert parts.have.tolist() == [False, True, False, False]


@pytest.mark.parametrize('points, chunks', [
    (0, 0), (0, 2), (1, 0), (1, 2), (10, 11), (MAX_POINTS + 1, 1), (2 ** 32 - 1, 65535), (2 ** 32 - 1, 0)])
def test_impossible_clouds(points, chunks):
    with pytest.raises(ValueError, match='%d points in %d chunks' % (points, chunks)):
        CloudParts(points, chunks, plain(False))


def test_memory_is_bounded():
    for points, chunks in ((MAX_POINTS, 65535), (MAX_POINTS, 1), (65536, 65535)):
        tracemalloc.start()
        parts = CloudParts(points, chunks, plain(True))
        assert tracemalloc.get_traced_memory()[1] < 50e6
        tracemalloc.stop()
        assert not parts.complete


def test_the_end_is_noticed_though_chunks_of_it_are_lost():
    _, payloads, parts = written(100, 50)
    order = sending_order(50)
    gathered(parts, payloads, [order[:-ENDING]])
    assert not parts.ending
    gathered(parts, payloads, [order[-ENDING:][:1]])
    assert parts.ending


def test_points_that_are_not_finite_are_left_out():
    points, intensity = numbered(4)
    points[1, 2], points[2, 0] = np.nan, np.inf
    parts = CloudParts(4, 1, plain(True))
    parts.add(np.array([0]), plain(True).write(points, intensity).reshape(1, -1))
    assert [part.tolist() for part in parts.merge()] == [points[[0, 3]].tolist(), [0, 6]]


# the simulated scene through both ends

FIELDS = [PointField(name, POINT.fields[name][1], PointField.FLOAT32, 1) for name in ('x', 'y', 'z', 'intensity')]


def cloud_message(points, frame_id='velodyne', stamp=1700000000):
    """A PointCloud2 of an array of lidar.POINT."""
    message = PointCloud2(height=1, width=len(points), point_step=points.itemsize, row_step=points.nbytes,
                          data=points.tobytes(), fields=FIELDS)
    message.header.stamp, message.header.frame_id = Time(stamp, 5), frame_id
    return message


@pytest.fixture(scope='module')
def scan():
    points = Lidar(building(1), 0.9, 1).scan((1.5, 7, 0.3), 1.0)
    points['x'][::100] = np.nan
    return points


def sender(**options):
    return CloudSender('lidar', check({'robot_topic': '/points', **options}, CloudSender.PARAMETERS), Link(DATAGRAM))


def receiver():
    return CloudReceiver('lidar', check({'operator_topic': '/points'}, CloudReceiver.PARAMETERS), Link(DATAGRAM))


def frame_of(message, **options):
    frame, = sender(**options).frames(message)
    assert frame.datagram_size <= DATAGRAM
    return frame


def received(frame, came=None):
    """What an operator shows of a frame, or of some of its datagrams: message, and the cloud it was made of."""
    operator = receiver()
    operator.take(frame.records, np.ones(len(frame), bool) if came is None else came)
    assert not sum(operator._sequence.dropped.values())
    return finished(operator)


def finished(operator):
    dated = operator._finished.pop() if operator._finished else operator._sequence.poll(float('inf'))
    return operator.message(dated.picture.head, dated.picture), dated.picture


def points_in(message):
    """A message's points, and intensities or None."""
    return as_points(message.data, message.fields, message.height, message.width, message.point_step,
                     message.row_step, message.is_bigendian, True)


def thinned(scan, intensity=False, leaf=LEAF):
    kept = scan[np.isfinite(scan['x'])]
    points = np.stack([kept[name] for name in 'xyz'], axis=1)
    values = kept['intensity'].copy() if intensity else None
    return voxel_filter(points, leaf, values) if leaf else (points, values)


@pytest.mark.parametrize('intensity', [False, True])
@pytest.mark.parametrize('encoding', ['float32', 'packed'])
@pytest.mark.parametrize('leaf', [0.0, LEAF])
def test_both_ends_agree(scan, encoding, intensity, leaf):
    frame = frame_of(cloud_message(scan), encoding=encoding, intensity=intensity, leaf_size=leaf)
    message, parts = received(frame)
    points, values = points_in(message)
    expected, expected_values = thinned(scan, intensity, leaf)
    assert message.is_dense and parts.complete
    assert [field.name for field in message.fields] == ['x', 'y', 'z'] + ['intensity'] * intensity
    if encoding == 'float32':
        np.testing.assert_array_equal(points, expected)
        assert values is None if not intensity else values.tolist() == expected_values.tolist()
    else:
        np.testing.assert_allclose(points, expected, rtol=0, atol=BOUND + 2e-6)
        if intensity:
            half = np.ptp(expected_values) / 255 / 2
            np.testing.assert_allclose(values, expected_values, rtol=0, atol=half + 1e-4)
    assert (parts.head.frame_id, parts.head.stamp) == ('velodyne', 1700000000 * 10 ** 9 + 5)


@pytest.mark.parametrize('encoding', ['float32', 'packed'])
@pytest.mark.parametrize('intensity', [False, True])
def test_a_datagram_reads_as_the_message_says(scan, encoding, intensity):
    """Read in Python alone, word for word from CloudChunk.msg."""
    frame = frame_of(cloud_message(scan), encoding=encoding, intensity=intensity)
    expected, expected_values = thinned(scan, intensity)
    for row in frame.rows[:5]:
        chunk = CloudChunk().deserialize(row[OVERHEAD:].tobytes())
        assert (chunk.header.frame_id, chunk.points, chunk.chunks) == ('velodyne', len(expected), len(frame))
        assert chunk.has_intensity == intensity and (chunk.step > 0) == (encoding == 'packed')
        width = sum(chunk.bits) + 8 * intensity
        size = -(-width // 8) if chunk.step else 16 if intensity else 12
        assert len(chunk.data) == size * -(-chunk.points // chunk.chunks)
        number = chunk.index
        for at in range(0, len(chunk.data), size):
            data = chunk.data[at:at + size]
            if chunk.step:
                whole, point = int.from_bytes(data, 'little'), []
                for origin, bits in zip(chunk.origin, chunk.bits):
                    point.append((origin + whole % (1 << bits)) * chunk.step)
                    whole >>= bits
                if intensity:
                    point.append(chunk.intensity_min + chunk.intensity_step * whole)
            else:
                point = np.frombuffer(data, '<f4')
            place = min(number, chunk.points - 1)
            assert point[:3] == pytest.approx(expected[place], abs=(BOUND if chunk.step else 0) + 2e-6)
            if intensity:
                assert point[3] == pytest.approx(expected_values[place], abs=chunk.intensity_step / 2 + 1e-4)
            number += chunk.chunks


@pytest.mark.parametrize('size', [200, 576, DATAGRAM, 8000])
@pytest.mark.parametrize('encoding', ['float32', 'packed'])
@pytest.mark.parametrize('frame_id', ['', 'robot/velodyne/a_long_name'])
def test_datagrams_are_full_and_no_longer_than_they_may_be(scan, size, encoding, frame_id):
    robot = sender(encoding=encoding, intensity=True, points_per_chunk=5000)
    robot.link = Link(size)
    frame, = robot.frames(cloud_message(scan, frame_id))
    points, data = int(frame.records['points'][0]), frame.records['data'].shape[1]
    a_point = data // -(-points // len(frame))
    most = (size - frame.datagram_size + data) // a_point
    assert frame.datagram_size <= size and len(frame) == -(-points // most)


def test_packed_takes_less_than_half(scan):
    for leaf in (0.0, LEAF):
        exact, short = (frame_of(cloud_message(scan), encoding=encoding, leaf_size=leaf)
                        for encoding in ('float32', 'packed'))
        assert short.rows.nbytes <= exact.rows.nbytes / 2
        count = int(short.records['points'][0])
        assert count == exact.records['points'][0] and -(-count // len(short)) >= 200
        assert len(exact) == -(-count // 80)


@pytest.mark.parametrize('encoding, deviation', [('float32', 0.2), ('packed', 0.3)])
def test_lost_chunks_thin_the_cloud_evenly(scan, encoding, deviation):
    frame = frame_of(cloud_message(scan), encoding=encoding)
    whole = points_in(received(frame)[0])[0]
    _, block, counts = np.unique(np.floor(whole), axis=0, return_inverse=True, return_counts=True)
    many = counts >= 50
    assert many.sum() > 20

    def worst(came):
        """By how much the share kept of a 1 m block with many points is off."""
        there = set(map(tuple, points_in(received(frame, came)[0])[0].tolist()))
        kept = np.array([point in there for point in map(tuple, whole.tolist())])
        assert kept.mean() == pytest.approx(came.mean(), abs=0.01)
        return np.abs(np.bincount(block.reshape(-1), kept)[many] / counts[many] - came.mean()).max()

    half = np.arange(len(frame)) < len(frame) // 2
    assert worst(half) < 0.1      # the link breaks half way through
    # were points not dealt but cut into chunks, half a dozen blocks would be gone each time
    for seed in range(10):
        assert worst(np.random.RandomState(seed).permutation(half)) < deviation


def test_a_cloud_cropped_to_nothing_comes_as_an_empty_one(scan):
    for encoding in ('float32', 'packed'):
        frame = frame_of(cloud_message(scan), encoding=encoding, min_x=900.0)
        message, _ = received(frame)
        assert (len(frame), message.height, message.width, message.data) == (1, 1, 0, b'')


def test_crop_box_and_least_range(scan):
    frame = frame_of(cloud_message(scan), leaf_size=0.0, min_range=2.0, min_x=-1.0, max_x=5.0, max_z=0.5)
    points, _ = thinned(scan, leaf=0)
    x, _, z = points.T
    kept = (x >= -1) & (x <= 5) & (z <= 0.5) & (np.linalg.norm(points, axis=1) >= 2)
    np.testing.assert_array_equal(points_in(received(frame)[0])[0], points[kept])


def test_a_cloud_in_too_many_chunks_is_refused():
    points = np.zeros(65536, POINT)
    robot = sender(leaf_size=0.0, points_per_chunk=1)
    with pytest.raises(ValueError, match='65536 points in 65536 chunks'):
        robot.frames(cloud_message(points))
    assert len(robot.frames(cloud_message(points[1:]))[0]) == 65535


# what a hostile sender may send

HOSTILE = {
    'points': [0, 1, 2, 80, 65536, MAX_POINTS, MAX_POINTS + 1, 2 ** 31, 2 ** 32 - 1],
    'chunks': [0, 1, 2, 3, 80, 65535], 'index': [0, 1, 2, 65535], 'has_intensity': [0, 1, 2, 255],
    'step': [0.0, -0.0, 1e-45, 0.025, 3e38, -1.0, np.inf, -np.inf, np.nan],
    'origin': [0, -2 ** 31, 2 ** 31 - 1], 'bits': [0, 1, 8, 20, 21, 255],
    'intensity_min': [0.0, np.nan, np.inf, 3e38], 'intensity_step': [0.0, np.nan, -np.inf, 3e38]}
SIZES = [0, 1, 5, 6, 8, 12, 16, 24, 32, 80, 384, 512, 960, 1280]
BATCH = st.tuples(st.integers(0, 2 ** 32 - 1), st.integers(1, 4), st.sampled_from(SIZES), st.integers(0, 3),
                  st.fixed_dictionaries({name: st.sampled_from([None, *values]) for name, values in HOSTILE.items()}),
                  st.sampled_from([None, 0, 1, 2 ** 32 - 1]))


def forged(seed, count, size, text, fields, secs):
    """Records of random bytes, where fields do not say otherwise."""
    dtype = record_dtype(CloudChunk, {'header.frame_id': text, 'data': size})
    records = np.frombuffer(np.random.RandomState(seed).bytes(count * dtype.itemsize), dtype).copy()
    for name, value in fields.items():
        if value is not None:
            records[name] = value
    if secs is not None:
        records['header']['stamp'] = secs, seed % 3
    return records


@settings(deadline=None, max_examples=400)
@given(st.lists(BATCH, min_size=1, max_size=5))
def test_forged_chunks_raise_nothing(batches):
    operator = receiver()
    for batch in batches:
        records = forged(*batch)
        operator.take(records, np.ones(len(records), bool))
        while operator._finished or operator._sequence.deadline is not None:
            message, _ = finished(operator)
            assert len(message.data) == message.width * message.point_step
            message.serialize(io.BytesIO())


def test_forged_chunks_do_get_through():
    """Else the test above would show little."""
    operator = receiver()
    fields = {'points': 4, 'chunks': 2, 'index': 1, 'has_intensity': 255, 'step': 3e38, 'origin': 2 ** 31 - 1,
              'bits': 8, 'intensity_min': np.inf, 'intensity_step': np.nan}
    operator.take(forged(1, 2, 8, 3, fields, 7), np.ones(2, bool))
    assert operator._sequence._current.picture.have.tolist() == [False, True]


def test_forged_chunks_cost_the_true_cloud_nothing(scan):
    """Those of its own stamp that contradict it."""
    frame = frame_of(cloud_message(scan))
    half = np.arange(len(frame)) < len(frame) // 2
    operator = receiver()
    operator.take(frame.records, half)
    for seed in range(20):
        fields = {'points': seed, 'chunks': 1 + seed % 3, 'step': 0.0, 'bits': 0, 'has_intensity': 0}
        records = forged(seed, 3, 12 * seed, 8, fields, None)
        records['header']['stamp'] = frame.records['header']['stamp'][0]
        operator.take(records, np.ones(3, bool))
    operator.take(frame.records, ~half)
    np.testing.assert_array_equal(points_in(finished(operator)[0])[0], thinned(scan)[0])
    assert operator._sequence.dropped['contradiction'] == 60
