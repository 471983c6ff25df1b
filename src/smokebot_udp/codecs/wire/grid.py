# SPDX-License-Identifier: BSD-3-Clause
"""Occupancy grids: reduced without losing an obstacle, and pictures of them that grow (D6.3, section 5)."""
import numpy as np

from . import interleave
from .interleave import MAX_DEPTH, MAX_SIDE

UNKNOWN = -1
DEEPEST = 1 << MAX_DEPTH
"""The side of the largest block."""


def as_cells(data, height, width, resolution):
    """The fields of a nav_msgs/OccupancyGrid as (height, width) int8.

    :raises ValueError: naming the field that is wrong and its value
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


def reduce_by(cells, factor):
    """Each block of factor by factor cells becomes its highest; unknown only where all of it is.

    :param cells: (height, width) int8; -1: unknown
    :return: (ceil(height / factor), ceil(width / factor)) int8; blocks at the far borders may be cut off
    """
    # by rows first: whole rows at once, and what is left for the columns is little
    return np.maximum.reduceat(_highest_rows(cells, factor), np.arange(0, cells.shape[1], factor), axis=1)


def _highest_rows(cells, factor):
    whole = len(cells) // factor * factor
    rows = cells[:whole].reshape(-1, factor, cells.shape[1]).max(axis=1) if whole else cells[:0]
    return rows if whole == len(cells) else np.concatenate([rows, cells[whole:].max(axis=0, keepdims=True)])


def fit(height, width, room, max_cells, max_segments):
    """The least factor by which a map must be reduced, and the cut of what is left.

    :param room: bytes of cells that a datagram has room for
    :param max_cells: of a segment
    :return: (factor, Interleave, subimages a segment)
    """
    room = min(room, max_cells)
    factor = max(1, int(np.sqrt(height * width / (max_segments * room))))
    while True:
        rows, columns = -(-height // factor), -(-width // factor)
        # the deepest cut has the smallest subimages: one of them must fit
        if -(-rows // DEEPEST) * -(-columns // DEEPEST) <= room:
            cut, per_segment = interleave.fit(rows, columns, 1, room)
            if -(-len(cut) // per_segment) <= max_segments:
                return factor, cut, per_segment
        factor += 1


def unknown(subimages, have, cut):
    """A fill method (see codecs.fill): what never came is unknown."""
    filled = subimages.copy()
    filled[~have] = np.array(UNKNOWN, np.int8).view(filled.dtype)
    return filled
