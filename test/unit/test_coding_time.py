# SPDX-License-Identifier: BSD-3-Clause
import pytest

from smokebot_udp.streams.image.coding_time import BYTE_TIME, CELL_TIME, CodingTime


def test_a_byte_takes_its_part_of_what_an_image_took_on_both_sides() -> None:
    time = CodingTime()
    assert time.per_byte == 0
    for _ in range(50):
        time.coded(300000, 20000, 2 * (CELL_TIME * 300000 + BYTE_TIME * 20000))     # a processor of half the speed
    assert time.per_byte == pytest.approx(4 * BYTE_TIME)


def test_the_times_of_predictions_and_images_are_smoothed() -> None:
    time = CodingTime()
    for duration in (0.01, 0.01, 0.02):
        time.predicted(duration)
        time.done(3 * duration)
    assert 0.01 < time.prediction < 0.015 and 0.03 < time.image < 0.045
