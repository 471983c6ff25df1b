# SPDX-License-Identifier: BSD-3-Clause
import pytest

from smokebot_udp.congestion.delay import QueueDelay
from smokebot_udp.congestion.feedback import PacketSample
from smokebot_udp.congestion.probe_rtt import (
    DIP_DURATION,
    DIP_GAIN,
    DRAIN_DURATION,
    DRAIN_GAIN,
    MAX_BASE_STEP,
    MIN_DRAIN_DURATION,
    ProbeRtt,
)


def sample(sent: float, delay: float) -> PacketSample:
    return PacketSample(sent, sent + delay, 1000, 0)


def settled() -> QueueDelay:
    delay = QueueDelay()
    delay.update([sample(0.0, 0.02)], 1e6, 0.0)
    return delay


def test_a_dip_measures_the_base_delay_again() -> None:
    delay, pause = settled(), ProbeRtt()
    pause.begin(True, False, 10.0)
    assert pause.gain(10.0 + DIP_DURATION / 2) == DIP_GAIN and not pause.active(10.0 + DIP_DURATION)
    assert pause.covers(10.1) and not pause.covers(9.9)
    assert not pause.on_sample(sample(10.05, 0.05), 0.03, 0.01, delay, 10.1)
    assert pause.on_sample(sample(10.15, 0.04), 0.02, 0.01, delay, 10.0 + DIP_DURATION)
    assert delay.of(sample(10.3, 0.04)) == pytest.approx(0.02 - MAX_BASE_STEP)


def test_a_drain_ends_when_the_queue_is_gone() -> None:
    delay, pause = settled(), ProbeRtt()
    pause.begin(False, True, 10.0)
    assert pause.gain(10.0 + DRAIN_DURATION / 2) == DRAIN_GAIN
    assert not pause.on_sample(sample(10.02, 0.1), 0.08, 0.01, delay, 10.1)
    assert pause.on_sample(sample(10.1, 0.021), 0.001, 0.01, delay, 10.05 + MIN_DRAIN_DURATION)
    assert delay.of(sample(10.3, 0.031)) == pytest.approx(0.01)


def test_what_a_drain_leaves_is_the_path() -> None:
    delay, pause, now = settled(), ProbeRtt(), 10.0
    pause.begin(False, True, now)
    while not pause.on_sample(sample(now - 0.05, 0.07), 0.05, 0.01, delay, now):
        now += 0.1
    assert now == pytest.approx(10.0 + DRAIN_DURATION, abs=0.11)
    assert delay.of(sample(now, 0.07)) == 0


def test_a_drain_is_extended_while_the_delay_falls() -> None:
    delay, pause, now, way = settled(), ProbeRtt(), 10.0, 0.2
    pause.begin(False, True, now)
    while not pause.on_sample(sample(now - 0.05, way), way - 0.02, 0.01, delay, now):
        now, way = now + 0.1, max(0.02, way - 0.01)
    assert now > 10.0 + 2 * DRAIN_DURATION and way < 0.035
