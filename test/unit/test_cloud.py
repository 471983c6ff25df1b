# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from smokebot_udp.codecs.cloud import CloudParts, PointFormat, deal, packed, plain, sending_order

POINTS = arrays.arrays(np.float32, st.tuples(st.integers(1, 80), st.just(3)), elements=st.floats(-80, 80, width=32))


def test_points_are_dealt_like_cards():
    assert deal(np.arange(7), 3).tolist() == [[0, 3, 6], [1, 4, 6], [2, 5, 6]]


def test_the_order_of_sending_spreads_every_beginning():
    assert sending_order(8).tolist() == [0, 4, 2, 6, 1, 5, 3, 7]
    for chunks in (1, 2, 3, 60, 100):
        assert sorted(sending_order(chunks)) == list(range(chunks))


@given(POINTS)
def test_float32_is_exact(points):
    written = plain(False).write(points)
    assert written.shape == (len(points), 12)
    assert plain(False).read(written)[0].tobytes() == points.tobytes()


@given(POINTS, st.sampled_from([0.0125, 0.1, 0.001]))
def test_packed_keeps_its_bound(points, bound):
    point_format = packed(points, bound)
    back, _ = point_format.read(point_format.write(points))
    assert np.abs(back.astype(float) - points).max() <= bound * (1 + 1e-6) + 1e-5
    assert point_format.size == max(1, -(-sum(point_format.bits) // 8))


def test_an_indoor_cloud_takes_a_third():
    points = np.random.RandomState(0).uniform((-10, -7, -1), (11, 7, 2), (5000, 3)).astype(np.float32)
    assert packed(points, 0.0125).size == 4      # 10 + 10 + 7 bits


def test_intensity_takes_8_bits_more():
    points, intensity = np.zeros((3, 3), np.float32), np.array([0, 100, 255], np.float32)
    point_format = packed(points, 0.0125, intensity)
    assert point_format.size == 1
    np.testing.assert_allclose(point_format.read(point_format.write(points, intensity))[1], intensity, atol=0.5)


def test_a_cloud_that_spans_too_much_is_float32():
    assert packed(np.array([[0, 0, 0], [1e6, 0, 0]], np.float32), 0.0125) == plain(False)


@given(st.integers(1, 60), st.integers(1, 60), st.randoms(use_true_random=False))
def test_what_comes_is_in_the_clouds_order(count, chunks, random):
    chunks = min(chunks, count)
    points = np.arange(3 * count, dtype=np.float32).reshape(count, 3)
    dealt = deal(plain(False).write(points), chunks).reshape(chunks, -1)
    came = sorted(random.sample(range(chunks), random.randint(1, chunks)))
    parts = CloudParts(count, chunks, plain(False))
    assert parts.add(np.array(came), dealt[came]).all()
    assert parts.add(np.array(came), dealt[came]).all()      # duplicates change nothing
    expected = points[[i for i in range(count) if i % chunks in came]]
    assert parts.merge()[0].tolist() == expected.tolist()
    assert parts.complete == (len(came) == chunks) and parts.completeness == len(came) / chunks


def test_an_empty_cloud_is_one_chunk():
    parts = CloudParts(0, 1, plain(False))
    assert parts.add(np.array([0]), np.zeros((1, 0), np.uint8)).all()
    assert parts.complete and parts.merge()[0].shape == (0, 3)


@pytest.mark.parametrize('points, chunks', [(0, 0), (0, 2), (5, 6), (2 ** 21 + 1, 1), (2 ** 32 - 1, 65535)])
def test_impossible_clouds_are_refused(points, chunks):
    with pytest.raises(ValueError):
        CloudParts(points, chunks, plain(False))


@pytest.mark.parametrize('values', [{'step': -1.0}, {'step': float('nan')}, {'step': 1.0, 'bits': (21, 0, 0)}])
def test_impossible_formats_are_refused(values):
    with pytest.raises(ValueError):
        PointFormat(False, **values)


def test_chunks_that_do_not_fit_are_dropped():
    parts = CloudParts(10, 2, plain(False))
    assert not parts.add(np.array([2, 65535]), np.zeros((2, 60), np.uint8)).any()
    assert not parts.add(np.array([0]), np.zeros((1, 59), np.uint8)).any()
    forged = np.full((1, 60), 255, np.uint8)     # NaN
    assert parts.add(np.array([1]), forged).all() and len(parts.merge()[0]) == 0
