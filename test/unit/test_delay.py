# SPDX-License-Identifier: BSD-3-Clause
import pytest

from smokebot_udp.congestion.delay import BASE_LIFETIME, QueueDelay, typical
from smokebot_udp.congestion.feedback import PacketSample

CAPACITY = 1e6
"""[byte/s]"""


def sample(sent: float, delay: float, size: int = 1000) -> PacketSample:
    return PacketSample(sent, sent + delay, size, 0)


def test_the_typical_sample_has_the_median_delay_of_the_newest() -> None:
    old, samples = sample(0.0, 0.9), [sample(1.0, 0.03), sample(1.001, 0.01), sample(1.002, 0.05)]
    assert typical([old] + samples) == samples[0]
    assert typical(samples[:2]) == samples[1]


def test_queueing_delay_is_above_the_base_delay() -> None:
    delay = QueueDelay()
    delay.update([sample(1.0, 7000.02)], CAPACITY, 1.1)       # the clocks differ by some hours
    assert delay.of(sample(1.1, 7000.05)) == pytest.approx(0.03)
    assert delay.of(sample(1.2, 7000.01)) == 0
    delay.update([sample(1.2, 7000.01)], CAPACITY, 1.3)
    assert delay.of(sample(1.3, 7000.05)) == pytest.approx(0.04)


def test_time_on_the_air_is_no_queueing_delay() -> None:
    delay = QueueDelay()
    delay.update([sample(1.0, 0.02, size=100)], CAPACITY, 1.1)
    assert delay.of(sample(1.1, 0.0209, size=1000)) == pytest.approx(0, abs=1e-9)
    assert delay.of(sample(1.1, 0.03, size=1000)) == pytest.approx(0.0091)


def test_a_base_that_nothing_confirms_expires() -> None:
    delay = QueueDelay()
    delay.update([sample(1.0, 0.02)], CAPACITY, 1.0)
    delay.update([sample(4.0, 0.021)], CAPACITY, 4.0)
    assert not delay.expired(4.0 + BASE_LIFETIME)
    delay.update([sample(8.0, 0.03)], CAPACITY, 8.0)
    assert delay.expired(4.1 + BASE_LIFETIME)


def test_a_base_is_raised_by_a_limited_step() -> None:
    delay = QueueDelay()
    delay.update([sample(1.0, 0.02)], CAPACITY, 1.0)
    delay.raise_base(sample(2.0, 0.03), 0.004, 2.0)
    assert delay.of(sample(2.1, 0.03)) == pytest.approx(0.006)
    delay.raise_base(sample(3.0, 0.026), 0.004, 3.0)
    assert delay.of(sample(3.1, 0.03)) == pytest.approx(0.004)


def test_jitter_is_noise_and_a_growing_queue_is_not() -> None:
    delay = QueueDelay()
    for _ in range(50):
        delay.update_noise([sample(0.01 * k, 0.02 + 0.001 * k) for k in range(20)])
    assert delay.noise == pytest.approx(0, abs=1e-6)
    for _ in range(50):
        delay.update_noise([sample(0.01 * k, 0.02 + 0.004 * (k % 2)) for k in range(20)])
    assert delay.noise == pytest.approx(0.002, rel=0.1)
