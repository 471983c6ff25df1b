# SPDX-License-Identifier: BSD-3-Clause
"""The voxel grid filter as compiled loops: a radix sort of the points by voxel, then their means."""
from typing import Any, Tuple

import numpy as np

from ...arrays import Array, Float32Array
from ..layered.loops import compiled, inlined, int64

DIGIT = 12
"""Bits of a voxel's number that one pass sorts by, at most: the counts of 2^12 digits fit into a first level cache of
32 kB, and the clouds of a building take two passes."""


@inlined
def _voxel(scaled: float, farthest: float) -> Any:
    """floor(scaled), at most `farthest` from 0. By truncation: with np.floor the keys take four times as long."""
    bounded = min(max(scaled, -farthest), farthest)
    voxel = int64(bounded)
    return voxel - 1 if voxel > bounded else voxel


@compiled
def _keys(points: Array, scale: float, low: Array, strides: Array, farthest: float, index_bits: int) -> Array:
    """(n,) int64: the number of each point's voxel, see `centroids`, and behind it the point's index."""
    keys = np.empty(len(points), np.int64)
    for i in range(len(points)):
        x = _voxel(points[i, 0] * scale, farthest)
        y = _voxel(points[i, 1] * scale, farthest)
        z = _voxel(points[i, 2] * scale, farthest)
        keys[i] = ((x - low[0]) * strides[0] + (y - low[1]) * strides[1] + (z - low[2]) * strides[2]) << index_bits | i
    return keys


@compiled
def _sorted(keys: Array, begin: int, end: int) -> Array:
    """The keys in ascending order of their bits from `begin` to `end`; those with equal ones stay in their order.

    :param keys: (n,) int64; it is overwritten
    """
    other = np.empty(len(keys), np.int64)
    passes = max((end - begin + DIGIT - 1) // DIGIT, 1)
    digit_bits = max((end - begin + passes - 1) // passes, 1)
    mask = int64((1 << digit_bits) - 1)
    for shift in range(begin, end, digit_bits):
        begins = np.zeros((1 << digit_bits) + 1, np.int64)
        for key in keys:
            begins[(key >> shift & mask) + 1] += 1
        for digit in range(1 << digit_bits):
            begins[digit + 1] += begins[digit]
        for key in keys:
            digit = key >> shift & mask
            other[begins[digit]] = key
            begins[digit] += 1
        keys, other = other, keys
    return keys


@compiled
def centroids(points: Float32Array, intensity: Float32Array, scale: float, low: Array, strides: Array, farthest: float,
              bits: Tuple[int, int]) -> Tuple[Float32Array, Float32Array]:
    """The mean of each voxel's points, in the order of the voxels' numbers.

    A point's voxel is floor(point * scale), at most `farthest` from the origin; its number is
    (voxel - low) . strides.

    :param points: (n, 3) float32, C-contiguous, finite
    :param intensity: (n,) float32; (0,): there is none
    :param scale: float32 [1/m]
    :param low: (3,) int64: the least voxel
    :param strides: (3,) int64
    :param farthest: float32
    :param bits: of the greatest number, and of the greatest index: together 63 at most
    :return: (m, 3) and (m,) float32; the latter (0,) without intensity
    """
    number_bits, index_bits = bits
    keys = _sorted(_keys(points, scale, low, strides, farthest, index_bits), index_bits, index_bits + number_bits)
    count, with_intensity, mask = len(keys), len(intensity) > 0, int64((1 << index_bits) - 1)
    found = np.empty((count, 3), np.float32)
    mean = np.empty(count if with_intensity else 0, np.float32)
    voxels = begin = 0
    while begin < count:
        number, end = keys[begin] >> index_bits, begin
        x = y = z = value = 0.0
        while end < count and keys[end] >> index_bits == number:
            i = keys[end] & mask
            x += points[i, 0]
            y += points[i, 1]
            z += points[i, 2]
            if with_intensity:
                value += intensity[i]
            end += 1
        points_inside = end - begin
        found[voxels, 0], found[voxels, 1], found[voxels, 2] = x / points_inside, y / points_inside, z / points_inside
        if with_intensity:
            mean[voxels] = value / points_inside
        voxels += 1
        begin = end
    return found[:voxels].copy(), mean[:voxels].copy()
