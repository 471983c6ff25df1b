# SPDX-License-Identifier: BSD-3-Clause
import tracemalloc
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.codecs.wire.interleave import MAX_DEPTH, Interleave, fit, table

TABLE_3A = [[0, 8, 2, 10],
            [12, 4, 14, 6],
            [3, 11, 1, 9],
            [15, 7, 13, 5]]
TABLE_3B = [[0, 32, 8, 40, 2, 34, 10, 42],
            [48, 16, 56, 24, 50, 18, 58, 26],
            [12, 44, 4, 36, 14, 46, 6, 38],
            [60, 28, 52, 20, 62, 30, 54, 22],
            [3, 35, 11, 43, 1, 33, 9, 41],
            [51, 19, 59, 27, 49, 17, 57, 25],
            [15, 47, 7, 39, 13, 45, 5, 37],
            [63, 31, 55, 23, 61, 29, 53, 21]]


def test_table_2a() -> None:
    assert table(1).tolist() == [[0, 2], [3, 1]]


def test_table_2b_is_2a_all_over_an_8x4_image() -> None:
    cut = Interleave(4, 8, 1)
    marked = cut.merge(np.repeat(np.arange(4), 8).reshape((4,) + cut.shape))
    assert marked.tolist() == [[0, 2] * 4, [3, 1] * 4] * 2


def test_tables_3() -> None:
    assert table(2).tolist() == TABLE_3A
    assert table(3).tolist() == TABLE_3B


@pytest.mark.parametrize('depth', range(MAX_DEPTH + 1))
def test_every_prefix_of_4_to_the_k_is_a_regular_grid(depth) -> None:
    p = 1 << depth
    assert sorted(table(depth).ravel()) == list(range(p * p))
    for k in range(depth + 1):
        rows, columns = np.nonzero(table(depth) < 4 ** k)
        step = p >> k
        assert sorted(zip(rows.tolist(), columns.tolist())) == [
            (row, column) for row in range(0, p, step) for column in range(0, p, step)]


def test_subimages_by_hand() -> None:
    grid = np.arange(9).reshape(3, 3)       # 3 x 3 is no multiple of 2: the border is repeated
    assert Interleave(3, 3, 1).split(grid).tolist() == [
        [[0, 2], [6, 8]],
        [[4, 5], [7, 8]],
        [[1, 2], [7, 8]],
        [[3, 5], [6, 8]]]


def test_places_outside_a_small_image_have_no_subimage() -> None:
    cut = Interleave(1, 5, 2)
    assert cut.order.tolist() == [0, 2, 8, 10]     # the first row of Table 3(a)
    assert cut.shape == (1, 2)
    assert cut.split(np.arange(5)[np.newaxis]).tolist() == [[[0, 4]], [[2, 4]], [[1, 4]], [[3, 4]]]


ITEMS = [np.dtype('u1'), np.dtype('u2'), np.dtype('V3'), np.dtype('u4'), np.dtype('>f4')]


@settings(max_examples=300, deadline=None)
@given(st.integers(1, 70), st.integers(1, 70), st.integers(0, MAX_DEPTH), st.sampled_from(ITEMS), st.integers(0, 99))
def test_merge_is_the_inverse_of_split(height, width, depth, item, seed) -> None:
    data = np.random.RandomState(seed).bytes(height * width * item.itemsize)
    grid = np.frombuffer(data, item).reshape(height, width)
    cut = Interleave(height, width, depth)
    subimages = cut.split(grid)
    assert subimages.shape == (len(cut),) + cut.shape
    assert cut.merge(subimages).tobytes() == data


def test_the_pixels_of_a_subimage_by_hand() -> None:
    assert Interleave(3, 5, 1).pixel_mask(np.array([True, False, True, False])).tolist() == [
        [True, True, True, True, True], [False] * 5, [True, True, True, True, True]]
    assert Interleave(3, 5, 1).pixel_mask(np.array([False, True, False, False])).tolist() == [
        [False] * 5, [False, True, False, True, False], [False] * 5]


@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 5), st.randoms(use_true_random=False))
def test_the_pixels_of_some_subimages(height: int, width: int, depth: int, random: Random) -> None:
    cut = Interleave(height, width, depth)
    have = np.array([random.random() < 0.5 for _ in range(len(cut))])
    mask = cut.pixel_mask(have)
    assert mask.shape == (height, width) and mask.dtype == bool
    assert (mask == cut.merge(np.repeat(have, cut.shape[0] * cut.shape[1]).reshape((-1,) + cut.shape))).all()


@pytest.mark.parametrize('height, width, item', [(4096, 4096, 'u4'), (4096, 1, 'u2'), (1, 4096, 'V3'), (17, 1023, 'u1'),
                                                 (1, 1, 'u1'), (1080, 1920, 'V3'), (4095, 4001, 'u2')])
def test_large_and_odd_sizes(height, width, item) -> None:
    item = np.dtype(item)
    grid = np.frombuffer(np.random.RandomState(1).bytes(height * width * item.itemsize), item).reshape(height, width)
    cut, per_segment = fit(height, width, item.itemsize, 1390)
    assert per_segment * cut.shape[0] * cut.shape[1] * item.itemsize <= 1390
    assert cut.merge(cut.split(grid)).tobytes() == grid.tobytes()


@pytest.mark.parametrize('height, width, size, depth, per_segment', [
    (240, 320, 1, 3, 1),      # the deliverable's Table 4: 64 subimages
    (480, 640, 2, 5, 2),      # 1024 of 600 bytes, two a datagram
    (480, 640, 3, 6, 5),      # at depth 5 a datagram would be 900 bytes: a quarter more of them
    (10, 10, 1, 0, 1)])
def test_fit_fills_a_datagram(height, width, size, depth, per_segment) -> None:
    cut, count = fit(height, width, size, 1390)
    assert (cut.depth, count) == (depth, per_segment)


def test_forged_sizes_do_not_fill_the_memory() -> None:
    tracemalloc.start()
    try:
        for height in range(150, 250):
            assert len(Interleave(height, 256, 8).positions) == 4 ** 8
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 20e6


@pytest.mark.parametrize('height, width', [(0, 4), (4, 0), (4097, 4), (4, 4097), (-1, 4)])
def test_impossible_sizes(height, width) -> None:
    with pytest.raises(ValueError, match='must be from 1 to 4096'):
        fit(height, width, 1, 1390)


def test_what_no_depth_can_do() -> None:
    with pytest.raises(ValueError, match='do not fit'):
        fit(4096, 4096, 8, 1000)
    with pytest.raises(ValueError, match='depth is 9'):
        table(9)
    with pytest.raises(ValueError, match='the grid is'):
        Interleave(4, 4, 1).split(np.zeros((4, 5)))
