# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, Optional, Tuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluation.pcl_plane import fit_by_pcl, pcl
from smokebot_udp import optional
from smokebot_udp.arrays import Array, Float32Array, FloatArray
from smokebot_udp.codecs.perception import ground
from smokebot_udp.codecs.perception.ground import GroundFinder, Plane, fit_by_loops, fit_by_numpy
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.lidar import Lidar
from smokebot_udp.simulation.world import building

MOUNT = 0.9
needs_numba = pytest.mark.skipif(optional.attempt('numba').module is None, reason='python3-numba is not installed')
PCL = [fit_by_pcl] if pcl is not None else []
FITS = [fit_by_numpy, pytest.param(fit_by_loops, marks=needs_numba),
        pytest.param(fit_by_pcl, marks=pytest.mark.skipif(not PCL, reason='PCL is missing'))]
NOWHERE = np.full((500, 3), np.nan, np.float32)

both_fits = pytest.mark.parametrize('fit', FITS)


def rotation(pitch: float = 0.0, roll: float = 0.0) -> FloatArray:
    """(3, 3): from level axes to those of a sensor that is tilted [degrees]."""
    p, r = np.radians(pitch), np.radians(roll)
    about_y = np.array([(np.cos(p), 0, np.sin(p)), (0, 1, 0), (-np.sin(p), 0, np.cos(p))])
    about_x = np.array([(1, 0, 0), (0, np.cos(r), -np.sin(r)), (0, np.sin(r), np.cos(r))])
    return about_y @ about_x


def floor(height: float = -MOUNT, side: float = 6.0, count: int = 60) -> Float32Array:
    """(n, 3) float32: a square grid of points, level."""
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-side, side, count)] * 2))
    return np.stack([x, y, np.full_like(x, height)], axis=1).astype(np.float32)


def scan(time: float, seed: int = 1, noise: float = 0.03, world: int = 1) -> Float32Array:
    points = Lidar(building(world), mount=MOUNT, seed=seed, noise=noise).scan(Drive().pose(time), time)
    return np.stack([points['x'], points['y'], points['z']], axis=1)


def angle(one: Array, other: Any) -> float:
    """Between two unit vectors [degrees]."""
    return np.degrees(np.arccos(np.clip(np.dot(one, other), -1, 1)))


def test_heights_and_level_axes_by_hand() -> None:
    plane = Plane(np.array([0.6, 0.0, 0.8]), 2.0)
    points = np.array([(0, 0, 0), (0.6, 0, 0.8), (0.8, 0, -0.6), (0, 1, 0)], np.float32)
    assert plane.height(points) == pytest.approx([2, 3, 2, 2])
    x, y, height = plane.level(points)
    assert x == pytest.approx([0, 0, 1, 0], abs=1e-6)
    assert y == pytest.approx([0, 0, 0, 1], abs=1e-6)
    assert height == pytest.approx([2, 3, 2, 2])
    assert x.dtype == height.dtype == plane.height(points).dtype == np.float32


@given(st.floats(-40, 40), st.floats(-40, 40))
def test_level_axes_are_right_handed_and_forward_stays_forward(pitch, roll) -> None:
    axes = Plane(rotation(pitch, roll)[:, 2], 1.0).axes()
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(axes) == pytest.approx(1)
    assert axes[0] @ (0, 1, 0) == pytest.approx(-axes[2, 0] * axes[2, 1] / np.hypot(axes[2, 1], axes[2, 2]), abs=1e-9)
    assert axes[0, 0] > 0


@both_fits
@pytest.mark.parametrize('mount', [0.0, 0.4, 1.5])
def test_a_bare_floor(fit, mount) -> None:
    finder = GroundFinder(mount, fit=fit)
    plane = finder.find(floor(-mount))
    assert finder.found
    assert plane.normal == pytest.approx([0, 0, 1], abs=1e-4)
    assert plane.offset == pytest.approx(mount, abs=1e-4)


@both_fits
@pytest.mark.parametrize('pitch, roll', [(10, 0), (-10, 0), (0, 10), (0, -10), (7, -7), (-3, 2)])
def test_a_tilted_robot_finds_the_floor_of_the_building(fit, pitch, roll) -> None:
    tilt = rotation(pitch, roll)
    for time in range(0, 240, 15):
        finder = GroundFinder(MOUNT, fit=fit)
        plane = finder.find(scan(time) @ tilt.T.astype(np.float32))
        assert finder.found
        assert angle(plane.normal, tilt[:, 2]) < 0.5
        assert plane.offset == pytest.approx(MOUNT, abs=0.02)


@both_fits
@pytest.mark.parametrize('pitch, roll', [(10, 0), (-10, 0), (0, 10), (0, -10)])
def test_on_a_ramp_in_a_level_base_frame(fit, pitch, roll) -> None:
    """The base is on the ground, its frame is level: the ground is not."""
    tilt = rotation(pitch, roll)
    points = (scan(64) + np.array([0, 0, MOUNT], np.float32)) @ tilt.T.astype(np.float32)
    finder = GroundFinder(0.0, fit=fit)
    plane = finder.find(points)
    assert finder.found
    assert angle(plane.normal, tilt[:, 2]) < 0.5
    assert plane.offset == pytest.approx(0.0, abs=0.02)


@both_fits
@pytest.mark.parametrize('world', range(4))
def test_walls_do_not_outvote_the_little_floor_between_them(fit, world) -> None:
    """In the rooms' middles, the lowest ring meets the floor but in the corners."""
    finder = GroundFinder(MOUNT, fit=fit)
    for time in (10, 20, 37, 70, 90, 130, 150):
        plane = finder.find(scan(time, world=world))
        assert finder.found
        assert angle(plane.normal, (0, 0, 1)) < 0.5
        assert plane.offset == pytest.approx(MOUNT, abs=0.02)


def test_candidates_are_points_of_flat_places() -> None:
    finder = GroundFinder(MOUNT)
    along, up = (axis.ravel() for axis in np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-0.9, 0.5, 20)))
    wall = np.stack([np.full(400, 3.1), along, up], axis=1)
    table = floor(0.0, side=1.0)
    far = floor() + np.array([20, 0, 0], np.float32)
    assert len(finder.candidates(wall.astype(np.float32))) == 0
    assert len(finder.candidates(table)) == 0
    assert len(finder.candidates(far)) == 0
    assert len(finder.candidates(floor(side=5.0))) == 3600
    assert len(GroundFinder(0.0).candidates(np.zeros((500, 3), np.float32))) == 0     # no returns


@both_fits
def test_the_plane_has_the_least_squared_distances(fit) -> None:
    random = np.random.RandomState(3)
    points = floor(count=30)
    points[:, 2] += random.normal(0, 0.008, len(points)).astype(np.float32)
    normal, offset = fit(points, 0.05, random)
    centre = points.mean(axis=0).astype(np.float64)
    spread = np.linalg.eigh(np.cov((points - centre).T))
    assert angle(normal, spread[1][:, 0] * np.sign(spread[1][2, 0])) < 0.01
    assert offset == pytest.approx(-normal @ centre, abs=1e-4)
    assert np.linalg.norm(normal) == pytest.approx(1) and normal[2] > 0


@both_fits
def test_outliers_do_not_move_it(fit) -> None:
    random = np.random.RandomState(0)
    outliers = random.uniform((-5, -5, -0.8), (5, 5, 0), (1500, 3)).astype(np.float32)
    normal, offset = fit(np.concatenate([floor(count=40), outliers]), 0.04, random)
    assert angle(normal, (0, 0, 1)) < 0.3 and offset == pytest.approx(MOUNT, abs=0.02)


@both_fits
@pytest.mark.parametrize('refused', [
    floor() @ rotation(pitch=13).T.astype(np.float32),      # too steep
    floor(-MOUNT - 0.3), floor(-MOUNT + 0.3),                # too low, too high
    floor(count=5), NOWHERE, NOWHERE[:0],                    # too few, none, nothing
    np.zeros((500, 3), np.float32)])                         # no returns
def test_fallbacks(fit, refused) -> None:
    finder = GroundFinder(MOUNT, fit=fit, reach=20)
    before = finder.find(refused)
    assert not finder.found
    assert before.normal.tolist() == [0, 0, 1] and before.offset == MOUNT
    good = finder.find(floor(-0.95))
    assert finder.found
    after = finder.find(refused)
    assert not finder.found
    assert after.normal.tolist() == good.normal.tolist()
    assert after.offset == good.offset == pytest.approx(0.95, abs=1e-3)
    finder.find(floor(-0.85))
    assert finder.found


def test_a_refused_plane_is_tried_again_with_other_draws() -> None:
    answers = [(np.array([1.0, 0.0, 0.0]), 0.0), None, (np.array([0.0, 0.0, 1.0]), MOUNT)]
    drawn = []

    def fit(points: Array, threshold: float, random: np.random.RandomState) -> Optional[Tuple[FloatArray, float]]:
        drawn.append(points)
        return answers[len(drawn) - 1]

    finder = GroundFinder(MOUNT, fit=fit)
    finder.find(floor())
    assert finder.found
    assert len(drawn) == 3 and not np.array_equal(drawn[0], drawn[1])


@both_fits
def test_a_steeper_limit_lets_a_steeper_plane_pass(fit) -> None:
    points = floor() @ rotation(roll=13).T.astype(np.float32)
    finder = GroundFinder(MOUNT, max_tilt=np.radians(15), fit=fit)
    plane = finder.find(points)
    assert finder.found and angle(plane.normal, (0, 0, 1)) == pytest.approx(13, abs=0.05)


@both_fits
def test_points_that_are_not_finite_change_nothing(fit) -> None:
    points = np.concatenate([floor(), NOWHERE, np.full((9, 3), np.inf, np.float32), np.zeros((9, 3), np.float32)])
    mixed = points[np.random.RandomState(0).permutation(len(points))]
    plane = GroundFinder(MOUNT, fit=fit).find(mixed)
    assert plane.normal == pytest.approx([0, 0, 1], abs=1e-4) and plane.offset == pytest.approx(MOUNT, abs=1e-4)


@both_fits
def test_the_same_random_numbers_find_the_same_plane(fit) -> None:
    points = scan(20)
    one, other = (GroundFinder(MOUNT, fit=fit, random=np.random.RandomState(5)).find(points) for _ in range(2))
    assert one.normal.tolist() == other.normal.tolist() and one.offset == other.offset


@both_fits
def test_no_plane_through_a_line(fit) -> None:
    line = np.outer(np.arange(200), (0.01, 0.02, 0)).astype(np.float32) - np.array([0, 0, MOUNT], np.float32)
    finder = GroundFinder(MOUNT, fit=fit)
    plane = finder.find(line)
    assert not finder.found and plane.normal.tolist() == [0, 0, 1] and plane.offset == MOUNT


def test_same_points_have_no_plane() -> None:
    for fit in [fit_by_numpy, *([fit_by_loops] if optional.attempt('numba').module else [])]:
        assert fit(np.ones((100, 3), np.float32), 0.04, np.random.RandomState(0)) is None


@needs_numba
@pytest.mark.parametrize('seed', range(20))
@pytest.mark.parametrize('threshold', [0.01, 0.04, 0.3])
def test_the_loops_give_numpys_plane_of_the_same_random_points(seed, threshold) -> None:
    points = scan(3 * seed)
    points = points[np.isfinite(points).all(axis=1)][seed::23]
    one, other = (fit(points, threshold, np.random.RandomState(seed)) for fit in (fit_by_loops, fit_by_numpy))
    np.testing.assert_allclose(one[0], other[0], rtol=0, atol=1e-9)
    assert one[1] == pytest.approx(other[1], abs=1e-9)


@needs_numba
def test_all_ways_find_the_same_planes_in_a_building() -> None:
    """PCL draws other points: its planes are the same within what 3 cm of noise allow."""
    for time in range(0, 240, 15):
        points = scan(time)
        plane, *others = (GroundFinder(MOUNT, fit=fit).find(points) for fit in (fit_by_loops, fit_by_numpy, *PCL))
        for other, tolerance in zip(others, (1e-9, 0.01)):
            np.testing.assert_allclose(other.normal, plane.normal, rtol=0, atol=tolerance)
            assert other.offset == pytest.approx(plane.offset, abs=tolerance)


@pytest.mark.parametrize('loaded, used', [(False, 'fit_by_numpy'), (True, 'fit_by_loops')])
def test_loops_are_used_where_they_are_loaded(loaded, used, monkeypatch) -> None:
    monkeypatch.setattr(ground, used, lambda points, threshold, random: (np.array([0.0, 0.0, 1.0]), MOUNT + 0.01))
    finder = GroundFinder(MOUNT, threshold=0.05)
    assert finder.find(floor(), loaded).offset == MOUNT + 0.01


@pytest.mark.parametrize('limit', ['max_tilt', 'max_offset', 'threshold', 'reach', 'min_points'])
@pytest.mark.parametrize('value', [0, -1, float('nan')])
def test_impossible_limits(limit, value) -> None:
    with pytest.raises(ValueError, match=limit):
        GroundFinder(MOUNT, **{limit: value})
