# SPDX-License-Identifier: BSD-3-Clause
"""Virtual 2D scans out of a 3D scan (D6.3, section 6.2; after Wulf, Arras, Christensen, Wagner: 2D Mapping of
Cluttered Indoor Environments by Means of 3D Perception, ICRA 2004).

f picks points, g: (x, y, z) -> (x, y) lays them on the floor plan. The obstacle scan is of what a robot would run
into: the nearest of all points above the ground and below a height. The landmark scan is of what stays where it is:
the farthest of the points on upright planes, mostly walls, seen over and past the clutter.

Column i is the direction ANGLE_MIN + i * INCREMENT, as in a LaserScan, and covers the bearings from half an increment
before it up to, not including, half an increment after it; so column 0 is behind the robot, on both sides of +-pi.
Bearing and range are measured over the ground plane: along its normal, from the frame's origin, x forward.

Ranges are REP-117's: -inf where something is nearer than range_min, +inf where returns came, but none of them from
what the scan shows, NaN where none came. A scanner's missing and erroneous points (NaN) have no bearing. So a column
without any return may be open, or covered, or too near, or never looked at: it is missing, not free.
"""
from dataclasses import dataclass

import numpy as np

COLUMNS = 720
ANGLE_MIN = -np.pi
INCREMENT = 2 * np.pi / COLUMNS
"""[rad]"""

SNAP = 0.05
"""Of a column. Scanners' own steps fall on our columns' borders; so far before one counts as on it, that neither
rounding nor the ground plane's last hundredth of a degree scatters them."""

FARTHEST = 1000.0
"""[m]"""

MIN_POINTS = 3
"""An upright surface has as many in its column: two may be over each other by chance."""

MIN_NEIGHBOURS = 5
"""So many columns on one side are looked at, or more where they are narrow."""

MIN_IN_LINE = 4
"""And so many of them and the column itself must show a surface: three may lie in a line by chance."""


@dataclass(frozen=True, eq=False)
class Fan:
    """A 3D scan's points above the ground, sorted by column, then by range."""
    column: np.ndarray     # (n,) int16
    range: np.ndarray      # (n,) float32, over the floor plan, 0..range_max [m]
    height: np.ndarray     # (n,) float32, above the ground [m]
    range_min: float       # nearer ones are too close to be measured [m]
    seen: np.ndarray       # (COLUMNS,) bool: columns with any return, be it from the ground

    def __len__(self):
        return len(self.column)

    def of(self, chosen):
        """The points that an index or a mask chooses."""
        return Fan(self.column[chosen], self.range[chosen], self.height[chosen], self.range_min, self.seen)

    def scan(self, columns, ranges):
        """(COLUMNS,) float32: these ranges in these columns, in others +inf where they were seen, NaN else."""
        scan = np.where(self.seen, np.float32(np.inf), np.float32(np.nan))
        scan[columns] = np.where(ranges < self.range_min, -np.inf, ranges)
        return scan


def fan(xyz, plane, tolerance=0.1, slope=0.0, range_min=0.4, range_max=100.0):
    """Remove the ground and sort what remains by column and range.

    :param xyz: (n, 3) float [m], in any order; points that are not finite, or exactly (0, 0, 0), are no returns
    :param plane: ground.Plane in the same frame
    :param tolerance: what is not higher above the plane is ground [m]
    :param slope: and so much more per metre of range, where the floor is not quite a plane
    :param range_min: [m]; range_max: farther returns only tell that nothing is nearer [m]
    :return: Fan
    :raises ValueError: where the limits contradict each other
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
    chosen = chosen[np.argsort(_key(column[chosen], distance[chosen]))]
    return Fan(column[chosen], distance[chosen], height[chosen], range_min, seen)


def obstacle_scan(points, max_height=1.2, depth=0.1):
    """Where the robot would run into something: the nearest surface in each column.

    Of the nearest surface's points the nearest is also the one whose noise is most against it; so the range is the
    mean of those up to `depth` behind it.

    :param points: Fan
    :param max_height: what is higher above the ground is in nobody's way [m]
    :param depth: [m]; some three standard deviations of a range
    :return: (COLUMNS,) float32 [m], see above
    """
    points = points.of(points.height <= max_height)
    key = _key(points.column, points.range)
    first = np.flatnonzero(np.diff(points.column, prepend=-1))
    behind = np.searchsorted(key, key[first] + depth, side='right')
    total = _sums(points.range)
    ranges = (total[behind] - total[first]) / (behind - first)
    return points.scan(points.column[first], ranges)


def landmark_scan(points, extent=0.2, depth=0.1, width=0.1, flatness=0.05):
    """Where the building stands: the farthest surface in each column that is upright and flat.

    Upright is a surface whose points within `depth` spread over some height, and flat where it lies in a line with
    those of the neighbouring columns, on one side at least: it may end on the other.

    :param points: Fan
    :param extent: height that an upright surface is seen over, at least [m]
    :param depth: [m], as obstacle_scan's
    :param width: how much of the neighbours on one side is to be in line [m]
    :param flatness: quadratic mean of their distances from the line, at most [m]
    :return: (COLUMNS,) float32 [m], see above; -inf where all that is above the ground is too close
    """
    farthest = np.flatnonzero(np.diff(points.column, append=COLUMNS))
    scan = points.scan(points.column[farthest], np.where(points.range[farthest] < points.range_min, -np.inf, np.inf))
    columns, ranges = _upright(points.of(points.range >= points.range_min), extent, depth)
    flat = _in_line(columns, ranges, width, flatness)
    scan[columns[flat]] = ranges[flat]
    return scan


def _upright(points, extent, depth):
    """The farthest upright surfaces: (m,) int columns, in order, and (m,) float64 ranges [m]."""
    key = _key(points.column, points.range)
    start = np.searchsorted(key, key - depth)       # of the points up to `depth` before each
    count = np.arange(1, len(key) + 1) - start
    height = points.height.astype(np.float64)
    mean, mean_square = ((total[1:] - total[start]) / count for total in (_sums(height), _sums(height * height)))
    # as of points that are evenly spread over the extent
    upright = np.flatnonzero((count >= MIN_POINTS) & (mean_square - mean * mean >= extent ** 2 / 12))
    last = upright[np.diff(points.column[upright], append=COLUMNS) > 0]
    total = _sums(points.range)
    return points.column[last], (total[last + 1] - total[start[last]]) / count[last]


def _in_line(columns, ranges, width, flatness):
    """(m,) bool: which of the surfaces lie in a line with their neighbours.

    :param columns: (m,) int, each once; ranges: (m,) float [m]
    """
    bearing = ANGLE_MIN + columns * INCREMENT
    x, y = ranges * np.cos(bearing), ranges * np.sin(bearing)
    moments = np.zeros((6, COLUMNS))
    moments[:, columns] = np.ones_like(x), x, y, x * x, x * y, y * y
    # three turns, so that no window ends at a border
    total = np.apply_along_axis(_sums, 1, np.tile(moments, 3))
    side = np.clip(np.ceil(width / (ranges * INCREMENT)), MIN_NEIGHBOURS, COLUMNS // 8).astype(int)
    flat = np.zeros(len(columns), bool)
    for before, after in ((side, 0), (0, side)):
        here = columns + COLUMNS
        n, mx, my, mxx, mxy, myy = total[:, here + after + 1] - total[:, here - before]
        a, b, c = mxx / n - (mx / n) ** 2, mxy / n - mx * my / n ** 2, myy / n - (my / n) ** 2
        across = (a + c) / 2 - np.hypot((a - c) / 2, b)      # the covariance's lesser eigenvalue
        # in a narrow view any ranges are nearly in a line, the line of sight: it must be thinner than the view is wide
        wide = n * ranges * INCREMENT / np.sqrt(12)          # as a deviation, too
        flat |= (n >= MIN_IN_LINE) & (across <= np.minimum(flatness, wide / 2) ** 2)
    return flat


def _key(column, distance):
    """(n,) float64 that sorts points by column and then by range; between columns is room for any depth."""
    return np.multiply(column, 2 * FARTHEST, dtype=np.float64) + distance


def _sums(values):
    """(n,) -> (n + 1,) float64: of the first 0, 1, ... n values, so that differences are the sums of stretches."""
    return np.concatenate([[0.0], np.cumsum(values, dtype=np.float64)])
