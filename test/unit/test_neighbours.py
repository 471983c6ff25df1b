# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from smokebot_udp.arrays import BoolArray
from smokebot_udp.codecs.concealment.neighbours import SPARSE, neighbours

COUNT, REACH = 12, 2


def test_by_hand() -> None:
    """In blocks of 2 by 2 the upper left is received: around the lower right it is 1 or 3 away, both down and right."""
    (nearest,) = neighbours(np.array([[0, 0]]), np.array([[1, 1]]), 2, 4, REACH)
    assert {tuple(place) for place in nearest} == {(0, 0), (0, 2), (2, 0), (2, 2)}
    (nearest,) = neighbours(np.array([[0, 0]]), np.array([[1, 0]]), 2, 2, REACH)
    assert {tuple(place) for place in nearest} == {(0, 0), (2, 0)}


@pytest.mark.parametrize('depth', range(1, 7))
@pytest.mark.parametrize('share', [0.0, 0.5 * SPARSE, SPARSE, 1.3 * SPARSE, 0.5, 0.95])
@settings(max_examples=10, deadline=None)
@given(st.integers(0, 9999))
def test_none_is_nearer(depth, share, seed) -> None:
    p, random = 1 << depth, np.random.RandomState(seed)
    have = random.random_sample((p, p)) < share
    have.ravel()[random.permutation(p * p)[:2]] = True, False
    check(have)


@given(st.integers(1, 4), st.integers(1, 4))
@settings(deadline=None)
def test_none_is_nearer_where_all_received_are_together(rows, columns) -> None:
    """Then the mean ratio says little about the longest search."""
    have = np.zeros((8, 8), bool)
    have[:2 * rows, :2 * columns] = True
    assume(not have.all())
    check(have)


def check(have: BoolArray) -> None:
    p = len(have)
    received, missing = np.argwhere(have), np.argwhere(~have)[:40]
    nearest = neighbours(received, missing, p, COUNT, REACH)
    assert nearest.shape == (len(missing), COUNT, 2)
    assert have[tuple(np.moveaxis(nearest % p, -1, 0))].all()
    assert nearest.min() >= -REACH * p and nearest.max() < (REACH + 1) * p
    assert all(len({tuple(one) for one in found}) == COUNT for found in nearest)
    blocks = np.argwhere(np.tile(have, (2 * REACH + 1, 2 * REACH + 1))) - REACH * p
    squared = ((missing[:, np.newaxis] - blocks) ** 2).sum(axis=2)
    squared.partition(COUNT - 1, axis=1)
    wanted = np.sort(squared[:, :COUNT], axis=1)
    assert (((nearest - missing[:, np.newaxis]) ** 2).sum(axis=2) == wanted).all()
