# SPDX-License-Identifier: BSD-3-Clause
"""Where the sensors are on the robot: above base_link, which is on the floor, and facing forward."""
from typing import Dict, Tuple

CAMERA, LIDAR, LASER = 0.6, 0.9, 0.3
"""Heights above the floor [m]."""

Quaternion = Tuple[float, float, float, float]
"""(x, y, z, w)"""

LEVEL: Quaternion = (0.0, 0.0, 0.0, 1.0)
OPTICAL: Quaternion = (-0.5, 0.5, -0.5, 0.5)
"""Orientation of a camera's optical frame, x right, y down, z forward (REP-103), in the robot's frame."""

FRAMES: Dict[str, Tuple[float, Quaternion]] = {
    'velodyne': (LIDAR, LEVEL),
    'laser': (LASER, LEVEL),
    'thermal_optical_frame': (CAMERA, OPTICAL),
    'camera_optical_frame': (CAMERA, OPTICAL),
}
"""{frame: (height above base_link [m], orientation in base_link)}"""
