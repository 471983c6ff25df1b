# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import List, Optional

import numpy as np
import pytest

from evaluation.live_clip import place
from evaluation.live_idle import Moment, flows
from evaluation.live_methods import by_number
from evaluation.live_score import (
    LinkSample,
    Screen,
    Shown,
    Taken,
    aged_as,
    blurred,
    image_rows,
    judged,
    judged_step,
    link_use,
    longest_gap,
    of_rms,
    settled_after,
)
from smokebot_udp.monitoring.stages import Sized

DELAY = 0.08


def quality(number: int, place: int) -> float:
    """40 dB of the same image, and 5 dB less for each one between them."""
    return 40.0 - 5 * abs(number - place)


def a_screen(numbers: List[Optional[int]], count: int = 20) -> Screen:
    """A screen for images taken each 0.1 s from 100 s on. The images of these numbers were shown DELAY later."""
    taken = [Taken(number, 100 + number / 10) for number in range(count)]
    return Screen(taken, [Shown(number, 100 + (index if number is None else number) / 10 + DELAY, index)
                          for index, number in enumerate(numbers)], quality)


def test_an_image_is_judged_beside_what_it_shows_and_the_screen_beside_what_the_camera_sees() -> None:
    screen = a_screen(list(range(20)))
    assert screen.psnr(99.0) is None and screen.psnr(100.05) is None
    assert screen.psnr(101.01) == 35.0 and screen.psnr(101.09) == 40.0
    assert screen.image_psnr(screen.shown[3]) == 40.0 and screen.age(screen.shown[3]) == pytest.approx(DELAY)
    row = judged(screen, [], 100.5, 101.5)
    assert row['image mean [dB]'] == row['image worst [dB]'] == 40.0
    assert row['screen mean [dB]'] == pytest.approx(36.0, abs=0.1) and row['screen worst [dB]'] == 35.0
    assert row['age p50 [s]'] == pytest.approx(DELAY) and row['freeze [s]'] == pytest.approx(0.1)
    assert row['rate [Hz]'] == 10 and row['used'] is row['capacity known'] is None


def test_a_frozen_screen_is_the_worse_the_more_the_camera_has_seen_since() -> None:
    row = judged(a_screen([0, 1, 2, 3]), [], 100.3, 102.0)
    assert row['freeze [s]'] == pytest.approx(102.0 - 100.38)
    assert row['screen worst [dB]'] == 40.0 - 5 * 16 and row['rate [Hz]'] == pytest.approx(1 / 1.7)


def test_an_image_that_nobody_knows_counts_for_the_rate_and_the_screen_only() -> None:
    row = judged(a_screen([None, None]), [], 100.0, 100.3)
    assert row['image mean [dB]'] is row['age p50 [s]'] is None and row['rate [Hz]'] == pytest.approx(2 / 0.3)
    assert row['screen mean [dB]'] is not None


def link_sample(when: float, carried: float, capacity: float) -> LinkSample:
    return LinkSample(when, 1.0, carried, 2, {'capacity': capacity})


def test_the_capacity_is_known_within_a_tenth_and_not_where_it_is_nan() -> None:
    values = (1.0, 0.9, 0.91), (2.0, 0.7, 1.09), (3.0, 0.8, 1.2), (4.0, 0.8, math.nan)
    row = link_use([link_sample(*one) for one in values])
    assert row == {'used': pytest.approx(0.8), 'capacity known': 0.5, 'dropped': 8}
    assert link_use([LinkSample(1.0, 1.0, 0.5, 0, {})])['capacity known'] is None


def test_the_link_is_to_be_used_while_images_are_blurred_or_missing() -> None:
    samples = [link_sample(100.0 + second, 0.5 + 0.1 * second, 1.0) for second in range(4)]
    sharp = a_screen(list(range(20)))
    sharp.quality = lambda number, place: 45.0 if number < 10 else 38.0
    assert [one.time for one in blurred(sharp, samples)] == [102.0, 103.0]      # and nothing after 102 s
    assert judged(sharp, samples, 99.0, 104.0)['used while blurred'] == pytest.approx(0.75)


def test_gaps_are_counted_from_the_beginning_and_to_the_end() -> None:
    assert longest_gap([1.0, 2.0, 2.5], 0.5, 3.0) == 1.0
    assert longest_gap([0.1, 9.0], 1.0, 3.0) == 2.0


def test_a_step_is_over_with_the_first_of_five_good_images() -> None:
    images = [(10 + i / 10, psnr) for i, psnr in enumerate([30, 30, 39, 39, 30, 39, 39, 40, 40, 40, 40])]
    assert settled_after(images, [40.0, 40.0], 10.0) == pytest.approx(0.5)
    assert settled_after(images[:8], [40.0], 10.0) is None and settled_after([], [], 10.0) is None


def test_a_step_is_judged_by_its_oldest_image_and_what_it_comes_to() -> None:
    screen = a_screen(list(range(20)))
    row = judged_step(screen, [], 100.0, 102.0)
    assert row['oldest [s]'] == pytest.approx(DELAY) and row['steady after [s]'] == pytest.approx(DELAY)
    assert row['steady mean [dB]'] == row['worst [dB]'] == 40.0


def test_another_quality_is_aged_as_the_screen_was() -> None:
    screen = a_screen([0, None, 4])
    other = aged_as(screen, lambda number, place: 50.0 - abs(number - place))
    assert [(one.number, one.place) for one in other.shown] == [(0, 0), (4, 4)]
    assert other.psnr(100.49) == 50.0 and other.psnr(100.79) == 47.0


def test_each_image_has_a_line_with_what_decided_its_size() -> None:
    sizes = by_number([Sized('camera', 100200000000, 1.0, 'layered', 3800.0, 3700, 'room', 2.55),
                       Sized('thermal', 100200000000, 1.0, 'layered', 1.0, 1, 'room', 1.0),
                       Sized('camera', 5, 1.0, 'layered', 1.0, 1, 'room', 1.0)],
                      {one.stamp: one.number for one in a_screen([]).taken})
    first, second = image_rows(a_screen([1, 2]), sizes)
    assert (second['coding'], second['used [byte]'], second['bound']) == ('layered', 3700, 'room')
    assert second['estimated PSNR [dB]'] == pytest.approx(40.0) and second['granted [byte]'] == 3800.0
    assert second['time [s]'] == pytest.approx(0.1) and second['age [s]'] == pytest.approx(DELAY)
    assert first['coding'] is first['estimated PSNR [dB]'] is None


def test_an_exact_image_has_the_highest_psnr() -> None:
    assert of_rms(0.0) == of_rms(1e-6) == 60.0 and of_rms(255.0) == 0.0


def test_a_clip_is_played_forwards_and_backwards() -> None:
    assert [place(number, 4) for number in range(9)] == [0, 1, 2, 3, 2, 1, 0, 1, 2]
    assert [place(number, 1) for number in range(3)] == [0, 0, 0]


LISTED = """{"nftables": [{"metainfo": {}}, {"set": {"name": "incoming", "elem": [
    {"elem": {"val": {"concat": ["udp", 40000, 50000, "af41"]}, "counter": {"packets": 9, "bytes": 9000}}},
    {"elem": {"val": {"concat": ["udp", 40000, 50000, "ef"]}, "counter": {"packets": 1, "bytes": 100}}}]}},
    {"set": {"name": "outgoing"}}]}"""


def test_flows_are_counted_and_the_largest_one_may_be_left_out() -> None:
    counted = flows(LISTED)
    assert counted == {
        'incoming': {('udp', 40000, 50000, 'af41'): 9000, ('udp', 40000, 50000, 'ef'): 100}, 'outgoing': {}}
    before = Moment(10.0, {'incoming': {('udp', 40000, 50000, 'af41'): 1000}, 'outgoing': {}})
    after = Moment(12.0, counted)
    assert after.since(before, 'incoming') == pytest.approx(8e-3 * 8100 / 2)
    assert after.since(before, 'incoming', largest=False) == pytest.approx(8e-3 * 100 / 2)
    assert after.since(before, 'outgoing', largest=False) == 0


def test_the_course_covers_all_moments_once_there_is_an_image() -> None:
    course = np.array(a_screen(list(range(20))).course(100.0, 101.0))
    assert course[0, 0] == pytest.approx(100 + DELAY, abs=0.017) and len(course) == 54
