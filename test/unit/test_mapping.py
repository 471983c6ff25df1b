# SPDX-License-Identifier: BSD-3-Clause
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from smokebot_udp.simulation import mounts
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.lidar import Lidar
from smokebot_udp.simulation.mapping import FREE, LEVEL, OCCUPIED, REACH, RESOLUTION, STEP, UNKNOWN, Mapper
from smokebot_udp.simulation.rays import ranges
from smokebot_udp.simulation.world import Prism, World, building

POSES = [Drive().pose(time) for time in (0.0, 11.0, 23.0, 47.0)]


def centres(mapper, state) -> Any:
    """(n, 2) of the cells of this state [m]."""
    rows, columns = np.nonzero(mapper.cells == state)
    return np.array(mapper.origin) + (np.stack([columns, rows], axis=1) + 0.5) * RESOLUTION


def test_a_wall_ahead_is_occupied_before_it_is_free_and_behind_it_unknown() -> None:
    mapper = Mapper(World([Prism('wall', (3.0, 0.0), (2.0, 40.0), 0.0, 0.0, 2.7, 20.0, (0, 0, 0))]))
    assert mapper.update((0.02, 0.02, 0.0))
    row, column = (int(round(-origin / RESOLUTION)) for origin in mapper.origin[::-1])
    ahead = mapper.cells[row, column:]
    assert (ahead[:40] == FREE).all() and ahead[40] == OCCUPIED and (ahead[41:] == UNKNOWN).all()
    assert mapper.cells[row, column - 50] == FREE
    assert len(centres(mapper, FREE)) * RESOLUTION ** 2 < np.pi * REACH ** 2      # what is far is not known, too


def test_what_is_lower_or_higher_than_the_mapped_level_is_no_obstacle() -> None:
    for bottom, top in ((0.0, LEVEL - 0.1), (LEVEL + 0.1, 2.7)):
        mapper = Mapper(World([Prism('box', (3.0, 0.0), (2.0, 2.0), 0.0, bottom, top, 20.0, (0, 0, 0))]))
        mapper.update((0.0, 0.0, 0.0))
        assert not (mapper.cells == OCCUPIED).any()


@pytest.mark.parametrize('pose', POSES)
def test_nothing_is_known_that_was_not_seen(pose) -> None:
    world = building(1)
    mapper = Mapper(world)
    mapper.update(pose)

    def look(azimuths) -> Any:
        return ranges(world, pose[:2], LEVEL, azimuths, np.array([0.0]), floor=False)[0][:, 0]
    away = centres(mapper, FREE) - pose[:2]
    assert len(away) > 1000
    assert (np.hypot(*away.T) < np.minimum(look(np.arctan2(away[:, 1], away[:, 0])), REACH)).mean() > 0.999
    azimuths = np.linspace(-np.pi, np.pi, 20000)
    seen = look(azimuths)[:, np.newaxis] * np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
    distance, _ = cKDTree(seen).query(centres(mapper, OCCUPIED) - pose[:2])
    assert len(distance) > 100 and distance.max() < 0.9 * RESOLUTION     # half a diagonal, and a little


def test_occupied_is_where_the_cloud_sees_walls_and_things() -> None:
    world = building(1)
    mapper, lidar = Mapper(world), Lidar(world, mounts.LIDAR, 1, noise=0.0)
    seen = np.zeros((1000, 1000), bool)
    for pose in POSES:
        mapper.update(pose)
        points = lidar.scan(pose, 0.0)
        points = points[(points['z'] > 0.1 - mounts.LIDAR) & (points['z'] < 2.0 - mounts.LIDAR)]
        c, s = np.cos(pose[2]), np.sin(pose[2])
        x, y = pose[0] + points['x'] * c - points['y'] * s, pose[1] + points['x'] * s + points['y'] * c
        row, column = (np.floor(value / RESOLUTION + 100.5).astype(int) for value in (y, x))
        for i in (-1, 0, 1):
            for j in (-1, 0, 1):
                seen[row + i, column + j] = True      # to the neighbouring cell at most
    occupied = centres(mapper, OCCUPIED)
    column, row = np.floor(occupied / RESOLUTION + 100.5).astype(int).T
    assert len(occupied) > 1000
    assert seen[row, column].mean() > 0.99
    # and on what stands there
    sides = world.normals @ occupied.T - world.offsets[..., np.newaxis]
    assert np.abs(sides.max(axis=1).min(axis=0)).max() < RESOLUTION


def test_the_map_grows_in_steps_and_keeps_what_it_knows() -> None:
    drive, mapper = Drive(), Mapper(building(1))
    sizes = set()
    for time in np.arange(0.0, drive.period, 2.0):
        before, occupied = (mapper.cells >= 0).sum(), centres(mapper, OCCUPIED)
        mapper.update(drive.pose(time))
        sizes.add(mapper.cells.shape)
        assert (mapper.cells >= 0).sum() >= before
        column, row = np.floor((occupied - mapper.origin) / RESOLUTION).astype(int).T
        assert (mapper.cells[row, column] == OCCUPIED).all()
        assert np.mod(mapper.origin, STEP).tolist() == [0, 0]
        assert np.mod(np.array(mapper.cells.shape) * RESOLUTION, STEP) == pytest.approx([0, 0])
    assert len(sizes) > 2 and max(sizes) == (300, 500)
    assert (mapper.cells >= 0).mean() > 0.6
    assert set(np.unique(mapper.cells)) == {UNKNOWN, FREE, OCCUPIED}


def test_a_map_tells_whether_it_changed() -> None:
    mapper = Mapper(building(1))
    assert mapper.update(POSES[0])
    assert not mapper.update(POSES[0])
    assert mapper.update(POSES[1])
