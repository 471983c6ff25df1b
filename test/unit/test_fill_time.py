# SPDX-License-Identifier: BSD-3-Clause
import pytest

from smokebot_udp.codecs.concealment.fill import METHODS
from smokebot_udp.streams.fill_time import CHEAPEST, LONGEST_PERIOD, PATIENCE, FillTime

SLOW, QUICK = 0.08, 0.01
LIMIT = 0.05


def pictures(times, seconds, now=0.0, period=0.1, limit=LIMIT):
    """Fill a picture each `period` that takes so many seconds; what each was filled by."""
    used = []
    for took in seconds:
        times.came(int(now * 1e9))
        used.append(times.method(now))
        times.took(took if used[-1] != CHEAPEST else QUICK, limit, now + took)
        now += period
    return used


def test_the_cheapest_is_a_method():
    assert CHEAPEST in METHODS


def test_what_is_quick_stays():
    assert pictures(FillTime('kriging'), [QUICK] * 50) == ['kriging'] * 50


def test_one_slow_picture_is_forgiven():
    assert pictures(FillTime('kriging'), [QUICK, SLOW, QUICK, SLOW, QUICK]) == ['kriging'] * 5


def test_two_slow_ones_in_a_row_are_not_and_it_is_tried_again_once():
    times = FillTime('kriging')
    used = pictures(times, [SLOW] * 250)     # 25 s
    assert used[:3] == ['kriging', 'kriging', CHEAPEST]
    tries = [i for i, method in enumerate(used) if method == 'kriging']
    assert len(tries) == 4 and tries[2] == pytest.approx(1 + PATIENCE / 0.1, abs=1) and tries[3] > tries[2] + 50


def test_it_comes_back_when_there_is_time_again():
    times = FillTime('kriging')
    pictures(times, [SLOW, SLOW])
    assert pictures(times, [QUICK] * 9, now=PATIENCE + 1) == ['kriging'] * 9


def test_took_tells_when_it_falls_back():
    times = FillTime('kriging')
    assert [times.took(SLOW, LIMIT, now) for now in (0.1, 0.2, 0.3)] == [False, True, False]


def test_never_longer_than_pictures_come_apart():
    assert CHEAPEST in pictures(FillTime('kriging'), [SLOW] * 4, limit=9.0, period=0.05)
    assert CHEAPEST not in pictures(FillTime('kriging'), [SLOW] * 4, limit=9.0, period=0.1)


@pytest.mark.parametrize('strange', [-5.0, 0.0, LONGEST_PERIOD + 1])
def test_strange_intervals_say_nothing(strange):
    times = FillTime('kriging')
    assert CHEAPEST not in pictures(times, [SLOW] * 4, limit=9.0, period=0.1)
    times.came(int((0.3 + strange) * 1e9))
    assert [times.took(SLOW, 9.0, now) for now in (1.0, 2.0)] == [False, False]


def test_the_cheapest_has_no_fallback():
    times = FillTime(CHEAPEST)
    assert [times.took(SLOW, LIMIT, now) for now in (1.0, 2.0, 3.0)] == [False] * 3
