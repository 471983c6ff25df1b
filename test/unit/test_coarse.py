# SPDX-License-Identifier: BSD-3-Clause
"""What is shown of an overview beside the cells that were received."""
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.codecs.tiles.rectangle import Rectangle
from smokebot_udp.streams.grid.canvas import Canvas, Identity
from smokebot_udp.streams.grid.coarse import Coarse

AREA = Rectangle(-1, 0, 4, 4)
"""Its blocks of two cells are columns -1; 0, 1; 2 and rows 0, 1; 2, 3."""

NOTHING = np.empty((0, 4), int)


def put(canvas: Canvas, revision: int, place: Rectangle, value: int) -> None:
    tile = Identity(revision, place, value)
    canvas.put(tile, np.full((place.height, place.width), value, np.int8), canvas.older(tile))


def overview(coarse: Coarse, revision: int) -> None:
    """Put an overview with the blocks unknown, 0, 100 / 0, 100, 50."""
    coarse.put(1, Rectangle(-1, 0, 3, 2), revision, np.array([[-1, 0, 100], [0, 100, 50]], np.int8))


def test_an_overview_stands_for_cells_that_were_never_received() -> None:
    canvas, coarse = Canvas(AREA), Coarse(AREA)
    assert coarse.empty
    put(canvas, 1, Rectangle(0, 0, 1, 2), 0)
    overview(coarse, 1)
    assert not coarse.empty
    np.testing.assert_array_equal(coarse.shown(canvas), [
        [-1, 0, 0, 100],
        [-1, 0, 0, 100],
        [0, 100, 100, 50],
        [0, 100, 100, 50]])


def test_where_it_contradicts_older_cells_it_is_shown_until_their_tile_comes() -> None:
    canvas, coarse = Canvas(AREA), Coarse(AREA)
    put(canvas, 3, AREA, 0)
    overview(coarse, 7)
    np.testing.assert_array_equal(coarse.shown(canvas), [
        [-1, 0, 0, 100],
        [-1, 0, 0, 100],
        [0, 100, 100, 50],
        [0, 100, 100, 50]])
    put(canvas, 6, Rectangle(1, 2, 1, 1), 100)      # its block's maximum now
    put(canvas, 8, Rectangle(2, 0, 1, 2), 0)        # newer than the overview
    np.testing.assert_array_equal(coarse.shown(canvas), [
        [-1, 0, 0, 0],
        [-1, 0, 0, 0],
        [0, 0, 100, 50],
        [0, 0, 0, 50]])


def test_cells_that_were_never_received_may_hide_the_maximum() -> None:
    canvas, coarse = Canvas(AREA), Coarse(AREA)
    put(canvas, 1, Rectangle(0, 2, 1, 2), 0)
    put(canvas, 2, Rectangle(2, 2, 1, 1), 60)
    overview(coarse, 7)
    assert coarse.shown(canvas)[2:].tolist() == [[0, 0, 100, 50], [0, 0, 100, 50]]      # 60 is above the maximum


def test_a_statement_settles_what_is_not_pending() -> None:
    canvas, coarse = Canvas(AREA), Coarse(AREA)
    put(canvas, 3, AREA, 0)
    overview(coarse, 7)
    assert coarse.newest == 7
    assert coarse.settle(np.array([[2, 3, 1, 1], [500, 0, 9, 9]]))
    np.testing.assert_array_equal(coarse.shown(canvas), [[0, 0, 0, 0]] * 2 + [[0, 0, 0, 50]] * 2)
    assert coarse.settle(NOTHING) and not coarse.settle(NOTHING)
    assert not coarse.shown(canvas).any()


def test_a_former_session_says_nothing_against_cells() -> None:
    canvas, coarse = Canvas(AREA), Coarse(AREA)
    put(canvas, 3, Rectangle(-1, 0, 4, 2), 0)
    overview(coarse, 7)
    for part in (canvas, coarse):
        part.begin_session()
    np.testing.assert_array_equal(coarse.shown(canvas), [[0, 0, 0, 0]] * 2 + [[0, 100, 100, 50]] * 2)


def test_it_is_kept_where_the_map_moves_and_rescaled() -> None:
    coarse = Coarse(AREA)
    overview(coarse, 7)
    coarse.move(Rectangle(0, 2, 5, 3))
    canvas = Canvas(Rectangle(0, 2, 5, 3))
    np.testing.assert_array_equal(coarse.shown(canvas), [[100, 100, 50, 50, -1]] * 2 + [[-1] * 5])
    coarse.put(2, Rectangle(1, 1, 1, 1), 8, np.array([[30]], np.int8))      # block of 4 from cell 4, 4
    np.testing.assert_array_equal(coarse.shown(canvas), [[100] * 4 + [-1]] * 2 + [[-1] * 4 + [30]])
    coarse.put(1, Rectangle(2, 2, 1, 1), 9, np.array([[20]], np.int8))
    np.testing.assert_array_equal(coarse.shown(canvas), [[100] * 4 + [-1]] * 2 + [[-1] * 4 + [20]])


@given(st.integers(-20, 20), st.integers(-20, 20), st.integers(1, 30), st.integers(1, 30), st.integers(1, 5),
       st.integers(0, 1 << 30))
def test_no_obstacle_is_lost(column: int, row: int, width: int, height: int, shift: int, seed: int) -> None:
    """Whatever parts of an old and of the new map are there, each block shows at least the new map's maximum."""
    area, random = Rectangle(column, row, width, height), np.random.RandomState(seed)
    old, new = (random.choice(np.array([-1, 0, 100], np.int8), (height, width), p=[0.3, 0.6, 0.1]) for _ in range(2))
    canvas, coarse = Canvas(area), Coarse(area)
    for revision, cells in ((1, old), (2, new)) * 3:
        w, h = random.randint(1, width + 1), random.randint(1, height + 1)
        place = Rectangle(column + random.randint(0, width - w + 1), row + random.randint(0, height - h + 1), w, h)
        tile = Identity(revision, place, 0)
        canvas.put(tile, cells[area.slices(place)], canvas.older(tile))
    coarse.put(shift, area.blocks(shift), 2, pooled(new, area, shift))
    shown = coarse.shown(canvas)
    assert (pooled(shown, area, shift) >= pooled(new, area, shift)).all()
    np.testing.assert_array_equal(coarse.shown(complete(area, new)), new)


def pooled(cells: np.ndarray, area: Rectangle, shift: int) -> np.ndarray:
    blocks = area.blocks(shift)
    values = np.full((blocks.height, blocks.width), -1, np.int8)
    rows, columns = (np.arange(first, first + size) >> shift for first, size in (
        (area.row, area.height), (area.column, area.width)))
    np.maximum.at(values, (rows[:, np.newaxis] - blocks.row, columns - blocks.column), cells)
    return values


def complete(area: Rectangle, cells: np.ndarray) -> Canvas:
    canvas, tile = Canvas(area), Identity(2, area, 0)
    canvas.put(tile, cells, canvas.older(tile))
    return canvas
