# SPDX-License-Identifier: BSD-3-Clause
"""Orders in which the subimages of an image may be sent: permutations of the pixels of a block."""
from typing import Dict, List

import numpy as np
from scipy import spatial

from smokebot_udp.arrays import Array, FloatArray, IntArray
from smokebot_udp.codecs.concealment.kriging import NEIGHBOURS, SMOOTH, weigh
from smokebot_udp.codecs.wire.interleave import table

AROUND = np.array([(down, right) for down in range(-2, 3) for right in range(-2, 3)])
"""Offsets of the blocks in which neighbours are searched: (25, 2)."""

TIE_TOLERANCE = 1e-4
"""Variances that differ by less, relative to the greatest, are equal."""

GOLDEN = (np.sqrt(5) - 1) / 2


def orders(depth: int, seed: int) -> Dict[str, IntArray]:
    """Orders by name: (n,) indexes of the subimages, as Table 3 numbers them, in sending order."""
    p = 1 << depth
    index = table(depth)
    bits = [sum((i >> bit & 1) << depth - 1 - bit for bit in range(depth)) for i in range(p)]
    n = p * p
    stride = next(s for s in range(int(GOLDEN * n), n) if np.gcd(s, n) == 1)
    return {
        'Table 3': np.arange(n),
        'Z coarse first': np.array([_digits(i, depth) for i in range(n)]),     # Table 3 made of 0 1 / 2 3
        'bits reversed': index[np.ix_(bits, bits)].ravel(),     # rows coarse first, and in each the columns
        'farthest point': index[tuple(farthest_point(p).T)],
        'least certain': index[tuple(least_certain(p).T)],
        'golden stride': np.arange(n) * stride % n,             # each far from the one before in Table 3, too
        'random': np.random.RandomState(seed).permutation(n),
        'by rows': index.ravel(),
    }


def _digits(i: int, depth: int) -> int:
    """The subimage of Table 3 at the place that has number i with 0 1 / 2 3 as Table 2(a): base 4, digit by digit."""
    return sum((0, 2, 3, 1)[i >> 2 * digit & 3] << 2 * digit for digit in range(depth))


def farthest_point(p: int) -> IntArray:
    """Each place is the farthest from all before it; of several, the one with the most room on average.

    :return: (p * p, 2) rows and columns
    """
    places: IntArray = np.argwhere(np.ones((p, p), bool))
    distance = _distances(p)
    chosen: List[int] = []
    nearest, sum_inverse = np.full(p * p, np.inf), np.zeros(p * p)
    for _ in range(p * p):
        best = int(np.lexsort((sum_inverse, -nearest))[0])
        chosen.append(best)
        nearest = np.minimum(nearest, distance[best])
        nearest[chosen] = -1
        with np.errstate(divide='ignore'):
            sum_inverse = sum_inverse + 1 / distance[best] ** 2
    return places[chosen]


def _distances(p: int) -> FloatArray:
    """(p * p, p * p) distances between places of a block that repeats endlessly."""
    row, column = np.divmod(np.arange(p * p), p)
    apart = [np.abs(x - x[:, np.newaxis]) for x in (row, column)]
    distances: FloatArray = np.hypot(*(np.minimum(x, p - x) for x in apart))
    return distances


def least_certain(p: int) -> IntArray:
    """Each place has the highest kriging variance; of several, the one that reduces the others' variance most.

    :return: (p * p, 2) rows and columns
    """
    places: IntArray = np.argwhere(np.ones((p, p), bool))
    have = np.zeros(p * p, bool)
    have[0] = True
    chosen = [0]
    while not have.all():
        missing = np.flatnonzero(~have)
        uncertain = variance(places[have], places[missing], p)
        ties = missing[uncertain >= (1 - TIE_TOLERANCE) * uncertain.max()]
        left = []
        for tie in ties if len(ties) > 1 and len(missing) > 1 else ():
            others = missing[missing != tie]
            left.append(variance(np.concatenate([places[have], places[[tie]]]), places[others], p).mean())
        chosen.append(int(ties[np.argmin(left)] if left else ties[0]))
        have[chosen[-1]] = True
    return places[chosen]


def variance(received: IntArray, missing: IntArray, p: int) -> FloatArray:
    """The kriging variance of estimates.

    :param received, missing: (n, 2), (m, 2) places of a block that repeats endlessly
    :return: (m,)
    """
    points = (received + p * AROUND[:, np.newaxis]).reshape(-1, 2)
    _, nearest = spatial.cKDTree(points).query(missing, min(NEIGHBOURS, len(points)))
    offsets = points[nearest.reshape(len(missing), -1)] - missing[:, np.newaxis]
    weights = weigh(offsets)
    between = _model(offsets[:, :, np.newaxis] - offsets[:, np.newaxis])
    result: FloatArray = 2 * (weights * _model(offsets)).sum(axis=1) - np.einsum('mi,mij,mj->m', weights, between,
                                                                                 weights)
    return result


def _model(offsets: Array) -> FloatArray:
    """The variogram that kriging assumes."""
    distances: FloatArray = np.sqrt((offsets ** 2).sum(axis=-1) + SMOOTH ** 2) - SMOOTH
    return distances
