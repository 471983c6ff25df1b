# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from smokebot_udp.codecs.concealment.ring import border_of, continued, moved, repeated


def test_repeated_and_moved_by_hand() -> None:
    subimages = np.array([[[1, 2], [3, 4]], [[5, 6], [7, 8]]])
    views = moved(repeated(subimages, 1), 1)
    assert views.shape == (2, 3, 3, 2, 2)
    assert views[0, 1, 1].tolist() == [[1, 2], [3, 4]]      # its own block's
    assert views[0, 0, 1].tolist() == [[1, 2], [1, 2]]      # of the block above
    assert views[0, 1, 2].tolist() == [[2, 2], [4, 4]]      # of the block to the right
    assert views[1, 2, 0].tolist() == [[7, 7], [7, 7]]      # below, to the left


@pytest.mark.parametrize('reach', [1, 2])
def test_moved_of_several_channels(reach) -> None:
    subimages = np.random.RandomState(0).randint(0, 99, (3, 4, 5, 3))
    views = moved(repeated(subimages, reach), reach)
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            rows = np.clip(np.arange(4) + down, 0, 3)
            columns = np.clip(np.arange(5) + right, 0, 4)
            assert (views[:, reach + down, reach + right] == subimages[:, rows][:, :, columns]).all()


def test_continued_by_hand() -> None:
    """Three pixels of each 4 x 4 block came, in 2 x 2 blocks. A dot is a missing pixel:

        .  .  .  .   .  .  .  .
        .  1  .  .   .  2  .  .
        .  . 11  .   .  . 12  .
       21  .  .  .  22  .  .  .
        .  .  .  .   .  .  .  .
        .  3  .  .   .  4  .  .
        .  . 13  .   .  . 14  .
       23  .  .  .  24  .  .  .
    """
    subimages = np.array([[[1, 2], [3, 4]], [[11, 12], [13, 14]], [[21, 22], [23, 24]]])
    first, second, third = continued(subimages, 1, border_of(np.array([[1, 1], [2, 2], [3, 0]]), 4), np.arange(3))
    alone, = continued(subimages, 1, border_of(np.array([[1, 1], [2, 2], [3, 0]]), 4), np.array([2]))
    assert (alone == third).all()
    # above and to the left of the second row is the first pixel, to the right the second
    assert first.tolist() == [[1, 1, 2, 2], [1, 1, 2, 12], [3, 3, 4, 14], [23, 23, 24, 14]]
    # nearest to where its column meets the top is the first; left of its row the third; else itself
    assert second.tolist() == [[1, 1, 2, 2], [21, 11, 12, 12], [23, 13, 14, 14], [23, 13, 14, 14]]
    assert third.tolist() == [[1, 1, 2, 2], [21, 21, 22, 12], [23, 23, 24, 14], [23, 23, 24, 14]]


@pytest.mark.parametrize('p', [1, 2, 4, 8, 16])
@pytest.mark.parametrize('share', [0.01, 0.3, 1.0])
def test_the_border_has_the_nearest(p, share) -> None:
    random = np.random.RandomState(p)
    came = random.random_sample((p, p)) < share
    came[random.randint(p), random.randint(p)] = True
    place = random.permutation(np.argwhere(came))
    border = border_of(place, p)

    def check(found: int, row: int, column: int) -> None:
        distances = np.linalg.norm(place - (row, column), axis=1)
        assert distances[found] == distances.min()
    for k, end in enumerate((0, p - 1)):
        for i, (row, column) in enumerate(place):
            check(border.across[k, i], end, column)
            check(border.along[k, i], row, end)
        for j, corner in enumerate((0, p - 1)):
            check(border.corners[k, j], end, corner)


def test_the_ring_has_pixels_from_near_the_border_only() -> None:
    """Each pixel's value is its place: what continues the image upwards is from its first rows."""
    p, rows, columns = 8, 4, 5
    at = np.moveaxis(np.indices((rows * p, columns * p)), 0, -1)
    place = np.random.RandomState(0).permutation(np.argwhere(np.ones((p, p))))[:20]
    subimages = np.array([at[row::p, column::p] for row, column in place])
    ringed = continued(subimages, 2, border_of(place, p), np.arange(20))
    height, width = rows * p, columns * p
    assert ringed.shape == (20, rows + 4, columns + 4, 2)
    assert ringed[:, :2, ..., 0].max() < 4 and ringed[:, -2:, ..., 0].min() >= height - 4
    assert ringed[..., :2, 1].max() < 4 and ringed[:, :, -2:, 1].min() >= width - 4
    columns_above = ringed[:, 0, 2:-2, 1] - subimages[:, 0, :, 1]
    assert abs(columns_above).max() < 4
