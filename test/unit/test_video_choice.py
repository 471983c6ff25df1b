# SPDX-License-Identifier: BSD-3-Clause
"""When images cross as video, and how alike images are."""
from typing import Any, Optional

import numpy as np
import pytest

from smokebot_udp.streams.image.similarity import COMPARED, Similarity
from smokebot_udp.streams.image.video_choice import (
    ALIKE,
    ENOUGH_BITS,
    HOLD,
    LEAST_BITS,
    PROBE,
    STANDING,
    STILL_ALIKE,
    STILL_SCARCE,
    STILL_STANDING,
    VideoChoice,
    VideoConditions,
)

SCARCE = VideoConditions(0.01, 5e3, 2e4)
PLENTY = VideoConditions(0.01, 5e4, 2e4)
OTHERS = VideoConditions(0.9, 5e3, 2e4)


def after(choice: VideoChoice, conditions: VideoConditions, now: float) -> bool:
    """What is chosen where conditions hold from a time on."""
    choice.update(conditions, now)
    return choice.update(conditions, now + HOLD)


def chosen(video: bool) -> VideoChoice:
    choice = VideoChoice()
    assert after(choice, SCARCE if video else PLENTY, 0.0) is video
    return choice


@pytest.mark.parametrize('conditions, expected', [
    (SCARCE, True), (PLENTY, False), (OTHERS, False),
    (SCARCE._replace(needed=float('inf')), True),       # there are no layered ones
    (PLENTY._replace(room=float('inf')), False),
    (SCARCE._replace(area=640 * 480), True),
    (SCARCE._replace(room=1e3, area=1920 * 1080), False),   # video images would be too large to be sent
    (SCARCE._replace(ratio=0.0), False),                    # layered ones become exact
])
def test_a_slow_scene_on_a_slow_link_is_video(conditions: VideoConditions, expected: bool) -> None:
    for before in (False, True):
        assert after(chosen(before), conditions, 10.0) is expected


def test_nothing_changes_at_once_nor_while_anything_is_unknown() -> None:
    choice = VideoChoice()
    for unknown in (SCARCE._replace(ratio=None), SCARCE._replace(needed=None)):
        assert not after(choice, unknown, 0.0)
    assert not choice.update(SCARCE, 10.0) and not choice.update(PLENTY, 11.0)
    assert not choice.update(SCARCE, 12.0) and not choice.update(SCARCE, 13.9)      # the time begins anew
    assert choice.update(SCARCE, 14.0)


@pytest.mark.parametrize('between', [
    SCARCE._replace(ratio=(ALIKE + STILL_ALIKE) / 2), SCARCE._replace(room=(1 + STILL_SCARCE) / 2 * 2e4),
    SCARCE._replace(ratio=(STANDING + STILL_STANDING) / 2)])
def test_near_the_limits_what_is_chosen_stays(between: VideoConditions) -> None:
    for video in (False, True):
        assert after(chosen(video), between, 10.0) is video


def test_without_room_for_it_there_is_no_video_until_there_is_more() -> None:
    choice, area = VideoChoice(), 1920 * 1080
    least, enough = LEAST_BITS / 8 * area, ENOUGH_BITS / 8 * area
    assert choice.has_room(least, area) and not choice.has_room(least - 1, area)
    assert not choice.has_room(enough - 1, area) and choice.has_room(enough, area)
    assert choice.has_room(least, area)


def test_what_layered_images_take_is_measured_now_and_then() -> None:
    choice = VideoChoice()
    assert not choice.is_due(100.0)
    assert after(choice, SCARCE, 100.0)
    now = 100.0 + HOLD
    assert not choice.is_due(now + PROBE - 0.1) and choice.is_due(now + PROBE)
    choice.measured(now + PROBE)
    assert not choice.is_due(now + PROBE + 1.0)


def ratio_of(*images: Any) -> Optional[float]:
    similarity = Similarity()
    for image in images:
        similarity.add(image)
    return similarity.ratio


def test_the_difference_of_two_images_by_hand() -> None:
    similarity = Similarity()
    assert similarity.difference is None and similarity.ratio is None
    first = np.zeros((16, 16), np.uint8)
    first[8:] = 10                              # of the four pixels that are compared, two are 10
    second = first.copy()
    second[8, 8] = 20                           # their variance is 68.75
    for image in (first, second) * COMPARED:
        similarity.add(image)
    assert similarity.difference == 25.0        # one of them differs by 10
    assert similarity.ratio == pytest.approx(25.0 / (2 * 68.75))


def test_independent_images_have_ratio_one_and_a_standing_scene_none() -> None:
    noise = [np.random.RandomState(seed).randint(0, 256, (240, 320, 3)).astype(np.uint8) for seed in range(COMPARED)]
    assert ratio_of(*noise) == pytest.approx(1.0, rel=0.05)
    assert ratio_of(*[noise[0]] * COMPARED) == 0.0
    assert ratio_of(*[np.full((48, 64), 7, np.uint8)] * COMPARED) == 0.0


def test_images_of_another_size_begin_anew() -> None:
    noise = [np.random.RandomState(seed).randint(0, 256, (48, 64)).astype(np.uint8) for seed in range(COMPARED)]
    assert ratio_of(*noise, noise[0][:40]) is None
    assert ratio_of(*noise[:COMPARED // 2]) is None
