# SPDX-License-Identifier: BSD-3-Clause
"""Tiles: bytes by hand, round trips, the limit of bytes, hostile ones."""
import zlib
from typing import Tuple

import needs_numba  # noqa: F401
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.tiles.cells import decode_cells, encode_cells
from smokebot_udp.codecs.tiles.coder import MAX_CELLS, decode, encode

MUCH = 1 << 20

shapes = st.tuples(st.integers(1, 40), st.integers(1, 40))


def maps_of(values: 'st.SearchStrategy[int]') -> 'st.SearchStrategy[Array]':
    """Some cells of their own in an area of one value."""
    return arrays.arrays(np.int8, shapes, elements=values, fill=values)


three_values, many_values = st.sampled_from([-1, 0, 100]), st.integers(-1, 100)


def round_trip(cells: Array) -> bytes:
    data = encode(cells, MUCH)
    assert data is not None
    decoded = decode(np.frombuffer(data, np.uint8), *cells.shape)
    assert decoded.dtype == np.int8 and decoded.tolist() == cells.tolist()
    return data


def room_with_walls(height: int, width: int) -> Array:
    cells = np.full((height, width), -1, np.int8)
    cells[3:-3, 3:-3] = 0
    cells[3:-3, [3, -4]] = cells[[3, -4], 3:-3] = 100
    return cells


def gradient(height: int, width: int) -> Array:
    """Costs that fall with the distance from a wall, as costmap_2d inflates obstacles."""
    distance = np.abs(np.subtract.outer(np.arange(height) * 0.3, np.arange(width))) * 0.05
    cells = (98 * np.exp(-3.0 * distance)).astype(np.int8)
    cells[distance < 0.05] = 100
    return cells


@pytest.mark.parametrize('value, data', [(-1, b'\0'), (0, b'\1'), (37, b'\x26'), (100, b'\x65')])
def test_uniform_tiles_take_a_byte(value: int, data: bytes) -> None:
    for shape in (1, 1), (512, 512):
        assert round_trip(np.full(shape, value, np.int8)) == data


@given(maps_of(three_values))
def test_maps_of_three_values(cells: Array) -> None:
    round_trip(cells)


@given(maps_of(many_values))
def test_maps_of_many_values(cells: Array) -> None:
    round_trip(cells)


@pytest.mark.parametrize('seed, levels', [(1, 3), (2, 102), (3, 20)])
def test_noise_crosses_without_loss(seed: int, levels: int) -> None:
    random = np.random.RandomState(seed)
    values = random.permutation(102)[:levels] - 1
    round_trip(values[random.randint(0, levels, (61, 83))].astype(np.int8))


def test_a_room_takes_few_bytes() -> None:
    assert len(round_trip(room_with_walls(300, 200))) < 30


def test_parts_of_a_message_are_coded_as_they_lie() -> None:
    whole = room_with_walls(60, 80)
    whole.flags.writeable = False
    assert round_trip(whole[10:50, 20:77]) == round_trip(whole[10:50, 20:77].copy())
    round_trip(whole)
    # the loops were compiled for one kind of array: compiling another would take seconds
    assert len(encode_cells.signatures) == len(decode_cells.signatures) == 1


@given(maps_of(many_values), st.integers(1, 80))
def test_no_more_bytes_than_there_is_room_for(cells: Array, most: int) -> None:
    data, limited = encode(cells, MUCH), encode(cells, most)
    assert limited == (data if data is not None and len(data) <= most else None)


def test_costs_take_less_than_zlib() -> None:
    cells = gradient(120, 150)
    assert len(round_trip(cells)) < len(zlib.compress(cells.tobytes(), 9))


@pytest.mark.parametrize('height, width', [(0, 5), (5, 0), (-1, -1), (1024, 1025), (1 << 40, 1 << 40)])
def test_impossible_sizes(height: int, width: int) -> None:
    with pytest.raises(ValueError, match='a tile of'):
        decode(np.zeros(1, np.uint8), height, width)


def test_the_largest_tile() -> None:
    assert decode(np.zeros(1, np.uint8), 1, MAX_CELLS).shape == (1, MAX_CELLS)


@pytest.mark.parametrize('data', [b'', b'\0\0', b'\x65\1', b'\xff', b'\xff' * 40])
def test_bytes_that_are_no_tile(data: bytes) -> None:
    with pytest.raises(ValueError):
        decode(np.frombuffer(data, np.uint8), 20, 30)


@pytest.mark.parametrize('cells', [room_with_walls(50, 60), gradient(30, 40)])
def test_a_tile_that_is_cut_or_goes_on_is_refused(cells: Array) -> None:
    data = round_trip(cells)
    for length in range(len(data)):
        with pytest.raises(ValueError):
            decode(np.frombuffer(data[:length], np.uint8), *cells.shape)
    with pytest.raises(ValueError, match='broken'):
        decode(np.frombuffer(data + bytes(7), np.uint8), *cells.shape)


@settings(max_examples=300)
@given(st.integers(101, 105), st.binary(max_size=60), shapes)
def test_any_bytes_are_cells_or_refused(kind: int, data: bytes, shape: Tuple[int, int]) -> None:
    try:
        cells = decode(np.frombuffer(bytes([kind]) + data, np.uint8), *shape)
    except ValueError:
        return
    assert cells.shape == shape and cells.min() >= -1 and cells.max() <= 100


def test_golden_bytes() -> None:
    """Both sides may have different versions: the bytes are fixed."""
    assert round_trip(room_with_walls(12, 20)).hex() == '665a6e0861299431c97976f1'
    assert round_trip(gradient(8, 16)).hex() == (
        '6781fdf6f718c67415dc8c47d59eeec062f8aaccdbc759af0514764f61ae952cf184de82bba6df4b6bd56c')
