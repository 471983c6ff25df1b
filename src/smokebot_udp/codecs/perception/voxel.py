# SPDX-License-Identifier: BSD-3-Clause
"""A voxel grid filter: the points of each voxel are replaced by their centroid (D6.3, section 6.1).

PCL's filter is used where its Python module (python3-pcl) can be imported; elsewhere, as on Debian 13, which has none,
loops that numba compiles, and numpy where these are not loaded. All give the same voxels in the same order. The
centroids of the loops are numpy's; PCL's sums are float32, and so differ by their rounding. Measured with a leaf of
0.1 m, median time of one cloud on one core, without and with intensity; `./smokebot bench codecs` repeats it for the
first of these:

====================  ============  ============  ============
points                PCL [ms]      loops [ms]    numpy [ms]
====================  ============  ============  ============
23 040, simulated     1.2 and 1.4   0.8 and 0.8   3.7 and 3.7
322 560, 14 of these  27 and 29     11 and 12     62 and 63
====================  ============  ============  ============
"""
from typing import Optional, Tuple

import numpy as np

from ... import optional
from ...arrays import Array, Float32Array, IntArray
from ..wire.points import bounding_box

pcl = optional.attempt('pcl').module

PCL_INDEXES = 2 ** 31 - 1
"""PCL numbers voxels in 32 bits; a cloud that spans more it would return unchanged."""

FARTHEST = 2.0 ** 61
"""Voxels are numbered up to here on each axis; the last one contains all that is beyond."""

COLOURS = 'rgb', 'rgba'
"""Fields of 4 bytes, one a channel."""

Filtered = Tuple[Float32Array, Optional[Float32Array]]
"""(m, 3) centroids, ordered by voxel: by z, then y, then x; and (m,) mean intensities or None."""


def voxel_filter(points: Float32Array, leaf: float, intensity: Optional[Float32Array] = None, loaded: bool = False
                 ) -> Filtered:
    """One point for each voxel that contains any, by PCL if possible.

    :param points: (n, 3) float32 [m], finite, n >= 1
    :param leaf: side of a voxel [m]
    :param intensity: (n,) float32, averaged likewise, or None
    :param loaded: whether compiled loops are loaded, see streams/codec.py
    """
    if pcl is not None and _within_pcl(points, leaf):
        return filter_by_pcl(points, leaf, intensity)
    return (filter_by_loops if loaded else filter_by_numpy)(points, leaf, intensity)


def filter_by_pcl(points: Float32Array, leaf: float, intensity: Optional[Float32Array] = None) -> Filtered:
    """As voxel_filter; the cloud must not span more than PCL_INDEXES voxels."""
    if intensity is None:
        cloud = pcl.PointCloud(points)
    else:
        cloud = pcl.PointCloud_PointXYZI(np.column_stack([points, intensity]))
    grid = cloud.make_voxel_grid_filter()
    grid.set_leaf_size(leaf, leaf, leaf)
    centroids = grid.filter().to_array()
    return centroids[:, :3], None if intensity is None else centroids[:, 3]


def filter_by_loops(points: Float32Array, leaf: float, intensity: Optional[Float32Array] = None) -> Filtered:
    """As voxel_filter. It imports numba."""
    from ..layered.loops import float32
    from . import voxel_loops
    ends = voxels_of(bounding_box(points), leaf)
    sides = [int(side) for side in ends[1] - ends[0] + 1]
    bits = (sides[0] * sides[1] * sides[2] - 1).bit_length(), (len(points) - 1).bit_length()
    if sum(bits) >= 64:     # a voxel's number and a point's index share a word
        return filter_by_numpy(points, leaf, intensity)
    centroids, means = voxel_loops.centroids(
        np.array(points, np.float32, order='C'),
        np.empty(0, np.float32) if intensity is None else np.array(intensity, np.float32),
        float32(1) / float32(leaf), ends[0], np.array([1, sides[0], sides[0] * sides[1]]), float32(FARTHEST), bits)
    return centroids, None if intensity is None else means


def filter_with_fields(points: Float32Array, leaf: float, intensity: Optional[Float32Array], extra: Array
                       ) -> Tuple[Float32Array, Optional[Float32Array], Array]:
    """As voxel_filter, with further fields: means of the channels of rgb and rgba, of others the first point's value.

    :param extra: (n,) structured array of unsigned integers
    :return: centroids and mean intensities as of voxel_filter, and (m,) extra
    """
    groups = _groups(points, leaf)
    merged = extra[groups[0][groups[1]]]
    for name in COLOURS:
        if name in (extra.dtype.names or ()) and extra.dtype[name].itemsize == 4:
            channels = np.ascontiguousarray(extra[name]).view(np.uint8).reshape(-1, 4)
            means = [_means(channels[:, channel], *groups) for channel in range(4)]
            merged[name] = np.rint(np.stack(means, axis=1)).astype(np.uint8).view('<u4')[:, 0]
    return (*_filtered(points, intensity, *groups), merged)


def filter_by_numpy(points: Float32Array, leaf: float, intensity: Optional[Float32Array] = None) -> Filtered:
    """As voxel_filter."""
    return _filtered(points, intensity, *_groups(points, leaf))


def _groups(points: Float32Array, leaf: float) -> Tuple[IntArray, IntArray]:
    """(n,) the points' indexes, voxel by voxel and in their order within each; (m,) where in it a voxel begins."""
    voxels = voxels_of(points, leaf)
    low = voxels.min(axis=0)
    # Python's own integers: the product may not fit in 64 bits
    sides = [int(side) for side in voxels.max(axis=0) - low + 1]
    if sides[0] * sides[1] * sides[2] < 2 ** 63:
        keys = (voxels - low) @ np.array([1, sides[0], sides[0] * sides[1]])
        order = np.argsort(keys, kind='stable')
        begins = np.flatnonzero(np.diff(keys[order], prepend=keys[order[0]] - 1))
    else:
        order = np.lexsort(voxels.T)
        begins = np.flatnonzero(np.append(True, (np.diff(voxels[order], axis=0) != 0).any(axis=1)))
    return order, begins


def _filtered(points: Float32Array, intensity: Optional[Float32Array], order: IntArray, begins: IntArray) -> Filtered:
    """The centroids and mean intensities of groups of points."""
    centroids = np.stack([_means(points[:, axis], order, begins) for axis in range(3)], axis=1)
    return centroids, None if intensity is None else _means(intensity, order, begins)


def _means(values: Array, order: IntArray, begins: IntArray) -> Float32Array:
    """(m,) the means of groups of (n,) values."""
    sums: Array = np.add.reduceat(values[order], begins, dtype=np.float64)
    means: Array = sums / np.diff(np.append(begins, len(order)))
    return means.astype(np.float32)


def voxels_of(points: Float32Array, leaf: float) -> IntArray:
    """The voxel of each point: (n, 3) int64. In float32 as PCL does, so points on a border are in the same voxel."""
    with np.errstate(over='ignore'):
        voxels: Array = np.floor(points * (np.float32(1) / np.float32(leaf)))
    return np.clip(voxels, -FARTHEST, FARTHEST).astype(np.int64)


def _within_pcl(points: Float32Array, leaf: float) -> bool:
    """Whether PCL can number the voxels from the origin to each point, and those of the cloud's bounding box.

    For the latter each side is one longer than it is: PCL rounds a side's length, possibly up by one.
    """
    ends = voxels_of(bounding_box(points), leaf)
    wide, deep, high = (int(side) + 2 for side in ends[1] - ends[0])
    return int(np.abs(ends).max()) <= PCL_INDEXES and wide * deep * high <= PCL_INDEXES
