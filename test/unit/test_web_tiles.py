# SPDX-License-Identifier: BSD-3-Clause
import time
from typing import Any, Dict

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.web.tiles import LEVELS, TILE, Area, Key, Place, TiledMap, shades

PLACE = Place(-10.0, -5.0, 0.0, 0.05, 'map')
EVERYWHERE = Area(-10 ** 6, -10 ** 6, 10 ** 6, 10 ** 6)


def picture(tiled: TiledMap, key: Key) -> Any:
    """A tile, the first line at the bottom."""
    return cv2.imdecode(np.frombuffer(tiled.png(key), np.uint8), cv2.IMREAD_UNCHANGED)[::-1]


def versions(tiled: TiledMap, level: int = 0) -> Dict[Key, int]:
    return dict(tiled.versions(level, EVERYWHERE))


def test_cells_and_their_place_in_tiles() -> None:
    tiled, cells = TiledMap(), np.full((130, 5), -1, np.int8)
    cells[0, 0], cells[1, 2], cells[129, 4] = 0, 100, 50
    tiled.set(PLACE, cells)
    assert tiled.anchor == PLACE and tiled.area == (0, 0, 5, 130)
    assert set(versions(tiled)) == {Key(0, 0, 0), Key(0, 0, 1)}
    low, high = picture(tiled, Key(0, 0, 0)), picture(tiled, Key(0, 0, 1))
    assert low.shape == (TILE, TILE) and (low[0, 0], low[1, 2], low[2, 2]) == (1, 101, 0)
    assert high[1, 4] == 51 and np.count_nonzero(high) == 1
    coarse = picture(tiled, Key(1, 0, 0))
    assert coarse[0, 0] == 1 and coarse[0, 1] == 101 and coarse[64, 2] == 51


def test_only_what_changed_has_another_version() -> None:
    tiled, cells = TiledMap(), np.zeros((300, 300), np.int8)
    tiled.set(PLACE, cells)
    before = versions(tiled), versions(tiled, 1)
    assert len(before[0]) == 9 and len(before[1]) == 4
    cells[200, 10] = 100
    tiled.set(PLACE, cells)
    assert {key for key, version in versions(tiled).items() if version != before[0][key]} == {Key(0, 0, 1)}
    before = versions(tiled), versions(tiled, 1)
    assert picture(tiled, Key(0, 2, 0))[10, 34] == 1
    tiled.update(290, 10, np.full((2, 3), 100, np.int8))
    assert {key for key, version in versions(tiled).items() if version != before[0][key]} == {Key(0, 2, 0)}
    assert {key for key, version in versions(tiled, 1).items() if version != before[1][key]} == {Key(1, 1, 0)}
    assert picture(tiled, Key(0, 2, 0))[10:12, 34:37].tolist() == [[101] * 3] * 2
    now = versions(tiled)
    tiled.update(290, 10, np.full((2, 3), 100, np.int8))
    assert versions(tiled) == now


def test_a_map_that_grows_keeps_its_tiles() -> None:
    tiled, cells = TiledMap(), np.zeros((128, 128), np.int8)
    tiled.set(PLACE, cells)
    before, id_ = versions(tiled), tiled.id
    grown = np.full((228, 328), -1, np.int8)
    grown[100:, 200:] = cells
    tiled.set(PLACE._replace(x=PLACE.x - 200 * 0.05, y=PLACE.y - 100 * 0.05), grown)
    assert tiled.id == id_ and tiled.area == (-200, -100, 128, 128) and versions(tiled) == before
    grown[0, 0] = 100
    tiled.set(PLACE._replace(x=PLACE.x - 200 * 0.05, y=PLACE.y - 100 * 0.05), grown)
    assert set(versions(tiled)) - set(before) == {Key(0, -2, -1)}
    assert picture(tiled, Key(0, -2, -1))[28, 56] == 101


@pytest.mark.parametrize('change', [{'resolution': 0.1}, {'yaw': 0.1}, {'x': PLACE.x + 0.02}, {'frame': 'odom'},
                                    {'x': 1e9}])
def test_a_map_that_does_not_fit_begins_anew(change) -> None:
    tiled = TiledMap()
    tiled.set(PLACE, np.zeros((10, 10), np.int8))
    tiled.png(Key(0, 0, 0))
    id_ = tiled.id
    tiled.set(PLACE._replace(**change), np.full((10, 10), 100, np.int8))
    assert tiled.id == id_ + 1 and tiled.area == (0, 0, 10, 10) and picture(tiled, Key(0, 0, 0))[0, 0] == 101


def test_a_map_that_shrinks_leaves_nothing() -> None:
    tiled = TiledMap()
    tiled.set(PLACE, np.zeros((300, 10), np.int8))
    before = versions(tiled)
    tiled.set(PLACE, np.zeros((10, 10), np.int8))
    assert all(version != before[key] for key, version in versions(tiled).items())
    assert not picture(tiled, Key(0, 0, 2)).any()


@pytest.mark.parametrize('x, y, shape', [(-1, 0, (1, 1)), (0, 9, (2, 1)), (8, 0, (1, 3)), (0, 0, (11, 1))])
def test_an_update_outside_is_refused(x, y, shape) -> None:
    tiled = TiledMap()
    tiled.set(PLACE, np.zeros((10, 10), np.int8))
    with pytest.raises(ValueError, match='is not in the map'):
        tiled.update(x, y, np.zeros(shape, np.int8))


@pytest.mark.parametrize('place, shape', [(PLACE._replace(resolution=0.0), (2, 2)), (PLACE, (0, 5)),
                                          (PLACE._replace(x=float('nan')), (2, 2)),
                                          (PLACE._replace(resolution=float('nan')), (2, 2))])
def test_an_impossible_map_is_refused(place, shape) -> None:
    with pytest.raises(ValueError, match='a map'):
        TiledMap().set(place, np.zeros(shape, np.int8))


def test_illegal_cells_are_unknown() -> None:
    assert shades(np.array([-128, -1, 0, 100, 101, 127], np.int8)).tolist() == [0, 0, 1, 101, 0, 0]


def test_the_cells_of_an_area() -> None:
    tiled = TiledMap()
    tiled.set(PLACE, np.zeros((100, 200), np.int8))
    assert tiled.cells_in(-9.99, -4.99, -9.0, -4.0, PLACE) == (0, 0, 20, 20)
    assert tiled.cells_in(-1e6, -1e6, 1e6, 1e6, PLACE) == tiled.area
    turned = PLACE._replace(yaw=np.pi / 2)
    assert tiled.cells_in(-11.0, -5.0, -10.0, -3.0, turned) == pytest.approx((0, 0, 40, 20), abs=1)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 150), st.integers(0, 150), st.integers(1, 60), st.integers(1, 60),
                          st.integers(-1, 100)), max_size=8), st.integers(0, LEVELS - 1))
def test_updates_are_as_whole_maps(updates, level) -> None:
    cells = np.full((210, 210), -1, np.int8)
    one, other = TiledMap(), TiledMap()
    one.set(PLACE, cells)
    for x, y, width, height, value in updates:
        cells[y:y + height, x:x + width] = value
        one.update(x, y, np.full((height, width), value, np.int8))
    other.set(PLACE, cells)
    for key in versions(other, level):
        assert np.array_equal(picture(one, key), picture(other, key))


def test_a_large_map_is_quick_and_a_change_small() -> None:
    """First view of 1255 x 1857 cells within 0.5 s, a change within 5 kB; here without the network."""
    random = np.random.default_rng(1)
    cells = cv2.resize(random.integers(0, 3, (60, 40)).astype(np.uint8), (1255, 1857), interpolation=0).astype(np.int8)
    cells = np.select([cells == 0, cells == 1], [-1, 0], 100).astype(np.int8)
    tiled = TiledMap()
    begun = time.process_time()
    tiled.set(PLACE, cells)
    sizes = [len(tiled.png(key)) for key in versions(tiled)]
    assert time.process_time() - begun < 0.5 and sum(sizes) < 200000
    before = versions(tiled)
    tiled.update(600, 900, np.full((40, 40), 100, np.int8))
    changed = [key for key, version in versions(tiled).items() if version != before[key]]
    assert sum(len(tiled.png(key)) for key in changed) < 5000
