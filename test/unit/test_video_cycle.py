# SPDX-License-Identifier: BSD-3-Clause
"""When the robot's video changes its refresh cycle."""
import pytest

pytest.importorskip('av', reason='video needs PyAV: sudo apt install python3-av')

from smokebot_udp.codecs.video import rate  # noqa: E402
from smokebot_udp.codecs.video.redundancy import Division  # noqa: E402
from smokebot_udp.streams.image.video_encoder import _Session  # noqa: E402


def plan(refresh: int, gain: float, unlike: bool = False) -> rate.Plan:
    return rate.Plan(Division(3000, 0, 0.0), 3000, refresh, gain, unlike)


def session() -> _Session:
    """One whose encoder is old enough to be replaced."""
    made = _Session((48, 64), 1300, 1)
    made.prepare(plan(rate.LONG, -0.5))
    made._age = rate.LEAST_AGE
    return made


def test_a_burst_of_losses_changes_nothing() -> None:
    video = session()
    for gain in 20 * [1.0, 1.0, 1.0, -1.0, -1.0, -1.0]:
        video.prepare(plan(rate.SHORT if gain > 0 else rate.LONG, gain))
    assert video.refresh == rate.LONG


def test_losses_that_remain_do() -> None:
    video, images = session(), 0
    while video.refresh == rate.LONG:
        video.prepare(plan(rate.SHORT, 0.5))
        images += 1
    assert images == int(rate.REPAID / 0.5) + 1


def test_another_view_in_each_image_does_at_once() -> None:
    video = session()
    video.prepare(plan(rate.EACH, 0.5, unlike=True))
    assert video.refresh == rate.EACH
