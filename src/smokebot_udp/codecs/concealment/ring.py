# SPDX-License-Identifier: BSD-3-Clause
"""Subimages padded by a ring of blocks, and shifted by whole blocks.

This gives access to a missing pixel's neighbours in the blocks around its own, also where these are outside the image.
"""
from typing import NamedTuple

import numpy as np

from ...arrays import Array, IntArray


def moved(ringed: Array, reach: int) -> Array:
    """Padded subimages, each shifted by every number of blocks up to `reach`.

    :param ringed: (n, rows + 2 * reach, columns + 2 * reach, ...) array
    :param reach: maximum shift [block]
    :return: (n, 2 * reach + 1, 2 * reach + 1, rows, columns, ...) read-only view: at each block,
        [i, reach + down, reach + right] has the pixel of the block that is `down` further down and `right` to the right
    """
    side = 2 * reach + 1
    height, width, *more = ringed.shape[1:]
    plane, row, column, *rest = ringed.strides
    return np.lib.stride_tricks.as_strided(
        ringed, (len(ringed), side, side, height - 2 * reach, width - 2 * reach, *more),
        (plane, row, column, row, column, *rest), writeable=False)


def repeated(subimages: Array, reach: int) -> Array:
    """Pad by repeating each subimage's pixels at the border.

    :param subimages: (n, rows, columns, ...) array
    :return: (n, rows + 2 * reach, columns + 2 * reach, ...) array
    """
    return np.pad(subimages, ((0, 0), (reach, reach), (reach, reach)) + ((0, 0),) * (subimages.ndim - 3), mode='edge')


class Border(NamedTuple):
    """The received subimages nearest to the sides of a block. They are numbered among those received."""
    across: IntArray
    """(2, n) int: nearest to the top and the bottom of each subimage's column."""
    along: IntArray
    """(2, n) int: nearest to the left and the right end of its row."""
    corners: IntArray
    """(2, 2) int: nearest to the corners, top and bottom, left and right."""


def border_of(place: IntArray, p: int) -> Border:
    """The Border of blocks in which these places were received.

    :param place: (n, 2) int, the row and column of each received subimage in a block of p by p
    """
    block = np.full((p, p), -1)
    block[place[:, 0], place[:, 1]] = np.arange(len(place))
    top, bottom, left, right = (_nearest_to_top(turned) for turned in (block, block[::-1], block.T, block.T[::-1]))
    return Border(np.stack([top, bottom])[:, place[:, 1]], np.stack([left, right])[:, place[:, 0]],
                  np.array([[side[0], side[-1]] for side in (top, bottom)]))


def continued(subimages: Array, reach: int, border: Border, chosen: IntArray) -> Array:
    """Pad by continuing the image: each pixel outside is one of the received ones nearest to the image's border there.

    :param subimages: (n, rows, columns, ...) array, those received
    :param border: of these
    :param chosen: (m,) int, the numbers of those to pad
    :return: (m, rows + 2 * reach, columns + 2 * reach, ...) array
    """
    _, rows, columns, *more = subimages.shape
    ringed = np.empty((len(chosen), rows + 2 * reach, columns + 2 * reach, *more), subimages.dtype)
    inside, outside = np.s_[reach:-reach], (np.s_[:reach], np.s_[-reach:])
    ringed[:, inside, inside] = subimages[chosen]
    for k, end in enumerate((0, -1)):
        ringed[:, outside[k], inside] = subimages[border.across[k, chosen], end][:, np.newaxis]
        ringed[:, inside, outside[k]] = subimages[border.along[k, chosen], :, end][:, :, np.newaxis]
        for j, corner in enumerate((0, -1)):
            ringed[:, outside[k], outside[j]] = subimages[border.corners[k, j], end, corner]
    return ringed


def _nearest_to_top(block: IntArray) -> IntArray:
    """The number nearest to the upper end of each column.

    :param block: (p, p) int, -1: none
    :return: (p,) int
    """
    p = len(block)
    first = np.where((block >= 0).any(axis=0), (block >= 0).argmax(axis=0), 2 * p)      # each column's first row
    columns = np.arange(p)
    nearest = (first ** 2 + (columns - columns[:, np.newaxis]) ** 2).argmin(axis=1)
    numbers: IntArray = block[first[nearest], nearest]
    return numbers
