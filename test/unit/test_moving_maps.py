# SPDX-License-Identifier: BSD-3-Clause
"""Maps whose origin moves by parts of a cell, over a slow link that loses datagrams: they stay whole, and move."""
from typing import Any, Iterator

import needs_numba  # noqa: F401
import numpy as np
import pytest
from scipy import ndimage

from evaluation.map_transfer import MapTransfer
from evaluation.maps import map_message

RATE, PERIOD = 0.1e6, 1.0
"""Rate of the link [bit/s], and interval of the maps [s]."""

SIZE = 600
STEP = 0.37
"""Cells by which the origin moves from one map to the next."""

COUNT, FIRST = 15, 8
"""Number of maps, and the first one that is judged."""

RESOLUTION = float(np.float32(0.05))


def world() -> Any:
    """Rooms with clutter: it takes some seconds on the link."""
    random = np.random.RandomState(1)
    cells = np.where(random.rand(SIZE + 60, SIZE + 60) < 0.1, 100, 0).astype(np.int8)
    cells[::50] = cells[:, ::40] = 100
    cells[-30:] = -1
    return cells


def at(cells: Any, columns: float, rows: float) -> Any:
    message = map_message(np.ascontiguousarray(cells))
    message.info.resolution = RESOLUTION
    message.info.origin.position.x, message.info.origin.position.y = columns * RESOLUTION, rows * RESOLUTION
    return message


def moved_as_it_is() -> Iterator[Any]:
    for step in range(COUNT):
        yield at(world()[:SIZE, :SIZE], STEP * step, -STEP * step)


def window_over_a_still_world() -> Iterator[Any]:
    for way in (STEP * step for step in range(COUNT)):
        yield at(world()[int(way):int(way) + SIZE, int(way):int(way) + SIZE], way, way)


def sampled_anew() -> Iterator[Any]:
    """A mapper that draws its window anew from a world that is known in detail: walls and objects of several cells."""
    fine = np.kron(world()[:SIZE // 2 + 20, :SIZE // 2 + 20], np.ones((2, 2), np.int8))
    for way in (STEP * step for step in range(COUNT)):
        yield at(ndimage.shift(fine, (-way, -way), order=0, cval=-1)[:SIZE, :SIZE], way, way)


@pytest.mark.parametrize('loss', [0.0, 0.2])
@pytest.mark.parametrize('maps', [moved_as_it_is, window_over_a_still_world])
def test_what_is_held_stays_and_moves(maps: Any, loss: float) -> None:
    shares = MapTransfer('tiles', RATE, loss, 1).follow(maps(), PERIOD)
    assert min(shares[FIRST:]) > 0.97 and shares[-1] > 0.99, [round(share, 2) for share in shares]


@pytest.mark.parametrize('loss', [0.0, 0.2])
def test_what_changes_all_the_time_is_as_new_as_the_link_allows(loss: float) -> None:
    shares = MapTransfer('tiles', RATE, loss, 1).follow(sampled_anew(), PERIOD)
    assert min(shares[FIRST:]) > 0.97, [round(share, 2) for share in shares]
