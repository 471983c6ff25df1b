# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import Dict, List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.packet_scheduler import (
    BURST_DURATION,
    CHUNK_DURATION,
    MAX_CATCH_UP,
    MAX_DEBT,
    Chunk,
    PacketScheduler,
)


def sent(scheduler: PacketScheduler) -> List[Tuple[float, Chunk]]:
    """(when, chunk) of everything that leaves, each as early as allowed."""
    now, chunks = 0.0, []
    while scheduler.wait(now) < math.inf:
        now += scheduler.wait(now)
        chunks.append((now, scheduler.take(now)))
        assert chunks[-1][1] is not None
    return chunks


def test_without_a_rate_everything_leaves_at_once() -> None:
    scheduler = PacketScheduler()
    scheduler.put('a', 'work', [(50, 1000), (1, 10)])
    assert sent(scheduler) == [(0.0, Chunk('a', 'work', 0, 0, 50, 50000, 50)),
                               (0.0, Chunk('a', 'work', 1, 0, 1, 10, 1))]


def test_datagrams_are_paced_evenly() -> None:
    scheduler = PacketScheduler(rate=100000, burst=3000)        # a datagram each 10 ms
    scheduler.put('a', None, [(100, 1000)])
    chunks = sent(scheduler)
    assert [chunk.start for _, chunk in chunks] == list(range(100))
    assert [when for when, _ in chunks] == pytest.approx([0.01 * n for n in range(100)])


def test_at_high_rates_datagrams_leave_in_chunks() -> None:
    scheduler = PacketScheduler(rate=1e7, burst=16000)
    scheduler.put('a', None, [(160, 1000)])
    sizes = [chunk.size for _, chunk in sent(scheduler)]
    assert sizes == [16000] * 10 and 1e7 * CHUNK_DURATION > 16000


def test_a_newer_message_replaces_the_rest_of_the_older() -> None:
    scheduler = PacketScheduler(rate=1000)
    scheduler.put('a', 'old', [(5, 100), (2, 50)])
    assert scheduler.take(0.0).work == 'old'
    assert scheduler.sending('a') == 'old'
    scheduler.put('a', 'new', [(1, 100)])
    assert scheduler.dropped == {'a': 6}
    assert [chunk.work for _, chunk in sent(scheduler)] == ['new']
    assert scheduler.sending('a') is None


def test_streams_take_turns_by_their_shares() -> None:
    scheduler = PacketScheduler(rate=100000)
    scheduler.set_share('much', 3.0)
    scheduler.put('much', None, [(400, 100)])
    scheduler.put('little', None, [(400, 100)])
    first = [chunk.stream for _, chunk in sent(scheduler)][:200]
    assert 149 <= first.count('much') <= 151
    longest = max(len(run) for run in ''.join('m' if name == 'much' else ' ' for name in first).split())
    assert longest <= 4


def test_a_silent_stream_gains_no_credit() -> None:
    scheduler = PacketScheduler(rate=100000)
    scheduler.put('a', None, [(1000, 100)])
    for _ in range(500):
        now = scheduler.wait(0.0)
        scheduler.take(now)
    scheduler.put('b', None, [(100, 100)])
    rest = [chunk.stream for _, chunk in sent(scheduler)][:100]
    assert 45 <= rest.count('b') <= 55


def test_bytes_sent_past_the_scheduler_count() -> None:
    scheduler = PacketScheduler(rate=1000)
    scheduler.charge(500, 0.0)
    scheduler.put('a', None, [(1, 100)])
    assert scheduler.wait(0.0) == pytest.approx(0.5)
    assert scheduler.take(0.4) is None


def test_a_train_leaves_faster() -> None:
    scheduler = PacketScheduler(rate=10000, burst=100)
    scheduler.start_probe(40000, 400)
    scheduler.put('a', None, [(8, 100)])
    whens = [when for when, _ in sent(scheduler)]
    steps = [later - earlier for earlier, later in zip(whens, whens[1:])]
    assert steps == pytest.approx([0.0025] * 4 + [0.01] * 3)


def test_a_late_caller_catches_up_on_a_backlog_but_not_after_a_pause() -> None:
    scheduler = PacketScheduler(rate=100000, burst=1000)        # a datagram each 10 ms
    scheduler.put('a', None, [(100, 1000)])
    assert scheduler.take(0.0) and scheduler.take(0.005) is None
    assert scheduler.take(0.025) and scheduler.take(0.025) and scheduler.take(0.025) is None and scheduler.take(0.03)
    scheduler.drop('a')
    scheduler.put('a', None, [(1, 1000)])
    assert scheduler.take(2.0)
    scheduler.put('a', None, [(3, 1000)])
    assert scheduler.take(3.0) and scheduler.take(3.0) is None


def test_how_long_the_backlog_takes() -> None:
    scheduler = PacketScheduler(rate=1000)
    assert scheduler.takes() == 0
    scheduler.put('a', None, [(3, 100), (1, 50)])
    scheduler.put('b', None, [(1, 150)])
    assert scheduler.takes() == pytest.approx(0.5)
    scheduler.take(0.0)
    assert scheduler.takes() == pytest.approx(0.4)
    scheduler.set_rate(None)
    assert scheduler.takes() == 0


def test_a_datagram_larger_than_the_burst() -> None:
    scheduler = PacketScheduler(rate=1000, burst=10)
    scheduler.put('a', None, [(2, 100)])
    assert [when for when, _ in sent(scheduler)] == pytest.approx([0.0, 0.1])


@pytest.mark.parametrize('wrong', [{'rate': 0}, {'rate': -1.0}, {'rate': math.nan}, {'rate': math.inf}, {'burst': 0}])
def test_rates_and_bursts_must_be_positive_and_finite(wrong: Dict[str, float]) -> None:
    with pytest.raises(ValueError, match='must be positive'):
        PacketScheduler(**wrong)


@given(st.floats(1e3, 1e8), st.integers(1, 100000), st.lists(
    st.tuples(st.sampled_from('abc'), st.floats(0, 1), st.lists(st.tuples(st.integers(0, 30), st.integers(1, 2000)),
                                                                max_size=3)), max_size=20))
def test_no_more_leaves_than_rate_and_burst(rate: float, burst: int,
                                            puts: List[Tuple[str, float, List[Tuple[int, int]]]]) -> None:
    """In no span of time: what leaves in it is at most the rate's bytes, the bucket, and one chunk."""
    scheduler, now, left = PacketScheduler(rate, burst), 0.0, []
    for name, pause, parts in puts:
        until = now + pause
        while now + scheduler.wait(now) < until:
            now += scheduler.wait(now)
            chunk = scheduler.take(now) or scheduler.take(now + 1e-9)   # `now` was rounded
            left.append((now, chunk.size))
        now = until
        scheduler.put(name, None, parts)
    bucket = max([min(burst, rate * BURST_DURATION), *(size for _, size in left)])
    for i in range(len(left)):
        total = 0
        for when, size in left[i:]:
            total += size
            assert total <= rate * (when - left[i][0]) + bucket + MAX_CATCH_UP * rate + 1e-6 * rate + 1


def test_what_was_sent_at_a_tiny_share_does_not_block_a_stream_later() -> None:
    scheduler = PacketScheduler(rate=1e6)
    for name in ('picture', 'map'):
        scheduler.set_share(name, 0.0)
        scheduler.put(name, name, [(1000, 1000)])
    assert {scheduler.take(now).stream for now in (0.0, 0.1)} == {'picture', 'map'}
    scheduler.set_share('picture', 1000.0)
    scheduler.take(0.2)
    scheduler.set_share('map', 1000.0)
    left = [scheduler.take(0.3 + 0.1 * step).stream for step in range(20)]
    assert 9 <= left.count('picture') <= 11


def test_what_was_sent_past_it_holds_up_the_rest_for_a_moment_only() -> None:
    scheduler = PacketScheduler(rate=10000, burst=1000)
    for step in range(100):
        scheduler.charge(1000, 0.01 * step)         # ten times the rate
    scheduler.put('a', None, [(1, 500)])
    assert scheduler.wait(1.0) <= MAX_DEBT
    assert scheduler.wait(1.0 + MAX_DEBT) == 0.0
