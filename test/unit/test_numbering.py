# SPDX-License-Identifier: BSD-3-Clause
"""Numbers of the cells of maps that move: as many cells as possible keep theirs."""
import math
from typing import Any, Iterable, List, Optional, Tuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import MapMetaData

from smokebot_udp.codecs.tiles.lattice import Lattice
from smokebot_udp.streams.grid.numbering import COMPARED, Numbering

WORLD = np.where(np.random.RandomState(1).rand(200, 300) < 0.1, 100, 0).astype(np.int8)


def lattice(columns: float = 0.0, rows: float = 0.0, turn: float = 0.0, height: float = 0.0,
            resolution: float = 0.05) -> Lattice:
    info = MapMetaData(resolution=resolution)
    at = info.origin.position
    at.x, at.y, at.z = columns * resolution, rows * resolution, height
    info.origin.orientation.z, info.origin.orientation.w = math.sin(turn / 2), math.cos(turn / 2)
    return Lattice.of('map', info)


def corners(maps: Iterable[Tuple[Lattice, Any]]) -> List[Optional[Tuple[int, int]]]:
    numbering = Numbering()
    return [numbering.corner(at, cells) for at, cells in maps]


def window(column: int, row: int) -> Any:
    return WORLD[row:row + 90, column:column + 120]


def test_a_map_that_is_moved_as_it_is_keeps_its_numbers() -> None:
    maps = ((lattice(5.0 + 0.37 * step, -0.2 * step), window(0, 0)) for step in range(50))
    assert set(corners(maps)) == {(5, 0)}


def test_a_window_that_moves_over_a_still_world_numbers_the_worlds_cells() -> None:
    ways = [0.37 * step for step in range(100)]
    maps = [(lattice(10 + way, 20 + 0.5 * way), window(int(way), int(0.5 * way))) for way in ways]
    assert corners(maps) == [(10 + int(way), 20 + int(0.5 * way)) for way in ways]


@given(st.integers(-40, 40), st.integers(-40, 40), st.floats(-0.009, 0.009))
def test_by_whole_cells_numbers_move_whatever_the_cells_are(columns: int, rows: int, error: float) -> None:
    grown = np.full((170, 200), -1, np.int8)
    assert corners([(lattice(0.3, 0.3), window(0, 0)), (lattice(0.3 + columns + error, 0.3 + rows), grown)]) == [
        (0, 0), (columns, rows)]


@pytest.mark.parametrize('other', [lattice(turn=1e-4), lattice(height=0.3), lattice(-3.3, 2.2, 0.1, 1.0)])
def test_a_map_that_is_turned_or_raised_as_it_is_keeps_its_numbers(other: Lattice) -> None:
    assert corners([(lattice(), window(0, 0)), (other, window(0, 0))]) == [(0, 0), (0, 0)]


def test_where_nothing_can_be_kept_a_session_begins() -> None:
    turned = np.ascontiguousarray(np.rot90(WORLD))
    begin = lattice(), WORLD
    assert corners([begin, (lattice(turn=0.1), turned)]) == [(0, 0), None]
    assert corners([begin, (lattice(resolution=0.1), WORLD)]) == [(0, 0), None]
    assert corners([begin, (lattice()._replace(frame='odom'), WORLD)]) == [(0, 0), None]
    unknown = np.full(WORLD.shape, -1, np.int8)
    assert corners([begin, (lattice(turn=0.1), unknown)]) == [(0, 0), None]


def test_a_map_far_away_has_nothing_in_common_and_goes_on() -> None:
    assert corners([(lattice(), window(0, 0)), (lattice(1e6 + 0.5, 0.0), window(0, 0))]) == [(0, 0), (0, 0)]    # moved
    assert corners([(lattice(), window(0, 0)), (lattice(1e6 + 0.5, 0.0), window(60, 0))])[1] in [
        (10 ** 6, 0), (10 ** 6 + 1, 0)]


def test_large_maps_are_compared_in_a_part_of_their_rows() -> None:
    big = np.tile(WORLD, (10, 5))
    assert big.size > 10 * COMPARED
    maps = [(lattice(0.4 * step), np.roll(big, -int(0.4 * step), 1)) for step in range(6)]
    assert corners(maps) == [(int(0.4 * step), 0) for step in range(6)]


@pytest.mark.parametrize('way', [119.5, 120.5, 130.5, -119.5, -120.5, -130.5])
def test_maps_that_hardly_touch(way: float) -> None:
    for at in lattice(way, 0.0), lattice(0.0, way), lattice(way, way):
        first, second = corners([(lattice(), window(0, 0)), (at, 100 - window(60, 10))])
        assert first == (0, 0) and second is not None
        assert math.hypot(second[0] - at.column, second[1] - at.row) < 1
