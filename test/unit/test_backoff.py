# SPDX-License-Identifier: BSD-3-Clause
from smokebot_udp.backoff import Backoff


def test_intervals_double_up_to_the_longest_and_begin_again() -> None:
    backoff = Backoff(0.2, 1.0)
    assert backoff.interval == 0.2
    assert [backoff.take() for _ in range(5)] == [0.2, 0.4, 0.8, 1.0, 1.0]
    backoff.reset()
    assert backoff.take() == 0.2 and backoff.interval == 0.4
