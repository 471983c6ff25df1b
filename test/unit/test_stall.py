# SPDX-License-Identifier: BSD-3-Clause
from smokebot_udp.teleop.stall import MAX_GAP, RECOVERY, STALLED, Stall


def test_what_comes_after_a_stall_is_not_taken_until_all_that_waited_is_read() -> None:
    tested = Stall()
    assert [tested.look(100.0 + 0.1 * i) for i in range(20)] == [''] * 20
    resumed = 101.9 + MAX_GAP + 0.01
    assert [tested.look(resumed + wait) for wait in (0.0, 0.001, 0.9 * RECOVERY)] == [STALLED] * 3
    assert tested.look(resumed + 1.1 * RECOVERY) == ''


def test_a_thread_that_has_read_the_clock_before_the_stall_hides_nothing() -> None:
    tested = Stall()
    tested.look(100.0)
    tested.look(100.1)
    assert tested.look(100.05) == ''    # resumed first
    assert tested.look(103.0) == STALLED and tested.look(103.1) == STALLED
