# SPDX-License-Identifier: BSD-3-Clause
import pytest

from smokebot_udp.congestion.delay import QueueDelay
from smokebot_udp.congestion.feedback import PacketSample
from smokebot_udp.congestion.pause import CHECK, DIP, DRAIN, MAX_BASE_STEP, MIN_DRAIN_DURATION, Pause


def sample(sent: float, delay: float) -> PacketSample:
    return PacketSample(sent, sent + delay, 1000, 0)


def settled() -> QueueDelay:
    delay = QueueDelay()
    delay.update([sample(0.0, 0.02)], 1e6, 0.0)
    return delay


def test_a_dip_measures_the_base_delay_again() -> None:
    delay, pause = settled(), Pause()
    pause.begin(DIP, 10.0)
    assert pause.gain(10.0 + DIP.duration / 2) == DIP.gain and not pause.active(10.0 + DIP.duration)
    assert pause.covers(10.1) and not pause.covers(9.9) and pause.since(10.1) is None
    pause.on_sample(sample(10.05, 0.05), 0.03, 0.01, delay, 10.1)
    assert delay.of(sample(10.3, 0.04)) == pytest.approx(0.02)
    pause.on_sample(sample(10.15, 0.04), 0.02, 0.01, delay, 10.0 + DIP.duration)
    assert delay.of(sample(10.3, 0.04)) == pytest.approx(0.02 - MAX_BASE_STEP)


def test_a_drain_ends_when_the_queue_is_gone() -> None:
    delay, pause = settled(), Pause()
    pause.begin(DRAIN, 10.0)
    assert pause.gain(10.0 + DRAIN.duration / 2) == DRAIN.gain and pause.since(10.1) == 10.0
    pause.on_sample(sample(10.02, 0.1), 0.08, 0.01, delay, 10.1)
    pause.on_sample(sample(10.1, 0.021), 0.001, 0.01, delay, 10.05 + MIN_DRAIN_DURATION)
    assert not pause.active(10.05 + MIN_DRAIN_DURATION)
    assert delay.of(sample(10.3, 0.031)) == pytest.approx(0.01)


def test_what_a_drain_leaves_is_the_path() -> None:
    delay, pause, now = settled(), Pause(), 10.0
    pause.begin(DRAIN, now)
    while pause.active(now):
        now += 0.1
        pause.on_sample(sample(now - 0.05, 0.07), 0.05, 0.01, delay, now)
    assert now == pytest.approx(10.0 + DRAIN.duration, abs=0.11)
    assert delay.of(sample(now, 0.07)) == 0


def test_a_drain_is_extended_while_the_delay_falls() -> None:
    delay, pause, now, way = settled(), Pause(), 10.0, 0.2
    pause.begin(DRAIN, now)
    while pause.active(now):
        now, way = now + 0.1, max(0.02, way - 0.01)
        pause.on_sample(sample(now - 0.05, way), way - 0.02, 0.01, delay, now)
    assert now > 10.0 + 2 * DRAIN.duration and way < 0.035


def test_a_pause_is_not_begun_again_before_it_was_measured_and_a_cancelled_one_measures_nothing() -> None:
    delay, pause = settled(), Pause()
    pause.begin(DRAIN, 10.0)
    pause.on_sample(sample(10.02, 0.1), 0.08, 0.01, delay, 10.1)
    pause.begin(CHECK, 10.0 + 2 * DRAIN.duration)
    assert pause.kind is DRAIN and not pause.active(10.0 + 2 * DRAIN.duration)
    pause.cancel()
    pause.on_sample(sample(12.0, 0.1), 0.08, 0.01, delay, 12.1)
    assert delay.of(sample(12.0, 0.1)) == pytest.approx(0.08)
    pause.begin(CHECK, 13.0)
    assert pause.since(13.1) == 13.0 and pause.gain(13.1) == CHECK.gain
