# SPDX-License-Identifier: BSD-3-Clause
"""Occupancy grids: checked, and reduced without losing an obstacle (D6.3, section 5)."""
from typing import Sequence, Tuple, Union

import numpy as np

from ...arrays import Array, BoolArray
from . import interleave
from .interleave import MAX_DEPTH, MAX_SIDE, Interleave

UNKNOWN = -1
LARGEST_BLOCK = 1 << MAX_DEPTH
"""Side of the largest block [cell]."""


def as_cells(data: Union[Sequence[int], Array], height: int, width: int, resolution: float) -> Array:
    """The fields of a nav_msgs/OccupancyGrid as (height, width) int8; -1: unknown.

    :raises ValueError: names the wrong field and its value
    """
    for name, side in (('height', height), ('width', width)):
        if not 1 <= side <= MAX_SIDE:
            raise ValueError('%s is %d, must be from 1 to %d' % (name, side, MAX_SIDE))
    if not (np.isfinite(resolution) and resolution > 0):
        raise ValueError('resolution is %r m, must be above 0' % resolution)
    if len(data) != height * width:
        raise ValueError('data has %d cells, height x width is %d x %d = %d' % (
            len(data), height, width, height * width))
    return np.asarray(data, np.int8).reshape(height, width)


def reduce_by(cells: Array, factor: int) -> Array:
    """Max-pooling: each block of factor by factor cells becomes its maximum, so it is unknown only if all of it is.

    :param cells: (height, width) int8; -1: unknown
    :return: (ceil(height / factor), ceil(width / factor)) int8; blocks at the far borders may be incomplete
    """
    # rows first: they are contiguous, and little is left for the columns
    whole = len(cells) // factor * factor
    rows = cells[:whole].reshape(-1, factor, cells.shape[1]).max(axis=1) if whole else cells[:0]
    if whole < len(cells):
        rows = np.concatenate([rows, cells[whole:].max(axis=0, keepdims=True)])
    return np.maximum.reduceat(rows, np.arange(0, cells.shape[1], factor), axis=1)


def fit(height: int, width: int, room: int, max_cells: int, max_segments: int) -> Tuple[int, Interleave, int]:
    """The smallest factor by which a map must be reduced, and the layout of the reduced map.

    :param room: size of the cells in a datagram, at most [byte]
    :param max_cells: cells in a segment, at most
    :return: (factor, layout, subimages in a segment)
    """
    room = min(room, max_cells)
    factor = max(1, int(np.sqrt(height * width / (max_segments * room))))
    while True:
        rows, columns = -(-height // factor), -(-width // factor)
        # the deepest layout has the smallest subimages: one of them must fit
        if -(-rows // LARGEST_BLOCK) * -(-columns // LARGEST_BLOCK) <= room:
            cut, per_segment = interleave.fit(rows, columns, 1, room)
            if -(-len(cut) // per_segment) <= max_segments:
                return factor, cut, per_segment
        factor += 1


def unknown(subimages: Array, have: BoolArray, cut: Interleave) -> Array:
    """A fill method (see concealment.fill) that sets missing cells to unknown."""
    filled = subimages.copy()
    filled[~have] = np.array(UNKNOWN, np.int8).view(filled.dtype)
    return filled
