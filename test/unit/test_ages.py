# SPDX-License-Identifier: BSD-3-Clause
"""How old the regions of a map are."""
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from smokebot_udp.codecs.tiles.rectangle import Rectangle
from smokebot_udp.streams.grid.ages import Ages, age_message, uniform

AREA = Rectangle(-3, 0, 40, 20)
"""It touches blocks of 16 cells in columns -1..2 and rows 0..1."""

NOTHING = np.empty((0, 4), int)


def head(info: Any) -> SimpleNamespace:
    return SimpleNamespace(stamp=5 * 10 ** 9, frame_id='map', info=info)


def test_ages_count_from_what_was_received_or_confirmed() -> None:
    ages = Ages(AREA)
    assert (ages.seconds(0.0) == -1).all()
    ages.received(Rectangle(-3, 0, 19, 16), 10.0)
    ages.received_coarse(Rectangle(-3, 0, 40, 16), 20.0)
    assert ages.seconds(30.5).tolist() == [[20, 20, 10, 10], [-1, -1, -1, -1]]
    ages.confirm(np.array([[-1, 2, 1, 1], [1000, 1000, 5, 5]]), 40.0)
    assert ages.seconds(45.0).tolist() == [[35, 5, 25, 25], [-1, -1, -1, -1]]
    assert ages.seconds(45.0e3).tolist() == [[100, 100, 100, 100], [-1, -1, -1, -1]]
    ages.confirm(NOTHING, 50.0)
    assert ages.seconds(50.0).tolist() == [[0, 0, 30, 30], [-1, -1, -1, -1]]    # an overview is not confirmed


def test_a_map_that_moves_keeps_its_ages() -> None:
    ages = Ages(AREA)
    ages.received(Rectangle(16, 0, 16, 20), 10.0)
    ages.move(Rectangle(16, 16, 32, 32))
    assert ages.seconds(14.5).tolist() == [[4, -1], [-1, -1]]


def test_the_message_covers_the_map() -> None:
    """Turned by 90 degrees: the map's columns go along y, its rows along -x."""
    half = np.sqrt(0.5)
    info = ((7, 8), 0.5, 40, 20, ((100.0, 200.0, 1.0), (0.0, 0.0, half, half)))
    message = age_message(head(info), AREA, np.arange(8, dtype=np.int8).reshape(2, 4))
    assert (message.info.width, message.info.height, message.info.resolution) == (4, 2, 8.0)
    at = message.info.origin.position      # 13 columns before the map's first cell
    assert (at.x, at.y, at.z) == (pytest.approx(100.0), pytest.approx(200.0 - 13 * 0.5), 1.0)
    assert (message.header.stamp.secs, message.header.frame_id, message.info.map_load_time.nsecs) == (5, 'map', 8)
    assert message.data.tolist() == list(range(8))


def test_one_age_of_a_whole_map() -> None:
    for age, shown in ((2.9, 0), (3.0, 3), (-3.0, 0), (61.2, 61), (1e9, 100)):
        assert uniform(Rectangle(0, 0, 17, 5), age).tolist() == [[shown, shown]]
