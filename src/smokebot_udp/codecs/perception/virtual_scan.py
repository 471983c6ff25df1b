# SPDX-License-Identifier: BSD-3-Clause
"""Virtual 2D scans from a 3D scan (D6.3, section 6.2; after Wulf, Arras, Christensen, Wagner: 2D Mapping of Cluttered
Indoor Environments by Means of 3D Perception, ICRA 2004).

f selects points, g: (x, y, z) -> (x, y) projects them on the floor plan. The obstacle scan shows what a robot would
collide with: the nearest of all points above the ground and below a height. The landmark scan shows what does not move:
the farthest of the points on upright planes, mostly walls, seen over and past the clutter.

Column i is the direction ANGLE_MIN + i * INCREMENT, as in a LaserScan. It covers the bearings from half an increment
before it up to, but not including, half an increment after it, so column 0 is behind the robot, on both sides of +-pi.
Bearing and range are measured in the ground plane: along its normal, from the frame's origin, x forward.

Ranges follow REP-117: -inf if something is nearer than range_min, +inf if there are returns, but none of them in the
scan, NaN if there are no returns. A scanner's missing and erroneous points (NaN) have no bearing, so a column without
returns may be open, covered, too near or never scanned: it is missing, not free.
"""
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from ...arrays import Array, BoolArray, Float32Array, FloatArray, IntArray
from .ground import Plane

COLUMNS = 720
ANGLE_MIN = -np.pi
INCREMENT = 2 * np.pi / COLUMNS
"""[rad]"""

SNAP = 0.05
"""Scanners' own steps fall on the columns' borders. Points up to this far before a border belong to the next column, so
that neither rounding nor a hundredth of a degree of the ground plane's error scatters them [column]."""

FARTHEST = 1000.0
"""[m]"""

DEPTH = 0.1
"""A surface has the points up to this behind its first one: about three standard deviations of a range [m]."""

MIN_EXTENT = 0.2
"""Minimum height over which an upright surface is seen [m]."""

WIDTH, FLATNESS = 0.1, 0.05
"""Width of the neighbours on one side that must be in line with a surface, and maximum root mean square of their
distances from the line [m]."""

MIN_POINTS = 3
"""Minimum number of points of an upright surface in its column: two may be above each other by chance."""

MIN_NEIGHBOURS = 5
"""Minimum number of columns considered on one side; more are considered if they are narrow."""

MIN_IN_LINE = 4
"""Minimum number of columns that show a surface, of those considered and the column itself: three may be in a line by
chance."""


@dataclass(frozen=True, eq=False)
class Fan:
    """The points of a 3D scan above the ground, sorted by column, then by range."""
    column: Array
    """(n,) int16"""
    range: Float32Array
    """(n,) float32, horizontal, 0..range_max [m]"""
    height: Float32Array
    """(n,) float32, above the ground [m]"""
    range_min: float
    """Points nearer than this are too close to be measured [m]."""
    seen: BoolArray
    """(COLUMNS,) bool: columns with any return, including the ground's."""

    def __len__(self) -> int:
        return len(self.column)

    def select(self, chosen: BoolArray) -> 'Fan':
        """Some of the points: (n,) bool."""
        return Fan(self.column[chosen], self.range[chosen], self.height[chosen], self.range_min, self.seen)

    def scan(self, columns: Array, ranges: Array) -> Float32Array:
        """(COLUMNS,) float32: these ranges in these columns; in the others +inf if they were seen, else NaN."""
        scan = np.where(self.seen, np.float32(np.inf), np.float32(np.nan))
        scan[columns] = np.where(ranges < self.range_min, -np.inf, ranges)
        return scan


def fan(xyz: Array, plane: Plane, tolerance: float = 0.1, slope: float = 0.0, range_min: float = 0.4,
        range_max: float = 100.0) -> Fan:
    """Remove the ground, and sort the remaining points by column and range.

    :param xyz: (n, 3) float [m], in any order; points that are not finite, or exactly (0, 0, 0), are no returns
    :param plane: the ground, in the same frame
    :param tolerance: points up to this height above the plane are ground [m]
    :param slope: added to the tolerance for each metre of range, for uneven floors
    :param range_min: points nearer than this are too close [m]
    :param range_max: returns farther than this only show that nothing is nearer [m]
    :raises ValueError: the limits contradict each other
    """
    if not 0 <= range_min < range_max <= FARTHEST:
        raise ValueError('ranges from %r to %r m; they go up to %g' % (range_min, range_max, FARTHEST))
    with np.errstate(invalid='ignore', over='ignore'):
        x, y, height = plane.level(np.asarray(xyz, np.float32))
        distance = np.hypot(x, y)
        returns = np.flatnonzero((distance > 0) & np.isfinite(distance + height))
    x, y, height, distance = (values[returns] for values in (x, y, height, distance))
    column = np.floor((np.arctan2(y, x) - ANGLE_MIN) / INCREMENT + (0.5 + SNAP)).astype(np.int16) % COLUMNS
    seen = np.bincount(column, minlength=COLUMNS) > 0
    chosen = np.flatnonzero((height > tolerance + np.float32(slope) * distance) & (distance <= range_max))
    # stable: faster where a scanner's points come column by column
    chosen = chosen[np.argsort(_key(column[chosen], distance[chosen]), kind='stable')]
    return Fan(column[chosen], distance[chosen], height[chosen], range_min, seen)


def obstacle_scan(points: Fan, max_height: float = 1.2) -> Float32Array:
    """What the robot would collide with: the nearest surface in each column.

    The nearest point of a surface is the one with the largest error towards the robot, so the range is the mean of the
    points up to DEPTH behind it.

    :param max_height: points higher above the ground are no obstacles [m]
    :return: (COLUMNS,) float32 [m], see the module's docstring
    """
    points = points.select(points.height <= max_height)
    key = _key(points.column, points.range)
    first = np.flatnonzero(np.diff(points.column, prepend=-1))
    behind = np.searchsorted(key, key[first] + DEPTH, side='right')
    total = _cumulative(points.range)
    ranges = (total[behind] - total[first]) / (behind - first)
    return points.scan(points.column[first], ranges)


def landmark_scan(points: Fan) -> Float32Array:
    """What does not move: the farthest surface in each column that is upright and flat.

    A surface is upright if its points within DEPTH extend over MIN_EXTENT, and flat if it is in a line with those of
    the neighbouring columns, on one side at least: it may end on the other.

    :return: (COLUMNS,) float32 [m], see the module's docstring; -inf if all points above the ground are too close
    """
    farthest = np.flatnonzero(np.diff(points.column, append=COLUMNS))
    scan = points.scan(points.column[farthest], np.where(points.range[farthest] < points.range_min, -np.inf, np.inf))
    columns, ranges = _upright(points.select(points.range >= points.range_min))
    flat = _in_line(columns, ranges)
    scan[columns[flat]] = ranges[flat]
    return scan


def _upright(points: Fan) -> Tuple[Array, FloatArray]:
    """The farthest upright surfaces: (m,) int columns, ascending, and (m,) float64 ranges [m]."""
    key = _key(points.column, points.range)
    start: IntArray = np.searchsorted(key, key - DEPTH)     # of the points up to DEPTH before each
    count = np.arange(1, len(key) + 1) - start
    height = points.height.astype(np.float64)
    mean, mean_square = ((total[1:] - total[start]) / count for total in (
        _cumulative(height), _cumulative(height * height)))
    # the variance of points that are evenly distributed over the extent
    upright = np.flatnonzero((count >= MIN_POINTS) & (mean_square - mean * mean >= MIN_EXTENT ** 2 / 12))
    last = upright[np.diff(points.column[upright], append=COLUMNS) > 0]
    total = _cumulative(points.range)
    return points.column[last], (total[last + 1] - total[start[last]]) / count[last]


def _in_line(columns: Array, ranges: FloatArray) -> BoolArray:
    """Which of the surfaces are in a line with their neighbours: (m,) bool.

    :param columns: (m,) int, all different
    :param ranges: (m,) float64 [m]
    """
    bearing = ANGLE_MIN + columns * INCREMENT
    x, y = ranges * np.cos(bearing), ranges * np.sin(bearing)
    moments = np.zeros((6, COLUMNS))
    moments[:, columns] = np.ones_like(x), x, y, x * x, x * y, y * y
    # three turns, so that no window ends at a border
    total = _cumulative(np.tile(moments, 3))
    side = np.clip(np.ceil(WIDTH / (ranges * INCREMENT)), MIN_NEIGHBOURS, COLUMNS // 8).astype(int)
    flat = np.zeros(len(columns), bool)
    none = np.zeros_like(side)
    for before, after in ((side, none), (none, side)):
        here = columns + COLUMNS
        n, mx, my, mxx, mxy, myy = total[:, here + after + 1] - total[:, here - before]
        a, b, c = mxx / n - (mx / n) ** 2, mxy / n - mx * my / n ** 2, myy / n - (my / n) ** 2
        across = (a + c) / 2 - np.hypot((a - c) / 2, b)      # the covariance's smaller eigenvalue
        # in a narrow view any ranges are nearly in a line, the line of sight: it must be thinner than the view is wide
        wide = n * ranges * INCREMENT / np.sqrt(12)          # also a standard deviation
        flat |= (n >= MIN_IN_LINE) & (across <= np.minimum(FLATNESS, wide / 2) ** 2)
    return flat


def _key(column: Array, distance: Array) -> FloatArray:
    """(n,) float64 that sorts points by column, then by range; the gap between columns exceeds DEPTH."""
    key: FloatArray = np.multiply(column, 2 * FARTHEST, dtype=np.float64)
    key += distance
    return key


def _cumulative(values: Array) -> FloatArray:
    """(..., n) -> (..., n + 1) float64: sums of the first 0, 1, ... n values; differences are the sums of intervals."""
    sums = np.zeros(values.shape[:-1] + (values.shape[-1] + 1,))
    np.cumsum(values, axis=-1, out=sums[..., 1:])
    return sums
