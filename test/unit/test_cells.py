# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from smokebot_udp.codecs.concealment.cells import squared_differences


@pytest.mark.parametrize('kind', ['u1', '<u2', '>u2', '<f4'])
@pytest.mark.parametrize('channels', [1, 3])
@pytest.mark.parametrize('height,width', [(16, 24), (17, 30), (1, 1), (9, 0)])
def test_cells_are_compared_pixel_by_pixel(height, width, channels, kind) -> None:
    random = np.random.RandomState(0)
    size = height, 2 * width, channels
    first, second = (random.randint(0, 256, size).astype(kind)[:, ::2] for _ in range(2))   # not contiguous
    both, side = random.random_sample((height, width)) < 0.5, 8
    squares, pairs = squared_differences(first, second, both, side)
    assert squares.shape == pairs.shape == (-(-height // side), -(-width // side))
    distances = ((first.astype(float) - second.astype(float)) ** 2).sum(axis=2) * both
    for row, column in np.ndindex(*squares.shape):
        cell = np.s_[row * side:(row + 1) * side, column * side:(column + 1) * side]
        assert squares[row, column] == distances[cell].sum() and pairs[row, column] == both[cell].sum()
