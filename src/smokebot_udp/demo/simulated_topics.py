# SPDX-License-Identifier: BSD-3-Clause
"""The simulated sensors' measurements as ROS messages, with the topics, types and frames of real drivers.

Each class has publish(stamp, pose, time), which measures and publishes with this stamp: `pose` is the robot's true pose
(x, y, yaw) [m, rad], `time` the simulation's [s].
"""
import math
from typing import Any, List, Union

import numpy as np
import rospy
from geometry_msgs.msg import Point, Pose, Quaternion, Transform, TransformStamped, Vector3
from nav_msgs.msg import MapMetaData, OccupancyGrid, Odometry
from sensor_msgs.msg import BatteryState, CameraInfo, Image, LaserScan, PointCloud2, PointField
from std_msgs.msg import Float32, Header
from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

from ..arrays import Records
from ..simulation import battery, mounts, scanner
from ..simulation.camera import Camera
from ..simulation.gas import GasSensor
from ..simulation.lidar import POINT, Lidar
from ..simulation.mapping import RESOLUTION, Mapper
from ..simulation.odometry import Odometry as SimulatedOdometry
from ..simulation.pinhole import Pinhole
from ..simulation.pose import Pose as PlanarPose
from ..simulation.scanner import Scanner
from ..simulation.thermal import ThermalCamera

FORMATS = {'<f4': PointField.FLOAT32, '<u2': PointField.UINT16}
POINT_FIELDS = [PointField(name, POINT.fields[name][1], FORMATS[POINT[name].str], 1)    # type: ignore[index]
                for name in POINT.names or ()]
SCAN_TIME = 0.05
"""Duration of a planar scanner's revolution, for LaserScan.scan_time [s]."""


def quaternion(yaw: float) -> Any:
    """geometry_msgs/Quaternion of a yaw [rad]."""
    return Quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


def transform(stamp: Any, parent: str, child: str, pose: PlanarPose) -> Any:
    """The TransformStamped of the pose of `child` in `parent`."""
    return TransformStamped(Header(stamp=stamp, frame_id=parent), child,
                            Transform(Vector3(pose[0], pose[1], 0.0), quaternion(pose[2])))


def mount_transforms(stamp: Any) -> List[Any]:
    """The TransformStamped from base_link to each sensor."""
    return [TransformStamped(Header(stamp=stamp, frame_id='base_link'), frame,
                             Transform(Vector3(0.0, 0.0, height), Quaternion(*turn)))
            for frame, (height, turn) in mounts.FRAMES.items()]


class Mounts:
    """Publishes the sensors' poses on the robot, once, latched."""

    def __init__(self) -> None:
        self._broadcaster = StaticTransformBroadcaster()
        self._broadcaster.sendTransform(mount_transforms(rospy.Time.now()))


class CameraTopics:
    """A camera's image and camera_info."""

    def __init__(self, name: str, encoding: str, camera: Union[Camera, ThermalCamera]) -> None:
        self._frame_id, self._encoding, self._camera = name + '_optical_frame', encoding, camera
        self._image = rospy.Publisher(name + '/image_raw', Image, queue_size=1)
        self._info = rospy.Publisher(name + '/camera_info', CameraInfo, queue_size=1)

    def publish(self, stamp: Any, pose: PlanarPose, time: float) -> None:
        pixels, header = self._camera.look(pose, time), Header(stamp=stamp, frame_id=self._frame_id)
        self._image.publish(Image(header=header, height=pixels.shape[0], width=pixels.shape[1],
                                  encoding=self._encoding, step=pixels.strides[0], data=pixels.tobytes()))
        self._info.publish(calibration(header, self._camera.pinhole))


def calibration(header: Any, pinhole: Pinhole) -> Any:
    """The CameraInfo of a Pinhole."""
    f, cx, cy = pinhole.focal_length, (pinhole.width - 1) / 2, (pinhole.height - 1) / 2
    return CameraInfo(header=header, width=pinhole.width, height=pinhole.height, distortion_model='plumb_bob',
                      D=[0.0] * 5, K=[f, 0, cx, 0, f, cy, 0, 0, 1], R=[1, 0, 0, 0, 1, 0, 0, 0, 1],
                      P=[f, 0, cx, 0, 0, f, cy, 0, 0, 0, 1, 0])


class CloudTopic:
    """The LiDAR's point cloud."""

    def __init__(self, lidar: Lidar) -> None:
        self._lidar = lidar
        self._publisher = rospy.Publisher('velodyne_points', PointCloud2, queue_size=1)

    def publish(self, stamp: Any, pose: PlanarPose, time: float) -> None:
        self._publisher.publish(cloud(Header(stamp=stamp, frame_id='velodyne'), self._lidar.scan(pose, time)))


def cloud(header: Any, points: Records) -> Any:
    """The PointCloud2 of an (n,) POINT array."""
    return PointCloud2(header=header, height=1, width=len(points), fields=POINT_FIELDS, point_step=POINT.itemsize,
                       row_step=points.nbytes, data=points.tobytes(), is_dense=bool(np.isfinite(points['x']).all()))


class ScanTopic:
    """The planar scanner's scan."""

    def __init__(self, sensor: Scanner) -> None:
        self._sensor = sensor
        self._publisher = rospy.Publisher('scan', LaserScan, queue_size=1)

    def publish(self, stamp: Any, pose: PlanarPose, time: float) -> None:
        ranges, intensities = self._sensor.scan(pose, time)
        angles = scanner.ANGLES
        self._publisher.publish(LaserScan(
            header=Header(stamp=stamp, frame_id='laser'), angle_min=angles[0], angle_max=angles[-1],
            angle_increment=(angles[-1] - angles[0]) / (len(angles) - 1), scan_time=SCAN_TIME,
            range_min=scanner.MIN_RANGE, range_max=scanner.MAX_RANGE, ranges=ranges, intensities=intensities))


class MapTopic:
    """The map, latched; published only if it has changed."""

    def __init__(self, mapper: Mapper) -> None:
        self._mapper, self._begun = mapper, rospy.Time.now()
        self._publisher = rospy.Publisher('map', OccupancyGrid, queue_size=1, latch=True)

    def publish(self, stamp: Any, pose: PlanarPose, time: float) -> None:
        if self._mapper.update(pose):
            cells, origin = self._mapper.cells, self._mapper.origin
            info = MapMetaData(map_load_time=self._begun, resolution=RESOLUTION, width=cells.shape[1],
                               height=cells.shape[0], origin=Pose(Point(*origin, 0.0), quaternion(0.0)))
            self._publisher.publish(OccupancyGrid(Header(stamp=stamp, frame_id='map'), info, cells.ravel().tolist()))


class OdometryTopics:
    """Publishes odom, and on /tf the transforms from map over odom to base_link."""

    # of x, y, z, roll, pitch, yaw [m^2, rad^2]; small where a planar robot does not move
    COVARIANCE = np.diag([0.01, 0.01, 1e-6, 1e-6, 1e-6, 1e-3]).ravel().tolist()

    def __init__(self, odometry: SimulatedOdometry) -> None:
        self._odometry = odometry
        self._publisher = rospy.Publisher('odom', Odometry, queue_size=5)
        self._broadcaster = TransformBroadcaster()

    def publish(self, stamp: Any, pose: PlanarPose, time: float) -> None:
        message = Odometry(header=Header(stamp=stamp, frame_id='odom'), child_frame_id='base_link')
        (x, y, yaw), twist = self._odometry.pose(time), message.twist.twist
        message.pose.pose = Pose(Point(x, y, 0.0), quaternion(yaw))
        twist.linear.x, twist.angular.z = self._odometry.twist(time)
        message.pose.covariance = message.twist.covariance = self.COVARIANCE
        self._publisher.publish(message)
        self._broadcaster.sendTransform(transforms(stamp, self._odometry, time))


def transforms(stamp: Any, odometry: SimulatedOdometry, time: float) -> List[Any]:
    """The TransformStamped from map to odom, and from odom to base_link."""
    return [transform(stamp, 'map', 'odom', odometry.correction(time)),
            transform(stamp, 'odom', 'base_link', odometry.pose(time))]


class GasTopic:
    """The carbon monoxide concentration."""

    def __init__(self, sensor: GasSensor) -> None:
        self._sensor = sensor
        self._publisher = rospy.Publisher('gas/co', Float32, queue_size=1)

    def publish(self, stamp: Any, pose: PlanarPose, time: float) -> None:
        self._publisher.publish(self._sensor.measure(pose, time))


class BatteryTopic:
    """The battery's state."""

    def __init__(self) -> None:
        self._publisher = rospy.Publisher('battery', BatteryState, queue_size=1)

    def publish(self, stamp: Any, pose: PlanarPose, time: float) -> None:
        charge = battery.state_of_charge(time)
        self._publisher.publish(BatteryState(
            header=Header(stamp=stamp, frame_id='base_link'), voltage=battery.voltage(charge), current=-battery.CURRENT,
            charge=charge * battery.CAPACITY, capacity=battery.CAPACITY, design_capacity=battery.CAPACITY,
            percentage=charge, temperature=math.nan, present=True,
            power_supply_status=BatteryState.POWER_SUPPLY_STATUS_DISCHARGING,
            power_supply_health=BatteryState.POWER_SUPPLY_HEALTH_GOOD,
            power_supply_technology=BatteryState.POWER_SUPPLY_TECHNOLOGY_LION))
