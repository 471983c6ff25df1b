# SPDX-License-Identifier: BSD-3-Clause
"""Depth images in metres (32FC1, REP-118) to 16-bit counts of a unit, and back; NaN and infinities stay (REP-117)."""
from typing import Optional, Tuple

import numpy as np

from ...arrays import Array, Float32Array, UInt8Array
from .image import Decoded
from .loops import compiled, int64

FINITE, NAN, PLUS_INFINITY, MINUS_INFINITY = range(4)
MOST = 65535
"""The largest count; what is farther becomes this."""


def to_counts(depth: Float32Array, unit: float) -> Tuple[Array, Optional[UInt8Array]]:
    """Counts and classes of a depth image.

    :param depth: (height, width) float32 [m]
    :param unit: of a count [m]
    :returns: (height, width) uint16, filled from their neighbours where the depth is not finite; and (height, width)
        uint8, or None where all are finite
    :raises ValueError: if the unit is not positive
    """
    if not unit > 0:
        raise ValueError('a unit of %r m' % unit)
    finite = np.isfinite(depth)
    if finite.all():
        return _counts(depth, unit), None
    classes = np.where(finite, FINITE, np.where(np.isnan(depth), NAN, np.where(depth > 0, PLUS_INFINITY,
                                                                               MINUS_INFINITY))).astype(np.uint8)
    mean = float(depth[finite].mean()) if finite.any() else 0.0
    counts = _counts(np.where(finite, depth, np.float32(mean)), unit)
    _fill(counts, np.ascontiguousarray(finite))
    return counts, classes


@compiled
def _fill(counts: Array, finite: Array) -> None:
    """Set what is not finite to the mean of what is on its left and above: it takes few bytes, and where the map of
    classes is coarse it is shown."""
    for y in range(counts.shape[0]):
        for x in range(counts.shape[1]):
            if not finite[y, x] and (x > 0 or y > 0):
                left = int64(counts[y, x - 1]) if x > 0 else int64(counts[y - 1, x])
                above = int64(counts[y - 1, x]) if y > 0 else left
                counts[y, x] = (left + above) >> 1


def _counts(depth: Float32Array, unit: float) -> Array:
    return np.rint(np.clip(depth * np.float32(1 / unit), 0, MOST)).astype(np.uint16)


def from_counts(decoded: Decoded, unit: float) -> Float32Array:
    """(height, width) float32 [m]"""
    depth: Float32Array = decoded.pixels.astype(np.float32) * np.float32(unit)
    if decoded.classes is not None:
        for kind, value in ((NAN, np.nan), (PLUS_INFINITY, np.inf), (MINUS_INFINITY, -np.inf)):
            depth[decoded.classes == kind] = value
    return depth
