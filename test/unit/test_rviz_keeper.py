# SPDX-License-Identifier: BSD-3-Clause
"""When rviz is started again; integration/rviz_keeper.test runs a program in its place."""
import pathlib
from typing import Any

import pytest

from smokebot_udp.nodes import rviz_keeper
from smokebot_udp.nodes.rviz_keeper import Restarts, find_rviz


def test_the_user_may_close_it() -> None:
    assert Restarts().delay(0, 0.5) is None
    assert Restarts().delay(0, 1000.0) is None


def test_what_crashes_is_started_again() -> None:
    assert Restarts().delay(-11, 1000.0) == 1.0
    assert Restarts().delay(1, 1000.0) == 1.0


def test_what_cannot_start_is_started_less_and_less_often() -> None:
    restarts = Restarts()
    assert [restarts.delay(-6, 0.5) for _ in range(8)] == [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0]
    assert restarts.delay(-6, 20.0) == 1.0


def test_a_machine_without_rviz_or_display_is_told_apart(monkeypatch: Any) -> None:
    monkeypatch.setattr(rviz_keeper.roslib.packages, 'find_node', lambda *_: [])
    with pytest.raises(OSError, match='not installed'):
        find_rviz()
    monkeypatch.setattr(rviz_keeper.roslib.packages, 'find_node', lambda *_: [pathlib.Path('/bin/rviz')])
    for name in ('DISPLAY', 'WAYLAND_DISPLAY'):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(OSError, match='no display'):
        find_rviz()
    monkeypatch.setenv('DISPLAY', ':0')
    assert find_rviz() == '/bin/rviz'
