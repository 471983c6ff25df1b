# SPDX-License-Identifier: BSD-3-Clause
"""Two references blended to one: bit for bit, their shares, and their bytes."""
from typing import Any

import needs_numba  # noqa: F401
import numpy as np
import pytest

from smokebot_udp.codecs.layered import blend, motion
from smokebot_udp.codecs.layered.blend import SHARES, Course, Second
from smokebot_udp.codecs.layered.motion import NODES, NONE, Motion


def moved(down: int, right: int) -> Motion:
    """The same motion everywhere [1/32 pixel]."""
    return Motion(np.tile(np.array([down, right], np.int16), (NODES, NODES, 1)), False)


def same(one: Course, other: Course) -> bool:
    """Whether two courses are equal, arrays included."""
    return repr(one) == repr(other)


def test_a_blend_is_rounded() -> None:
    first, second = np.array([[0, 255, 10, 7]], np.uint8), np.array([[255, 0, 11, 7]], np.uint8)
    assert blend.blended(first, second, 4).tolist() == [[64, 191, 10, 7]]
    assert blend.blended(first, second, 8).tolist() == [[128, 128, 11, 7]]


@pytest.mark.parametrize('kind, shape', [(np.uint8, (5, 7)), (np.uint16, (4, 9)), (np.uint8, (3, 5, 3))])
@pytest.mark.parametrize('share', [0, 1, 7, 15, SHARES])
def test_blends_are_those_of_wide_integers(kind: Any, shape: Any, share: int) -> None:
    random = np.random.RandomState(share)
    first, second = (random.randint(0, np.iinfo(kind).max + 1, shape).astype(kind) for _ in range(2))
    expected = (first.astype(int) * (SHARES - share) + second.astype(int) * share + SHARES // 2) // SHARES
    found = blend.blended(first, second, share)
    assert found.dtype == kind and np.array_equal(found, expected)


def test_a_second_image_as_noisy_as_the_first_has_about_half() -> None:
    random = np.random.RandomState(1)
    scene = np.full((64, 64), 100)
    first, second, image = (np.asarray(scene + random.normal(0, 5, scene.shape), np.uint8) for _ in range(3))
    assert blend.share_of(first, second, image) in (7, 8, 9)


def test_a_second_image_of_no_use_has_no_share() -> None:
    random = np.random.RandomState(1)
    first, other = (random.randint(0, 256, (64, 64)).astype(np.uint8) for _ in range(2))
    assert blend.share_of(first, other, first) == blend.share_of(first, first, other) == 0
    assert blend.share_of(first[:1, :1], other[:1, :1], first[:1, :1]) == 0


def test_a_share_is_never_the_whole() -> None:
    first, second = np.zeros((16, 16), np.uint8), np.full((16, 16), 200, np.uint8)
    assert blend.share_of(first, second, second) == SHARES - 1


@pytest.mark.parametrize('course', [
    Course(NONE, None), Course(moved(3, -9), None), Course(NONE, Second(1, 1, 0, 1, NONE)),
    Course(moved(1, 2), Second(255, 14, 2 ** 32 - 1, SHARES - 1, moved(-700, 40)._replace(smooth=True))),
    Course(NONE, Second(2, 3, 4, 5, moved(6, 7)))])
def test_bytes_give_the_course_back(course: Course) -> None:
    data = blend.to_bytes(course)
    assert len(data) <= 255 and same(blend.from_bytes(data), course)
    if course.second is None:
        assert data == motion.to_bytes(course.motion)


GOOD = blend.to_bytes(Course(moved(1, 2), Second(2, 3, 4, 5, moved(6, 7))))


@pytest.mark.parametrize('data', [
    GOOD[:1], GOOD[:8], GOOD[:9], GOOD[:-1], GOOD + b'\0',
    *(GOOD[:at] + bytes([value]) + GOOD[at + 1:]
      for at, value in ((0, 3), (1, 0), (2, 0), (3, 0), (3, SHARES), (8, 255)))])
def test_other_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError):
        blend.from_bytes(data)


def test_references_are_displaced_before_they_are_blended() -> None:
    first, second = np.zeros((16, 16), np.uint8), np.zeros((16, 16), np.uint8)
    first[8, 8], second[8, 4] = 160, 160
    course = Course(NONE, Second(1, 1, 0, 8, moved(0, -4 * 32)))
    expected = np.zeros((16, 16), int)
    expected[8, 8] = 160
    assert blend.predicted(course, first, second).tolist() == expected.tolist()
    assert blend.predicted(course._replace(second=None), first, second) is first


def test_a_second_reference_that_helps_by_a_fiftieth_is_used() -> None:
    """By hand: noise of 4 and of 20 counts, so a sixteenth leaves (15/16)^2 + (1/16)^2 * 25 = 0.977 of the squares."""
    random = np.random.RandomState(2)
    image = np.full((64, 512), 128, np.uint8)
    first, second = (np.rint(image + random.normal(0, sigma, image.shape)).astype(np.uint8) for sigma in (4, 20))
    assert blend.share_of(first, second, image) == 1
