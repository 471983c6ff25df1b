# SPDX-License-Identifier: BSD-3-Clause
"""What the simulated sensors see as ROS messages: topic, type and frame as the real drivers have them.

Each class' publish(stamp, pose, time) brings what was measured at `stamp`, at the true pose (x, y, yaw) [m, rad] and
`time` [s] of the simulation.
"""
import math

import numpy as np
import rospy
from geometry_msgs.msg import Point, Pose, Quaternion, Transform, TransformStamped, Vector3
from nav_msgs.msg import MapMetaData, OccupancyGrid, Odometry
from sensor_msgs.msg import BatteryState, CameraInfo, Image, LaserScan, PointCloud2, PointField
from std_msgs.msg import Float32, Header
from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

from ..simulation import battery, mounts, scanner
from ..simulation.lidar import POINT
from ..simulation.mapping import RESOLUTION

POINT_FIELDS = [PointField(name, offset, {'<f4': PointField.FLOAT32, '<u2': PointField.UINT16}[format.str], 1)
                for name, (format, offset) in POINT.fields.items()]
SCAN_TIME = 0.05
"""A planar scanner's revolution [s]; LaserScan wants it told."""


def quaternion(yaw):
    return Quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


def transform(stamp, parent, child, pose):
    """A TransformStamped of a pose (x, y, yaw) of `child` in `parent`."""
    return TransformStamped(Header(stamp=stamp, frame_id=parent), child,
                            Transform(Vector3(pose[0], pose[1], 0.0), quaternion(pose[2])))


def mount_transforms(stamp):
    """[TransformStamped, ...] from base_link to each sensor."""
    return [TransformStamped(Header(stamp=stamp, frame_id='base_link'), frame,
                             Transform(Vector3(0.0, 0.0, height), Quaternion(*turn)))
            for frame, (height, turn) in mounts.FRAMES.items()]


class Mounts:
    """The sensors' places on the robot, published once, latched."""

    def __init__(self):
        self._broadcaster = StaticTransformBroadcaster()
        self._broadcaster.sendTransform(mount_transforms(rospy.Time.now()))


class CameraTopics:
    """A camera's image and camera_info."""

    def __init__(self, name, encoding, camera):
        self._frame_id, self._encoding, self._camera = name + '_optical_frame', encoding, camera
        self._image = rospy.Publisher(name + '/image_raw', Image, queue_size=1)
        self._info = rospy.Publisher(name + '/camera_info', CameraInfo, queue_size=1)

    def publish(self, stamp, pose, time):
        picture, header = self._camera.look(pose, time), Header(stamp=stamp, frame_id=self._frame_id)
        self._image.publish(Image(header=header, height=picture.shape[0], width=picture.shape[1],
                                  encoding=self._encoding, step=picture.strides[0], data=picture.tobytes()))
        self._info.publish(calibration(header, self._camera.pinhole))


def calibration(header, pinhole):
    """A Pinhole's CameraInfo."""
    f, cx, cy = pinhole.focal_length, (pinhole.width - 1) / 2, (pinhole.height - 1) / 2
    return CameraInfo(header=header, width=pinhole.width, height=pinhole.height, distortion_model='plumb_bob',
                      D=[0.0] * 5, K=[f, 0, cx, 0, f, cy, 0, 0, 1], R=[1, 0, 0, 0, 1, 0, 0, 0, 1],
                      P=[f, 0, cx, 0, 0, f, cy, 0, 0, 0, 1, 0])


class CloudTopic:

    def __init__(self, lidar):
        self._lidar = lidar
        self._publisher = rospy.Publisher('velodyne_points', PointCloud2, queue_size=1)

    def publish(self, stamp, pose, time):
        self._publisher.publish(cloud(Header(stamp=stamp, frame_id='velodyne'), self._lidar.scan(pose, time)))


def cloud(header, points):
    """A PointCloud2 of a (n,) POINT array."""
    return PointCloud2(header=header, height=1, width=len(points), fields=POINT_FIELDS, point_step=POINT.itemsize,
                       row_step=points.nbytes, data=points.tobytes(), is_dense=bool(np.isfinite(points['x']).all()))


class ScanTopic:

    def __init__(self, sensor):
        self._sensor = sensor
        self._publisher = rospy.Publisher('scan', LaserScan, queue_size=1)

    def publish(self, stamp, pose, time):
        ranges, intensities = self._sensor.scan(pose, time)
        angles = scanner.ANGLES
        self._publisher.publish(LaserScan(
            header=Header(stamp=stamp, frame_id='laser'), angle_min=angles[0], angle_max=angles[-1],
            angle_increment=(angles[-1] - angles[0]) / (len(angles) - 1), scan_time=SCAN_TIME,
            range_min=scanner.NEAREST, range_max=scanner.FARTHEST, ranges=ranges, intensities=intensities))


class MapTopic:
    """The map, latched, whenever the robot has seen something new."""

    def __init__(self, mapper):
        self._mapper, self._begun = mapper, rospy.Time.now()
        self._publisher = rospy.Publisher('map', OccupancyGrid, queue_size=1, latch=True)

    def publish(self, stamp, pose, time):
        if self._mapper.update(pose):
            cells, origin = self._mapper.cells, self._mapper.origin
            info = MapMetaData(map_load_time=self._begun, resolution=RESOLUTION, width=cells.shape[1],
                               height=cells.shape[0], origin=Pose(Point(*origin, 0.0), quaternion(0.0)))
            self._publisher.publish(OccupancyGrid(Header(stamp=stamp, frame_id='map'), info, cells.ravel().tolist()))


class OdometryTopics:
    """odom, and /tf from map to base_link by way of it."""

    # [m^2, rad^2], x, y, z, roll, pitch, yaw; what does not move is known well
    COVARIANCE = np.diag([0.01, 0.01, 1e-6, 1e-6, 1e-6, 1e-3]).ravel().tolist()

    def __init__(self, odometry):
        self._odometry = odometry
        self._publisher = rospy.Publisher('odom', Odometry, queue_size=5)
        self._broadcaster = TransformBroadcaster()

    def publish(self, stamp, pose, time):
        message = Odometry(header=Header(stamp=stamp, frame_id='odom'), child_frame_id='base_link')
        there, twist = self._odometry.pose(time), message.twist.twist
        message.pose.pose = Pose(Point(there[0], there[1], 0.0), quaternion(there[2]))
        twist.linear.x, twist.angular.z = self._odometry.twist(time)
        message.pose.covariance = message.twist.covariance = self.COVARIANCE
        self._publisher.publish(message)
        self._broadcaster.sendTransform(transforms(stamp, self._odometry, time))


def transforms(stamp, odometry, time):
    """[TransformStamped, ...] from map to odom, and from there to base_link."""
    return [transform(stamp, 'map', 'odom', odometry.correction(time)),
            transform(stamp, 'odom', 'base_link', odometry.pose(time))]


class GasTopic:

    def __init__(self, sensor):
        self._sensor = sensor
        self._publisher = rospy.Publisher('gas/co', Float32, queue_size=1)

    def publish(self, stamp, pose, time):
        self._publisher.publish(self._sensor.measure(pose, time))


class BatteryTopic:

    def __init__(self):
        self._publisher = rospy.Publisher('battery', BatteryState, queue_size=1)

    def publish(self, stamp, pose, time):
        share = battery.share_left(time)
        self._publisher.publish(BatteryState(
            header=Header(stamp=stamp, frame_id='base_link'), voltage=battery.voltage(share), current=-battery.CURRENT,
            charge=share * battery.CAPACITY, capacity=battery.CAPACITY, design_capacity=battery.CAPACITY,
            percentage=share, temperature=math.nan, present=True,
            power_supply_status=BatteryState.POWER_SUPPLY_STATUS_DISCHARGING,
            power_supply_health=BatteryState.POWER_SUPPLY_HEALTH_GOOD,
            power_supply_technology=BatteryState.POWER_SUPPLY_TECHNOLOGY_LION))
