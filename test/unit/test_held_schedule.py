# SPDX-License-Identifier: BSD-3-Clause
"""When an operator reports what it holds."""
from smokebot_udp.streams.held_schedule import COALESCED, MAX_SILENCE, PERIOD, HeldSchedule


def test_segments_are_reported_at_once_and_further_ones_together() -> None:
    schedule = HeldSchedule()
    assert schedule.deadline() is None and schedule.poll(0.0) is None
    schedule.received('map', 5.0)
    assert schedule.poll(5.0) == 'map' and schedule.poll(5.0) is None
    for now in (5.01, 5.02):
        schedule.received('map', now)
    assert schedule.deadline() == 5.0 + COALESCED
    assert schedule.poll(5.05) is None
    assert schedule.poll(5.1) == 'map' and schedule.poll(5.15) is None


def test_reports_are_repeated_while_the_robot_is_heard() -> None:
    schedule = HeldSchedule()
    schedule.received('map', 0.0)
    times, now = [], 0.0
    while now <= 2 * MAX_SILENCE:
        if schedule.poll(now):
            times.append(now)
        now += 0.5
    assert times == [PERIOD * k for k in range(int(MAX_SILENCE / PERIOD) + 1)]
    assert schedule.deadline() is None
    schedule.received('map', 100.0)
    assert schedule.poll(100.0) == 'map'


def test_a_kind_may_be_reported_more_often() -> None:
    schedule = HeldSchedule()
    schedule.received('thermal', 5.0, 0.03)
    assert schedule.poll(5.0) == 'thermal'
    schedule.received('thermal', 5.01, 0.03)
    schedule.received('map', 5.01)
    assert schedule.poll(5.01) == 'map' and schedule.deadline() == 5.03
    assert schedule.poll(5.03) == 'thermal'


def test_streams_are_reported_each_for_itself() -> None:
    schedule = HeldSchedule()
    schedule.received('map', 0.0)
    schedule.received('costmap', 0.0)
    assert {schedule.poll(0.0), schedule.poll(0.0)} == {'map', 'costmap'}
    schedule.received('costmap', 0.02)
    assert schedule.poll(0.1) == 'costmap' and schedule.poll(0.1) is None
