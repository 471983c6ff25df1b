# SPDX-License-Identifier: BSD-3-Clause
"""Stands in for the hardware: a robot driving through a burning building, seen by its sensors.

Parameters

| name | type | default | unit | meaning |
|---|---|---|---|---|
| ~seed | int | 1 | | which furniture, fires and noise |
| ~speed | double | 0.7 | m/s | of the drive, between halts |
| ~noise | bool | true | | whether the sensors have noise |
| ~width, ~height | int | 640, 480 | pixel | of both pictures |
| ~thermal_rate | double | 10 | Hz | 0: no thermal camera |
| ~camera_rate | double | 10 | Hz | 0: no colour camera |

Publishes thermal/image_raw (mono16, counts of 0.04 K: see simulation.thermal), camera/image_raw (bgr8), and
their camera_info. Stamps are the time at which the robot was where the picture shows it.
"""
import math
import threading
import time

import rospy
from sensor_msgs.msg import CameraInfo, Image

from ..simulation.camera import Camera
from ..simulation.drive import Drive
from ..simulation.pinhole import Pinhole
from ..simulation.thermal import ThermalCamera
from ..simulation.world import building
from .common import number_parameter

FIELD_OF_VIEW = math.radians(70)
MOUNT = 0.6
"""Height of the cameras [m]."""


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


class CameraTopics:
    """A camera's image and camera_info."""

    def __init__(self, name, encoding, pinhole, look):
        self._frame_id, self._encoding, self._look = name + '_optical_frame', encoding, look
        self._image = rospy.Publisher(name + '/image_raw', Image, queue_size=1)
        self._info = rospy.Publisher(name + '/camera_info', CameraInfo, queue_size=1)
        f, cx, cy = pinhole.focal_length, (pinhole.width - 1) / 2, (pinhole.height - 1) / 2
        self._calibration = CameraInfo(width=pinhole.width, height=pinhole.height, distortion_model='plumb_bob',
                                       D=[0.0] * 5, K=[f, 0, cx, 0, f, cy, 0, 0, 1], R=[1, 0, 0, 0, 1, 0, 0, 0, 1],
                                       P=[f, 0, cx, 0, 0, f, cy, 0, 0, 0, 1, 0])

    def publish(self, stamp):
        picture = self._look(stamp)
        image = Image(height=picture.shape[0], width=picture.shape[1], encoding=self._encoding,
                      step=picture.strides[0], data=picture.tobytes())
        for message in (image, self._calibration):
            message.header.stamp, message.header.frame_id = stamp, self._frame_id
        self._image.publish(image)
        self._info.publish(self._calibration)


class SimulatedRobot:
    def __init__(self):
        seed = int(number_parameter('~seed', 1, least=0, most=2 ** 31 - 1))
        size = [int(number_parameter(name, default, least=16, most=4096)) for name, default in (
            ('~width', 640), ('~height', 480))]
        noisy = bool(rospy.get_param('~noise', True))
        drive = Drive(number_parameter('~speed', 0.7, least=0.01, most=5.0))
        world, pinhole = building(seed), Pinhole(size[0], size[1], FIELD_OF_VIEW, MOUNT)
        begun = rospy.Time.now()
        thermal = ThermalCamera(world, pinhole, seed, noise=0.05 * noisy)
        camera = Camera(world, pinhole, seed, noise=2.0 * noisy)
        for name, encoding, sensor in (('thermal', 'mono16', thermal), ('camera', 'bgr8', camera)):
            rate = number_parameter('~%s_rate' % name, 10.0, least=0.0, most=1000.0)
            if rate:
                def look(stamp, sensor=sensor):
                    elapsed = (stamp - begun).to_sec()
                    return sensor.look(drive.pose(elapsed), elapsed)
                PeriodicSensor(name, rate, CameraTopics(name, encoding, pinhole, look).publish)


def main():
    rospy.init_node('simulated_robot')
    SimulatedRobot()
    rospy.spin()
