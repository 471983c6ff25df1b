# SPDX-License-Identifier: BSD-3-Clause
import bisect
import itertools
from typing import List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.delivery_rate import busy_period, peak_rate
from smokebot_udp.congestion.feedback import SAMPLE_INTERVAL, PacketSample
from smokebot_udp.congestion.shaper import Passed


def samples(*times: Tuple[float, float], size: int = 1000) -> List[PacketSample]:
    """Samples of (sent, arrived), one after the other."""
    return [PacketSample(sent, arrived, size, size * (k + 1)) for k, (sent, arrived) in enumerate(times)]


def passed(chain: List[PacketSample], waits: List[float], tokens: float = 0.0) -> List[Passed]:
    return [Passed(sample, wait, tokens) for sample, wait in zip(chain, waits)]


def test_the_peak_rate_is_the_offered_rate_where_intervals_are_kept() -> None:
    assert peak_rate(passed(samples((0, 5), (0.01, 5.01), (0.02, 5.02)), [0, 0, 0]), 0.0) == pytest.approx(100000)


def test_the_peak_rate_is_the_carried_rate_where_intervals_grow() -> None:
    assert peak_rate(passed(samples((0, 5), (0.01, 5.02), (0.02, 5.04)), [0, 0.01, 0.02]), 0.0) == pytest.approx(50000)


def test_clumped_arrivals_do_not_inflate_the_peak_rate() -> None:
    """All came until 5.03 s, and the first one by 5.0 s."""
    chain = samples((0, 5.03), (0.01, 5.0301), (0.02, 5.0302))
    assert peak_rate(passed(chain, [0.03, 0.0201, 0.0102]), 0.0) == pytest.approx(2000 / 0.0302)


def test_a_late_reader_does_not_inflate_the_rate_of_a_train() -> None:
    """At 100 kB/s they came at 5.00, 5.01, 5.02 and 5.03 s; nothing was read from 5.005 to 5.025 s."""
    chain = [PacketSample(*times, 1000, total) for *times, total in (
        (0.0, 5.0, 1000), (0.001, 5.025, 2000), (0.003, 5.03, 4000), (0.004, 5.04, 5000))]
    assert peak_rate(passed(chain, [0, 0.024, 0.027, 0.036]), 0.0) == pytest.approx(100000)


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(1, 5)), min_size=2, max_size=60),
       st.lists(st.tuples(st.integers(1, 100), st.integers(1, 60)), max_size=20))
def test_no_late_reader_shows_a_faster_link(bursts: List[Tuple[int, int]], stalls: List[Tuple[int, int]]) -> None:
    """The rate of a link of 1 MB/s that carries datagrams of 1 kB is not overestimated.

    :param bursts: pause before each [ms], and its number of datagrams
    :param stalls: pause before each, and its duration, in which nothing is read [ms]
    """
    ends = list(itertools.accumulate(itertools.chain(*stalls)))
    chain: List[PacketSample] = []
    sent = idle_from = total = 0
    for pause, count in bursts:
        sent += pause
        for _ in range(count):
            idle_from, total = max(sent, idle_from) + 1, total + 1000
            at = bisect.bisect_right(ends, idle_from)
            read = ends[at] if at % 2 else idle_from       # ends of pauses and stalls alternate
            if not chain or read - 1e3 * chain[-1].arrived >= 1e3 * SAMPLE_INTERVAL:
                chain.append(PacketSample(1e-3 * sent, 1e-3 * read, 1000, total))
    waits = [sample.delay - 0.001 for sample in chain]
    assert peak_rate(passed(chain, waits), 0.0) <= 1e6 * (1 + 1e-9)


def test_what_a_token_bucket_lets_pass_at_once_shows_no_rate() -> None:
    chain = samples((0, 5), (0.001, 5.001), (0.1, 5.1), (0.101, 5.101))
    assert peak_rate(passed(chain, [0] * 4), 0.0) == pytest.approx(3000 / 0.101)
    assert peak_rate(passed(chain, [0] * 4, 1000.0), 0.0) == pytest.approx(2000 / 0.101)
    assert peak_rate(passed(chain, [0] * 4, 2000.0), 0.0) == 0


def test_one_interval_gives_no_peak_rate() -> None:
    assert peak_rate(passed(samples((0, 5), (0.01, 5.01)), [0, 0]), 0.0) == 0.0


def test_the_air_was_busy_between_datagrams_that_were_queued_or_followed_each_other() -> None:
    """At 100 kB/s 1 kB is on the air for 10 ms."""
    queued = samples((0, 5.05), (0.02, 5.07), (0.04, 5.08))
    assert busy_period(queued, [0.04, 0.04, 0.03], 0.0, 1e5) == (2000, pytest.approx(0.03))
    follows = samples((0, 5.01), (0.009, 5.02), (0.03, 5.1))
    assert busy_period(follows, [0.0, 0.003, 0.06], 0.0, 1e5) == (1000, pytest.approx(0.01))
    between = [follows[0], follows[1]._replace(total=3000)]       # another one was sent between them
    assert busy_period(between, [0.0, 0.003], 0.0, 1e5) == (0, 0.0)
    assert busy_period(queued, [0.04, 0.04, 0.03], 0.035, 1e5) == (1000, pytest.approx(0.02))    # noise hides one


def test_behind_a_bucket_the_last_tokens_do_not_count_as_carried() -> None:
    """1.5 of the first two datagrams passed at once; then 100 kB/s."""
    chain, waits = samples((0, 5), (0, 5.005), (0, 5.015), (0, 5.025)), [0.0, 0.005, 0.015, 0.025]
    assert busy_period(chain, waits, 0.0, 1e5) == (3000, pytest.approx(0.025))
    assert busy_period(chain, waits, 0.0, 1e5, True) == (2000, pytest.approx(0.02))
