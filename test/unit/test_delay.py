# SPDX-License-Identifier: BSD-3-Clause
from typing import List

import numpy as np
import pytest

from smokebot_udp.congestion.delay import BASE_LIFETIME, NOISY_LIFETIME, QueueDelay, own_waits, typical
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


def chain(*delays: float, interval: float = 0.01, size: int = 1000) -> List[PacketSample]:
    """Samples in even intervals."""
    return [sample(interval * k, delay, size)._replace(total=size * (k + 1)) for k, delay in enumerate(delays)]


def test_jitter_is_noise_and_a_growing_queue_is_not() -> None:
    delay = QueueDelay()
    for _ in range(50):
        delay.update_noise(chain(*(0.02 + 0.001 * k for k in range(20))), CAPACITY)
    assert delay.noise == pytest.approx(0, abs=1e-6)
    for _ in range(50):
        delay.update_noise(chain(*(0.02 + 0.004 * (k % 2) for k in range(20))), CAPACITY)
    assert delay.noise == pytest.approx(0.002, rel=0.1)


def test_datagrams_wait_for_those_before_them() -> None:
    """1000 byte take 20 ms, and the third datagram leaves 30 ms after the second. Before the last one another was
    lost."""
    samples = [PacketSample(0.0, 0.5, 1000, 1000), PacketSample(0.0, 0.5, 500, 1500),
               PacketSample(0.03, 0.5, 1000, 2500), PacketSample(0.09, 0.5, 500, 3000),
               PacketSample(0.10, 0.5, 500, 4500)]
    np.testing.assert_allclose(own_waits(samples, 50000.0), [0.02, 0.03, 0.02, 0.01, 0.03])


def test_what_ones_own_datagrams_wait_for_each_other_is_no_noise() -> None:
    """Images of four datagrams leave faster than a slow link carries them."""
    delay, link, free = QueueDelay(), 37500.0, 0.0
    samples, total = [], 0
    for image in range(5):
        for number in range(4):
            sent, total = 0.1 * image + 0.001 * number, total + 700
            free = max(free, sent) + 700 / link
            samples.append(PacketSample(sent, free + 0.02, 700, total))
    for _ in range(20):
        delay.update_noise(samples, link)
    assert delay.noise == pytest.approx(0, abs=1e-6)


def test_a_noisy_base_is_raised_further() -> None:
    """Where few datagrams came, the least delay is one that jitter made short."""
    delay = QueueDelay()
    delay.update([sample(1.0, 0.02)], CAPACITY, 1.0)
    for _ in range(50):
        delay.update_noise(chain(*(0.02 + 0.009 * (k % 2) for k in range(20))), CAPACITY)
    assert delay.allowance == pytest.approx(0.009, rel=0.1)
    delay.raise_base(sample(2.0, 0.05), 0.004, 2.0)
    assert delay.of(sample(2.1, 0.05)) == pytest.approx(0.017, abs=0.0005)
    delay.raise_base(sample(3.0, 0.05), 0.004, 3.0)     # that was no least delay
    assert delay.of(sample(3.1, 0.05)) == pytest.approx(0.013, abs=0.0005)


def test_a_base_that_jitter_may_have_made_short_expires_sooner() -> None:
    delay = QueueDelay()
    delay.update([sample(0.0, 0.01)], CAPACITY, 0.0)
    assert not delay.expired(NOISY_LIFETIME + 0.1)
    for _ in range(20):
        delay.update_noise(chain(*(0.03 if k % 2 else 0.01 for k in range(20))), CAPACITY)
    assert delay.expired(NOISY_LIFETIME + 0.1)
    delay.set_base(sample(3.0, 0.02), 3.0)      # measured in a pause
    assert not delay.expired(3.0 + BASE_LIFETIME) and delay.expired(3.1 + BASE_LIFETIME)
