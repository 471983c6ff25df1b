# SPDX-License-Identifier: BSD-3-Clause
"""When packet trains leave, and how fast they are."""
import pytest

from smokebot_udp.congestion.feedback import PacketSample
from smokebot_udp.congestion.probing import FIRST_GAIN, NEXT_GAIN, QUEUED_RETRY_INTERVAL, ProbeController

CAPACITY, SIZE = 1e6, 1000
"""[byte/s], [byte]"""


def newest(total: int) -> PacketSample:
    return PacketSample(0.0, 0.0, SIZE, total)


@pytest.mark.parametrize('empty, gain', [(True, NEXT_GAIN), (False, FIRST_GAIN)])
def test_after_a_train_that_found_more_the_next_one_is_faster_unless_others_may_have_paused(empty: bool,
                                                                                           gain: float) -> None:
    probes = ProbeController()
    first = probes.next(CAPACITY, empty, True, newest(0), 0, QUEUED_RETRY_INTERVAL)
    assert first is not None and first.rate == FIRST_GAIN * CAPACITY
    arrived = newest(int(first.size))
    second = probes.next(2 * CAPACITY, True, True, arrived, 0, 10.0) or probes.next(
        2 * CAPACITY, True, True, arrived, 0, 20.0)
    assert second is not None and second.rate == gain * 2 * CAPACITY
