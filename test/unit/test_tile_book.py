# SPDX-License-Identifier: BSD-3-Clause
import random
from typing import Any, Dict

import needs_numba  # noqa: F401
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.codecs.tiles import coder
from smokebot_udp.streams.grid.tile_book import PATCH_PART, TileBook
from smokebot_udp.streams.grid.tile_queue import Item

ROOM = 200


def rooms(height: int = 120, width: int = 160, seed: int = 0) -> Any:
    """Rich in detail, so that a tile has hundreds of bytes."""
    chance = np.random.RandomState(seed)
    cells = np.zeros((height, width), np.int8)
    cells[chance.rand(height, width) < 0.02] = 100
    return cells


def shown(items: Any, corner: Any, shape: Any) -> Any:
    """What an operator shows who holds these: each cell of the highest revision."""
    cells = np.full(shape, 99, np.int8)
    for item in sorted(items, key=lambda item: item.revision):
        row, column = item.place.row - corner[1], item.place.column - corner[0]
        cells[row:row + item.place.height, column:column + item.place.width] = coder.decode(
            np.frombuffer(item.data, np.uint8), item.place.height, item.place.width)
    return cells


def test_a_small_change_is_a_patch() -> None:
    book, cells = TileBook(ROOM), rooms()
    first = book.update(cells, (0, 0), ROOM)
    assert [item.revision for item in first.made] == list(range(1, len(first.made) + 1)) and not first.gone
    assert not any(item.urgent for item in first.made) and len(first.made) > 2
    changed = cells.copy()
    changed[33, 41:44] = 100 - changed[33, 41:44]
    second = book.update(changed, (0, 0), ROOM)
    patch, = second.made
    assert tuple(patch.place) == (41, 33, 3, 1) and patch.urgent and not second.gone
    assert (shown([*first.made, patch], (0, 0), cells.shape) == changed).all()


def test_a_patch_covers_what_changed_back() -> None:
    book, cells = TileBook(ROOM), rooms()
    book.update(cells, (0, 0), ROOM)
    there, back = cells.copy(), cells.copy()
    there[33, 41], back[33, 45] = 100 - cells[33, 41], 100 - cells[33, 45]
    before, = book.update(there, (0, 0), ROOM).made
    change = book.update(back, (0, 0), ROOM)
    patch, = change.made
    assert tuple(patch.place) == (41, 33, 5, 1) and change.gone == [before.revision]


def test_a_patch_takes_the_place_of_the_one_before() -> None:
    book, cells = TileBook(ROOM), rooms()
    book.update(cells, (0, 0), ROOM)
    for column in (41, 45):
        cells = cells.copy()
        cells[33, column] = 100 - cells[33, column]
        patch, = book.update(cells, (0, 0), ROOM).made
    assert tuple(patch.place) == (41, 33, 5, 1)


def test_an_unchanged_map_makes_nothing() -> None:
    book, cells = TileBook(ROOM), rooms()
    book.update(cells, (0, 0), ROOM)
    assert book.update(cells.copy(), (0, 0), ROOM) == ([], [])


def test_a_large_change_makes_the_tile_anew() -> None:
    book, cells = TileBook(ROOM), rooms()
    first = book.update(cells, (0, 0), ROOM)
    change = book.update(rooms(seed=1), (0, 0), ROOM)
    assert set(change.gone) == {item.revision for item in first.made} and all(item.urgent for item in change.made)


def test_a_map_that_grows_keeps_the_tiles_inside() -> None:
    book, cells = TileBook(ROOM), rooms(300, 400)
    first = book.update(cells, (0, 0), ROOM)
    grown = np.full((340, 440), -1, np.int8)
    grown[20:320, 10:410] = cells
    change = book.update(grown, (-10, -20), ROOM)
    assert 0 < len(change.gone) < len(first.made) / 2
    assert not any(item.urgent for item in change.made)     # nothing new is seen
    seen = grown.copy()
    seen[5, 5] = 0
    assert any(item.urgent for item in book.update(seen, (-10, -20), ROOM).made)


def test_smaller_datagrams_are_no_news() -> None:
    book, cells = TileBook(ROOM), rooms()
    book.update(cells, (0, 0), ROOM)
    change = book.update(cells, (0, 0), ROOM // 3)
    assert change.made and not any(item.urgent for item in change.made)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10 ** 6))
def test_who_holds_all_in_use_shows_the_map_whatever_else_came(seed: int) -> None:
    chance, room = random.Random(seed), ROOM
    book, cells, corner = TileBook(room), rooms(60, 80, seed), (-20, 30)
    used: Dict[int, Item] = {}
    ever = []
    for _ in range(8):
        change = book.update(cells, corner, room)
        for revision in change.gone:
            del used[revision]
        used.update({item.revision: item for item in change.made})
        ever += change.made
        assert all(len(item.data) <= room for item in used.values())
        late = [item for item in ever if item.revision not in used and chance.random() < 0.5]
        inside = [item for item in late if item.place.within(_rectangle(corner, cells)) == item.place]
        assert (shown([*used.values(), *inside], corner, cells.shape) == cells).all()
        for number, item in used.items():       # a patch never covers its tile: the tile goes on being reported
            assert not any(other.place == item.place and other.revision > number for other in used.values())
        cells = cells.copy()
        row, column = chance.randrange(60), chance.randrange(80)
        height, width = chance.randrange(1, 30), chance.randrange(1, 30)
        cells[row:row + height, column:column + width] = chance.choice([-1, 0, 100, 7])
        if chance.random() < 0.3:
            room = chance.choice([60, 120, ROOM])
        if chance.random() < 0.2:
            cells = np.pad(cells, ((0, 0), (0, 3)), constant_values=-1)
    assert 0 < PATCH_PART < 1


def _rectangle(corner: Any, cells: Any) -> Any:
    from smokebot_udp.codecs.tiles.tiling import Rectangle
    return Rectangle(*corner, cells.shape[1], cells.shape[0])
