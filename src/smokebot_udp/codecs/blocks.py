# SPDX-License-Identifier: BSD-3-Clause
"""Subimages moved by whole blocks: how a missing pixel's neighbours in the blocks around it are reached."""
import numpy as np


def moved(subimages, reach):
    """Subimages as they look when each pixel is replaced by that of another block.

    Beyond the border, the pixels at the border repeat.

    :param subimages: (n, rows, columns, ...) array
    :param reach: how many blocks away these may be
    :return: (n, 2 * reach + 1, 2 * reach + 1, rows, columns, ...) read-only view of a copy: [i, reach + down,
             reach + right] has at each block the pixel of the block so many further down and right
    """
    rows, columns, *more = subimages.shape[1:]
    ringed = np.pad(subimages, ((0, 0), (reach, reach), (reach, reach)) + ((0, 0),) * len(more), mode='edge')
    plane, row, column, *rest = ringed.strides
    side = 2 * reach + 1
    return np.lib.stride_tricks.as_strided(
        ringed, (len(subimages), side, side, rows, columns, *more), (plane, row, column, row, column, *rest),
        writeable=False)
