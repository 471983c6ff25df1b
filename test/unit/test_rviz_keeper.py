# SPDX-License-Identifier: BSD-3-Clause
"""Whether rviz can be started; integration/rviz_keeper.test runs a program in its place."""
import pathlib
from typing import Any

import pytest

from smokebot_udp.nodes import rviz_keeper
from smokebot_udp.nodes.rviz_keeper import find_rviz


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
