# SPDX-License-Identifier: BSD-3-Clause
"""Subimages with a ring of blocks around the picture, and moved by whole blocks.

So a missing pixel's neighbours in the blocks around its own are reached, also where these lie outside the picture.
"""
from typing import NamedTuple

import numpy as np


def moved(ringed, reach):
    """Subimages with a ring, each as it looks where every pixel is replaced by that of another block.

    :param ringed: (n, rows + 2 * reach, columns + 2 * reach, ...) array
    :param reach: how many blocks away these may be
    :return: (n, 2 * reach + 1, 2 * reach + 1, rows, columns, ...) read-only view: [i, reach + down, reach + right] has
             at each block the pixel of the block so many further down and right
    """
    side = 2 * reach + 1
    height, width, *more = ringed.shape[1:]
    plane, row, column, *rest = ringed.strides
    return np.lib.stride_tricks.as_strided(
        ringed, (len(ringed), side, side, height - 2 * reach, width - 2 * reach, *more),
        (plane, row, column, row, column, *rest), writeable=False)


def repeated(subimages, reach):
    """The ring repeats each subimage's pixels at the border: the pixel outside is one inside, up to a block away."""
    return np.pad(subimages, ((0, 0), (reach, reach), (reach, reach)) + ((0, 0),) * (subimages.ndim - 3), mode='edge')


def continued(subimages, reach, border):
    """The ring continues the picture: the pixel outside is one of the received ones nearest to where the picture ends.

    :param subimages: (n, rows, columns, ...) array, those received
    :param border: Border of these
    :return: (n, rows + 2 * reach, columns + 2 * reach, ...) array
    """
    n, rows, columns, *more = subimages.shape
    ringed = np.empty((n, rows + 2 * reach, columns + 2 * reach, *more), subimages.dtype)
    inside, outside = np.s_[reach:-reach], (np.s_[:reach], np.s_[-reach:])
    ringed[:, inside, inside] = subimages
    for k, end in enumerate((0, -1)):
        ringed[:, outside[k], inside] = subimages[border.across[k], end][:, np.newaxis]
        ringed[:, inside, outside[k]] = subimages[border.along[k], :, end][:, :, np.newaxis]
        for j, corner in enumerate((0, -1)):
            ringed[:, outside[k], outside[j]] = subimages[border.corners[k, j], end, corner]
    return ringed


class Border(NamedTuple):
    """Which received subimages are nearest to a block's sides. Their numbers count those received."""
    across: np.ndarray
    """(2, n) int: to where each subimage's column meets the top and the bottom."""
    along: np.ndarray
    """(2, n) int: to where its row meets the left and the right."""
    corners: np.ndarray
    """(2, 2) int: to the corners, top and bottom, left and right."""


def border_of(place, p):
    """The Border of blocks in which these places were received.

    :param place: (n, 2) int, where in a block of p by p each received subimage has its pixel, row and column
    """
    block = np.full((p, p), -1)
    block[place[:, 0], place[:, 1]] = np.arange(len(place))
    top, bottom, left, right = (_nearest_to_top(turned) for turned in (block, block[::-1], block.T, block.T[::-1]))
    return Border(np.stack([top, bottom])[:, place[:, 1]], np.stack([left, right])[:, place[:, 0]],
                  np.array([[side[0], side[-1]] for side in (top, bottom)]))


def _nearest_to_top(block):
    """For each column, (p,) int: what is nearest to its upper end, of a (p, p) block's numbers that are not -1."""
    p = len(block)
    first = np.where((block >= 0).any(axis=0), (block >= 0).argmax(axis=0), 2 * p)      # each column's first row
    columns = np.arange(p)
    nearest = (first ** 2 + (columns - columns[:, np.newaxis]) ** 2).argmin(axis=1)
    return block[first[nearest], nearest]
