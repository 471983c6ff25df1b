# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, Callable, Iterable, List, Sequence, Tuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.arrays import Array, Float32Array, FloatArray
from smokebot_udp.codecs.perception.ground import GroundFinder, Plane
from smokebot_udp.codecs.perception.virtual_scan import ANGLE_MIN, COLUMNS, INCREMENT, fan, landmark_scan, obstacle_scan
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.lidar import COLUMNS as AZIMUTHS
from smokebot_udp.simulation.lidar import RINGS, Lidar
from smokebot_udp.simulation.rays import ranges as cast
from smokebot_udp.simulation.world import World, building

FLOOR = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
"""The floor in a base frame."""

AHEAD = COLUMNS // 2
MOUNT, TOLERANCE, MAX_HEIGHT = 0.9, 0.1, 1.2


def points(*cylindrical: Tuple[float, float, float]) -> Float32Array:
    """(n, 3) float32 of (column, range, height) each; a column's fractions are directions within it."""
    column, distance, height = np.array(cylindrical, float).reshape(-1, 3).T
    bearing = ANGLE_MIN + column * INCREMENT
    return np.stack([distance * np.cos(bearing), distance * np.sin(bearing), height], axis=1).astype(np.float32)


def scans(xyz: Array, plane: Plane = FLOOR, **limits: float) -> Tuple[Float32Array, Float32Array]:
    """The obstacle scan and the landmark scan of points."""
    above = fan(xyz, plane, **limits)
    return obstacle_scan(above), landmark_scan(above)


def wall(columns: Iterable[int], distance: Callable[[int], float],
         heights: Sequence[float] = (0.4, 0.8, 1.2, 1.6)) -> Float32Array:
    """Points of an upright surface: in these columns, at distance(column)."""
    return points(*[(column, distance(column), height) for column in columns for height in heights])


def straight(far: float) -> Callable[[int], float]:
    """The range of a wall in each column: it stands across the way, `far` metres ahead."""
    return lambda column: far / np.cos((column - AHEAD) * INCREMENT)


def rotation(pitch: float, roll: float) -> FloatArray:
    p, r = np.radians(pitch), np.radians(roll)
    about_y = np.array([(np.cos(p), 0, np.sin(p)), (0, 1, 0), (-np.sin(p), 0, np.cos(p))])
    return about_y @ np.array([(1, 0, 0), (0, np.cos(r), -np.sin(r)), (0, np.sin(r), np.cos(r))])


# by hand

def test_columns_are_a_laser_scans() -> None:
    obstacles, _ = scans(np.array([(2, 0, 0.5), (0, 3, 0.5), (-4, 0, 0.5), (0, -5, 0.5)], np.float32))
    found = np.flatnonzero(np.isfinite(obstacles))
    assert obstacles.shape == (COLUMNS,) and obstacles.dtype == np.float32
    assert found.tolist() == [0, 180, 360, 540]
    assert obstacles[found] == pytest.approx([4, 5, 2, 3])


@pytest.mark.parametrize('within, column', [
    (-0.6, 99), (-0.5, 100), (-0.4, 100), (0, 100), (0.4, 100), (0.5, 101), (0.6, 101)])
def test_a_column_is_half_open_around_its_direction(within, column) -> None:
    for distance in (1.0, 7.7, 60.0):
        obstacles, _ = scans(points((100 + within, distance, 0.5)))
        assert np.flatnonzero(np.isfinite(obstacles)).tolist() == [column]


@pytest.mark.parametrize('column', [-0.4, 0, 0.4, 719.6, 720, 719.4])
def test_column_0_is_behind_on_both_sides(column) -> None:
    obstacles, _ = scans(points((column, 5, 0.5)))
    assert np.flatnonzero(np.isfinite(obstacles)).tolist() == [719 if column == 719.4 else 0]


def test_the_nearest_above_the_ground_and_below_the_limit() -> None:
    obstacles, _ = scans(points((7, 1, 0.05), (7, 2, 1.3), (7, 4, 0.15), (7, 5, 0.5), (8, 3, 1.19), (9, 3, 1.21)))
    assert obstacles[[7, 8]] == pytest.approx([4, 3]) and obstacles[9] == np.inf


def test_the_nearest_surfaces_noise_is_averaged() -> None:
    obstacles, _ = scans(points((7, 2.0, 0.3), (7, 2.02, 0.4), (7, 2.09, 0.5), (7, 2.12, 0.6), (7, 3, 0.6)))
    assert obstacles[7] == pytest.approx((2.0 + 2.02 + 2.09) / 3)


def test_rep_117() -> None:
    obstacles, landmarks = scans(points(
        (1, 0.3, 0.5), (1, 3.0, 0.5),     # too close
        (2, 0.3, 0.5),                    # only too close
        (3, 3.0, 0.02), (4, 3.0, 2.5),    # ground; out of the way
        (5, 31.0, 0.5),                   # farther than asked for
        (6, 0.3, 0.02)), range_max=30.0)  # the ground beside the robot is not too close
    assert obstacles[1:7].tolist() == [-np.inf, -np.inf, np.inf, np.inf, np.inf, np.inf]
    assert landmarks[1:7].tolist() == [np.inf, -np.inf, np.inf, np.inf, np.inf, np.inf]
    assert np.isnan(obstacles[7:]).all() and np.isnan(landmarks[7:]).all() and np.isnan(obstacles[0])


@pytest.mark.parametrize('nothing', [
    np.zeros((0, 3), np.float32), np.full((50, 3), np.nan, np.float32), np.full((50, 3), np.inf, np.float32),
    np.full((50, 3), -np.inf, np.float32), np.zeros((50, 3), np.float32), np.array([(1, np.nan, 1), (2, 2, np.nan)])])
def test_no_returns_are_missing_not_free(nothing) -> None:
    for plane in (FLOOR, Plane(rotation(5, 5)[:, 2], 0.9)):
        for scan in scans(nothing, plane):
            assert np.isnan(scan).all() and scan.shape == (COLUMNS,) and scan.dtype == np.float32


def test_bare_ground_is_free() -> None:
    for scan in scans(points(*[(column, 3 + column % 5, 0.0) for column in range(COLUMNS)])):
        assert (scan == np.inf).all()


def test_a_straight_wall_is_a_landmark_and_what_stands_before_it_is_not() -> None:
    columns = np.arange(320, 400)
    crate = wall(range(350, 370), straight(2.0), heights=(0.2, 0.4, 0.6))
    obstacles, landmarks = scans(np.concatenate([wall(columns, straight(5.0)), crate]))
    assert landmarks[columns] == pytest.approx(straight(5.0)(columns), abs=1e-5)
    assert obstacles[350:370] == pytest.approx(straight(2.0)(np.arange(350, 370)), abs=1e-5)
    assert np.isnan(landmarks[400:]).all()


def test_what_lies_flat_is_no_landmark() -> None:
    """A ceiling: in a column no two rings meet it at the same range."""
    ceiling = points(*[(column, far, 2.7) for column in range(COLUMNS) for far in (6.7, 7.8, 9.3, 11.4)])
    _, landmarks = scans(ceiling)
    assert (landmarks == np.inf).all()
    table = points(*[(column, far, 0.75) for column in range(COLUMNS) for far in np.arange(1, 3, 0.02)])
    _, landmarks = scans(table)
    assert (landmarks == np.inf).all()


def test_two_points_over_each_other_are_no_surface() -> None:
    _, landmarks = scans(wall(range(300, 400), straight(4.0), heights=(0.5, 2.0)))
    assert not np.isfinite(landmarks).any()


def test_a_ramp_ahead_is_no_landmark() -> None:
    """10 degrees, and seen by a dense scanner."""
    far = np.arange(2, 8, 0.02)
    _, landmarks = scans(points(*[(column, r, np.tan(np.radians(10)) * r) for column in range(300, 420) for r in far]))
    assert not np.isfinite(landmarks).any()


def test_what_is_upright_but_not_flat_is_no_landmark() -> None:
    """As leaves are: each column's range is another."""
    random = np.random.RandomState(0)
    for far in (4.0, 20.0):
        scattered = random.uniform(far - 0.25, far + 0.25, COLUMNS)
        _, landmarks = scans(wall(range(300, 420), lambda column, scattered=scattered: scattered[column]))
        assert np.isfinite(landmarks).sum() < 12
        _, landmarks = scans(wall(range(300, 420), lambda column, far=far: far))
        assert np.isfinite(landmarks).sum() == 120


@pytest.mark.parametrize('far', [0.6, 1.0, 3.0, 10.0])
def test_a_noisy_wall_is_flat(far) -> None:
    """With what remains of 3 cm in the mean of eight points."""
    noise = np.random.RandomState(0).normal(0, 0.03 / np.sqrt(8), COLUMNS)
    _, landmarks = scans(wall(range(300, 420), lambda column: straight(far)(column) + noise[column]))
    assert np.isfinite(landmarks).sum() > 110


def test_a_wall_too_close_is_no_landmark_but_hides_one() -> None:
    columns = np.arange(330, 390)
    obstacles, landmarks = scans(wall(columns, lambda column: 0.3))
    assert (obstacles[columns] == -np.inf).all() and (landmarks[columns] == -np.inf).all()
    behind = wall(columns, straight(3.0), heights=(1.8, 2.0, 2.2))
    _, landmarks = scans(np.concatenate([wall(columns, lambda column: 0.3), behind]))
    assert landmarks[columns] == pytest.approx(straight(3.0)(columns), abs=1e-5)


def test_a_lone_pole_is_no_landmark() -> None:
    _, landmarks = scans(wall([360, 361], straight(4.0)))
    assert not np.isfinite(landmarks).any()


@pytest.mark.parametrize('edge', [0, 5, 717])
def test_a_wall_goes_on_behind_the_robot(edge) -> None:
    columns = np.arange(edge - 20, edge + 20)
    _, landmarks = scans(wall(columns, lambda column: 3 / np.cos(column * INCREMENT)))
    assert landmarks[columns % COLUMNS] == pytest.approx(3 / np.cos(columns * INCREMENT), abs=1e-5)


def test_a_wall_ends_at_a_door() -> None:
    """Its last columns have neighbours on one side only; behind the door is another wall."""
    near, far = np.arange(330, 350), np.arange(350, 390)
    _, landmarks = scans(np.concatenate([wall(near, straight(2.0)), wall(far, straight(7.0))]))
    assert landmarks[near] == pytest.approx(straight(2.0)(near), abs=1e-5)
    assert landmarks[far] == pytest.approx(straight(7.0)(far), abs=1e-5)


def test_the_slope_lets_the_ground_be_farther_from_the_plane_far_away() -> None:
    xyz = points((7, 5, 0.14), (8, 20, 0.14), (9, 20, 0.4))
    assert obstacle_scan(fan(xyz, FLOOR))[7:10] == pytest.approx([5, 20, 20])
    assert obstacle_scan(fan(xyz, FLOOR, slope=0.01))[7:10].tolist() == pytest.approx([np.inf, np.inf, 20])


@pytest.mark.parametrize('limits', [
    {'range_min': -0.1}, {'range_min': 5.0, 'range_max': 5.0}, {'range_max': 1001.0}, {'range_min': float('nan')}])
def test_impossible_limits(limits) -> None:
    with pytest.raises(ValueError, match='ranges from'):
        fan(points((0, 1, 1)), FLOOR, **limits)


# properties

places = st.tuples(st.integers(0, COLUMNS - 1), st.sampled_from([-0.4, -0.25, 0.0, 0.3]),
                   st.integers(1, 80), st.integers(-2, 30))


def cloud(drawn: Sequence[Tuple[int, float, int, int]]) -> List[Tuple[float, float, float]]:
    """Points whose ranges are a quarter of a metre apart and whose heights keep away from the limits."""
    return [(column + within, 0.25 * steps, 0.1 * level + 0.03) for column, within, steps, level in drawn]


clouds = st.lists(places, max_size=60).map(cloud)
walls = st.builds(
    lambda first, count, steps: [(first + i, 0.25 * steps, h) for i in range(count) for h in (0.33, 0.73, 1.13)],
    st.integers(0, COLUMNS - 1), st.integers(1, 40), st.integers(2, 80))
scenes = st.builds(lambda a, b, c: a + b + c, clouds, walls, walls)


def same(one: Any, other: Any) -> bool:
    return np.allclose(one, other, rtol=1e-5, atol=1e-5, equal_nan=True)


@given(scenes, st.integers(-COLUMNS, COLUMNS))
def test_turning_the_points_by_columns_turns_the_scans(scene, columns) -> None:
    for scan, turned in zip(scans(points(*scene)), scans(points(*[(c + columns, r, h) for c, r, h in scene]))):
        assert same(np.roll(scan, columns), turned)


@given(scenes, st.randoms(use_true_random=False))
def test_the_order_of_the_points_is_nothing(scene, random) -> None:
    shuffled = list(scene)
    random.shuffle(shuffled)
    for scan, other in zip(scans(points(*scene)), scans(points(*shuffled))):
        assert same(scan, other)


@given(scenes)
def test_missing_points_change_nothing(scene) -> None:
    xyz = points(*scene)
    missing = np.concatenate([np.full((9, 3), np.nan), np.zeros((9, 3)), xyz, np.full((9, 3), np.inf)])
    for scan, other in zip(scans(xyz), scans(missing)):
        np.testing.assert_array_equal(scan, other)


@given(scenes)
def test_the_obstacle_scan_is_the_least_range_of_each_column(scene) -> None:
    """By a loop."""
    obstacles, _ = scans(points(*scene))
    for column in range(COLUMNS):
        here = [(r, h) for c, r, h in scene if round(c) % COLUMNS == column]
        nearest = min((r for r, h in here if TOLERANCE < h <= MAX_HEIGHT), default=np.inf if here else np.nan)
        assert same(obstacles[column], -np.inf if nearest < 0.4 else nearest)


@given(scenes)
def test_landmarks_are_where_points_are(scene) -> None:
    _, landmarks = scans(points(*scene))
    for column in np.flatnonzero(np.isfinite(landmarks)):
        assert min(abs(r - landmarks[column]) for c, r, h in scene if round(c) % COLUMNS == column) < 1e-4


@given(scenes, st.floats(-10, 10), st.floats(-10, 10), st.floats(-2, 2))
def test_only_the_points_relative_to_the_plane_matter(scene, pitch, roll, mount) -> None:
    xyz = points(*scene)
    plane = Plane(rotation(pitch, roll)[:, 2], mount)
    tilted = (xyz - np.array([0, 0, mount])) @ plane.axes()
    for scan, other in zip(scans(xyz), scans(tilted, plane)):
        finite = np.isfinite(scan) & np.isfinite(other)
        assert (np.isfinite(scan) == np.isfinite(other)).all()
        assert np.allclose(scan[finite], other[finite], atol=1e-3)


# numbers

def truth(world: World, pose: Tuple[float, float, float]) -> Tuple[FloatArray, FloatArray]:
    """What the rings see from a pose: (COLUMNS,) the nearest obstacle or inf, (COLUMNS,) the farthest wall or -inf [m].

    By ray casting and surface ids alone. Each column holds two of the scanner's directions: its own, and the one on its
    border with the column before.
    """
    azimuths = np.arange(AZIMUTHS) * (2 * np.pi / AZIMUTHS)
    level, surface = cast(world, pose[:2], MOUNT, azimuths + pose[2], np.tan(RINGS))
    height = MOUNT + level * np.tan(RINGS)
    in_the_way = (surface >= 0) & (height > TOLERANCE) & (height <= MAX_HEIGHT)
    obstacles = np.where(in_the_way, level, np.inf).min(axis=1)
    walls = np.where((surface >= 0) & world.to_ceiling[surface], level, -np.inf).max(axis=1)
    own = 2 * ((np.arange(COLUMNS) + COLUMNS // 2) % COLUMNS)      # column 0 is behind
    return np.minimum(obstacles[own], obstacles[own - 1]), np.maximum(walls[own], walls[own - 1])


def shares(noise: float, bound: float, pitch: float = 0, roll: float = 0, seeds: Sequence[int] = (1, 4),
           every: int = 8) -> FloatArray:
    """Ratios of the columns whose range is within the bound of the truth, at poses `every` seconds apart:
    (poses, 2), obstacles and landmarks."""
    tilt = rotation(pitch, roll).T.astype(np.float32)
    result = []
    for seed in seeds:
        world = building(seed)
        lidar, drive, finder = Lidar(world, mount=MOUNT, seed=1, noise=noise), Drive(), GroundFinder(MOUNT)
        for time in range(0, 240, every):
            seen = lidar.scan(drive.pose(time), time)
            xyz = np.stack([seen['x'], seen['y'], seen['z']], axis=1) @ tilt
            obstacles, landmarks = scans(xyz, finder.find(xyz))
            nearest, farthest = truth(world, drive.pose(time))
            with np.errstate(invalid='ignore'):
                right = (np.abs(obstacles - nearest) <= bound) | (np.isinf(obstacles) & np.isinf(nearest))
                walls = np.abs(landmarks - farthest) <= bound
            result.append((right.mean(), walls[np.isfinite(farthest)].mean()))
    return np.array(result)


@pytest.mark.parametrize('noise, bound', [(0, 0.05), (0.03, 0.1)])
def test_the_scans_of_the_building_are_right(noise, bound) -> None:
    obstacles, landmarks = shares(noise, bound).T
    # with noise a ring that meets somebody who lies there some mm below TOLERANCE may be above it
    assert obstacles.min() >= (0.98 if noise else 0.99) and landmarks.mean() >= 0.98
    # where but one ring looks over a shelf, what it sees may as well be the ceiling
    assert landmarks.min() >= 0.9


@pytest.mark.parametrize('pitch, roll', [(10, 0), (-10, 0), (0, 10), (0, -10), (4, 0)])
@pytest.mark.parametrize('noise, bound', [(0, 0.05), (0.03, 0.1)])
def test_the_scans_of_a_tilted_robot_are_right(noise, bound, pitch, roll) -> None:
    obstacles, landmarks = shares(noise, bound, pitch, roll, seeds=(1,), every=20).T
    assert obstacles.mean() >= 0.99 and landmarks.mean() >= 0.97
