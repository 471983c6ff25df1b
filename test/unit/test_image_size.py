# SPDX-License-Identifier: BSD-3-Clause
"""The one decision for the size of an image, by hand."""
import math
from typing import Any, Dict, Optional

import numpy as np
import pytest

from smokebot_udp.streams.encoder import LinkView
from smokebot_udp.streams.image.image_size import (
    FILL,
    GOOD_BITS,
    LATEST,
    LEAST_BYTES,
    LEAST_FILL,
    MOTION,
    Bound,
    Costs,
    Grant,
    choose,
    grant,
    period_of,
)
from smokebot_udp.streams.outlook import Rooms

SOON = 1e-9
"""A period in which no byte arrives: only the sum of the errors counts [s]."""

ENDS, ERRORS = np.array([100, 1000, 2000, 4000]), np.array([400.0, 100.0, 50.0, 25.0])


@pytest.mark.parametrize('rate, source, period', [(10.0, None, 0.1), (20.0, None, 0.05), (30.0, 20.0, 0.05),
                                                  (1.0, None, LATEST)])
def test_the_time_to_the_next_image(rate: float, source: Optional[float], period: float) -> None:
    assert period_of(LinkView(source_rate=source).frame_rate({'rate': rate})) == pytest.approx(period)


@pytest.mark.parametrize('settings, granted', [
    ({}, Grant(FILL * 1e4, Bound.ROOM)),
    ({'air_time': 0.02}, Grant(2e3, Bound.AIR_TIME)),
    ({'air_time': 5.0}, Grant(FILL * 1e4, Bound.ROOM)),
    ({'max_bytes': 3000}, Grant(3000, Bound.MAX_BYTES)),
    ({'max_bytes': 3000, 'air_time': 0.02}, Grant(2e3, Bound.AIR_TIME)),
    ({'max_bytes': 10}, Grant(LEAST_BYTES, Bound.MAX_BYTES))])
def test_the_least_limit_is_the_bound(settings: Dict[str, Any], granted: Grant) -> None:
    assert grant({'air_time': 0.0, 'max_bytes': 0, **settings}, 1e5, 0.1) == (pytest.approx(granted.size),
                                                                              granted.bound)


def test_what_is_left_of_the_last_image_leaves_first() -> None:
    settings = {'air_time': 0.0, 'max_bytes': 0}
    assert grant(settings, 1e5, 0.1, 0.03).size == pytest.approx((FILL * 0.1 - 0.03) * 1e5)
    assert grant(settings, 1e5, 0.1, 0.09).size == pytest.approx(LEAST_FILL * 1e4)
    assert grant(settings, 0.0, 0.1).size == LEAST_BYTES
    assert grant(settings, math.inf, 0.1).size == math.inf


@pytest.mark.parametrize('good, motion', [(10000, MOTION), (1000, 1.0)])
def test_bytes_are_sent_while_they_gain_more_than_the_scene_moves_meanwhile(good: int, motion: float) -> None:
    """2000 bytes more save 25; on a link of 1e5 byte/s they take 20 ms, and with as much coding 40 ms. Beyond a good
    image both errors count alike."""
    link, processors = Costs(1.0, 0.0, 1e5), Costs(1.0, 1e-5, 1e5)
    worth, cells = 25 / 0.02 / motion, int(good * 8 / GOOD_BITS)
    for growth, costs, points in ((0.0, link, 4), (0.99 * worth, link, 4), (1.01 * worth, link, 3),
                                  (0.99 * worth, processors, 3), (worth, Costs(2.0, 0.0, 1e5), 3),
                                  (1e9, link, 1), (1e3, Costs(1.0, 0.0, 0.0), 1)):
        assert choose(ENDS, ERRORS, cells, growth, SOON, costs) == (points, ERRORS[points - 1])
    assert choose(ENDS, ERRORS, cells, 0.0, SOON, Costs(1.0, 0.0, math.inf)) == (4, 25.0)


@pytest.mark.parametrize('rate, points', [(1e5, 3), (1e4, 3), (1e6, 4)])
def test_from_42_5_db_on_an_image_is_shorter_for_its_freshness(rate: float, points: int) -> None:
    """The scene moves by 45 count^2/s. The last 2000 bytes save 0.3 of an image that is good without them: they take
    20 ms, and are left out; on a link that is ten times as fast they are worth their 2 ms. On one that is ten times as
    slow the image still takes what makes it good. A measurement takes all."""
    errors, costs = np.array([40.0, 10.0, 3.6, 3.3]), Costs(1.0, 0.0, rate)
    assert choose(ENDS, errors, 752 * 480, 45.0, SOON, costs) == (points, errors[points - 1])
    assert choose(ENDS, errors, 752 * 480, 45.0, SOON, costs, 0.0) == (4, 3.3)


@pytest.mark.parametrize('tokens, points', [(0.0, 3), (2000.0, 3), (3000.0, 4), (1e6, 4)])
def test_what_a_token_bucket_lets_pass_at_once_is_not_late(tokens: float, points: int) -> None:
    """As above, on a link of 1e5 byte/s: with 3000 tokens the last 2000 bytes take 10 of their 20 ms."""
    errors = np.array([40.0, 10.0, 3.6, 3.1])
    assert choose(ENDS, errors, 752 * 480, 45.0, SOON, Costs(1.0, 0.0, 1e5, tokens)) == (points, errors[points - 1])


@pytest.mark.parametrize('rate, points', [(1e6, 4), (1e5, 3), (2e4, 1)])
def test_a_scene_that_moves_fast_makes_no_image_blurred(rate: float, points: int) -> None:
    """What has moved until the next image, 0.1 s later, is a squared error of 1e8: by its sum with the others' each
    byte costs more than it gains. By hand, mean logarithms of the screen's error at 1e5 byte/s, where 1000 bytes take
    10 ms: 0.9 ln 1600 + 0.1 ln 1e8 = 8.5, 0.8 ln 100 + 0.2 ln 1e8 = 7.4, 0.6 ln 25 + 0.4 ln 1e8 = 9.3."""
    ends, errors = np.array([500, 1000, 2000, 4000]), np.array([6400.0, 1600.0, 100.0, 25.0])
    assert choose(ends, errors, 76800, 1e9, 0.1, Costs(1.0, 0.0, rate), 0.0) == (points, errors[points - 1])
    assert choose(ends, errors, 76800, 1e9, SOON, Costs(1.0, 0.0, rate), 0.0) == (1, errors[0])


def test_what_gains_nothing_makes_no_image_short() -> None:
    errors = np.array([400.0, 100.0, 50.0, 49.9])
    assert choose(ENDS, errors, 76800, 100.0, SOON, Costs(1.0, 0.0, 1e5)) == (4, 49.9)


def test_the_room_is_followed_with_the_second_estimate_and_not_with_the_first() -> None:
    rooms = Rooms()
    found = [rooms.update({'camera': room})['camera'] for room in (9.0, 10.0, 11.0, 3.0, 10.0, 11.0, 3.0, 3.0, 10.0)]
    assert found == [9.0, 9.0, 10.0, 10.0, 10.0, 10.0, 10.0, 3.0, 3.0]
    assert rooms.update({'thermal': 5.0}) == {'thermal': 5.0}
    assert rooms.update({'camera': 7.0}) == {'camera': 7.0}
