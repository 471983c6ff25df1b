# SPDX-License-Identifier: BSD-3-Clause
"""When a program is started again."""
from smokebot_udp.nodes.restarts import Restarts


def test_what_ran_for_long_is_started_again_soon() -> None:
    assert [Restarts().delay(1000.0), Restarts().delay(0.0)] == [1.0, 1.0]


def test_what_cannot_start_is_started_less_and_less_often() -> None:
    restarts = Restarts()
    assert [restarts.delay(0.5) for _ in range(8)] == [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0]
    assert restarts.delay(20.0) == 1.0
