# SPDX-License-Identifier: BSD-3-Clause
"""The ground plane under the robot, found by RANSAC near the expected floor (D6.3, section 6.2).

Walls could outvote the little floor that is seen between them, so only points of flat places vote: those in a cell of
the floor plan in which all points have about the same height.

The plane is fitted by loops that numba compiles, or by numpy where these are not loaded; both draw the same random
points, and give the same plane. PCL's RANSAC is not used: its random numbers cannot be seeded, so a robot with PCL
would see another plane than one without. With 1000 voters from the simulated building the loops
take 0.12 ms, PCL 0.13 ms, numpy 0.9 ms; `./smokebot bench codecs` repeats it.
"""
from dataclasses import dataclass
from typing import Callable, Optional, Tuple

import numpy as np

from ...arrays import Array, Float32Array, FloatArray, IntArray

CELL = 0.4
"""Side of a cell of the floor plan [m]: on a ramp of 10 degrees its heights have a standard deviation of 3 cm."""

MAX_HEIGHT = 1.0
"""Points higher above the expected floor do not affect whether a cell is flat: they may be the ceiling [m]."""

SLACK = 0.1
"""Distance from the expected floor up to which points are candidates at any range [m]."""

TILT_ERROR = np.radians(1)
"""Measurement error by which a plane may exceed max_tilt [rad]."""

HYPOTHESES = 100
"""If half of the points are on the floor, three random points all are, with a probability of 1/8."""

ATTEMPTS = 3
"""Three points of one corner of the floor make a poor plane: if it is refused, other random points are tried."""

MAX_TILT = np.radians(10)
"""Default limit of the ground plane's tilt, for ramps and for the robot's own tilt [rad]."""

VOTERS = 1000
"""More points do not improve the plane."""

LEAST_NORMAL = 1e-9
"""Length of the product of the vectors from one point to two others; up to it the three are in a line [m^2]."""

Fit = Callable[[Float32Array, float, np.random.RandomState], Optional[Tuple[FloatArray, float]]]
"""f(points, threshold, random) -> (unit normal, offset) or None; see fit_by_numpy."""


@dataclass(frozen=True, eq=False)
class Plane:
    """The points with normal . point + offset = 0, in the frame of the points it was found in."""
    normal: FloatArray
    """(3,) float64, unit length, upward."""
    offset: float
    """Height of the frame's origin above the plane [m]."""

    def height(self, xyz: Array) -> Array:
        """(n, 3) points [m] -> (n,) height above the plane [m], in the points' dtype."""
        height: Array = _along(xyz.T, self.normal) + xyz.dtype.type(self.offset)
        return height

    def axes(self) -> FloatArray:
        """(3, 3) float64: rows forward, left, up. Up is the normal; forward is the frame's x, projected on it."""
        forward = np.array([1.0, 0.0, 0.0]) - self.normal[0] * self.normal
        forward /= np.linalg.norm(forward)
        return np.array([forward, np.cross(self.normal, forward), self.normal])

    def level(self, xyz: Array) -> Tuple[Array, Array, Array]:
        """Coordinates along the plane.

        :param xyz: (n, 3) points [m]
        :return: (n,) each, x forward and y left from the frame's origin, and height above the plane [m], in the points'
            dtype
        """
        rows = np.ascontiguousarray(xyz.T)
        x, y, z = (_along(rows, axis) for axis in self.axes())
        return x, y, z + rows.dtype.type(self.offset)


def _along(rows: Array, direction: FloatArray) -> Array:
    """(3, n) coordinates -> (n,) their component in a direction."""
    # no matrix product: BLAS would wake a thread on each core for it
    a, b, c = direction.astype(rows.dtype)
    component: Array = rows[0] * a + rows[1] * b + rows[2] * c
    return component


class GroundFinder:
    """Finds the ground in successive scans. If a scan does not show it, the last plane is returned.

    :param mount_height: of the frame's origin above the floor [m]; 0 for points in the robot's base frame
    :param max_tilt: planes that are tilted more against the frame's z are refused [rad]
    :param max_offset: planes that are farther from the expected floor, below the frame's origin, are refused [m]
    :param threshold: points this near a plane are on it [m]
    :param reach: points up to this horizontal range vote [m]
    :param min_points: planes with fewer points are refused
    :param fit: None: fit_by_loops where they are loaded, else fit_by_numpy
    :param random: selects the voters; None: seeded with 0
    :raises ValueError: a limit is not above 0
    """

    def __init__(self, mount_height: float, max_tilt: float = MAX_TILT, max_offset: float = 0.15,
                 threshold: float = 0.04, reach: float = 8.0, min_points: int = 50, fit: Optional[Fit] = None,
                 random: Optional[np.random.RandomState] = None) -> None:
        limits = {'max_tilt': max_tilt, 'max_offset': max_offset, 'threshold': threshold, 'reach': reach,
                  'min_points': min_points}
        for name, value in limits.items():
            if not value > 0:
                raise ValueError('%s is %r, must be above 0' % (name, value))
        self.mount_height, self.max_tilt, self.max_offset = mount_height, max_tilt, max_offset
        self.threshold, self.reach, self.min_points = threshold, reach, min_points
        self.found = False
        """Whether the last scan showed the ground."""
        self._fit = fit
        self._random = random or np.random.RandomState(0)
        self._plane = Plane(np.array([0.0, 0.0, 1.0]), float(mount_height))

    def find(self, xyz: Array, loaded: bool = False) -> Plane:
        """The ground in a scan; or in the last one that showed it; or if there was none, as the mounting height says.

        :param xyz: (n, 3) float [m], z up within max_tilt; points that are not finite are ignored
        :param loaded: whether compiled loops are loaded, see streams/codec.py
        """
        fit = self._fit or (fit_by_loops if loaded else fit_by_numpy)
        xyz = np.asarray(xyz, np.float32)
        rows = self._candidates(xyz)
        self.found = False
        for _ in range(ATTEMPTS if len(rows) >= self.min_points else 0):
            voters = xyz[rows[self._random.permutation(len(rows))[:VOTERS]]]
            fitted = fit(voters, self.threshold, self._random)
            if fitted is not None and self._is_ground(voters, Plane(*fitted)):
                self.found, self._plane = True, Plane(*fitted)
                break
        return self._plane

    def candidates(self, xyz: Float32Array) -> Float32Array:
        """The points of flat places that may be ground, within the tilt allowed: (n, 3) -> (m, 3) float32 [m]."""
        return xyz[self._candidates(xyz)]

    def _candidates(self, xyz: Float32Array) -> IntArray:
        """(m,) int: the rows of these points."""
        x, y, z = np.ascontiguousarray(xyz.T)
        with np.errstate(invalid='ignore', over='ignore'):
            height, distance = z + np.float32(self.mount_height), np.hypot(x, y)
            rise = SLACK + np.tan(self.max_tilt + TILT_ERROR) * distance
            near = np.flatnonzero((distance > 0) & (distance < self.reach) & (height > -rise) & (height < MAX_HEIGHT))
        x, y, height, rise = (values[near] for values in (x, y, height, rise))
        row, column = (((values + np.float32(self.reach)) / np.float32(CELL)).astype(np.intp) for values in (x, y))
        cell = row * (int(2 * self.reach / CELL) + 1) + column
        count = np.maximum(np.bincount(cell), 1)
        mean = np.bincount(cell, height) / count
        variance = np.bincount(cell, (height - mean[cell]) ** 2) / count
        candidates: IntArray = near[(variance < self.threshold ** 2)[cell] & (height < rise)]
        return candidates

    def _is_ground(self, points: Float32Array, plane: Plane) -> bool:
        """Whether a plane is near enough to the expected floor, and enough points are on it."""
        up = plane.normal[2]
        if up < np.cos(self.max_tilt + TILT_ERROR) or abs(plane.offset / up - self.mount_height) > self.max_offset:
            return False
        return int(np.count_nonzero(np.abs(plane.height(points)) < self.threshold)) >= self.min_points


def fit_by_numpy(points: Float32Array, threshold: float,
                 random: np.random.RandomState) -> Optional[Tuple[FloatArray, float]]:
    """The plane that most points are on, by RANSAC.

    :param points: (n, 3) float32 [m], n >= 3
    :param threshold: distance up to which points are on a plane [m]
    :param random: selects the points that make a hypothesis
    :return: (3,) float64 unit normal with z >= 0, and offset [m]; None if there is no plane
    """
    triples = points[_triples(points, random)].astype(np.float64)
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    planes = lengths > LEAST_NORMAL
    if not planes.any():
        return None
    normals = normals[planes] / lengths[planes, np.newaxis]
    offsets = -(normals * triples[planes, 0]).sum(axis=1)
    # axis by axis: half the time of one product of (hypotheses, 3) and (3, points)
    a, b, c = normals.astype(np.float32).T[:, :, np.newaxis]
    x, y, z = np.ascontiguousarray(points.T)
    distance = a * x
    distance += b * y
    distance += c * z
    distance += offsets.astype(np.float32)[:, np.newaxis]
    on_plane = np.abs(distance, out=distance) < threshold
    inliers = points[on_plane[np.count_nonzero(on_plane, axis=1).argmax()]].astype(np.float64)
    centre = inliers.mean(axis=0)
    return _least_squares(centre, np.cov((inliers - centre).T))


def fit_by_loops(points: Float32Array, threshold: float,
                 random: np.random.RandomState) -> Optional[Tuple[FloatArray, float]]:
    """As fit_by_numpy. It imports numba."""
    from ..layered.loops import float32
    from . import ground_loops
    count, centre, scatter = ground_loops.best_plane(
        np.array(points.T, np.float32, order='C'), _triples(points, random), float32(threshold), LEAST_NORMAL)
    return _least_squares(centre, scatter) if count else None


def _triples(points: Float32Array, random: np.random.RandomState) -> IntArray:
    """(HYPOTHESES, 3) int64: indexes of the points that make the hypotheses."""
    triples: IntArray = random.randint(len(points), size=(HYPOTHESES, 3))
    return triples


def _least_squares(centre: FloatArray, scatter: FloatArray) -> Tuple[FloatArray, float]:
    """The plane of least squared distances: its normal is the direction in which the points spread least.

    :param centre: (3,) of the points
    :param scatter: (3, 3) of the points about it, in any scale
    """
    normal = np.linalg.eigh(scatter)[1][:, 0]
    return _upward(normal, float(-normal @ centre))


def _upward(normal: FloatArray, offset: float) -> Tuple[FloatArray, float]:
    """The same plane with a normal of unit length and z >= 0."""
    scale = np.copysign(1 / np.linalg.norm(normal), normal[2])
    return normal * scale, float(offset * scale)
