# SPDX-License-Identifier: BSD-3-Clause
"""Fills missing subimages from the received ones (D6.3, section 4.2).

All blocks of an image have received the same places, so a missing subimage is filled as a whole: which received one is
near is computed once, on one block, and the pixels are then moved by the subimage.
"""
from typing import Dict, Tuple

import numpy as np
from scipy import ndimage

from ...arrays import Array, BoolArray, IntArray
from ..wire.interleave import Interleave, table
from ..wire.partial_image import FillMethod
from .kriging import kriging_clamped
from .ring import moved, repeated


def nearest(subimages: Array, have: BoolArray, cut: Interleave) -> Array:
    """Each missing pixel becomes its nearest received one: the deliverable's method (Figure 2).

    Nearest by Euclidean distance between pixels; among equally near ones scipy's choice, always the same. If the
    nearest would lie outside the image, it is replaced by the nearest pixel of the same subimage inside.

    :param subimages: (n, rows, columns, ...) array of any dtype, in cut.order
    :param have: (n,) bool, the subimages received; the values of the others do not matter
    :return: array like subimages: all of them; zero if nothing was received
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


def _nearest_received(have: BoolArray, cut: Interleave) -> Tuple[IntArray, IntArray]:
    """The nearest received one of each subimage: (n,) position, and (n, 2) in which block, -1..1 down and right."""
    p = cut.p
    position = cut.positions[table(cut.depth)]                       # (p, p), -1: no subimage
    missing = np.where(position < 0, True, ~have[position])
    # the block repeats in all directions, so the nearest is at most half a block away
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


METHODS: Dict[str, FillMethod] = {'nearest': nearest, 'kriging_clamped': kriging_clamped}
"""{name: method}, see `nearest`. It only moves pixels; the other calculates with the subimages' numbers."""

BEST = 'kriging_clamped'
"""By the measurements in doc/fill.md."""
