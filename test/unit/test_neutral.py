# SPDX-License-Identifier: BSD-3-Clause
from typing import Any

import pytest
from geometry_msgs.msg import Point32, Polygon, Twist, TwistStamped, Vector3
from sensor_msgs.msg import Joy
from std_msgs.msg import Duration, Header, String

from smokebot_udp.serialised import serialised
from smokebot_udp.streams.command.parameters import timeout_message
from smokebot_udp.teleop.neutral import Neutral

HEADER = Header(seq=3, frame_id='base_link')


@pytest.mark.parametrize('message', [
    Twist(), Twist(linear=Vector3(-0.0, 0.0, 0.0)), TwistStamped(header=HEADER), Joy(),
    Joy(header=HEADER, axes=[0.0] * 8, buttons=[0] * 11), String(), Duration(),
    Polygon([Point32()])])
def test_what_asks_for_nothing(message: Any) -> None:
    assert Neutral().deviation(message) is None


@pytest.mark.parametrize('message, where', [
    (Twist(linear=Vector3(0.0, 1e-9, 0.0)), 'linear.y'), (Twist(angular=Vector3(0.0, 0.0, float('nan'))), 'angular.z'),
    (String('go'), 'data'), (Joy(axes=[0.0, 0.0, -0.1]), 'axes[2]'), (Joy(buttons=[0, 1]), 'buttons[1]'),
    (Polygon([Point32(), Point32(z=0.1)]), 'points[1].z')])
def test_what_asks_for_something(message: Any, where: str) -> None:
    assert Neutral().deviation(message) == where


def gamepad(turn: float = 0.0, ahead: float = 0.0, left: float = 1.0, right: float = 1.0, buttons: Any = (0, 0)) -> Any:
    """What joy_node says of one: two sticks and two triggers, which rest at 1."""
    return Joy(header=HEADER, axes=[turn, ahead, left, 0.0, 0.0, right], buttons=list(buttons))


def test_what_on_timeout_sends_is_neutral_value_by_value() -> None:
    settings = {'message_type': 'sensor_msgs/Joy', 'on_timeout': {'axes': [0.1, 0, 1, 0, 0, 1], 'buttons': [0, 0]}}
    neutral = Neutral(timeout_message(settings))
    crossed = Joy().deserialize(serialised(gamepad(turn=0.1)))     # its axes are of 32 bits
    assert neutral.deviation(crossed) is None
    assert neutral.deviation(gamepad(left=0.0, right=0.0)) is None     # as before the triggers were touched
    assert neutral.deviation(gamepad(left=0.0)) is None and neutral.deviation(Joy()) is None
    assert neutral.deviation(gamepad(ahead=1.0)) == 'axes[1]' and neutral.deviation(gamepad(left=-1.0)) == 'axes[2]'
    assert neutral.deviation(gamepad(buttons=(0, 1))) == 'buttons[1]'


def test_what_the_sticks_show_at_rest_is_neutral_once_it_was_said_so() -> None:
    neutral = Neutral()
    for _ in range(1000):
        assert neutral.deviation(gamepad()) == 'axes[2]'       # it may as well be held
    assert neutral.rests(gamepad()) == 'axes[2] 1.0, axes[5] 1.0'
    assert neutral.deviation(gamepad()) is None and neutral.deviation(gamepad(left=0.0)) is None
    assert neutral.deviation(gamepad(ahead=0.7)) == 'axes[1]'
    assert neutral.rests(gamepad(0.0, 0.0, 0.0, 0.0)) == 'all zero'
    assert neutral.deviation(gamepad()) == 'axes[2]'

