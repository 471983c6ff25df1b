# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from smokebot_udp.codecs.wire import interleave
from smokebot_udp.codecs.wire.grid import as_cells, fit, reduce_by, unknown
from smokebot_udp.codecs.wire.interleave import Interleave


def test_the_highest_of_each_block_and_unknown_only_where_all_is() -> None:
    cells = np.array([[-1, -1, 0, 5, 100], [-1, -1, -1, 3, -1], [0, -1, 1, 2, -1]], np.int8)
    assert reduce_by(cells, 2).tolist() == [[-1, 5, 100], [0, 2, -1]]
    assert reduce_by(cells, 1).tolist() == cells.tolist()
    assert reduce_by(cells, 9).tolist() == [[100]]


@given(arrays.arrays(np.int8, st.tuples(st.integers(1, 20), st.integers(1, 20)), elements=st.integers(-1, 100)),
       st.integers(1, 7))
def test_against_a_slow_loop(cells, factor) -> None:
    height, width = (-(-side // factor) for side in cells.shape)
    slow = [[cells[r * factor:(r + 1) * factor, c * factor:(c + 1) * factor].max() for c in range(width)]
            for r in range(height)]
    assert reduce_by(cells, factor).tolist() == slow


def segments_needed(height, width, factor, room) -> Any:
    try:
        cut, per_segment = interleave.fit(-(-height // factor), -(-width // factor), 1, room)
    except ValueError:
        return math.inf
    return -(-len(cut) // per_segment)


@given(st.integers(1, 4096), st.integers(1, 4096), st.integers(1, 1400), st.integers(1, 1400),
       st.integers(1, 300) | st.integers(1, 65536))
@settings(deadline=None)
def test_the_least_factor_within_both_limits(height, width, room, max_cells, max_segments) -> None:
    factor, cut, per_segment = fit(height, width, room, max_cells, max_segments)
    rows, columns = cut.shape
    assert rows * columns * per_segment <= min(room, max_cells)
    assert (cut.height, cut.width) == (-(-height // factor), -(-width // factor))
    needed = [segments_needed(height, width, smaller, min(room, max_cells)) for smaller in range(1, factor + 1)]
    assert needed.pop() <= max_segments and all(count > max_segments for count in needed)


def test_cells_that_no_cut_fits_are_reduced_until_one_does() -> None:
    """4096 rows at the greatest depth are subimages of 16 cells, so one cell a segment takes 16 times fewer."""
    assert fit(4096, 16, 1350, 1, 65536) == (16, Interleave(256, 1, 8), 1)


def test_the_deliverables_numbers() -> None:
    assert fit(500, 500, 1350, 1300, 256)[0] == 1
    assert fit(4096, 4096, 1350, 1300, 256)[0] == 8


@pytest.mark.parametrize('arguments, words', [
    ((b'', 0, 5, 0.1), 'height is 0'), ((b'', 5, 5000, 0.1), 'width is 5000'),
    ((bytes(3), 2, 2, 0.1), 'data has 3 cells'),
    ((bytes(5), 2, 2, 0.1), 'data has 5 cells, height x width is 2 x 2 = 4'), ((bytes(4), -2, -2, 0.1), 'height is -2'),
    ((bytes(4), 2, 2, 0.0), 'resolution is 0.0'), ((bytes(4), 2, 2, float('nan')), 'resolution is nan'),
    ((bytes(4), 2, 2, -0.1), 'resolution is -0.1'), ((bytes(4), 2, 2, math.inf), 'resolution is inf')])
def test_what_is_wrong_is_named(arguments, words) -> None:
    data, *others = arguments
    with pytest.raises(ValueError, match=words):
        as_cells(np.frombuffer(data, np.int8), *others)


def test_what_never_came_is_unknown() -> None:
    cut = Interleave(2, 2, 1)
    filled = unknown(np.zeros((4, 1, 1), np.uint8), np.array([True, False, True, False]), cut)
    assert filled.view(np.int8).ravel().tolist() == [0, -1, 0, -1]


