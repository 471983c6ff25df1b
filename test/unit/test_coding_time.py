# SPDX-License-Identifier: BSD-3-Clause
import math

import pytest

from smokebot_udp.streams.image.coding_time import BYTE_TIME, CELL_TIME, GROWTH, SPARE, CodingTime, Foreseen


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_byte_takes_its_part_of_what_an_image_took_on_both_sides() -> None:
    clock = Clock()
    time = CodingTime(clock)
    assert time.per_byte == 0
    for _ in range(50):
        time.begin()
        clock.now += 2 * (CELL_TIME * 300000 + BYTE_TIME * 20000)      # a processor of half the speed
        time.coded(300000, 20000)
    assert time.per_byte == pytest.approx(4 * BYTE_TIME)


def test_the_time_of_predictions_is_smoothed() -> None:
    clock = Clock()
    time = CodingTime(clock)
    for duration in (0.01, 0.01, 0.02):
        time.begin()
        clock.now += duration
        time.predicted()
    assert 0.01 < time.prediction < 0.015


def test_what_is_foreseen_follows_what_was_worth_sending() -> None:
    foreseen = Foreseen()
    assert foreseen.size == math.inf
    foreseen.sent(8000, 100000, True)
    assert foreseen.size == SPARE * 8000
    foreseen.sent(10000, 10000, False)      # more might have been
    assert foreseen.size == GROWTH * 10000
    foreseen.sent(20000, 20000, True)       # there is no more
    assert foreseen.size == math.inf
