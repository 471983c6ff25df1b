# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from smokebot_udp.arrays import BoolArray
from smokebot_udp.codecs.concealment.fill import METHODS, nearest
from smokebot_udp.codecs.wire.interleave import Interleave


def received_pixels(cut: Interleave, have: BoolArray) -> BoolArray:
    """(height, width) bool"""
    return cut.merge(np.repeat(have, cut.shape[0] * cut.shape[1]).reshape((-1,) + cut.shape))


def test_by_hand() -> None:
    cut = Interleave(2, 4, 1)
    image = np.array([[1, 2, 3, 4], [5, 6, 7, 8]])
    have = np.array([True, False, False, False])      # only 1 and 3 came
    filled = cut.merge(nearest(cut.split(image), have, cut))
    assert filled[:, 0].tolist() == [1, 1] and filled[:, 2].tolist() == [3, 3]
    assert filled[0, 1] in (1, 3) and filled[0, 3] == 3


@settings(max_examples=200, deadline=None)
@given(st.integers(1, 24), st.integers(1, 24), st.integers(0, 4), st.floats(0.02, 0.98), st.integers(0, 999))
def test_missing_pixels_take_the_nearest_received_one(height, width, depth, share, seed) -> None:
    random = np.random.RandomState(seed)
    cut = Interleave(height, width, depth)
    have = random.random_sample(len(cut)) < share
    assume(have.any())
    image = np.arange(height * width).reshape(height, width)     # each value is its place
    filled = cut.merge(nearest(cut.split(image), have, cut))
    came = received_pixels(cut, have)
    assert (filled[came] == image[came]).all()
    # only what was received fills; what repeats the border came too
    assert np.isin(filled, cut.split(image)[have]).all()
    rows, columns = np.nonzero(came)
    for row, column in np.argwhere(~came):
        if min(row, column) < cut.p or row >= height - cut.p or column >= width - cut.p:
            continue    # at the border, the nearest of the same subimage
        distance = np.hypot(*np.subtract(np.divmod(filled[row, column], width), (row, column)))
        assert distance == pytest.approx(np.hypot(rows - row, columns - column).min())


@pytest.mark.parametrize('depth', range(1, 5))
@pytest.mark.parametrize('count', [1, 2, 3])
def test_nearest_of_few_across_the_blocks(depth, count) -> None:
    p = 1 << depth
    cut = Interleave(3 * p, 3 * p, depth)
    have = np.zeros(len(cut), bool)
    have[np.random.RandomState(depth).permutation(len(cut))[:count]] = True
    image = np.arange(9 * p * p).reshape(3 * p, 3 * p)
    filled = cut.merge(nearest(cut.split(image), have, cut))
    rows, columns = np.nonzero(received_pixels(cut, have))
    for row, column in np.ndindex(p, p):       # of the middle block
        row, column = row + p, column + p
        distance = np.hypot(*np.subtract(np.divmod(filled[row, column], 3 * p), (row, column)))
        assert distance == pytest.approx(np.hypot(rows - row, columns - column).min())


@pytest.mark.parametrize('item', ['u1', 'u2', 'V3', 'u4', '>f4'])
def test_any_pixels(item) -> None:
    cut = Interleave(9, 7, 2)
    data = np.random.RandomState(0).bytes(63 * np.dtype(item).itemsize)
    subimages = cut.split(np.frombuffer(data, item).reshape(9, 7))
    have = np.arange(len(cut)) != 5
    filled = nearest(subimages, have, cut)
    assert filled.dtype == subimages.dtype
    assert filled[have].tobytes() == subimages[have].tobytes()


@pytest.mark.parametrize('method', sorted(METHODS))
def test_all_and_nothing(method) -> None:
    cut = Interleave(5, 5, 1)
    subimages = cut.split(np.arange(25, dtype=np.uint8).reshape(5, 5))
    every = np.ones(len(cut), bool)
    assert (METHODS[method](subimages, every, cut) == subimages).all()
    assert not METHODS[method](subimages, ~every, cut).any()


def test_one_subimage_alone_makes_a_coarse_image() -> None:
    cut = Interleave(32, 32, 3)
    image = np.kron(np.arange(16).reshape(4, 4), np.ones((8, 8), int))
    filled = cut.merge(nearest(cut.split(image), np.arange(64) == 0, cut))
    assert (filled[::8, ::8] == image[::8, ::8]).all()
    assert set(filled.ravel()) == set(image.ravel())
