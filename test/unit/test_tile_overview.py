# SPDX-License-Identifier: BSD-3-Clause
"""Overviews: blocks by hand, no obstacle lost, few datagrams."""
from typing import Dict, List, Tuple

import needs_numba  # noqa: F401
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.tiles.coder import decode
from smokebot_udp.codecs.tiles.overview import Piece, overview


def values_of(pieces: List[Piece]) -> Dict[Tuple[int, int], int]:
    """{(column, row): value}; each is in one piece only."""
    found: Dict[Tuple[int, int], int] = {}
    for piece in pieces:
        cells = decode(np.frombuffer(piece.data, np.uint8), piece.height, piece.width)
        for (y, x), value in np.ndenumerate(cells):
            assert (piece.column + x, piece.row + y) not in found
            found[piece.column + x, piece.row + y] = int(value)
    return found


def scattered(seed: int, height: int, width: int, share: float) -> Array:
    random = np.random.RandomState(seed)
    return np.where(random.random_sample((height, width)) < share, random.randint(0, 101, (height, width)), -1).astype(
        np.int8)


def test_a_small_map_needs_none() -> None:
    shift, (piece,) = overview(np.zeros((7, 9), np.int8), (-3, 5), 100)
    assert shift == 0 and piece == Piece(-3, 5, 9, 7, b'\1')


def test_blocks_are_those_of_the_lattice() -> None:
    cells = np.full((40, 40), -1, np.int8)
    cells[0, 0], cells[1, 0], cells[39, 39], cells[20, 20:22] = 100, 0, 100, (0, 100)
    cells[10] = np.random.RandomState(2).permutation(40)
    shift, pieces = overview(cells, (-1, 3), 40, 1)
    assert shift > 0
    values = values_of(pieces)
    assert values[-1 >> shift, 3 >> shift] == 100 and values[38 >> shift, 42 >> shift] == 100
    assert set(values) == {(x >> shift, y >> shift) for x in range(-1, 39) for y in range(3, 43)}


@given(st.integers(0, 99), st.tuples(st.integers(1, 70), st.integers(1, 70)), st.tuples(
    st.integers(-99, 99), st.integers(-99, 99)), st.sampled_from([0.0, 0.01, 0.3, 1.0]), st.integers(12, 300),
    st.integers(1, 5))
def test_each_value_is_the_maximum_of_its_block(seed: int, shape: Tuple[int, int], corner: Tuple[int, int],
                                                share: float, room: int, most: int) -> None:
    cells = scattered(seed, *shape, share)
    shift, pieces = overview(cells, corner, room, most)
    assert 1 <= len(pieces) <= most and all(len(piece.data) <= room for piece in pieces)
    expected: Dict[Tuple[int, int], int] = {}
    for (y, x), value in np.ndenumerate(cells):
        block = (corner[0] + x) >> shift, (corner[1] + y) >> shift
        expected[block] = max(expected.get(block, -1), int(value))
    assert values_of(pieces) == expected


@pytest.mark.parametrize('room', [400, 1330])
def test_the_smallest_reduction_that_fits(room: int) -> None:
    cells = scattered(7, 300, 400, 0.05)
    shift, pieces = overview(cells, (0, 0), room)
    assert shift > 0
    # one step finer takes more than the datagrams have room for
    finer, more = overview(cells, (0, 0), room, 400)
    assert finer == 0 and sum(len(piece.data) for piece in more) > 4 * room
