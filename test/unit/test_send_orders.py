# SPDX-License-Identifier: BSD-3-Clause
"""The orders of sending that ./smokebot experiments send_order compares."""
from typing import Any, Callable

import numpy as np
import pytest

from evaluation.send_orders import farthest_point, least_certain, orders, variance


@pytest.mark.parametrize('depth', [1, 2, 3])
def test_every_subimage_is_sent_once(depth: int) -> None:
    for name, order in orders(depth, seed=1).items():
        assert sorted(order) == list(range(4 ** depth)), name


def test_table_2a_is_also_the_farthest_point_at_depth_1() -> None:
    assert orders(1, 1)['farthest point'].tolist() == orders(1, 1)['Table 3'].tolist() == [0, 1, 2, 3]


def test_by_rows_goes_along_the_rows_of_table_3() -> None:
    assert orders(2, 1)['by rows'].tolist() == [0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5]
    assert orders(2, 1)['Z coarse first'][:4].tolist() == [0, 2, 3, 1]


@pytest.mark.parametrize('order', [farthest_point, least_certain])
@pytest.mark.parametrize('p', [2, 4, 8])
def test_the_second_is_the_middle_of_four_of_the_first(order: Callable[[int], Any], p: int) -> None:
    assert order(p)[:2].tolist() == [[0, 0], [p // 2, p // 2]]


def test_the_farthest_points_stay_as_far_apart_as_can_be() -> None:
    """Four of 4 by 4 places can be 2 apart, across the block's sides, too."""
    places = farthest_point(4)[:4]
    for i, one in enumerate(places):
        for other in places[:i]:
            apart = np.abs(one - other)
            assert np.hypot(*np.minimum(apart, 4 - apart)) >= 2


def test_kriging_is_less_certain_the_farther_the_received_are() -> None:
    received = np.array([[0, 0]])
    near, far = variance(received, np.array([[0, 1], [4, 4]]), 8)
    assert 0 < near < far
    (more,) = variance(np.array([[0, 0], [4, 5]]), np.array([[4, 4]]), 8)
    assert 0 < more < far / 3
