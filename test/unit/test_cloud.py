# SPDX-License-Identifier: BSD-3-Clause
"""The clouds' codec, and that both ends of a stream agree: datagrams from a sender's frames to a receiver's cloud."""
import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.codecs.wire.cloud import (
    MAX_POINTS,
    CloudParts,
    PointFormat,
    deal,
    packed,
    plain,
    sending_order,
)

BOUND, LEAF, DATAGRAM = 0.0125, 0.1, 1472
F32 = np.float32


def floats(low, high) -> Any:
    """Numbers of float32, as hypothesis of Ubuntu 20.04 wants its limits."""
    return st.floats(float(F32(low)), float(F32(high)), width=32)


def points_of(rows) -> Any:
    return np.array(rows, F32).reshape(-1, 3)


# points as bytes

def test_float32_by_hand() -> None:
    assert plain(False).write(points_of([(1, 2, -2)])).tobytes().hex() == '0000803f' '00000040' '000000c0'
    data = plain(True).write(points_of([(1, 2, -2)]), np.array([0.5], F32))
    assert data.tobytes().hex() == '0000803f' '00000040' '000000c0' '0000003f'
    points, intensity = plain(True).read(data)
    assert points.tolist() == [[1, 2, -2]] and intensity.tolist() == [0.5]


def test_offsets_by_hand() -> None:
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
def test_size(bits, has_intensity, size) -> None:
    layout = PointFormat(has_intensity, 0.5, (0, 0, 0), bits)
    assert layout.size == size
    nothing = np.zeros((4, 3), F32), np.zeros(4, F32) if has_intensity else None
    assert layout.write(*nothing).shape == (4, size)
    # every axis to its end
    points = np.array([[0.5 * ((1 << axis) - 1) for axis in bits]], F32)
    assert layout.read(layout.write(points, np.zeros(1, F32)))[0].tolist() == points.tolist()


def test_size_of_float32() -> None:
    assert plain(False).size == 12 and plain(True).size == 16


def test_an_indoor_cloud_takes_a_third() -> None:
    points = np.random.RandomState(0).uniform((-10, -7, -1), (11, 7, 2), (5000, 3)).astype(F32)
    assert packed(points, BOUND).bits == (10, 10, 7) and packed(points, BOUND).size == 4


CLOUDS = st.lists(st.tuples(*[floats(-1000, 1000)] * 3), min_size=1, max_size=30).map(points_of)
ANY_CLOUD = st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False, width=32)] * 3), min_size=1,
                     max_size=10).map(points_of)


@settings(deadline=None)
@given(ANY_CLOUD, st.booleans())
def test_float32_is_exact(points, has_intensity) -> None:
    intensity = points[:, 0] if has_intensity else None
    back, values = plain(has_intensity).read(plain(has_intensity).write(points, intensity))
    assert back.tobytes() == points.tobytes()
    assert values is None if intensity is None else values.tolist() == intensity.tolist()


@settings(deadline=None)
@given(st.one_of(CLOUDS, ANY_CLOUD), st.floats(0.0002, 1.0), st.booleans())
def test_no_coordinate_is_off_by_more_than_the_bound(points, bound, with_intensity) -> None:
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
def test_an_intensity_is_off_by_half_a_256th_of_the_span(values) -> None:
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
def test_what_spans_too_much_is_exact(points, bound, with_intensity) -> None:
    points = points_of(points)
    intensity = np.zeros(len(points), F32) if with_intensity else None
    assert packed(points, bound, intensity) == plain(with_intensity)


def test_all_20_bits_of_each_axis_only_without_intensity() -> None:
    points = points_of([(0, 0, 0), (2 ** 20 - 1, -(2 ** 20 - 1), 2 ** 20 - 1)])
    layout = packed(points, 0.5)
    assert layout.bits == (20, 20, 20) and layout.read(layout.write(points))[0].tolist() == points.tolist()
    assert packed(points, 0.5, np.zeros(2, F32)) == plain(True)      # 68 bits do not fit in 64
    layout = packed(points_of([(0, 0, 0), (2 ** 19 - 1, 2 ** 19 - 1, 2 ** 18 - 1)]), 0.5, np.zeros(2, F32))
    assert layout.bits == (19, 19, 18) and layout.size == 8


@pytest.mark.parametrize('arguments', [
    (False, -1.0), (False, float('nan')), (False, float('inf')), (False, 1.0, (0, 0, 0), (0, 21, 0)),
    (False, 0.0, (0, 0, 0), (255, 0, 0)), (True, 1.0, (0, 0, 0), (20, 20, 17))])
def test_impossible_formats(arguments) -> None:
    with pytest.raises(ValueError, match='step is|bits are'):
        PointFormat(*arguments)


@pytest.mark.parametrize('step', [1e-45, 1.0, 3e38])
def test_any_bytes_can_be_read(step) -> None:
    random = np.random.RandomState(7)
    for has_intensity in (False, True):
        layout = PointFormat(has_intensity, step, (-2 ** 31, 2 ** 31 - 1, 0), (20, 15, 20), -np.inf, np.inf)
        data = np.frombuffer(random.bytes(50 * layout.size), np.uint8).reshape(50, -1)
        points, intensity = layout.read(data)
        assert points.shape == (50, 3) and (intensity is None or intensity.shape == (50,))


# dealing

@settings(deadline=None)
@given(st.integers(1, 200), st.data())
def test_points_are_dealt_like_cards(count, data) -> None:
    chunks = data.draw(st.integers(1, count))
    dealt = deal(np.arange(2 * count).reshape(count, 2), chunks)
    size = -(-count // chunks)
    assert dealt.shape == (chunks, size, 2)
    expected = [[min(chunk + place * chunks, count - 1) for place in range(size)] for chunk in range(chunks)]
    assert (dealt[:, :, 0] // 2).tolist() == expected and (dealt[:, :, 1] == dealt[:, :, 0] + 1).all()


def test_no_points_are_one_empty_chunk() -> None:
    assert deal(np.zeros((0, 12), np.uint8), 1).shape == (1, 0, 12)


def test_more_than_a_receiver_takes_is_not_dealt() -> None:
    deal(np.zeros((65535, 1), np.uint8), 65535)
    with pytest.raises(ValueError, match='65536 points in 65536 chunks'):
        deal(np.zeros((65536, 1), np.uint8), 65536)
    with pytest.raises(ValueError, match='2097153 points'):
        deal(np.zeros((MAX_POINTS + 1, 1), np.uint8), 100)


def test_sending_order_by_hand() -> None:
    assert sending_order(1).tolist() == [0] and sending_order(2).tolist() == [0, 1]
    assert sending_order(8).tolist() == [0, 4, 2, 6, 1, 5, 3, 7]
    assert sending_order(6).tolist() == [0, 4, 2, 1, 5, 3]      # 6 and 7 are left out


@settings(deadline=None)
@given(st.integers(1, 1100), st.floats(0.0, 1.0))
def test_any_first_chunks_are_spread_evenly(chunks, share) -> None:
    order = sending_order(chunks)
    assert sorted(order) == list(range(chunks))
    first = np.sort(order[:max(1, round(share * chunks))])
    assert np.diff(np.append(first, first[0] + chunks)).max() < 2 * chunks / len(first)


def test_the_longest_sending_order() -> None:
    assert (np.sort(sending_order(65535)) == np.arange(65535)).all()
    with pytest.raises(ValueError):
        sending_order(5)[0] = 3      # shared


# gathering

def numbered(count) -> Any:
    """Points that tell their place in the cloud, and intensities."""
    number = np.arange(count, dtype=F32)
    return np.stack([number, number / 4, -number], axis=1), number * 2


def gathered(parts, payloads, batches) -> Any:
    """Chunks added in batches; which were taken."""
    return [parts.add(np.array(batch, int), payloads[batch]).tolist() for batch in batches]


def written(count, chunks, layout=None) -> Any:
    """A cloud, its format, the payloads of its chunks, and parts that have none."""
    points, intensity = numbered(count)
    layout = layout or plain(True)
    payloads = deal(layout.write(points, intensity), chunks).reshape(chunks, -1)
    return points, payloads, CloudParts(count, chunks, layout)


@settings(deadline=None)
@given(st.integers(1, 120), st.sampled_from(['float32', 'float32 with intensity', 'offsets', 'offsets with intensity']),
       st.data())
def test_whatever_chunks_come_make_their_points_in_the_clouds_order(count, encoding, data) -> None:
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


def test_a_cloud_by_hand() -> None:
    """Ten points in four chunks of three: 0 4 8 | 1 5 9 | 2 6 (9) | 3 7 (9)."""
    _, payloads, parts = written(10, 4)
    gathered(parts, payloads, [[2], [1]])
    assert parts.merge()[0][:, 0].tolist() == [1, 2, 5, 6, 9]
    gathered(parts, payloads, [[3, 0, 3, 2]])
    points, intensity = parts.merge()
    assert points.tolist() == numbered(10)[0].tolist() and intensity.tolist() == numbered(10)[1].tolist()
    assert parts.complete


def test_no_points() -> None:
    for layout in (plain(False), plain(True), PointFormat(True, 0.5)):
        parts = CloudParts(0, 1, layout)
        assert not parts.complete and parts.merge()[0].shape == (0, 3)
        assert parts.add(np.array([0]), np.zeros((1, 12), np.uint8)).tolist() == [False]
        assert parts.add(np.array([0]), np.zeros((1, 0), np.uint8)).tolist() == [True]
        points, intensity = parts.merge()
        assert parts.complete and points.shape == (0, 3) and (intensity is not None) == layout.has_intensity


def test_chunks_that_contradict_the_cloud_are_dropped() -> None:
    _, payloads, parts = written(10, 4)
    size = payloads.shape[1]
    assert parts.add(np.array([4, 1, 65535]), payloads[:3]).tolist() == [False, True, False]
    for wrong in (0, 1, size - 1, size + 1, size - 16, size + 16):
        assert parts.add(np.array([0, 2]), np.zeros((2, wrong), np.uint8)).tolist() == [False, False]
    assert parts.have.tolist() == [False, True, False, False]


@pytest.mark.parametrize('points, chunks', [
    (0, 0), (0, 2), (1, 0), (1, 2), (10, 11), (MAX_POINTS + 1, 1), (2 ** 32 - 1, 65535), (2 ** 32 - 1, 0)])
def test_impossible_clouds(points, chunks) -> None:
    with pytest.raises(ValueError, match='%d points in %d chunks' % (points, chunks)):
        CloudParts(points, chunks, plain(False))


def test_memory_is_bounded() -> None:
    for points, chunks in ((MAX_POINTS, 65535), (MAX_POINTS, 1), (65536, 65535)):
        tracemalloc.start()
        parts = CloudParts(points, chunks, plain(True))
        assert tracemalloc.get_traced_memory()[1] < 50e6
        tracemalloc.stop()
        assert not parts.complete


def test_the_missing_chunk_that_is_sent_last_is_awaited() -> None:
    _, payloads, parts = written(100, 50)
    order = sending_order(50)
    gathered(parts, payloads, [order[:46]])
    assert parts.awaited == 49 and parts.places(order).tolist() == list(range(50))
    gathered(parts, payloads, [order[47:]])
    assert parts.awaited == 46 and parts.places(np.array([50, 65535, 0])).tolist() == [-1, -1, 0]


def test_points_that_are_not_finite_are_left_out() -> None:
    points, intensity = numbered(4)
    points[1, 2], points[2, 0] = np.nan, np.inf
    parts = CloudParts(4, 1, plain(True))
    parts.add(np.array([0]), plain(True).write(points, intensity).reshape(1, -1))
    assert [part.tolist() for part in parts.merge()] == [points[[0, 3]].tolist(), [0, 6]]


# the simulated scene through both ends


# what a hostile sender may send


