# SPDX-License-Identifier: BSD-3-Clause
"""When packet trains leave, and how fast they are."""
import pytest

from smokebot_udp.congestion.feedback import PacketSample
from smokebot_udp.congestion.probing import (
    DURATION,
    FIRST_GAIN,
    MAX_RETRY_INTERVAL,
    NEXT_GAIN,
    RETRY_INTERVAL,
    TIMEOUT,
    ProbeController,
)


def test_trains_get_faster_after_success_and_wait_after_failure() -> None:
    probes, capacity = ProbeController(), 1e6
    newest = PacketSample(0.0, 0.0, 1000, 50000)
    first = probes.next(capacity, True, True, newest, 2000, 1.0)
    assert first == (FIRST_GAIN * capacity, DURATION * capacity)
    assert probes.next(capacity, True, True, newest, 2000, 1.1) is None         # it has not come
    came = newest._replace(total=52000 + int(first.size))
    second = probes.next(2 * capacity, True, True, came, 0, 1.2)
    assert second == (NEXT_GAIN * 2 * capacity, DURATION * 2 * capacity)
    came = came._replace(total=came.total + int(second.size))
    assert probes.next(2 * capacity, True, True, came, 0, 1.3) is None          # it brought nothing
    assert probes.next(2 * capacity, True, True, came, 0, 1.2 + RETRY_INTERVAL) is None
    assert probes.next(2 * capacity, True, True, came, 0, 1.3 + RETRY_INTERVAL).rate == FIRST_GAIN * 2 * capacity


def test_no_train_leaves_unless_more_is_wanted() -> None:
    newest = PacketSample(0.0, 0.0, 1000, 50000)
    assert ProbeController().next(1e6, True, False, newest, 0, 1.0) is None


def test_where_streams_only_wish_for_more_trains_that_bring_nothing_become_rare() -> None:
    probes, trains, total = ProbeController(), [], 0
    for step in range(1200):
        now, total = 0.1 * step, total + 100000
        newest = PacketSample(now, now, 1000, total)
        if probes.next(1e6, True, False, newest, 0, now, True) is not None:
            trains.append(now)
    waits = [later - earlier for earlier, later in zip(trains, trains[1:])]
    assert waits[0] < 1.5 * RETRY_INTERVAL and waits[1] > 1.5 * waits[0]
    assert 0.9 * MAX_RETRY_INTERVAL < waits[-1] < 1.1 * MAX_RETRY_INTERVAL
    probes.retry()
    assert probes.next(1e6, True, False, newest, 0, now + TIMEOUT, True) is not None


@pytest.mark.parametrize('empty, gain, later', [(True, NEXT_GAIN, 0.1), (False, FIRST_GAIN, 0.1 + RETRY_INTERVAL)])
def test_a_train_beside_a_queue_proves_no_wider_link_as_others_may_have_paused(empty: bool, gain: float,
                                                                               later: float) -> None:
    probes = ProbeController()
    first = probes.next(1e6, empty, True, PacketSample(0.0, 0.0, 1000, 0), 0, 10.0)
    assert first is not None and first.rate == FIRST_GAIN * 1e6
    came = PacketSample(0.0, 0.0, 1000, int(first.size))
    second = probes.next(2e6, True, True, came, 0, 10.1)
    assert (second is not None) == empty
    second = second or probes.next(2e6, True, True, came, 0, 10.0 + later)
    assert second is not None and second.rate == gain * 2e6
