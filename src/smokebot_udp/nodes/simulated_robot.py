# SPDX-License-Identifier: BSD-3-Clause
"""Stands in for the hardware: a robot driving through a burning building, seen by its sensors.

Parameters

| name | type | default | unit | meaning |
|---|---|---|---|---|
| ~seed | int | 1 | | which furniture, fires and noise |
| ~speed | double | 0.7 | m/s | of the drive, between halts |
| ~noise | bool | true | | whether the sensors have noise |
| ~lidar_noise | double | 0.03 | m | standard deviation of the LiDAR's ranges; 0 where ~noise is false |
| ~width, ~height | int | 640, 480 | pixel | of both pictures |
| ~thermal_rate | double | 10 | Hz | 0: no thermal camera; so with the other rates |
| ~camera_rate | double | 10 | Hz | of the colour camera |
| ~lidar_rate | double | 10 | Hz | |
| ~scan_rate | double | 10 | Hz | of the planar scanner |
| ~map_rate | double | 1 | Hz | at most; a map that has not changed is not published again |
| ~odom_rate | double | 50 | Hz | of odom and /tf |
| ~gas_rate | double | 2 | Hz | |
| ~battery_rate | double | 1 | Hz | |

Publishes

| topic | type | frame |
|---|---|---|
| thermal/image_raw | Image, mono16: counts of 0.04 K, see simulation.thermal | thermal_optical_frame |
| camera/image_raw | Image, bgr8 | camera_optical_frame |
| thermal/camera_info, camera/camera_info | CameraInfo | as the image |
| velodyne_points | PointCloud2, 23 040 points of 16 rings | velodyne |
| scan | LaserScan, 270 degrees | laser |
| map | OccupancyGrid, latched; it grows while the robot explores | map |
| odom | Odometry, which drifts | odom, base_link |
| gas/co | Float32 [ppm] | |
| battery | BatteryState | |
| /tf, /tf_static | map -> odom -> base_link -> each sensor | |

All see one world from one drive. A stamp is the time at which the robot was where the message shows it.
"""
import threading
import time

import numpy as np
import rospy

from ..simulation import mounts
from ..simulation.camera import Camera
from ..simulation.drive import Drive
from ..simulation.gas import GasSensor
from ..simulation.lidar import Lidar
from ..simulation.mapping import Mapper
from ..simulation.odometry import Odometry
from ..simulation.pinhole import Pinhole
from ..simulation.scanner import Scanner
from ..simulation.thermal import ThermalCamera
from ..simulation.world import building
from . import simulated_topics as topics
from .common import Parameters

FIELD_OF_VIEW = np.radians(70)


class PeriodicSensor:
    """Calls `measure(stamp)` at a steady rate in a thread of its own; a rate that cannot be kept skips beats."""

    def __init__(self, name, rate, measure):
        self._period, self._measure = 1.0 / rate, measure
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self):
        due = time.monotonic()
        while not rospy.is_shutdown():
            wait = due - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            try:
                self._measure(rospy.Time.now())
            except rospy.ROSException:
                return   # the topic was closed: the node ends
            due = max(due + self._period, time.monotonic())


class SimulatedRobot:
    def __init__(self):
        self._parameters = Parameters()
        seed = int(self._parameters.number('seed', 1, least=0, most=2 ** 31 - 1))
        size = [int(self._parameters.number(name, default, least=16, most=4096)) for name, default in (
            ('width', 640), ('height', 480))]
        noisy = bool(self._parameters.values.get('noise', True))
        lidar_noise = noisy * self._parameters.number('lidar_noise', 0.03, least=0.0, most=10.0)
        self._drive = drive = Drive(self._parameters.number('speed', 0.7, least=0.01, most=5.0))
        world, pinhole = building(seed), Pinhole(size[0], size[1], FIELD_OF_VIEW, mounts.CAMERA)
        self._begun = rospy.Time.now()
        self._mounts = topics.Mounts()
        self._start('thermal', 10.0, lambda: topics.CameraTopics(
            'thermal', 'mono16', ThermalCamera(world, pinhole, seed, noise=0.05 * noisy)))
        self._start('camera', 10.0, lambda: topics.CameraTopics(
            'camera', 'bgr8', Camera(world, pinhole, seed, noise=2.0 * noisy)))
        self._start('lidar', 10.0, lambda: topics.CloudTopic(Lidar(world, mounts.LIDAR, seed, lidar_noise)))
        self._start('scan', 10.0, lambda: topics.ScanTopic(Scanner(world, mounts.LASER, seed, 0.01 * noisy)))
        self._start('map', 1.0, lambda: topics.MapTopic(Mapper(world)))
        self._start('odom', 50.0, lambda: topics.OdometryTopics(Odometry(drive)))
        self._start('gas', 2.0, lambda: topics.GasTopic(GasSensor(world, seed, 1.0 * noisy)))
        self._start('battery', 1.0, topics.BatteryTopic)

    def _start(self, name, default_rate, make):
        """Start what the parameter ~NAME_rate does not switch off."""
        rate = self._parameters.number('%s_rate' % name, default_rate, least=0.0, most=1000.0)
        if not rate:
            return
        publish = make().publish

        def measure(stamp):
            elapsed = (stamp - self._begun).to_sec()
            publish(stamp, self._drive.pose(elapsed), elapsed)
        PeriodicSensor(name, rate, measure)


def main():
    rospy.init_node('simulated_robot')
    SimulatedRobot()
    rospy.spin()
