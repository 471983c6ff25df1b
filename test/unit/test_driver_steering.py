# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import Any

import numpy as np
import pytest

from evaluation.driver_steering import CLEARANCE, SPEED, is_reached, nearest_ahead, steer
from smokebot_udp.simulation.world import room_centre


@pytest.mark.parametrize('ranges, angles, nearest', [
    ([2.0, 1.0, 3.0], [0.0, 1.5, -0.05], 2.0),          # 1.0 m is beside the way
    ([math.nan, math.inf], [0.0, 0.1], math.inf),
    ([1.0], [math.pi], math.inf),                       # behind
    ([], [], math.inf),
])
def test_the_nearest_obstacle_ahead(ranges: Any, angles: Any, nearest: float) -> None:
    assert nearest_ahead(np.array(ranges, float), np.array(angles, float)) == pytest.approx(nearest)


@pytest.mark.parametrize('target, obstacle, forward, turn', [
    ((5.0, 0.0), math.inf, SPEED, 0.0),
    ((0.0, 5.0), math.inf, 0.0, 1.0),                   # it turns on the spot
    ((0.0, -5.0), math.inf, 0.0, -1.0),
    ((5.0, 0.0), CLEARANCE + 0.5, SPEED / 2, 0.0),
    ((5.0, 0.0), CLEARANCE - 0.1, 0.0, 0.0),
    ((0.5, 0.0), math.inf, SPEED / 2, 0.0),
])
def test_a_command(target: Any, obstacle: float, forward: float, turn: float) -> None:
    assert steer((0.0, 0.0, 0.0), target, obstacle) == pytest.approx((forward, turn))


def test_a_robot_that_obeys_arrives() -> None:
    x, y, yaw = 3.5, 7.0, 3.0
    target = room_centre((0, 1))
    for _ in range(1000):
        forward, turn = steer((x, y, yaw), target, math.inf)
        x, y, yaw = x + 0.05 * forward * math.cos(yaw), y + 0.05 * forward * math.sin(yaw), yaw + 0.05 * turn
        if is_reached((x, y, yaw), target):
            return
    raise AssertionError((x, y, yaw))
