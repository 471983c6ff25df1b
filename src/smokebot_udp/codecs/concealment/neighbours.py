# SPDX-License-Identifier: BSD-3-Clause
"""Finds the received pixels nearest to each missing one, in a pattern of blocks that repeats in all directions.

If many are received, the places around all missing pixels are searched at once, the nearest first. If that would be a
long search, a k-d tree is used.
"""
import functools

import numpy as np
from scipy import spatial

from ...arrays import Array, BoolArray, IntArray

SPARSE = 1 / 8
"""The tree is faster if a smaller ratio is received."""

SEARCH_FACTOR = 2
"""The search covers this many times the places that contain enough received pixels on average."""

CACHED_DISCS = 64


def neighbours(received: IntArray, missing: IntArray, p: int, count: int, reach: int) -> IntArray:
    """The received places nearest to each missing one, by Euclidean distance; any of those equally near.

    :param received: (n, 2) int, n > 0: places in a block of p by p, row and column, all different
    :param missing: (m, 2) int, other places in it
    :param count: number of neighbours of each
    :param reach: maximum distance [block]; a single received place must have `count` copies within it
    :return: (m, count, 2) int rows and columns, the nearest first; outside 0..p - 1 they are in other blocks
    """
    ratio = len(received) / p ** 2
    if ratio < SPARSE:
        return _by_tree(received, missing, p, count, reach)
    disc = _disc(int(SEARCH_FACTOR * count / ratio))
    margin = int(disc.max())
    blocks = _blocks(received, p, margin)
    # places as indexes of the flat array, in which the same step is the same offset everywhere
    start: Array = np.ravel_multi_index(tuple((missing + margin).T), blocks.shape).astype(np.int32)
    steps = (disc[:, 0] * len(blocks) + disc[:, 1]).astype(np.int32)
    there = blocks.ravel()[start[:, np.newaxis] + steps]            # (m, places of the disc)
    found = np.count_nonzero(there, axis=1)
    first = np.cumsum(found) - found
    enough = found >= count
    chosen = np.flatnonzero(there)[first[enough, np.newaxis] + np.arange(count)] % len(disc)
    nearest = np.empty((len(missing), count, 2), int)
    nearest[enough] = missing[enough, np.newaxis] + disc[chosen]
    if not enough.all():
        nearest[~enough] = _by_tree(received, missing[~enough], p, count, reach)
    return nearest


@functools.lru_cache(maxsize=CACHED_DISCS)
def _disc(size: int) -> IntArray:
    """The places nearest to a place, (size, 2) int, the nearest first; of those equally near, opposite ones in turn."""
    radius = int(np.sqrt(size / np.pi)) + 2
    places = np.mgrid[-radius:radius + 1, -radius:radius + 1].reshape(2, -1).T
    angle = np.arctan2(places[:, 0], places[:, 1])
    order = np.lexsort((angle, np.round(angle % np.pi, 6), (places ** 2).sum(axis=1)))
    disc: IntArray = places[order[1:size + 1]]
    return disc


def _by_tree(received: IntArray, missing: IntArray, p: int, count: int, reach: int) -> IntArray:
    # so far that a disc at the block's corner contains twice the neighbours
    radius = np.sqrt(2 * count / (np.pi * len(received))) * p
    margin = min(int(np.ceil(radius)) + 1, reach * p)
    points = np.argwhere(_blocks(received, p, margin)) - margin
    _, indexes = spatial.cKDTree(points, balanced_tree=False, compact_nodes=False).query(missing, count)
    nearest: IntArray = points[indexes.reshape(len(missing), count)]
    return nearest


def _blocks(received: IntArray, p: int, margin: int) -> BoolArray:
    """The received places of a block and of a margin around it: (p + 2 * margin, p + 2 * margin) bool."""
    block = np.zeros((p, p), bool)
    block[received[:, 0], received[:, 1]] = True
    around = np.arange(-margin, p + margin) % p
    blocks: BoolArray = block[around][:, around]
    return blocks
