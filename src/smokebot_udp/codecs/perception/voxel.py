# SPDX-License-Identifier: BSD-3-Clause
"""A voxel grid filter: the points of each box become their centroid (D6.3, section 6.1).

By PCL where python3-pcl is installed; else numpy gives PCL's own answer: the same boxes in the same order,
centroids equal but for the rounding of float32 sums.
"""
import numpy as np

try:
    import pcl
except ImportError:
    pcl = None

PCL_INDEXES = 2 ** 31 - 1
"""PCL counts boxes in 32 bits; a cloud that spans more of them it would return as it is."""

FARTHEST = 2.0 ** 61
"""Boxes are counted so far; what lies beyond is in the last one."""


def voxel_filter(points, leaf, intensity=None):
    """One point for each box that has any.

    :param points: (n, 3) float32 [m], finite, n >= 1
    :param leaf: a box' side [m]
    :param intensity: (n,) float32, averaged likewise, or None
    :return: (m, 3) float32 centroids, ordered by box: x counts first, then y, z; and (m,) float32 or None
    """
    if pcl is not None and _within_pcl(points, leaf):
        return _by_pcl(points, leaf, intensity)
    return _by_numpy(points, leaf, intensity)


def _by_pcl(points, leaf, intensity):
    if intensity is None:
        cloud = pcl.PointCloud(points)
    else:
        cloud = pcl.PointCloud_PointXYZI(np.column_stack([points, intensity]))
    grid = cloud.make_voxel_grid_filter()
    grid.set_leaf_size(leaf, leaf, leaf)
    centroids = grid.filter().to_array()
    return centroids[:, :3], None if intensity is None else centroids[:, 3]


def _by_numpy(points, leaf, intensity):
    cells = _cells(points, leaf)
    low = cells.min(axis=0)
    # Python's own numbers: the product may not fit in 64 bits
    sides = [int(side) for side in cells.max(axis=0) - low + 1]
    if sides[0] * sides[1] * sides[2] < 2 ** 63:
        keys = (cells - low) @ np.array([1, sides[0], sides[0] * sides[1]])
        order = np.argsort(keys, kind='stable')
        begins = np.flatnonzero(np.diff(keys[order], prepend=keys[order[0]] - 1))
    else:
        order = np.lexsort(cells.T)
        begins = np.flatnonzero(np.append(True, (np.diff(cells[order], axis=0) != 0).any(axis=1)))
    counts = np.diff(np.append(begins, len(points)))

    def mean(values):
        return (np.add.reduceat(values[order], begins, dtype=np.float64) / counts).astype(np.float32)

    centroids = np.stack([mean(points[:, axis]) for axis in range(3)], axis=1)
    return centroids, None if intensity is None else mean(intensity)


def _cells(points, leaf):
    """(n, 3) int64: each point's box. In float32 like PCL, so that points on a border fall on the same side."""
    with np.errstate(over='ignore'):
        boxes = np.floor(points * (np.float32(1) / np.float32(leaf)))
    return np.clip(boxes, -FARTHEST, FARTHEST).astype(np.int64)


def _within_pcl(points, leaf):
    """Whether PCL can count the boxes from the origin to each point, and those of the cloud's bounding box.

    The latter with one more a side than there are: PCL rounds a side's length, which may come to one more.
    """
    ends = _cells(np.stack([points.min(axis=0), points.max(axis=0)]), leaf)
    wide, deep, high = (int(side) + 2 for side in ends[1] - ends[0])
    return np.abs(ends).max() <= PCL_INDEXES and wide * deep * high <= PCL_INDEXES
