# SPDX-License-Identifier: BSD-3-Clause
"""The pictures of the demo over a bad link: what is seen when, and how old it is."""
import pathlib

import cv2
import numpy as np
import pytest

from smokebot_udp.demo.pictures import summary
from smokebot_udp.demo.strip import (
    CAPTION,
    CELL,
    FILM_RATE,
    Seen,
    at,
    caption,
    cell,
    film_frame,
    moments,
    strip,
    write_film,
)
from smokebot_udp.optional import found


def seen(when: float, stamp: float, grey: int = 200, width: int = 64, height: int = 48) -> Seen:
    return Seen(when, stamp, cv2.imencode('.jpg', np.full((height, width, 3), grey, np.uint8))[1].tobytes())


SHOWN = [seen(2.0, 1.9, 50), seen(4.0, 3.0, 150), seen(5.0, 3.1, 250)]


def test_what_is_on_a_screen_came_last_before() -> None:
    assert at(SHOWN, 1.99) is None and at([], 1.0) is None
    assert at(SHOWN, 2.0) is SHOWN[0] and at(SHOWN, 4.9) is SHOWN[1] and at(SHOWN, 99.0) is SHOWN[2]


def test_moments_are_evenly_spread_and_the_last_is_the_end() -> None:
    assert moments(10.0, 20.0, 4) == [12.5, 15.0, 17.5, 20.0]


def test_the_age_is_that_of_the_moment_not_of_the_arrival() -> None:
    assert caption(SHOWN[1], 4.0) == 'age 1.0 s' and caption(SHOWN[1], 12.0) == 'age 9.0 s'
    assert caption(None, 12.0) == 'nothing yet'


@pytest.mark.parametrize('width, height, box', [(64, 48, (0, 0, 320, 240)), (48, 48, (40, 0, 240, 240)),
                                               (640, 120, (0, 90, 320, 60))])
def test_an_image_fills_its_cell_without_distortion(width, height, box) -> None:
    left, top, wide, high = box
    image = cell(seen(0.0, 0.0, 200, width, height), 1.0)[:CELL[1]]
    inside = image[top:top + high, left:left + wide]
    assert (abs(inside.astype(int) - 200) < 3).all() and (image > 100).sum() == inside.size
    assert not cell(None, 1.0)[:CELL[1]].any() and cell(None, 1.0)[CELL[1]:].any()    # says that there is nothing


def test_a_strip_has_a_row_for_each_screen_and_a_column_for_each_moment() -> None:
    picture = strip({'one': SHOWN, 'other': []}, [2.5, 6.0])
    row = CAPTION + CELL[1] + CAPTION
    assert picture.shape == (2 * row, 2 * CELL[0], 3)
    values = [int(picture[CAPTION + 100 + row * number, 160 + CELL[0] * column, 0])
              for number in range(2) for column in range(2)]
    assert values == pytest.approx([50, 250, 0, 0], abs=2)


def test_a_film_shows_all_screens_for_the_time(tmp_path: pathlib.Path) -> None:
    screens = {'one': SHOWN, 'other': SHOWN, 'third': []}
    assert film_frame(screens, 2.0).shape == (2 * (2 * CAPTION + CELL[1]), 2 * CELL[0], 3)
    if not found('av'):
        pytest.skip('PyAV is missing')
    import av
    path = str(tmp_path / 'film.mp4')
    assert write_film(path, screens, 2.0, 4.0)
    with av.open(path) as film:
        frames = [frame.to_ndarray(format='bgr24') for frame in film.decode(video=0)]
    assert len(frames) == 2 * FILM_RATE and abs(int(frames[5][CAPTION + 100, 160, 0]) - 50) < 8


def test_a_summary_counts_what_came_and_says_how_old_it_was() -> None:
    assert summary([], 0.0, 30.0) == 'no image in 30 s'
    assert summary(SHOWN, 3.95, 5.95) == '2 images in 2 s, age on the screen p50 1.9 s, most 2.7 s'
    assert 'nothing at first for 1.0 s' in summary(SHOWN, 1.01, 3.0)
