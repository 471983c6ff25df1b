# SPDX-License-Identifier: BSD-3-Clause
"""The cells of a map by the revisions of their tiles."""
from typing import Any, List, Tuple

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.codecs.tiles.rectangle import Rectangle
from smokebot_udp.streams.grid import canvas as canvas_module
from smokebot_udp.streams.grid.canvas import Canvas, Identity

AREA = Rectangle(-3, 5, 6, 4)


def put(canvas: Canvas, revision: int, place: Rectangle, value: int) -> None:
    tile = Identity(revision, place, value)
    canvas.put(tile, np.full((place.height, place.width), value, np.int8), canvas.older(tile))


def test_newer_tiles_cover_older_ones_in_any_order() -> None:
    canvas = Canvas(AREA)
    put(canvas, 2, Rectangle(-2, 6, 2, 2), 100)
    put(canvas, 1, Rectangle(-3, 5, 4, 3), 0)
    np.testing.assert_array_equal(canvas.cells, [
        [0, 0, 0, 0, -1, -1],
        [0, 100, 100, 0, -1, -1],
        [0, 100, 100, 0, -1, -1],
        [-1, -1, -1, -1, -1, -1]])
    assert (canvas.known, canvas.complete, sorted(canvas.held)) == (12, False, [1, 2])
    put(canvas, 3, AREA, 7)
    assert (canvas.known, canvas.complete, sorted(canvas.held)) == (24, True, [3])
    assert canvas.holds(Identity(3, AREA, 7)) and not canvas.holds(Identity(3, AREA, 8))
    assert not canvas.older(Identity(2, AREA, 0)).any()


def test_a_tile_is_held_as_long_as_a_cell_of_it_is_shown() -> None:
    canvas = Canvas(AREA)
    put(canvas, 1, Rectangle(-3, 5, 3, 1), 0)
    put(canvas, 2, Rectangle(-3, 5, 2, 1), 0)
    assert sorted(canvas.held) == [1, 2]
    put(canvas, 3, Rectangle(-1, 5, 1, 1), 0)
    assert sorted(canvas.held) == [2, 3]
    assert canvas.disown(2) and not canvas.disown(2)
    assert sorted(canvas.held) == [3]


def test_a_map_that_moves_keeps_what_is_in_both() -> None:
    canvas = Canvas(AREA)
    put(canvas, 1, Rectangle(-3, 5, 2, 4), 10)
    put(canvas, 2, Rectangle(1, 5, 2, 2), 20)
    canvas.move(Rectangle(-2, 4, 6, 3))     # a column less on the left, a row more above, two less below
    np.testing.assert_array_equal(canvas.cells, [
        [-1, -1, -1, -1, -1, -1],
        [10, -1, -1, 20, 20, -1],
        [10, -1, -1, 20, 20, -1]])
    assert canvas.known == 6
    assert sorted(canvas.held) == [2]       # the other one was cut
    canvas.move(Rectangle(100, 100, 2, 1))
    np.testing.assert_array_equal(canvas.cells, [[-1, -1]])
    assert canvas.known == 0


def test_a_new_session_keeps_what_is_known_until_it_is_replaced() -> None:
    canvas = Canvas(AREA)
    put(canvas, 1000, AREA, 50)
    canvas.begin_session()
    assert canvas.complete and not list(canvas.held)
    put(canvas, 1, Rectangle(-3, 5, 1, 1), 60)
    assert canvas.cells[0].tolist() == [60, 50, 50, 50, 50, 50]
    assert list(canvas.held) == [1]


def test_what_is_remembered_of_tiles_is_bounded(monkeypatch: Any) -> None:
    monkeypatch.setattr(canvas_module, 'MAX_HELD', 3)
    canvas = Canvas(AREA)
    for revision in range(1, 6):
        put(canvas, revision, Rectangle(-4 + revision, 5, 1, 1), 0)
    assert sorted(canvas.held) == [3, 4, 5]


@st.composite
def rectangles(draw: Any) -> Rectangle:
    column, row = draw(st.integers(0, 5)), draw(st.integers(0, 3))
    return Rectangle(AREA.column + column, AREA.row + row, draw(st.integers(1, 6 - column)),
                     draw(st.integers(1, 4 - row)))


@given(st.lists(st.tuples(st.integers(1, 8), rectangles()), max_size=12, unique_by=lambda tile: tile[0]))
def test_the_order_of_arrival_does_not_matter(tiles: List[Tuple[int, Rectangle]]) -> None:
    canvas, expected = Canvas(AREA), np.full((4, 6), -1, np.int8)
    for revision, place in sorted(tiles):
        expected[AREA.slices(place)] = revision
    for revision, place in tiles:
        put(canvas, revision, place, revision)
    np.testing.assert_array_equal(canvas.cells, expected)
    assert set(canvas.held) == set(expected[expected > 0].tolist())
    assert canvas.known == np.count_nonzero(expected > 0)
