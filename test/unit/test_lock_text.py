# SPDX-License-Identifier: BSD-3-Clause
from typing import Dict, Optional

import pytest

from smokebot_udp.nodes.operator_control import lock_text, view_text


@pytest.mark.parametrize('reasons, text', [
    ({}, ''), ({'cmd_vel': None}, ''), ({'cmd_vel': 'thermal is 2.0 s old'}, 'LOCKED: thermal is 2.0 s old'),
    ({'cmd_vel': 'nobody drives', 'arm': 'nobody drives'}, 'LOCKED: nobody drives'),
    ({'cmd_vel': None, 'arm': 'no image of camera'}, 'LOCKED: arm: no image of camera'),
    ({'arm': 'no image of thermal', 'pad': 'release the stick: axes[2] is not at rest', 'cmd_vel': None},
     'LOCKED: pad: release the stick: axes[2] is not at rest'),
])
def test_which_streams_are_locked_and_why(reasons: Dict[str, Optional[str]], text: str) -> None:
    assert lock_text(reasons) == text


@pytest.mark.parametrize('notice, commanded, text', [
    ('LOCKED: release the stick', False, ''), ('LOCKED: release the stick', True, 'LOCKED: release the stick'),
    ('EMERGENCY STOP', False, 'EMERGENCY STOP'), ('NOT IN CONTROL: /a drives', False, 'NOT IN CONTROL: /a drives'),
    ('', True, '')])
def test_nothing_is_red_before_anyone_has_driven(notice: str, commanded: bool, text: str) -> None:
    assert view_text(notice, commanded) == text
