# SPDX-License-Identifier: BSD-3-Clause
"""A simulated robot: drives through a burning building and publishes its sensors' measurements.

It is on a tour, unless somebody drives it: by commands or to a goal. A while after that the tour goes on.

Parameters: SIMULATED_ROBOT in nodes/parameters.py.

Publishes

| topic | type | frame |
|---|---|---|
| thermal/image_raw | Image, mono16: counts of 0.04 K, see simulation.thermal | thermal_optical_frame |
| camera/image_raw | Image, bgr8 | camera_optical_frame |
| thermal/camera_info, camera/camera_info | CameraInfo | as the image |
| velodyne_points | PointCloud2, 23 040 points of 16 rings | velodyne |
| scan | LaserScan, 270 degrees | laser |
| map | OccupancyGrid, latched; grows while the robot explores | map |
| odom | Odometry with drift | odom, base_link |
| gas/co | Float32 [ppm] | |
| battery | BatteryState | |
| /tf, /tf_static | map -> odom -> base_link -> each sensor | |

Subscribes

| topic | type | |
|---|---|---|
| cmd_vel | Twist | obeyed for 0.5 s, then it stands: the watchdog of a base's driver; it stops before walls |
| move_base_simple/goal | PoseStamped | in map, odom or base_link |

Action: move_base (MoveBaseAction). Service: count (Trigger), whose message is how often it was called.

All sensors see the same world from the same robot. The stamp is the time of the measurement.
"""
import threading
import time
from typing import Any, Callable

import numpy as np
import rospy

from .. import udpros
from ..nodes import malloc_tuning
from ..nodes.common import Parameters
from ..nodes.parameters import SIMULATED_ROBOT
from ..simulation import mounts
from ..simulation.camera import Camera
from ..simulation.drive import Drive
from ..simulation.gas import GasSensor
from ..simulation.lidar import Lidar
from ..simulation.mapping import Mapper
from ..simulation.odometry import Odometry
from ..simulation.pinhole import Pinhole
from ..simulation.planner import Planner
from ..simulation.robot import Robot
from ..simulation.scanner import Scanner
from ..simulation.thermal import ThermalCamera
from ..simulation.world import building
from . import simulated_topics as topics
from .simulated_driving import Commands, Counter, MoveBase, SharedRobot

FIELD_OF_VIEW = np.radians(70)
"""Horizontal field of view of both cameras [rad]."""

SMOKE, BILLOWS = 0.45, 0.6
"""Extinction of the camera's smoke [1/m] and its relative deviation in billows, see simulation.camera: people 4 m away
are hardly seen. The thermal camera sees through it."""


class PeriodicSensor:
    """Calls `measure(stamp)` at a steady rate in its own thread; if it is too slow, measurements are skipped.

    :param rate: [Hz]
    """

    def __init__(self, name: str, rate: float, measure: Callable[[Any], None]) -> None:
        self._period, self._measure = 1.0 / rate, measure
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        due = time.monotonic()
        while not rospy.is_shutdown():
            time.sleep(max(0.0, due - time.monotonic()))
            try:
                self._measure(rospy.Time.now())
            except rospy.ROSException:
                return   # the topic is closed: the node shuts down
            due = max(due + self._period, time.monotonic())


class SimulatedRobot:
    """Starts the sensors and what drives; they run until the node shuts down."""

    def __init__(self) -> None:
        self._parameters = parameters = Parameters(SIMULATED_ROBOT)
        seed, noisy = parameters['seed'], parameters['noise']
        lidar_noise = noisy * parameters['lidar_noise']
        world = building(seed)
        self._robot = robot = SharedRobot(Robot(Drive(parameters['speed']), world, Planner(world), parameters['speed'],
                                                parameters['tour_pause']))
        odometry = Odometry(robot)
        pinhole = Pinhole(parameters['width'], parameters['height'], FIELD_OF_VIEW, mounts.CAMERA)
        self._start_time = rospy.Time.now()
        with udpros.registered_together():
            self._mounts = topics.Mounts()
            self._start('thermal', lambda: topics.CameraTopics(
                'thermal', 'mono16', ThermalCamera(world, pinhole, seed, noise=0.05 * noisy)))
            self._start('camera', lambda: topics.CameraTopics(
                'camera', 'bgr8', Camera(world, pinhole, seed, SMOKE, BILLOWS, noise=2.0 * noisy)))
            self._start('lidar', lambda: topics.CloudTopic(Lidar(world, mounts.LIDAR, seed, lidar_noise)))
            self._start('scan', lambda: topics.ScanTopic(Scanner(world, mounts.LASER, seed, 0.01 * noisy)))
            self._start('map', lambda: topics.MapTopic(Mapper(world)))
            self._start('odom', lambda: topics.OdometryTopics(odometry))
            self._start('gas', lambda: topics.GasTopic(GasSensor(world, seed, 1.0 * noisy)))
            self._start('battery', topics.BatteryTopic)
            Commands(robot, self._now)
            Counter()
            MoveBase(robot, odometry, self._now)

    def _now(self) -> float:
        """The simulation's time [s]."""
        return self._elapsed(rospy.Time.now())

    def _elapsed(self, stamp: Any) -> float:
        return float((stamp - self._start_time).to_sec())

    def _start(self, name: str, make: Callable[[], Any]) -> None:
        """Start a sensor unless its ~NAME_rate is 0."""
        rate = self._parameters['%s_rate' % name]
        if not rate:
            return
        publish = make().publish

        def measure(stamp: Any) -> None:
            elapsed = self._elapsed(stamp)
            publish(stamp, self._robot.pose(elapsed), elapsed)
        PeriodicSensor(name, rate, measure)


def main() -> None:
    malloc_tuning.keep_freed_memory()
    udpros.init_node('simulated_robot')
    SimulatedRobot()
    rospy.spin()
