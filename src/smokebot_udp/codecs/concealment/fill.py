# SPDX-License-Identifier: BSD-3-Clause
"""Fills the subimages that did not come from those that did (D6.3, section 4.2).

What came of a picture is the same for all its blocks, so a missing subimage is filled as a whole: which
received one is near is worked out once on a block, and the pixels then move by the subimage.
"""
import numpy as np
from scipy import ndimage

from ..wire.interleave import table
from .kriging import kriging, kriging_clamped, kriging_steered
from .ring import moved, repeated


def nearest(subimages, have, cut):
    """Each missing pixel is its nearest received one: the deliverable's way (Figure 2).

    Nearest by Euclidean distance between pixels; of those equally near, scipy's choice, always the same. At
    the picture's border, where the nearest would lie outside, it is the nearest of the same subimage inside.

    :param subimages: (n, rows, columns, ...) array of any dtype, in cut.order
    :param have: (n,) bool, which of them were received; the others' values do not matter
    :param cut: Interleave
    :return: an array like subimages: all of them; zero where nothing was received
    """
    if have.all():
        return subimages
    if not have.any():
        return np.zeros_like(subimages)
    missing = np.flatnonzero(~have)
    source, block = _nearest_received(have, cut)
    received = np.flatnonzero(have)
    rank = np.cumsum(have) - 1
    filled = np.empty_like(subimages)
    filled[received] = subimages[received]
    filled[missing] = moved(repeated(subimages[received], 1), 1)[
        rank[source[missing]], 1 + block[missing, 0], 1 + block[missing, 1]]
    return filled


def _nearest_received(have, cut):
    """For each subimage the nearest received one: (n,) position, and (n, 2) in which block, -1..1 down and right."""
    p = cut.p
    position = cut.positions[table(cut.depth)]                       # (p, p), -1: no subimage
    missing = np.where(position < 0, True, ~have[position])
    # the block repeats for ever, so no place's nearest is further up, down or aside than half a block
    half = p // 2
    indices = ndimage.distance_transform_edt(
        np.pad(missing, half, mode='wrap'), return_distances=False, return_indices=True)
    indices = indices[:, half:half + p, half:half + p] - half
    row, column = np.nonzero(position >= 0)
    at = position[row, column]
    down, right = indices[:, row, column]
    source, block = np.empty(len(cut), int), np.empty((len(cut), 2), int)
    source[at] = position[down % p, right % p]
    block[at, 0], block[at, 1] = down // p, right // p
    return source, block


METHODS = {'nearest': nearest, 'kriging': kriging, 'kriging_clamped': kriging_clamped,
           'kriging_steered': kriging_steered}
"""{name: f(subimages, have, cut) -> subimages}, see `nearest`; all but it reckon with the subimages' numbers"""

BEST = 'kriging_clamped'
"""doc/fill.md"""
