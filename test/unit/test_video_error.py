# SPDX-License-Identifier: BSD-3-Clause
"""What losses add to the error of a video, as it is estimated."""
from typing import Any, List

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.streams.image.video_error import NO_IMAGE, VideoError

CHANGE = 4.0 ** 2
"""Mean squared difference of two successive images."""


def scene(number: int) -> Any:
    """Images that differ by 4 counts each."""
    return np.full((64, 96), 100 + 4 * (number % 2), np.uint8)


def begun() -> VideoError:
    """After images of which all came."""
    error = VideoError()
    assert [error.add(scene(number), 1.0, 0, number == 0, 10) for number in range(5)] == 5 * [0.0]
    return error


def test_what_is_missing_is_wrong_as_the_scene_has_changed_until_it_is_coded_anew() -> None:
    error = begun()
    assert error.add(scene(5), 0.75, 0, False, 10) == pytest.approx(CHANGE / 4, rel=0.2)
    after = [error.add(scene(6 + number), 1.0, 0, False, 10) for number in range(20)]
    assert after == sorted(after, reverse=True) and after[0] > 0.8 * CHANGE / 4 and after[-1] < 0.15 * CHANGE / 4
    assert error.add(scene(30), 1.0, 0, True, 10) == 0.0


def test_images_that_are_lost_as_a_whole_add_what_has_changed_meanwhile() -> None:
    assert begun().add(scene(7), 1.0, 2, False, 10) == pytest.approx(2 * CHANGE, rel=0.3)


def test_of_a_beginning_that_is_incomplete_nothing_is_known() -> None:
    assert VideoError().add(scene(0), 0.9, 0, True, 10) == pytest.approx(NO_IMAGE / 10)
    error = begun()
    error.begin()
    assert error.add(scene(5), 1.0, 0, False, 10) > NO_IMAGE / 2


def test_where_no_image_is_predicted_each_is_as_good_as_its_own_slices() -> None:
    error = VideoError()
    error.add(scene(0), 0.9, 0, True, 1)
    for number in range(1, 6):
        error.add(scene(number), 1.0, 0, True, 1)
    assert error.add(scene(6), 1.0, 0, True, 1) == 0.0
    assert error.add(scene(7), 0.5, 0, True, 1) == pytest.approx(CHANGE / 2, rel=0.2)


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 1 << 32), st.booleans(), st.integers(1, 120),
                          st.integers(1, 40))))
def test_it_is_always_a_number(images: List[Any]) -> None:
    error = VideoError()
    for share, lost, intra, refresh, side in images:
        found = error.add(np.full((side, side), side, np.uint8), share, lost, intra, refresh)
        assert 0 <= found < float('inf')
