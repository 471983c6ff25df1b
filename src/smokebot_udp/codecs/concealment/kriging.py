# SPDX-License-Identifier: BSD-3-Clause
"""Fills missing pixels by ordinary kriging: the best linear estimate from the received ones (G. Matheron, 1963).

How much two pixels differ, squared and in the mean, is thought to grow with their distance h like sqrt(h^2 + b^2) - b
(a multiquadric: R. L. Hardy, 1971). Far apart that is in proportion to the distance, as scenes of objects with edges
do, at any scale; within b, SMOOTH, less, for the camera's own blur. Of all weights w_i that sum to 1, so that
brightness does not matter, kriging takes those for the received neighbours z_i with which sum w_i z_i is least off.

b is fixed, so the weights depend only on where the received pixels lie, not on the picture: all its blocks have
received the same, and a missing subimage is estimated as a whole, by one set of weights, which the next picture may
need again. The best b for each picture would gain little (doc/fill.md).
"""
import functools
import math
from typing import NamedTuple

import numpy as np
from scipy import sparse

from ..wire.interleave import table
from .neighbours import neighbours
from .ring import Border, border_of, continued, moved
from .steering import DIRECTIONS, along, blended, edges

SMOOTH = 1.0
"""Within so much pictures are smooth [pixel]."""

NEIGHBOURS = 12
"""So many received pixels estimate a missing one; with 20 it is 0.2 dB better, and takes half as long again."""

CLAMPING = 5
"""An estimate is clamped to the range of so many nearest neighbours; with 4 to 12 it is as good."""

REACH = 2
"""Neighbours are looked for so many blocks away: at a single received subimage this finds NEIGHBOURS."""

PLANS_KEPT = 8
"""Weights are kept for so many sets of received subimages: without loss, they are the same for each picture."""


def kriging(subimages, have, cut, smooth=SMOOTH):
    """Each missing pixel is the best linear estimate from the received ones nearest to it.

    Beyond the picture's border the received pixels nearest to it go on. An estimate may exceed its neighbours, as where
    an edge or a peak lies between them. Where a neighbour is no finite number, as in a depth picture, the nearest
    received pixel is taken.

    :param subimages: (n, rows, columns, ...) array of numbers, of any byte order, in cut.order
    :param have: (n,) bool, which of them were received; the others' values do not matter
    :param cut: Interleave
    :param smooth: b of the model [pixel]
    :return: an array like subimages: all of them; zero where nothing was received
    """
    return _fill(subimages, have, cut, smooth, clamp=False)


def kriging_clamped(subimages, have, cut, smooth=SMOOTH):
    """The same, but no estimate exceeds the range of the received pixels nearest to it: it invents no peak."""
    return _fill(subimages, have, cut, smooth, clamp=True)


def kriging_steered(subimages, have, cut, smooth=SMOOTH):
    """As kriging_clamped, but pixels along an edge are thought to be more alike than those across it.

    Where edges run is seen in what kriging makes of the picture. It takes about ten times as long.
    """
    return _fill(subimages, have, cut, smooth, clamp=True, steer=True)


def _fill(subimages, have, cut, smooth, clamp, steer=False):
    if have.all():
        return subimages
    if not have.any():
        return np.zeros_like(subimages)
    plan = _plan(cut, have.tobytes(), float(smooth))
    numbers = _sources(subimages, have, plan)
    exact = numbers.astype(np.float32)
    estimates = plan.weights @ exact
    if steer:
        with np.errstate(invalid='ignore', over='ignore'):      # of floats that are no finite numbers, or very large
            estimates = _steered(estimates, exact, subimages, have, cut, smooth)
    estimates = _rounded(estimates, numbers.dtype)
    if clamp:
        np.clip(estimates, *_range(numbers, plan.nearest), out=estimates)
    if estimates.dtype.kind == 'f':
        strange = ~np.isfinite(estimates)
        estimates[strange] = numbers[plan.nearest[0]][strange]
    filled = np.empty_like(subimages)
    filled[have] = subimages[have]
    filled[~have] = estimates.reshape((-1,) + subimages.shape[1:])
    return filled


def _steered(estimates, exact, subimages, have, cut, smooth):
    """:param estimates, exact: the isotropic ones of missing subimages; the sources; of all channels side by side"""
    shape = (-1,) + cut.shape + (math.prod(subimages.shape[3:]),)
    picture = np.empty((len(cut),) + cut.shape, np.float32)
    picture[have] = subimages[have].reshape(shape).mean(axis=-1, dtype=np.float32)
    picture[~have] = estimates.reshape(shape).mean(axis=-1)
    picture[~np.isfinite(picture)] = 0
    found = cut.split(edges(cut.merge(picture), spacing=1 / math.sqrt(have.mean())))[~have]
    plain = estimates.reshape(shape)
    steered = (_steered_weights(cut, have.tobytes(), float(smooth)) @ exact).reshape((DIRECTIONS,) + plain.shape)
    return blended(plain, steered, found[:, :, :, np.newaxis]).reshape(estimates.shape)


class _Plan(NamedTuple):
    """How to fill what is missing of a cut.

    Sources are received subimages, each moved by whole blocks so that its pixels fall on the blocks they are
    neighbours of.
    """
    rank: np.ndarray
    """(s,) int: which of the received subimages each source is."""
    block: np.ndarray
    """(s, 2) int, -REACH..REACH: from which block, down and right, its pixels come."""
    weights: sparse.csr_matrix
    """(missing subimages, s) float32."""
    nearest: np.ndarray
    """(at most CLAMPING, missing subimages) int: the sources nearest to each, the nearest first."""
    border: Border
    offsets: np.ndarray
    """(missing subimages, k, 2) int: where the sources of a row of weights lie, in that order."""


@functools.lru_cache(maxsize=PLANS_KEPT)
def _plan(cut, have, smooth):
    """:param have: the bytes of (n,) bool"""
    p, have = cut.p, np.frombuffer(have, bool)
    position = cut.positions[table(cut.depth)]          # (p, p), -1: no subimage
    place = np.empty((len(cut), 2), int)
    place[position[position >= 0]] = np.argwhere(position >= 0)
    nearest = neighbours(place[have], place[~have], p, NEIGHBOURS, REACH)
    block, within = nearest >> cut.depth, nearest & p - 1
    subimage = position[within[..., 0], within[..., 1]]
    side = 2 * REACH + 1
    key = (subimage * side + block[..., 0] + REACH) * side + block[..., 1] + REACH
    used = np.zeros(len(cut) * side * side, bool)
    used[key] = True
    source = (np.cumsum(used, dtype=np.int32) - 1)[key]         # (missing, k)
    subimage, block = np.divmod(np.flatnonzero(used), side * side)
    offsets = nearest - place[~have][:, np.newaxis]
    weights = weigh(offsets, smooth)
    rows = np.arange(len(source) + 1, dtype=np.int32) * source.shape[1]
    return _Plan(
        (np.cumsum(have) - 1)[subimage], np.stack(np.divmod(block, side), axis=1) - REACH,
        sparse.csr_matrix((np.ravel(weights), source.ravel(), rows), (len(source), len(subimage))),
        np.ascontiguousarray(source[:, :CLAMPING].T), border_of(place[have], p), offsets)


@functools.lru_cache(maxsize=PLANS_KEPT)
def _steered_weights(cut, have, smooth):
    """(DIRECTIONS * missing subimages, s) float32 sparse matrix; :param have: as of _plan."""
    plan = _plan(cut, have, smooth)
    (m, s), k = plan.weights.shape, plan.offsets.shape[1]
    weights = weigh(along(plan.offsets).reshape(DIRECTIONS * m, k, 2), smooth)
    rows = np.arange(DIRECTIONS * m + 1, dtype=np.int32) * k
    return sparse.csr_matrix((weights.ravel(), np.tile(plan.weights.indices, DIRECTIONS), rows), (DIRECTIONS * m, s))


def weigh(offsets, smooth=SMOOTH):
    """The weights of ordinary kriging.

    What is estimated is how much the missing pixel differs from its first neighbour, by how much the others do: then
    the weights sum to 1 by themselves.

    :param offsets: (m, k, 2) numbers, where each one's k neighbours lie, seen from it; no two at the same place
    :param smooth: b of the model [pixel]
    :return: (m, k) float32; each row sums to 1
    """
    down, right = np.ascontiguousarray(offsets.T, np.float32)     # (k, m) each
    missing = _variogram(down, right, smooth)
    first = _variogram(down[1:] - down[0], right[1:] - right[0], smooth)
    k, m = down.shape
    # covariances, twice, of differences from the first: of each two neighbours, and of each and the missing pixel
    equations = np.empty((k - 1, k, m), np.float32)
    for i in range(k - 1):
        apart = _variogram(down[i + 1] - down[i + 1:], right[i + 1] - right[i + 1:], smooth)
        equations[i, i:-1] = first[i] + first[i:] - apart
        equations[i, -1] = missing[0] + first[i] - missing[i + 1]
    others = _solved(equations)
    return np.concatenate([1 - others.sum(axis=0, keepdims=True), others]).T


def _solved(equations):
    """Gauss' elimination of m systems of equations side by side: LAPACK, one after the other, takes five times as long.

    :param equations: (n, n + 1, m): symmetric and positive definite, of which only the upper triangle counts, and the
                      right side; changed
    :return: (n, m)
    """
    n = len(equations)
    for i in range(n):
        factors = equations[i, i + 1:n] / equations[i, i]
        for j in range(i + 1, n):
            equations[j, j:] -= factors[j - i - 1] * equations[i, j:]
    solution = equations[:, n]
    for i in reversed(range(n)):
        solution[i] -= (equations[i, i + 1:n] * solution[i + 1:]).sum(axis=0)
        solution[i] /= equations[i, i]
    return solution


def _variogram(down, right, smooth):
    """The mean squared difference of pixels so far apart, up to a factor."""
    return np.sqrt(down * down + right * right + np.float32(smooth ** 2)) - np.float32(smooth)


def _sources(subimages, have, plan):
    """The plan's sources: (s, pixels' numbers) array in the machine's byte order."""
    native = subimages[have].astype(subimages.dtype.newbyteorder('='), copy=False)
    down, right = (plan.block + REACH).T
    return moved(continued(native, REACH, plan.border), REACH)[plan.rank, down, right].reshape(len(plan.rank), -1)


def _range(numbers, nearest):
    """The least and the greatest of some sources, for each missing subimage."""
    low, high = numbers[nearest[0]], numbers[nearest[0]]
    for source in nearest[1:]:
        others = numbers[source]
        np.minimum(low, others, out=low)
        np.maximum(high, others, out=high)
    return low, high


def _rounded(estimates, dtype):
    """Estimates, float32, as numbers of this type, which they are clipped to."""
    if dtype.kind == 'f':
        return estimates.astype(dtype, copy=False)
    limits = np.iinfo(dtype)
    np.rint(np.clip(estimates, limits.min, limits.max, out=estimates), out=estimates)
    return estimates.astype(dtype)
