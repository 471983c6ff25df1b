# SPDX-License-Identifier: BSD-3-Clause
from typing import Any

import numpy as np
import pytest

from smokebot_udp.simulation.camera import Camera
from smokebot_udp.simulation.drive import HALT, Drive
from smokebot_udp.simulation.pinhole import Pinhole
from smokebot_udp.simulation.rays import NOTHING, ranges
from smokebot_udp.simulation.smoke import Smoke
from smokebot_udp.simulation.thermal import ThermalCamera, to_counts
from smokebot_udp.simulation.world import CEILING, FLOOR, ROOF, Prism, World, building

EYE = Pinhole(160, 120, np.radians(70), 0.6)


def box(name='box', centre=(3.0, 0.0), size=(2.0, 4.0), bottom=0.0, top=CEILING, temperature=30.0, flicker=0.0) -> Any:
    return Prism(name, centre, size, 0.0, bottom, top, temperature, (10, 20, 30), flicker)


def test_a_ray_at_a_known_wall_has_a_known_length() -> None:
    world = World([box()])                                    # its near face is x = 2
    distance, surface = ranges(world, (0.0, 0.0), 0.6, np.array([0.0, np.pi]), np.array([0.0]), floor=False)
    assert distance[0, 0] == pytest.approx(2.0) and surface[0, 0] == 0
    assert np.isinf(distance[1, 0]) and surface[1, 0] == NOTHING


def test_rays_meet_floor_ceiling_and_the_top_of_low_things() -> None:
    world = World([box(top=0.3)])
    slopes = np.array([-1.0, -0.1, 0.1])
    distance, surface = ranges(world, (0.0, 0.0), 0.6, np.array([0.0]), slopes)
    assert surface.tolist() == [[FLOOR, 0, ROOF]]
    assert distance[0] == pytest.approx([0.6, 3.0, 21.0])     # from 0.6 down to 0.3 at 1 in 10


@pytest.mark.parametrize('seed', [0, 1, 7])
def test_the_picture_and_the_rays_see_the_same(seed) -> None:
    world = building(seed)
    for time in (0.0, 31.0, 77.0):
        pose = Drive().pose(time)
        view = EYE.look(world, pose)
        row = 80
        right = (np.arange(EYE.width) - (EYE.width - 1) / 2) / EYE.focal_length
        up = ((EYE.height - 1) / 2 - row) / EYE.focal_length
        for column in range(0, EYE.width, 7):
            stretch = np.hypot(1.0, right[column])
            distance, surface = ranges(world, pose[:2], EYE.mount, np.array([pose[2] - np.arctan(right[column])]),
                                       np.array([up / stretch]))
            assert surface[0, 0] == view.surface[row, column]
            assert distance[0, 0] == pytest.approx(view.depth[row, column] * stretch, rel=1e-3)


def test_the_same_seed_is_the_same_building_fire_and_noise() -> None:
    pictures = [ThermalCamera(building(seed), EYE, seed).look(Drive().pose(20.0), 20.0) for seed in (3, 3, 4)]
    assert (pictures[0] == pictures[1]).all()
    assert (pictures[0] != pictures[2]).any()


def test_a_fire_is_hot_where_it_stands() -> None:
    world = building(1)
    for fire in np.flatnonzero(world.flicker > 0):
        x, y = world.prisms[fire].centre
        pose = x - 1.5, y, 0.0
        column, row, depth = EYE.project(pose, (x - world.prisms[fire].size[0] / 2, y, 0.3))
        counts = ThermalCamera(world, EYE, 1).look(pose, 5.0)
        assert counts[int(round(row)), int(round(column))] > to_counts(200.0)
        assert counts[5, 5] < to_counts(150.0)


def test_counts_are_kelvin_by_0_04() -> None:
    assert to_counts(0.0) == pytest.approx(6828.75)
    world = World([box(size=(2.0, 40.0), temperature=30.0)])
    counts = ThermalCamera(world, EYE, 1, noise=0.0).look((0.0, 0.0, 0.0), 0.0)
    view = EYE.look(world, (0.0, 0.0, 0.0))
    middle = counts[view.surface == 0] * 0.04 - 273.15
    assert abs(np.median(middle) - 32.0) < 3.0                # the wall, warmer towards the ceiling


def test_smoke_hides_what_is_far() -> None:
    world = building(1)
    pose = (1.5, 7.0, 0.0)
    clear, thick = (Camera(world, EYE, 1, smoke=smoke, noise=0.0).look(pose, 0.0).astype(float) for smoke in (0.0, 0.5))
    assert thick[40:80].std() < clear[40:80].std() / 2


def test_smoke_keeps_the_contrast_of_beer_and_lambert_and_billows_about_it() -> None:
    wall = World([box(centre=(3.0, 0.0), size=(2.0, 40.0))])      # 2 m ahead
    view = EYE.look(wall, (0.0, 0.0, 0.0))
    quiet, billowing = (Smoke(EYE, 0.5, billows, 1).clear(view, 0.0, 3.0) for billows in (0.0, 0.5))
    row = 60                                                      # z is 0.6 m: 0.7 + 0.5 z is 1
    assert quiet[row] == pytest.approx(np.exp(-0.5 * view.depth[row] * (0.7 + 0.5 * view.z[row])), rel=1e-4)
    extinction = np.log(billowing) / np.log(quiet)
    assert 0.45 < extinction.min() < 0.9 and 1.1 < extinction.max() < 1.8


def test_billows_turn_with_the_world() -> None:
    smoke, view = Smoke(EYE, 0.5, 0.5, 1), EYE.look(World([box(size=(2.0, 40.0))]), (0.0, 0.0, 0.0))
    ahead, left = (np.log(smoke.clear(view, yaw, 3.0)) for yaw in (0.0, 20 / EYE.focal_length))
    assert left[:, 20:] == pytest.approx(ahead[:, :-20], rel=1e-3)     # what was ahead is 20 pixels to the right
    assert smoke.clear(view, 50.0, 1e5).shape == (120, 160)            # also after days and many turns
    assert (smoke.clear(view, 0.0, 3.5) != smoke.clear(view, 0.0, 3.0)).any()


@pytest.mark.parametrize('seed', range(4))
def test_people_are_warmer_than_what_surrounds_them(seed) -> None:
    world = building(seed)
    people = [index for index, prism in enumerate(world.prisms) if prism.name.startswith('person')]
    assert len(people) == 4 * 4 + 2 * 3 and not world.flicker[people].any()
    pose = 1.5, 7.0, 0.0                                               # both who sit in the corridor are seen
    view, celsius = EYE.look(world, pose), ThermalCamera(world, EYE, 1).look(pose, 0.0) * 0.04 - 273.15
    seen = np.isin(view.surface, people)
    beside = ~seen & (view.depth < 8) & (view.z < 0.9)
    assert seen.sum() > 100 and np.median(celsius[seen]) > np.percentile(celsius[beside], 99) + 3


def test_the_drive_touches_nothing_and_closes() -> None:
    drive = Drive(0.7)
    times = np.arange(0.0, drive.period, 0.1)
    for seed in range(5):
        world = building(seed)
        assert min(world.distance(drive.pose(time)[:2]) for time in times) > 0.25
    start, end = drive.pose(0.0), drive.pose(drive.period)
    assert end[:2] == pytest.approx(start[:2])
    assert np.cos(end[2] - start[2]) == pytest.approx(1.0)


def test_the_drive_moves_and_stands() -> None:
    drive = Drive(0.7)
    twists = np.array([drive.twist(time) for time in np.arange(0.05, drive.period - 0.05, 0.1)])
    assert np.abs(twists[:, 0]).max() == pytest.approx(0.7, rel=1e-3)
    standing = (np.abs(twists) < 1e-6).all(axis=1)
    assert standing.mean() * drive.period == pytest.approx(7 * HALT, rel=0.1)


def test_a_standing_robot_sees_the_same_picture_without_noise() -> None:
    world, drive = building(2), Drive()
    camera = ThermalCamera(world, EYE, 1, noise=0.0)
    still = next(t for t in np.arange(0.0, drive.period, 0.1) if drive.twist(t) == (0.0, 0.0)) + 0.5
    first, second = (camera.look(drive.pose(t), 0.0) for t in (still, still + 1.0))
    moving = camera.look(drive.pose(still - 3.0), 0.0)
    assert (first == second).all() and (first != moving).any()
