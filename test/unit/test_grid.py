# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from smokebot_udp.codecs.grid import as_cells, fit, reduce_by, unknown
from smokebot_udp.codecs.interleave import Interleave


def test_the_highest_of_each_block_and_unknown_only_where_all_is():
    cells = np.array([[-1, -1, 0, 5, 100], [-1, -1, -1, 3, -1], [0, -1, 1, 2, -1]], np.int8)
    assert reduce_by(cells, 2).tolist() == [[-1, 5, 100], [0, 2, -1]]
    assert reduce_by(cells, 1).tolist() == cells.tolist()
    assert reduce_by(cells, 9).tolist() == [[100]]


@given(arrays.arrays(np.int8, st.tuples(st.integers(1, 20), st.integers(1, 20)), elements=st.integers(-1, 100)),
       st.integers(1, 7))
def test_against_a_slow_loop(cells, factor):
    height, width = (-(-side // factor) for side in cells.shape)
    slow = [[cells[r * factor:(r + 1) * factor, c * factor:(c + 1) * factor].max() for c in range(width)]
            for r in range(height)]
    assert reduce_by(cells, factor).tolist() == slow


@given(st.integers(1, 4096), st.integers(1, 4096))
def test_the_least_factor_within_both_limits(height, width):
    factor, cut, per_segment = fit(height, width, 1350, 1300, 256)
    rows, columns = cut.shape
    assert rows * columns * per_segment <= 1300 and -(-len(cut) // per_segment) <= 256
    assert (cut.height, cut.width) == (-(-height // factor), -(-width // factor))
    assert factor == 1 or (height * width) / (factor - 1) ** 2 > 0.5 * 256 * 1300     # about as much as would fit


def test_the_deliverables_numbers():
    assert fit(500, 500, 1350, 1300, 256)[0] == 1
    assert fit(4096, 4096, 1350, 1300, 256)[0] == 8


@pytest.mark.parametrize('arguments, words', [
    ((b'', 0, 5, 0.1), 'height is 0'), ((b'', 5, 5000, 0.1), 'width is 5000'),
    ((bytes(3), 2, 2, 0.1), 'data has 3 cells'),
    ((bytes(4), 2, 2, 0.0), 'resolution is 0.0'), ((bytes(4), 2, 2, float('nan')), 'resolution is nan')])
def test_what_is_wrong_is_named(arguments, words):
    data, *others = arguments
    with pytest.raises(ValueError, match=words):
        as_cells(np.frombuffer(data, np.int8), *others)


def test_what_never_came_is_unknown():
    cut = Interleave(2, 2, 1)
    filled = unknown(np.zeros((4, 1, 1), np.uint8), np.array([True, False, True, False]), cut)
    assert filled.view(np.int8).ravel().tolist() == [0, -1, 0, -1]
