# SPDX-License-Identifier: BSD-3-Clause
"""Finds the received pixels nearest to each missing one, in a pattern that repeats for ever, block by block.

Where many were received, each missing pixel looks at the places around it, the nearest first, all of them side by
side; where that would be far to look, a tree is asked.
"""
import functools

import numpy as np
from scipy import spatial

SPARSE = 1 / 8
"""Where a smaller share was received, the tree is quicker."""

AMPLE = 2
"""Around each missing pixel so many times the places are looked at that hold enough received ones in the mean."""

DISCS_KEPT = 64


def neighbours(received, missing, p, count, reach):
    """The places nearest to each missing one, by Euclidean distance; of those equally near any.

    :param received: (n, 2) int, n > 0: places of a block of p by p, row and column, no two the same
    :param missing: (m, 2) int, other places of it
    :param count: how many are looked for
    :param reach: only so many blocks away is looked; so far there must be enough of a single place
    :return: (m, count, 2) int rows and columns, the nearest first; outside 0..p - 1 they are of other blocks
    """
    share = len(received) / p ** 2
    if share < SPARSE:
        return _by_tree(received, missing, p, count, reach)
    disc = _disc(int(AMPLE * count / share))
    margin = int(disc.max())
    blocks = _blocks(received, p, margin)
    # places as indexes of the flat array, where the same step leads everywhere the same way
    start = np.ravel_multi_index((missing + margin).T, blocks.shape).astype(np.int32)
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


@functools.lru_cache(maxsize=DISCS_KEPT)
def _disc(size):
    """So many places around one, the nearest first, (size, 2) int; of those equally near, opposite ones in turn."""
    radius = int(np.sqrt(size / np.pi)) + 2
    places = np.mgrid[-radius:radius + 1, -radius:radius + 1].reshape(2, -1).T
    angle = np.arctan2(places[:, 0], places[:, 1])
    order = np.lexsort((angle, np.round(angle % np.pi, 6), (places ** 2).sum(axis=1)))
    return places[order[1:size + 1]]


def _by_tree(received, missing, p, count, reach):
    # so far that a disc at the block's corner holds twice the neighbours
    radius = np.sqrt(2 * count / (np.pi * len(received))) * p
    margin = min(int(np.ceil(radius)) + 1, reach * p)
    points = np.argwhere(_blocks(received, p, margin)) - margin
    _, indexes = spatial.cKDTree(points, balanced_tree=False, compact_nodes=False).query(missing, count)
    return points[indexes.reshape(len(missing), count)]


def _blocks(received, p, margin):
    """Where it was received in a block and so far around it: (p + 2 * margin, p + 2 * margin) bool."""
    block = np.zeros((p, p), bool)
    block[received[:, 0], received[:, 1]] = True
    around = np.arange(-margin, p + margin) % p
    return block[around][:, around]
