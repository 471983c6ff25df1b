# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import Any

import pytest
from nav_msgs.msg import MapMetaData

from smokebot_udp.streams.grid.map_info import cell_at


def info(turn: float = 0.0) -> Any:
    """A map whose first cell is at (1, 2), turned about z [rad]."""
    made = MapMetaData(resolution=0.5)
    made.origin.position.x, made.origin.position.y = 1.0, 2.0
    made.origin.orientation.z, made.origin.orientation.w = math.sin(turn / 2), math.cos(turn / 2)
    return made


def test_a_place_by_hand() -> None:
    assert cell_at(info(), 3.0, 2.5, 0.0) == pytest.approx((4.0, 1.0))


def test_a_place_in_a_turned_map() -> None:
    # its columns go along the frame's y, its rows along -x
    assert cell_at(info(math.pi / 2), 0.0, 5.0, 7.0) == pytest.approx((6.0, 2.0))


def test_an_orientation_of_zeros_is_no_turn() -> None:
    made = info()
    made.origin.orientation.w = 0.0
    assert cell_at(made, 3.0, 2.5, 0.0) == pytest.approx((4.0, 1.0))
