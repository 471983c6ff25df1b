# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, List

import rospy

from smokebot_udp.nodes.logging import log_error


def test_the_same_error_is_logged_once_a_period(monkeypatch: Any) -> None:
    logged: List[str] = []
    now = [100.0]
    monkeypatch.setattr(rospy, 'logerr', lambda text, *values: logged.append(text % values))
    monkeypatch.setattr(rospy, 'is_shutdown', lambda: False)
    monkeypatch.setattr('smokebot_udp.limited_log.time.monotonic', lambda: now[0])
    one, other = log_error('one', 60.0), log_error('other', 60.0)
    for _ in range(3):
        one(OSError('broken'))
        other(OSError('lost'))
    assert logged == ['one: broken', 'other: lost']
    now[0] += 61.0
    one(OSError('broken'))
    one(OSError('100 %s'))
    assert logged[2:] == ['one: broken (and 2 more like it)', 'one: 100 %s']
