# SPDX-License-Identifier: BSD-3-Clause
"""The simulated robot's sensors besides its cameras, and that all of them agree by way of the transforms."""
from typing import Any

import numpy as np
import pytest
import rospy
import tf2_ros
from std_msgs.msg import Header

from smokebot_udp.codecs.wire.points import as_points
from smokebot_udp.demo import simulated_topics
from smokebot_udp.simulation import battery, mounts, scanner
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.gas import FRESH_AIR, GasSensor, carbon_monoxide
from smokebot_udp.simulation.lidar import COLUMNS, POINT, Lidar
from smokebot_udp.simulation.odometry import Odometry
from smokebot_udp.simulation.pinhole import Pinhole
from smokebot_udp.simulation.pose import Pose, compose, inverse
from smokebot_udp.simulation.rays import NOTHING
from smokebot_udp.simulation.world import CEILING, FLOOR, ROOF, Prism, World, building

TIMES = 0.0, 11.0, 31.0, 77.0
LONE_WALL = World([Prism('wall', (3.0, 0.0), (2.0, 4.0), 0.0, 0.0, CEILING, 20.0, (30, 30, 30))])


def in_world(points: Any, pose: Pose, height: float) -> Any:
    """(n, 3) of a sensor's POINTs."""
    x, y, _ = compose(pose, (points['x'].astype(float), points['y'].astype(float), 0.0))
    return np.stack([x, y, points['z'] + height], axis=1)


@pytest.mark.parametrize('time', TIMES)
def test_lidar_points_lie_on_the_surfaces_they_met(time: float) -> None:
    world, pose = building(1), Drive().pose(time)
    lidar = Lidar(world, mounts.LIDAR, 1, noise=0.0)
    points, surface = in_world(lidar.scan(pose, time), pose, mounts.LIDAR), lidar.look(pose)[1].reshape(-1)
    assert len(points) == 23040 and set(np.unique(surface)) > {FLOOR, ROOF}
    assert points[surface == FLOOR, 2] == pytest.approx(0.0, abs=1e-4)
    assert points[surface == ROOF, 2] == pytest.approx(CEILING, abs=1e-4)
    for prism in set(surface[surface >= 0]):
        on = points[surface == prism]
        outside = (on[:, :2] @ world.normals[prism].T - world.offsets[prism]).max(axis=1)
        below, above = on[:, 2] - world.bottom[prism], on[:, 2] - world.top[prism]
        # a box' surface: of the distances from its sides, top and bottom the largest is 0
        assert np.maximum(outside, np.maximum(-below, above)) == pytest.approx(0.0, abs=1e-3)


def test_lidar_gives_rings_and_nan_where_nothing_is_in_range() -> None:
    points = Lidar(LONE_WALL, 0.9, 1, noise=0.0).scan((0.0, 0.0, 0.0), 0.0).reshape(COLUMNS, 16)
    assert (points['ring'] == np.arange(16)).all() and (points['z'][0, 8:] > 0).all()
    assert points['x'][0, 7:9] == pytest.approx(2.0)
    slight = points[COLUMNS // 2, 8]            # backwards, a degree upwards: the ceiling is 103 m away
    assert np.isnan([slight['x'], slight['y'], slight['z']]).all()


def test_lidar_noise_is_along_the_ray_with_its_deviation() -> None:
    world, pose = building(1), Drive().pose(31.0)
    exact, noisy = (Lidar(world, 0.9, 1, noise).scan(pose, 31.0) for noise in (0.0, 0.03))
    exact, noisy = (np.linalg.norm(in_world(points, (0, 0, 0), 0.0), axis=1) for points in (exact, noisy))
    assert (noisy - exact).std() == pytest.approx(0.03, rel=0.05)


def test_the_scanner_sees_to_the_left_and_infinity_where_nothing_is() -> None:
    distance, intensity = scanner.Scanner(LONE_WALL, 0.3, 1, noise=0.0).scan((0.0, 0.0, -np.pi / 4), 0.0)
    left = np.argmin(np.abs(scanner.ANGLES - np.pi / 4))
    assert len(distance) == len(intensity) == 541
    assert distance[left] == pytest.approx(2.0) and intensity[left] == pytest.approx(30 / 1.1)
    assert np.isposinf(distance[0]) and intensity[0] == 0
    far = World([Prism('wall', (40.0, 0.0), (2.0, 40.0), 0.0, 0.0, CEILING, 20.0, (30, 30, 30))])
    assert np.isposinf(scanner.Scanner(far, 0.3, 1).scan((0.0, 0.0, 0.0), 0.0)[0]).all()


def test_scanner_and_lidar_see_the_same_walls() -> None:
    world, pose = building(1), Drive().pose(31.0)
    ranges, _ = scanner.Scanner(world, 1.1, 1, noise=0.0).scan(pose, 31.0)
    ring = in_world(Lidar(world, 1.1, 1, noise=0.0).scan(pose, 31.0).reshape(COLUMNS, 16)[:, 8], (0, 0, 0), 0.0)
    ahead = np.linalg.norm(ring[:, :2], axis=1)[(np.round(np.degrees(scanner.ANGLES) * 4).astype(int)) % COLUMNS]
    assert np.isclose(ranges, ahead, rtol=1e-3).mean() > 0.98     # a degree upwards, and past a low edge


def test_carbon_monoxide_is_high_at_the_fires_and_smooth() -> None:
    world = building(1)
    fire, away = world.fires[0, :2], np.array([10.5, 7.0])
    way = [carbon_monoxide(world, fire + share * (away - fire), 5.0) for share in np.linspace(0, 1, 200)]
    assert way[0] > 500 and FRESH_AIR < way[-1] < 0.2 * way[0]
    assert np.abs(np.diff(way)).max() < 0.02 * way[0]
    still = [GasSensor(world, 1, 1.0).measure(tuple(away) + (0.0,), 5.0) for _ in range(2)]
    assert still[0] == still[1] and abs(still[0] - way[-1]) < 5
    assert GasSensor(World(LONE_WALL.prisms), 1, 0.0).measure((0.0, 0.0, 0.0), 5.0) == FRESH_AIR


def test_the_battery_empties_and_is_exchanged() -> None:
    charges = [battery.state_of_charge(time) for time in (0.0, 3600.0, 7199.0, 7200.0)]
    assert charges == pytest.approx([1.0, 0.5, 0.0, 1.0], abs=1e-3)
    assert battery.voltage(1.0) == pytest.approx(25.2)


def test_a_pose_and_its_inverse_cancel() -> None:
    pose = 1.0, -2.0, 0.7
    assert compose(pose, inverse(pose)) == pytest.approx((0, 0, 0))
    assert compose((1.0, 0.0, np.pi / 2), (2.0, 0.0, 0.1)) == pytest.approx((1.0, 2.0, np.pi / 2 + 0.1))


def test_odometry_drifts_slowly_and_only_on_the_way() -> None:
    drive = Drive()
    odometry = Odometry(drive)
    assert odometry.pose(0.0) == pytest.approx(drive.pose(0.0))
    times = np.arange(0.0, 3 * drive.period, 0.1)
    drift = np.array([odometry.correction(time) for time in times])
    assert np.hypot(*drift[:, :2].T).max() > 0.2 and np.abs(drift[:, 2]).max() > 0.03
    assert np.hypot(*np.diff(drift[:, :2], axis=0).T).max() < 0.02 * 0.07       # below 2 % of the way
    halts = [i for i in range(len(times) - 1) if np.allclose(drive.twist(times[i]), 0)
             and np.allclose(drive.twist(times[i + 1]), 0)]
    assert halts and np.allclose(np.diff(drift, axis=0)[halts], 0)


def transforms(time: float, stamp: Any) -> Any:
    """A tf2 buffer that has heard the robot at this time, under this stamp."""
    buffer = tf2_ros.BufferCore()
    for transform in simulated_topics.transforms(stamp, Odometry(Drive()), time):
        buffer.set_transform(transform, 'robot')
    for transform in simulated_topics.mount_transforms(stamp):
        buffer.set_transform_static(transform, 'robot')
    return buffer


def matrix(transform: Any) -> Any:
    """(4, 4) of a TransformStamped."""
    t, q = transform.transform.translation, transform.transform.rotation
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array([(1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), t.x),
                     (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), t.y),
                     (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), t.z), (0, 0, 0, 1)])


@pytest.mark.parametrize('time', TIMES + (700.0,))
def test_the_transforms_give_the_true_pose(time: float) -> None:
    stamp, (x, y, yaw) = rospy.Time(1000 + time), Drive().pose(time)
    found = matrix(transforms(time, stamp).lookup_transform_core('map', 'base_link', stamp))
    c, s = np.cos(yaw), np.sin(yaw)
    assert found == pytest.approx(np.array([(c, -s, 0, x), (s, c, 0, y), (0, 0, 1, 0), (0, 0, 0, 1)]), abs=1e-9)


def test_a_camera_s_axes_are_right_down_and_ahead() -> None:
    stamp = rospy.Time(1000)
    for name in ('thermal', 'camera'):
        turn = matrix(transforms(0.0, stamp).lookup_transform_core('base_link', name + '_optical_frame', stamp))
        assert turn[:3, :3] == pytest.approx(np.array([(0, 0, 1), (-1, 0, 0), (0, -1, 0)]))


@pytest.mark.parametrize('time', TIMES)
def test_the_cloud_falls_on_the_same_surfaces_of_the_thermal_image(time: float) -> None:
    """By what a receiver has: the cloud's message, tf and camera_info."""
    world, pose, stamp = building(1), Drive().pose(time), rospy.Time(1000 + time)
    lidar, eye = Lidar(world, mounts.LIDAR, 1, noise=0.0), Pinhole(320, 240, np.radians(70), mounts.CAMERA)
    message = simulated_topics.cloud(Header(stamp=stamp, frame_id='velodyne'), lidar.scan(pose, time))
    points, _ = as_points(message)
    turn = matrix(transforms(time, stamp).lookup_transform_core('thermal_optical_frame', 'velodyne', stamp))
    points = points @ turn[:3, :3].T + turn[:3, 3]
    surface = lidar.look(pose)[1].reshape(-1)
    ahead = points[:, 2] > 0.1
    points, surface = points[ahead], surface[ahead]
    column, row, _ = np.rint(points @ np.array(simulated_topics.calibration(Header(), eye).K).reshape(3, 3).T
                             / points[:, 2:]).astype(int).T
    inside = (column >= 0) & (column < eye.width) & (row >= 0) & (row < eye.height)
    view = eye.look(world, pose)
    depth, shown = view.depth[row[inside], column[inside]], view.surface[row[inside], column[inside]]
    # the LiDAR, higher up, sees over things that hide a little from the camera
    in_view = points[inside, 2] < 1.03 * depth + 0.03
    assert in_view.mean() > 0.9 and in_view.sum() > 1000
    assert (surface[inside] == shown)[in_view].mean() > 0.98
    assert len(set(shown)) > 1


def test_a_cloud_s_message_is_laid_out_as_velodyne_s() -> None:
    message = simulated_topics.cloud(Header(), Lidar(LONE_WALL, 0.9, 1).scan((0.0, 0.0, 0.0), 0.0))
    assert [(field.name, field.offset, field.datatype) for field in message.fields] == [
        ('x', 0, 7), ('y', 4, 7), ('z', 8, 7), ('intensity', 12, 7), ('ring', 16, 4), ('time', 18, 7)]
    assert (message.point_step, message.width, message.height) == (POINT.itemsize, 23040, 1) and not message.is_dense
    assert NOTHING not in Lidar(building(1), 0.9, 1).look((1.5, 7.0, 0.0))[1]
