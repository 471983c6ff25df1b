# SPDX-License-Identifier: BSD-3-Clause
import pytest

from smokebot_udp.congestion.delay import KEEPS, QueueDelay, typical
from smokebot_udp.congestion.feedback import Point
from smokebot_udp.congestion.probe_rtt import DIP, DIP_RATE, DRAIN, DRAIN_RATE, RISE, SETTLES, Quiet

CAPACITY = 1e6
"""[byte/s]"""


def point(sent, delay, size=1000):
    return Point(sent, sent + delay, size, 0)


def test_the_one_in_the_middle_speaks_for_those_that_came_last():
    old, points = point(0.0, 0.9), [point(1.0, 0.03), point(1.001, 0.01), point(1.002, 0.05)]
    assert typical([old] + points) == points[0]
    assert typical(points[:2]) == points[1]


def test_what_comes_on_top_of_the_least_delay_is_the_queue():
    delay = QueueDelay()
    delay.note([point(1.0, 7000.02)], CAPACITY, 1.1)       # the clocks differ by some hours
    assert delay.of(point(1.1, 7000.05)) == pytest.approx(0.03)
    assert delay.of(point(1.2, 7000.01)) == 0
    delay.note([point(1.2, 7000.01)], CAPACITY, 1.3)
    assert delay.of(point(1.3, 7000.05)) == pytest.approx(0.04)


def test_a_long_datagram_takes_its_time_on_the_air():
    delay = QueueDelay()
    delay.note([point(1.0, 0.02, size=100)], CAPACITY, 1.1)
    assert delay.of(point(1.1, 0.0209, size=1000)) == pytest.approx(0, abs=1e-9)
    assert delay.of(point(1.1, 0.03, size=1000)) == pytest.approx(0.0091)


def test_a_base_that_nothing_comes_near_to_expires():
    delay = QueueDelay()
    delay.note([point(1.0, 0.02)], CAPACITY, 1.0)
    delay.note([point(4.0, 0.021)], CAPACITY, 4.0)
    assert not delay.expired(4.0 + KEEPS)
    delay.note([point(8.0, 0.03)], CAPACITY, 8.0)
    assert delay.expired(4.1 + KEEPS)


def test_a_base_rises_by_little_at_once_and_falls_at_once():
    delay = QueueDelay()
    delay.note([point(1.0, 0.02)], CAPACITY, 1.0)
    delay.raise_to(point(2.0, 0.03), 0.004, 2.0)
    assert delay.of(point(2.1, 0.03)) == pytest.approx(0.006)
    delay.raise_to(point(3.0, 0.026), 0.004, 3.0)
    assert delay.of(point(3.1, 0.03)) == pytest.approx(0.004)


def test_jitter_is_noise_and_a_growing_queue_is_none():
    delay = QueueDelay()
    for _ in range(50):
        delay.note_noise([point(0.01 * k, 0.02 + 0.001 * k) for k in range(20)])
    assert delay.noise == pytest.approx(0, abs=1e-6)
    for _ in range(50):
        delay.note_noise([point(0.01 * k, 0.02 + 0.004 * (k % 2)) for k in range(20)])
    assert delay.noise == pytest.approx(0.002, rel=0.1)


def settled():
    delay = QueueDelay()
    delay.note([point(0.0, 0.02)], CAPACITY, 0.0)
    return delay


def test_a_dip_measures_the_least_delay_anew():
    delay, quiet = settled(), Quiet()
    quiet.begin(True, False, False, 0.0, 10.0)
    assert quiet.most(10.0 + DIP / 2) == DIP_RATE and not quiet.lasts(10.0 + DIP)
    assert quiet.holds(10.1) and not quiet.holds(9.9)
    assert not quiet.go_on(delay, point(10.05, 0.05), 0.03, 0.01, 10.1)
    assert quiet.go_on(delay, point(10.15, 0.04), 0.02, 0.01, 10.0 + DIP)
    assert delay.of(point(10.3, 0.04)) == pytest.approx(0.02 - RISE)


def test_a_drain_ends_where_the_queue_does():
    delay, quiet = settled(), Quiet()
    quiet.begin(False, True, False, 0.0, 10.0)
    assert quiet.most(10.0 + DRAIN / 2) == DRAIN_RATE
    assert not quiet.go_on(delay, point(10.02, 0.1), 0.08, 0.01, 10.1)
    assert quiet.go_on(delay, point(10.1, 0.021), 0.001, 0.01, 10.05 + SETTLES)
    assert delay.of(point(10.3, 0.031)) == pytest.approx(0.01)


def test_what_a_drain_leaves_is_the_way():
    delay, quiet, now = settled(), Quiet(), 10.0
    quiet.begin(False, True, False, 0.0, now)
    while not quiet.go_on(delay, point(now - 0.05, 0.07), 0.05, 0.01, now):
        now += 0.1
    assert now == pytest.approx(10.0 + DRAIN, abs=0.11)
    assert delay.of(point(now, 0.07)) == 0


def test_a_drain_goes_on_while_the_delay_falls():
    delay, quiet, now, way = settled(), Quiet(), 10.0, 0.2
    quiet.begin(False, True, False, 0.0, now)
    while not quiet.go_on(delay, point(now - 0.05, way), way - 0.02, 0.01, now):
        now, way = now + 0.1, max(0.02, way - 0.01)
    assert now > 10.0 + 2 * DRAIN and way < 0.035
