# SPDX-License-Identifier: BSD-3-Clause
import math
import statistics
from typing import List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.monitoring.windows import Rate, Samples, Silence


def test_a_rate_is_growth_over_time() -> None:
    rate = Rate(window=5.0)
    assert rate.per_second is None and rate.growth == 0
    rate.read(1000, 0.0)
    assert rate.per_second is None and rate.growth == 0
    for second in range(1, 20):
        rate.read(1000 + 10 * second, float(second))
        assert rate.per_second == pytest.approx(10.0)
    assert rate.growth == 50


def test_a_rate_ignores_growth_before_its_window() -> None:
    rate = Rate(window=5.0)
    for second in range(30):
        rate.read(100 * min(second, 10), float(second))
    assert rate.per_second == 0.0 and rate.growth == 0


def test_a_counter_that_falls_has_restarted() -> None:
    rate = Rate()
    for now, total in enumerate((100, 110, 4, 14)):
        rate.read(total, float(now))
    assert rate.growth == 10 + 4 + 10


def test_unknown_readings_are_ignored() -> None:
    rate = Rate()
    for now, total in enumerate((None, 5, None, 15)):
        rate.read(total, float(now))
    assert rate.growth == 10 and rate.per_second == pytest.approx(5.0)


def test_readings_at_the_same_time_count_once() -> None:
    rate = Rate()
    for total, now in ((0, 1.0), (5, 1.0), (7, 0.5), (17, 2.0)):
        rate.read(total, now)
    assert rate.per_second == pytest.approx(10.0)


def test_a_rate_between_rare_readings() -> None:
    rate = Rate(window=1.0)
    rate.read(0, 0.0)
    rate.read(50, 10.0)
    assert rate.per_second == pytest.approx(5.0)
    rate.read(60, 20.0)
    assert rate.per_second == pytest.approx(1.0)


@given(st.lists(st.tuples(st.floats(0.0, 2.0), st.integers(0, 1000)), max_size=300))
def test_rates_are_never_negative(steps: List[Tuple[float, int]]) -> None:
    rate, now = Rate(max_readings=16), 0.0
    for step, total in steps:
        now += step
        rate.read(total, now)
        assert rate.growth >= 0 and (rate.per_second or 0) >= 0


def test_readings_are_bounded() -> None:
    rate = Rate(window=1e9, max_readings=16)
    for second in range(300):
        rate.read(second, float(second))
    assert rate.growth == 15


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=100), st.floats(0, 100))
def test_percentiles_are_between_least_and_greatest(values: List[float], percent: float) -> None:
    samples = Samples(max_samples=100)
    for value in values:
        samples.add(value, 0.0)
    assert samples.percentile(0, 0.0) == min(values) and samples.percentile(100, 0.0) == max(values)
    assert samples.percentile(50, 0.0) == pytest.approx(statistics.median(values))
    below, found, above = (samples.percentile(p, 0.0) for p in (percent / 2, percent, (100 + percent) / 2))
    assert below <= found + 1e-6 and found <= above + 1e-6


def test_samples_outside_the_window_do_not_count() -> None:
    samples = Samples(window=5.0)
    assert samples.percentile(50, 0.0) is None
    samples.add(1.0, 0.0)
    samples.add(3.0, 4.0)
    assert samples.percentile(50, 4.0) == 2.0 and samples.percentile(75, 4.0) == 2.5
    assert samples.percentile(50, 6.0) == 3.0
    assert samples.percentile(50, 10.0) is None


def test_samples_that_are_not_finite_are_ignored() -> None:
    samples = Samples(max_samples=8)
    for value in (None, math.nan, math.inf):
        samples.add(value, 0.0)
    assert samples.percentile(99, 0.0) is None
    for value in range(100):
        samples.add(float(value), 0.0)
    assert samples.percentile(0, 0.0) == 92.0


def test_silence_is_too_long_beyond_the_limit() -> None:
    silence = Silence(0.0)
    assert silence.too_long(1.9, 2.0) is None and silence.too_long(2.1, 2.0) == pytest.approx(2.1)
    silence.read(0, 3.0)
    assert silence.too_long(3.0, 2.0) == pytest.approx(3.0)     # it counts, but has counted nothing
    silence.read(1, 4.0)
    assert silence.too_long(7.9, 4.0) is None and silence.too_long(8.1, 4.0) == pytest.approx(4.1)
    silence.reset(9.0)
    assert silence.too_long(12.9, 4.0) is None


def test_a_counter_that_stopped_early_is_silent_too_long_as_well() -> None:
    silence = Silence(0.0)
    for second in range(20):
        silence.read(min(3, second), float(second))
    assert silence.too_long(5.9, 2.0) is None and silence.too_long(6.1, 2.0) == pytest.approx(3.1)
    assert silence.too_long(19.0, 2.0) == 16.0


def test_a_slow_counter_may_be_silent_for_longer() -> None:
    silence = Silence(0.0)
    for second in range(41):
        silence.read(second // 4, float(second))
    assert silence.too_long(51.0, 2.0) is None      # 11 s where 4 s are usual
    assert silence.too_long(53.5, 2.0) == pytest.approx(13.5)
