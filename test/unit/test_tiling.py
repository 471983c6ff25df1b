# SPDX-License-Identifier: BSD-3-Clause
"""Tilings of maps that change, grow and move: what holds after any update, and cases by hand."""
from typing import List, Tuple

import needs_numba  # noqa: F401
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.tiles.coder import decode
from smokebot_udp.codecs.tiles.rectangle import Rectangle
from smokebot_udp.codecs.tiles.tiling import ROOT, Tile, Tiling

Corner = Tuple[int, int]


def rooms(seed: int, height: int, width: int) -> Array:
    """Free rooms with walls in the unknown."""
    random = np.random.RandomState(seed)
    cells = np.full((height, width), -1, np.int8)
    for _ in range(height * width // 300):
        y, x = random.randint(0, height), random.randint(0, width)
        cells[y:y + 22, x:x + 17] = 100
        cells[y + 1:y + 21, x + 1:x + 16] = 0
    return cells


def part(cells: Array, corner: Corner, place: Rectangle) -> Array:
    return cells[place.row - corner[1]:, place.column - corner[0]:][:place.height, :place.width]


def decoded(tile: Tile) -> Array:
    return decode(np.frombuffer(tile.data, np.uint8), tile.height, tile.width)


def check_cover(tiling: Tiling, cells: Array, corner: Corner) -> None:
    """The tiles are disjoint, fit, and make the map."""
    count = np.zeros(cells.shape, int)
    for revision, tile in tiling.tiles.items():
        assert tile.revision == revision and len(tile.data) <= tiling.room
        assert min(tile.column - corner[0], tile.row - corner[1]) >= 0
        assert (decoded(tile) == part(cells, corner, tile.place)).all()
        part(count, corner, tile.place)[:] += 1
    assert (count == 1).all()


def inner(place: Rectangle, whole: Rectangle) -> bool:
    """Whether a rectangle touches no side of another one."""
    return place.within(Rectangle(whole.column + 1, whole.row + 1, whole.width - 2, whole.height - 2)) == place


def check_update(before: List[Tile], old: Rectangle, made: List[Tile], tiling: Tiling, cells: Array, corner: Corner
                 ) -> None:
    """Nothing is made anew that did not change, except by merging."""
    check_cover(tiling, cells, corner)
    assert all(tiling.tiles[tile.revision] is tile for tile in made)
    assert min((tile.revision for tile in made), default=1 << 40) > max((tile.revision for tile in before), default=0)
    kept = [tile for tile in before if tile.revision in tiling.tiles]
    assert len(kept) + len(made) == len(tiling.tiles)
    whole = Rectangle(corner[0], corner[1], cells.shape[1], cells.shape[0])
    for tile in before:
        if tile.revision in tiling.tiles:
            assert tiling.tiles[tile.revision] == tile
        elif len(tile.data) <= tiling.room and (old == whole or (
                inner(tile.place, old) and inner(tile.place, whole))) and (
                decoded(tile) == part(cells, corner, tile.place)).all():
            # it was merged
            assert any(tile.place.within(new.place) == tile.place and new.place != tile.place for new in made)


steps = st.lists(st.tuples(st.sampled_from(['change', 'clear', 'grow', 'cut', 'room', 'same']),
                           st.integers(0, 1 << 30)), min_size=1, max_size=6)


def step(kind: str, seed: int, cells: Array, corner: Corner, tiling: Tiling) -> Tuple[Array, Corner]:
    random = np.random.RandomState(seed)
    top, left, bottom, right = random.randint(0, 12, 4)
    if kind == 'grow':
        padded = np.pad(cells, ((top, bottom), (left, right)), 'constant', constant_values=-1)
        return padded, (corner[0] - left, corner[1] - top)
    if kind == 'cut' and min(cells.shape) > 30:
        return cells[top:-bottom or None, left:-right or None], (corner[0] + left, corner[1] + top)
    if kind == 'room':
        tiling.room = int(random.randint(8, 120))
    elif kind != 'same':
        y, x = random.randint(0, cells.shape[0]), random.randint(0, cells.shape[1])
        cells = cells.copy()
        area = cells[y:y + 3 * top, x:x + 3 * left]
        area[:] = 0 if kind == 'clear' else random.randint(-1, 101, area.shape)
    return cells, corner


@settings(max_examples=150)
@given(st.integers(0, 1000), st.tuples(st.integers(1, 90), st.integers(1, 90)), st.tuples(
    st.integers(-700, 700), st.integers(-700, 700)), st.integers(8, 120), steps)
def test_any_updates(seed: int, shape: Tuple[int, int], corner: Corner, room: int,
                     then: List[Tuple[str, int]]) -> None:
    tiling, cells = Tiling(room), rooms(seed, *shape)
    check_update([], Rectangle(0, 0, 0, 0), tiling.update(cells, corner), tiling, cells, corner)
    for kind, number in then:
        old = Rectangle(corner[0], corner[1], cells.shape[1], cells.shape[0])
        cells, corner = step(kind, number, cells, corner, tiling)
        before = list(tiling.tiles.values())
        check_update(before, old, tiling.update(cells, corner), tiling, cells, corner)


def test_an_empty_map_is_a_tile_for_each_root_block() -> None:
    tiling = Tiling(100)
    made = tiling.update(np.full((ROOT, ROOT + 10), -1, np.int8), (-10, 0))
    assert [tile[1:] for tile in made] == [(-10, 0, 10, ROOT, b'\0'), (0, 0, ROOT, ROOT, b'\0')]
    assert [tile.revision for tile in made] == [1, 2]


def test_a_change_renews_the_tile_that_contains_it() -> None:
    cells, tiling = rooms(4, 400, 300), Tiling(100)
    tiling.update(cells, (5, 6))
    before = dict(tiling.tiles)
    assert len(before) > 8
    cells[200, 100] = 50
    gone = [tile for tile in before.values() if tile.place.within(Rectangle(105, 206, 1, 1)) == (105, 206, 1, 1)]
    made = tiling.update(cells, (5, 6))
    assert len(gone) == 1 and set(before) - set(tiling.tiles) == {gone[0].revision}
    assert {tile.place.within(gone[0].place) for tile in made} == {tile.place for tile in made}


def test_the_source_may_use_its_array_again() -> None:
    cells, tiling = rooms(1, 50, 50), Tiling(1000)
    tiling.update(cells, (0, 0))
    cells[7, 7] = 33
    assert len(tiling.update(cells, (0, 0))) == 1
    assert tiling.update(cells, (0, 0)) == []


def test_a_map_that_moves_its_origin_keeps_the_tiles_inside() -> None:
    cells, tiling = rooms(4, 400, 400), Tiling(60)
    tiling.update(cells[100:, 100:], (100, 100))
    inside = {revision for revision, tile in tiling.tiles.items() if min(tile.column, tile.row) > 100}
    assert len(inside) > 8
    tiling.update(cells, (0, 0))
    assert inside <= set(tiling.tiles)


def test_halves_are_merged_only_when_they_became_small() -> None:
    random = np.random.RandomState(1)
    cells, tiling = np.zeros((64, 64), np.int8), Tiling(200)
    noise = random.choice([0, 100], (64, 64))
    cells[:24] = noise[:24]
    tiling.update(cells, (0, 0))
    count = len(tiling.tiles)
    assert count > 1
    for rows in range(23, -1, -1):
        cells[rows] = 0
        tiling.update(cells, (0, 0))
        check_cover(tiling, cells, (0, 0))
        assert len(tiling.tiles) <= count
        count = len(tiling.tiles)
        sizes = [len(tile.data) for tile in tiling.tiles.values()]
        assert count == 1 or sum(sizes) > 0.75 * tiling.room
    assert count == 1
    # once merged it stays while it fits
    cells[:6] = noise[:6]
    tiling.update(cells, (0, 0))
    assert len(tiling.tiles) == 1


def test_less_room_renews_what_no_longer_fits_only() -> None:
    cells, tiling = rooms(4, 400, 300), Tiling(150)
    tiling.update(cells, (0, 0))
    fitting = {revision for revision, tile in tiling.tiles.items() if len(tile.data) <= 100}
    before = set(tiling.tiles)
    assert 0 < len(fitting) < len(before)
    tiling.room = 100
    tiling.update(cells, (0, 0))
    check_cover(tiling, cells, (0, 0))
    assert {revision for revision in tiling.tiles if revision in before} == fitting
    with pytest.raises(ValueError, match='0 bytes'):
        tiling.room = 0
