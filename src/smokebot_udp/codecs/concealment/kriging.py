# SPDX-License-Identifier: BSD-3-Clause
"""Fills missing pixels by ordinary kriging: the best linear estimate from the received ones (G. Matheron, 1963).

The variogram, the mean squared difference of two pixels at distance h, is modelled as sqrt(h^2 + b^2) - b (a
multiquadric: R. L. Hardy, 1971). At long distances it is linear, as in scenes of objects with edges, at any scale;
within b, SMOOTH, it is flatter, for the camera's own blur. Among all weights w_i that sum to 1, so that brightness does
not matter, kriging uses those for the received neighbours z_i that minimise the expected squared error of sum w_i z_i.

b is fixed, so the weights depend only on the places of the received pixels, not on the image. All blocks of an image
have received the same places, so a missing subimage is estimated as a whole by one set of weights, which are cached for
the next images. The best b for each image would gain little (doc/fill.md).
"""
import functools
from typing import Any, NamedTuple, Tuple

import numpy as np
from scipy import sparse

from ...arrays import Array, BoolArray, DType, Float32Array, IntArray
from ..wire.interleave import Interleave, table
from .neighbours import neighbours
from .ring import Border, border_of, continued, moved

SMOOTH = 1.0
"""Parameter b of the variogram: images are smooth within this distance [pixel]."""

NEIGHBOURS = 12
"""Number of received pixels that estimate a missing one; 20 gain 0.2 dB, and take half as long again."""

CLAMPING = 5
"""An estimate is clamped to the range of this many nearest neighbours; 4 to 12 are equally good."""

REACH = 2
"""Maximum distance of neighbours [block]: enough for NEIGHBOURS with a single received subimage."""

CACHED_PLANS = 8
"""Weights are cached for this many sets of received subimages: without loss, each image has the same set."""


def kriging_clamped(subimages: Array, have: BoolArray, cut: Interleave, smooth: float = SMOOTH) -> Array:
    """Each missing pixel becomes the best linear estimate from the received ones nearest to it.

    An estimate is limited to the range of the CLAMPING nearest: it invents no peak. Beyond the image's border the
    received pixels nearest to it are repeated. If a neighbour is not finite, as in a depth image, the nearest received
    pixel is used.

    :param subimages: (n, rows, columns, ...) array of numbers, of any byte order, in cut.order
    :param have: (n,) bool, the subimages received; the values of the others do not matter
    :param smooth: b of the model [pixel]
    :return: array like subimages: all of them; zero if nothing was received
    """
    if have.all():
        return subimages
    if not have.any():
        return np.zeros_like(subimages)
    plan = _plan(cut, have.tobytes(), float(smooth))
    numbers = _sources(subimages, have, plan)
    estimates = _rounded(plan.weights @ numbers.astype(np.float32), numbers.dtype)
    np.clip(estimates, *_range(numbers, plan.nearest), out=estimates)
    if estimates.dtype.kind == 'f':
        undefined = ~np.isfinite(estimates)
        estimates[undefined] = numbers[plan.nearest[0]][undefined]
    filled = np.empty_like(subimages)
    filled[have] = subimages[have]
    filled[~have] = estimates.reshape((-1,) + subimages.shape[1:])
    return filled


class _Plan(NamedTuple):
    """How to fill the missing subimages of a layout.

    Sources are received subimages, each moved by whole blocks so that its pixels fall on the blocks they are neighbours
    of.
    """
    rank: IntArray
    """(s,) int: the number of each source among the received subimages."""
    block: IntArray
    """(s, 2) int, -REACH..REACH: the block, down and right, that its pixels come from."""
    weights: Any
    """(missing subimages, s) float32 scipy.sparse.csr_matrix."""
    nearest: IntArray
    """(at most CLAMPING, missing subimages) int: the sources nearest to each, the nearest first."""
    border: Border


@functools.lru_cache(maxsize=CACHED_PLANS)
def _plan(cut: Interleave, have_bytes: bytes, smooth: float) -> _Plan:
    """:param have_bytes: the bytes of (n,) bool"""
    p, have = cut.p, np.frombuffer(have_bytes, bool)
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
    used_keys = np.flatnonzero(used)
    rank = np.empty(len(used), np.int32)
    rank[used_keys] = np.arange(len(used_keys))
    source = rank[key]                                          # (missing, k)
    subimage, block = np.divmod(used_keys, side * side)
    weights = weigh(nearest - place[~have][:, np.newaxis], smooth)
    rows = np.arange(len(source) + 1, dtype=np.int32) * source.shape[1]
    return _Plan(
        (np.cumsum(have) - 1)[subimage], np.stack(np.divmod(block, side), axis=1) - REACH,
        sparse.csr_matrix((np.ravel(weights), source.ravel(), rows), (len(source), len(subimage))),
        np.ascontiguousarray(source[:, :CLAMPING].T), border_of(place[have], p))


def weigh(offsets: Array, smooth: float = SMOOTH) -> Float32Array:
    """The weights of ordinary kriging.

    The difference between the missing pixel and its first neighbour is estimated from the differences between the other
    neighbours and the first, so the weights sum to 1 by construction.

    :param offsets: (m, k, 2) numbers, the places of k neighbours relative to each missing pixel; no two are the same
    :param smooth: b of the model [pixel]
    :return: (m, k) float32; each row sums to 1
    """
    down, right = np.ascontiguousarray(offsets.T, np.float32)     # (k, m) each
    missing = _variogram(down, right, smooth)
    first = _variogram(down[1:] - down[0], right[1:] - right[0], smooth)
    k, m = down.shape
    # twice the covariances of differences from the first: of each two neighbours, and of each and the missing pixel
    equations = np.empty((k - 1, k, m), np.float32)
    for i in range(k - 1):
        apart = _variogram(down[i + 1] - down[i + 1:], right[i + 1] - right[i + 1:], smooth)
        equations[i, i:-1] = first[i] + first[i:] - apart
        equations[i, -1] = missing[0] + first[i] - missing[i + 1]
    others = _solved(equations)
    weights: Float32Array = np.concatenate([1 - others.sum(axis=0, keepdims=True), others]).T
    return weights


def _solved(equations: Float32Array) -> Float32Array:
    """Gaussian elimination of m systems of equations at once; LAPACK, one after the other, takes five times as long.

    :param equations: (n, n + 1, m): symmetric and positive definite matrices, of which only the upper triangle is read,
        and the right-hand side; they are changed
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


def _variogram(down: Float32Array, right: Float32Array, smooth: float) -> Float32Array:
    """The mean squared difference of pixels at this distance, up to a factor."""
    difference: Float32Array = np.sqrt(down * down + right * right + np.float32(smooth ** 2)) - np.float32(smooth)
    return difference


def _sources(subimages: Array, have: BoolArray, plan: _Plan) -> Array:
    """The plan's sources: (s, numbers of a subimage) array in native byte order."""
    native = subimages[have].astype(subimages.dtype.newbyteorder('='), copy=False)
    sources: Array = native[plan.rank]
    # most of them are not moved
    elsewhere = np.flatnonzero(plan.block.any(axis=1))
    chosen, row = np.unique(plan.rank[elsewhere], return_inverse=True)
    down, right = (plan.block[elsewhere] + REACH).T
    sources[elsewhere] = moved(continued(native, REACH, plan.border, chosen), REACH)[row, down, right]
    return sources.reshape(len(plan.rank), -1)


def _range(numbers: Array, nearest: IntArray) -> Tuple[Array, Array]:
    """The minimum and the maximum of some sources, for each missing subimage."""
    low, high = numbers[nearest[0]], numbers[nearest[0]]
    for source in nearest[1:]:
        others = numbers[source]
        np.minimum(low, others, out=low)
        np.maximum(high, others, out=high)
    return low, high


def _rounded(estimates: Float32Array, dtype: DType) -> Array:
    """Estimates as numbers of another type, clipped to its limits. They may be changed."""
    if dtype.kind == 'f':
        return estimates.astype(dtype, copy=False)
    limits = np.iinfo(dtype)
    np.rint(np.clip(estimates, limits.min, limits.max, out=estimates), out=estimates)
    return estimates.astype(dtype)
