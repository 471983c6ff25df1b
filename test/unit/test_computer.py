# SPDX-License-Identifier: BSD-3-Clause
"""The load of a computer; test_black_box.py reads /proc/loadavg."""
from typing import List

import pytest

from smokebot_udp.monitoring.computer import OVERLOAD, ComputerMonitor
from smokebot_udp.monitoring.status import OK, WARN


@pytest.mark.parametrize('loads, level', [
    ([0.5] * 10, OK), ([0.5] * 6 + [9.0] * 4, OK), ([0.5] * 4 + [9.0] * 6, WARN), ([OVERLOAD] * 3, WARN),
    ([9.0] * 10 + [0.5] * 8, OK)])
def test_it_is_overloaded_where_it_is_most_of_the_time(loads: List[float], level: int) -> None:
    monitor = ComputerMonitor()
    statuses = [monitor.update(load, float(second)) for second, load in enumerate(loads)]
    assert statuses[-1].level == level
    assert (statuses[-1].message == 'fine') == (level == OK)


def test_the_message_has_the_number() -> None:
    assert ComputerMonitor().update(4.5, 0.0).message.startswith('overloaded: 4.5 programs for each processor')
