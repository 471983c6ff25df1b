# SPDX-License-Identifier: BSD-3-Clause
"""The ground under the robot: a plane through the points near the expected floor, found by RANSAC (D6.3, section 6.2).

PCL's RANSAC where PCL's Python module is installed, else numpy's own with the same meaning. Walls could outvote the
little floor that is seen between them; so only points of flat places vote: those in whose cell of the floor plan,
whatever is in it, has about one height.
"""
from dataclasses import dataclass

import numpy as np

try:
    import pcl
except ImportError:
    pcl = None

FRESH, LAST, ASSUMED = 'fresh', 'last', 'assumed'
"""Where a plane is from: this scan; an earlier one; no scan, only the mounting height."""

CELL = 0.4
"""Side of a cell of the floor plan [m]: on a ramp of 10 degrees its heights spread, as a deviation, by 3 cm."""

LOW = 1.0
"""What is higher above the expected floor does not tell whether a cell is flat: it may be the ceiling [m]."""

SLACK = 0.1
"""Points so far from the expected floor belong to it at any range [m]."""

TILT_ERROR = np.radians(1)
"""A ramp of max_tilt may be measured so much steeper [rad]."""

HYPOTHESES = 100
"""With half of the points on the floor, three points that are drawn lie on it once in 8."""

TRIES = 3
"""Three points of one corner of the floor make a poor plane: what was refused is tried again with other draws."""

MAX_TILT = np.radians(10)
"""Of ramps and robots [rad]."""

VOTERS = 1000
"""More points vote no better."""


@dataclass(frozen=True, eq=False)
class Plane:
    """The points with normal . point + offset = 0, in the frame of the points it was found in."""
    normal: np.ndarray     # (3,) float64, unit length, upward
    offset: float          # height of the frame's origin above it [m]
    source: str = FRESH    # or LAST or ASSUMED

    def height(self, xyz):
        """(n, 3) points [m] -> (n,) height above the plane [m], in the points' dtype."""
        return _along(np.asarray(xyz).T, self.normal) + np.asarray(xyz).dtype.type(self.offset)

    def axes(self):
        """(3, 3) float64: rows forward, left, up. Up is the normal; forward is the frame's x, made level."""
        forward = np.array([1.0, 0.0, 0.0]) - self.normal[0] * self.normal
        forward /= np.linalg.norm(forward)
        return np.array([forward, np.cross(self.normal, forward), self.normal])

    def level(self, xyz):
        """(n, 3) points [m] -> x forward, y left, both from the frame's origin, and height above the plane: (n,) each
        [m], in the points' dtype."""
        rows = np.ascontiguousarray(np.asarray(xyz).T)
        x, y, z = (_along(rows, axis) for axis in self.axes())
        return x, y, z + rows.dtype.type(self.offset)


def _along(rows, direction):
    """(3, n) coordinates -> (n,) their part along a direction."""
    # no matrix product: BLAS would wake a thread on each core for it
    a, b, c = direction.astype(rows.dtype)
    return rows[0] * a + rows[1] * b + rows[2] * c


class GroundFinder:
    """Finds the ground in one scan after the other; where a scan shows none, it is where it was.

    :param mount_height: of the frame's origin above the floor [m]; 0 for points in the robot's base frame
    :param max_tilt: planes that are tilted more against the frame's z are refused [rad]
    :param max_offset: planes that pass the expected floor farther off, below the frame's origin, are refused [m]
    :param threshold: points this near a plane are on it [m]
    :param reach: points up to this level range vote [m]
    :param min_points: planes with fewer points are refused
    :param fit: fit_by_pcl or fit_by_numpy; None: PCL's where it is installed
    :param random: RandomState that draws who votes; None: seeded with 0
    :raises ValueError: where a limit is not above 0, or PCL is asked for and not installed
    """

    def __init__(self, mount_height, max_tilt=MAX_TILT, max_offset=0.15, threshold=0.04, reach=8.0,
                 min_points=50, fit=None, random=None):
        limits = {'max_tilt': max_tilt, 'max_offset': max_offset, 'threshold': threshold, 'reach': reach,
                  'min_points': min_points}
        for name, value in limits.items():
            if not value > 0:
                raise ValueError('%s is %r, must be above 0' % (name, value))
        if fit is fit_by_pcl and pcl is None:
            raise ValueError("PCL's Python module (python3-pcl) is not installed")
        self.mount_height, self.max_tilt, self.max_offset = mount_height, max_tilt, max_offset
        self.threshold, self.reach, self.min_points = threshold, reach, min_points
        self._fit = fit or (fit_by_numpy if pcl is None else fit_by_pcl)
        self._random = random or np.random.RandomState(0)
        self._known = Plane(np.array([0.0, 0.0, 1.0]), float(mount_height), ASSUMED)

    def find(self, xyz):
        """The ground in a scan.

        :param xyz: (n, 3) float [m], z up within max_tilt; points that are not finite are ignored
        :return: Plane; its source tells whether it is of this scan
        """
        points = self.candidates(np.asarray(xyz, np.float32))
        for _ in range(TRIES if len(points) >= self.min_points else 0):
            voters = points[self._random.permutation(len(points))[:VOTERS]]
            found = self._fit(voters, self.threshold, self._random)
            if found is not None and self._is_ground(voters, *found):
                self._known = Plane(*found, source=LAST)
                return Plane(*found)
        return self._known

    def candidates(self, xyz):
        """(m, 3) float32: the points of flat places that the ground may reach when it is tilted."""
        x, y, z = np.ascontiguousarray(xyz.T)
        with np.errstate(invalid='ignore', over='ignore'):
            height, level = z + np.float32(self.mount_height), np.hypot(x, y)
            rise = self._rise(level)
            near = np.flatnonzero((level > 0) & (level < self.reach) & (height > -rise) & (height < LOW))
        x, y, height, rise = (values[near] for values in (x, y, height, rise))
        row, column = (((values + np.float32(self.reach)) / np.float32(CELL)).astype(np.intp) for values in (x, y))
        cell = row * (int(2 * self.reach / CELL) + 1) + column
        count = np.maximum(np.bincount(cell), 1)
        mean = np.bincount(cell, height) / count
        variance = np.bincount(cell, (height - mean[cell]) ** 2) / count
        return xyz[near[(variance < self.threshold ** 2)[cell] & (height < rise)]]

    def _rise(self, level):
        """How far from the expected floor the ground may be at a level range [m]."""
        return SLACK + np.tan(self.max_tilt + TILT_ERROR) * level

    def _is_ground(self, points, normal, offset):
        """Whether a plane is near enough to the expected floor, and on enough points."""
        level_enough = normal[2] >= np.cos(self.max_tilt + TILT_ERROR)
        if not level_enough or abs(offset / normal[2] - self.mount_height) > self.max_offset:
            return False
        return np.count_nonzero(np.abs(Plane(normal, offset).height(points)) < self.threshold) >= self.min_points


def fit_by_pcl(points, threshold, random):
    """The plane that most points are on: PCL's RANSAC, which needs no random numbers from outside.

    :param points: (n, 3) float32 [m], n >= 3; threshold: of a point's distance [m]
    :return: (3,) float64 unit normal with z >= 0, float offset; None where there is no plane
    """
    segmenter = pcl.PointCloud(points).make_segmenter()
    segmenter.set_model_type(pcl.SACMODEL_PLANE)
    segmenter.set_method_type(pcl.SAC_RANSAC)
    segmenter.set_distance_threshold(threshold)
    segmenter.set_MaxIterations(HYPOTHESES)
    segmenter.set_optimize_coefficients(True)
    inliers, coefficients = segmenter.segment()
    return _upward(np.array(coefficients[:3]), coefficients[3]) if inliers else None


def fit_by_numpy(points, threshold, random):
    """The plane that most points are on, as fit_by_pcl. :param random: RandomState that draws the hypotheses."""
    triples = points[random.randint(len(points), size=(HYPOTHESES, 3))].astype(np.float64)
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    planes = lengths > 1e-9      # not of three points in a line
    if not planes.any():
        return None
    normals = (normals[planes] / lengths[planes, np.newaxis]).astype(np.float32)
    offsets = -np.einsum('ij,ij->i', normals, triples[planes, 0].astype(np.float32))
    on_it = np.abs(np.einsum('ij,kj->ik', normals, points) + offsets[:, np.newaxis]) < threshold
    inliers = points[on_it[on_it.sum(axis=1).argmax()]].astype(np.float64)
    # and of those the plane with the least squared distances: its normal is where they spread least
    centre = inliers.mean(axis=0)
    normal = np.linalg.eigh(np.cov((inliers - centre).T))[1][:, 0]
    return _upward(normal, -normal @ centre)


def _upward(normal, offset):
    """Of the two ways to write a plane the one with z >= 0, and of unit length."""
    scale = np.copysign(1 / np.linalg.norm(normal), normal[2])
    return normal * scale, float(offset * scale)
