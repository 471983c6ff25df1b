# SPDX-License-Identifier: BSD-3-Clause
"""The last originals: bounded by age and memory, found by their stamps."""
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.capture.history import MESSAGE_OVERHEAD, Histories

SECOND = 10 ** 9


def message(size: int = 10) -> Any:
    return SimpleNamespace(data=bytes(size))


def filled(period: float = 10.0, count: int = 20) -> Histories:
    """One message a second, from 100 s on by its stamp."""
    histories = Histories(1 << 30)
    for second in range(count):
        histories.add('thermal', message(), (100 + second) * SECOND, period, float(second))
    return histories


def test_the_nearest_one_is_found_by_its_stamp_and_the_newest_one_without() -> None:
    histories = filled()
    assert histories.find('thermal', 0).stamp == 119 * SECOND
    assert histories.find('thermal', 115 * SECOND).stamp == 115 * SECOND
    assert histories.find('thermal', 115 * SECOND + SECOND // 3).stamp == 115 * SECOND
    assert histories.find('thermal', 119 * SECOND + SECOND // 2).stamp == 119 * SECOND


def test_old_ones_are_forgotten() -> None:
    histories = filled(10.0)
    assert histories.find('thermal', 109 * SECOND).stamp == 109 * SECOND
    with pytest.raises(ValueError, match=r"from 109\.000 to 119\.000, none within 1 s of 105\.000"):
        histories.find('thermal', 105 * SECOND)


def test_without_history_nothing_is_found() -> None:
    histories = Histories(1000)
    histories.add('camera', message(), 1, 0.0, 0.0)
    for stream in 'camera', 'lidar':
        with pytest.raises(ValueError, match="no original of stream '%s'" % stream):
            histories.find(stream, 0)
    assert histories.bytes == 0


def test_a_history_that_is_switched_off_is_given_back() -> None:
    histories = filled()
    histories.add('thermal', message(), 200 * SECOND, 0.0, 20.0)
    assert histories.bytes == 0


def test_where_memory_ends_the_oldest_of_all_streams_goes() -> None:
    one = 1000 + MESSAGE_OVERHEAD
    histories = Histories(3 * one)
    histories.add('camera', message(1000), 1 * SECOND, 10.0, 1.0)
    for second in (2, 3, 4):
        histories.add('thermal', message(1000), second * SECOND, 10.0, float(second))
    with pytest.raises(ValueError, match='camera'):
        histories.find('camera', 0)
    assert histories.find('thermal', 2 * SECOND).stamp == 2 * SECOND
    histories.add('thermal', message(1 << 20), 5 * SECOND, 10.0, 5.0)      # larger than all memory
    assert histories.bytes == 0


@given(st.lists(st.tuples(st.sampled_from('ab'), st.integers(0, 5000), st.floats(0, 20), st.floats(0, 3))))
def test_memory_is_always_bounded(steps: Any) -> None:
    histories, now = Histories(10000), 0.0
    for stream, size, period, passed in steps:
        now += passed
        histories.add(stream, message(size), int(now * SECOND), period, now)
        assert 0 <= histories.bytes <= 10000
