# SPDX-License-Identifier: BSD-3-Clause
"""Where the sensors are on the robot: all above base_link, which is on the floor, and looking ahead."""

CAMERA = 0.6
"""Heights above the floor [m]."""

LIDAR = 0.9
LASER = 0.3

OPTICAL = -0.5, 0.5, -0.5, 0.5
"""Quaternion (x, y, z, w) of a camera's optical axes in the robot's: x right, y down, z ahead (REP-103)."""

FRAMES = {
    'velodyne': (LIDAR, (0.0, 0.0, 0.0, 1.0)),
    'laser': (LASER, (0.0, 0.0, 0.0, 1.0)),
    'thermal_optical_frame': (CAMERA, OPTICAL),
    'camera_optical_frame': (CAMERA, OPTICAL),
}
"""{frame: (its height above base_link [m], its orientation there as a quaternion (x, y, z, w))}"""
