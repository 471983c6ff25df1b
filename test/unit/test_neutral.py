# SPDX-License-Identifier: BSD-3-Clause
from typing import Any

import pytest
from geometry_msgs.msg import Point32, Polygon, Twist, TwistStamped, Vector3
from sensor_msgs.msg import Joy
from std_msgs.msg import Duration, Header, String

from smokebot_udp.teleop.zero import is_zero

HEADER = Header(seq=3, frame_id='base_link')


@pytest.mark.parametrize('message', [
    Twist(), Twist(linear=Vector3(-0.0, 0.0, 0.0)), TwistStamped(header=HEADER), Joy(),
    Joy(header=HEADER, axes=[0.0] * 8, buttons=[0] * 11), String(), Duration(),
    Polygon([Point32()])])
def test_what_asks_for_nothing(message: Any) -> None:
    assert is_zero(message)


@pytest.mark.parametrize('message', [
    Twist(linear=Vector3(0.0, 1e-9, 0.0)), Twist(angular=Vector3(0.0, 0.0, float('nan'))), String('go'),
    Joy(axes=[0.0, 0.0, -0.1]), Joy(buttons=[0, 1]), Polygon([Point32(), Point32(z=0.1)])])
def test_what_asks_for_something(message: Any) -> None:
    assert not is_zero(message)
