# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import Dict, List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.packet_scheduler import (
    BASE_DURATION,
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
    assert sent(scheduler) == [(0.0, Chunk('a', 'work', 0, 0, 50, 50000, 50, 50010.0)),
                               (0.0, Chunk('a', 'work', 1, 0, 1, 10, 1, 10.0))]


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


def test_messages_leave_one_after_the_other_the_one_with_the_earlier_deadline_first() -> None:
    """Two images of 20 ms: in turns both would leave within 40 ms."""
    scheduler = PacketScheduler(rate=1e6)
    for name, share in (('camera', 2.5e5), ('thermal', 7.5e5)):
        scheduler.set_share(name, share)
        scheduler.put(name, None, [(20, 1000)])
    ends = {chunk.stream: when for when, chunk in sent(scheduler)}
    assert 0.015 <= ends['thermal'] <= 0.025 and 0.035 <= ends['camera'] <= 0.040      # after the base layer of camera


@pytest.mark.parametrize('size', [40, 400])
def test_streams_that_always_have_more_get_their_shares(size: int) -> None:
    scheduler, now, sizes = PacketScheduler(rate=1e6), 0.0, {'much': 0, 'little': 0, 'least': 0}
    for name, share in (('much', 6e5), ('little', 2e5), ('least', 1e5)):
        scheduler.set_share(name, share)
    while now < 20.0:
        for name in sizes:
            if scheduler.sending(name) is None:
                scheduler.put(name, name, [(size, 100)])
        chunk = scheduler.take(now)
        if chunk is not None:
            sizes[chunk.stream] += chunk.size
        now += max(scheduler.wait(now), 1e-6)
    assert sizes['much'] / sizes['least'] == pytest.approx(6, rel=0.05)
    assert sizes['little'] / sizes['least'] == pytest.approx(2, rel=0.05)


def test_streams_whose_messages_are_cut_off_get_their_shares() -> None:
    """Images of 0.15 s each, one every 0.1 s, of two streams beside each other."""
    scheduler, now, sizes = PacketScheduler(rate=1e6), 0.0, {'thermal': 0, 'camera': 0}
    scheduler.set_share('thermal', 6e5)
    scheduler.set_share('camera', 3e5)
    due = {'thermal': 0.0, 'camera': 0.05}
    while now < 20.0:
        for name in due:
            if due[name] <= now:
                due[name] += 0.1
                scheduler.put(name, name, [(150, 1000)])
        chunk = scheduler.take(now)
        if chunk is not None:
            sizes[chunk.stream] += chunk.size
        now = min(now + max(scheduler.wait(now), 1e-6), *due.values())
    assert sizes['thermal'] / sizes['camera'] == pytest.approx(2, rel=0.1)


def test_the_base_layer_of_a_message_leaves_before_the_rest_of_others() -> None:
    scheduler = PacketScheduler(rate=1e6)
    for name, share in (('image', 9e5), ('map', 1e4)):
        scheduler.set_share(name, share)
    scheduler.put('image', None, [(100, 1000)])
    now = 0.0
    for _ in range(20):
        now += scheduler.wait(now)
        scheduler.take(now)
    scheduler.put('map', None, [(30, 1000)], base=8)
    order = [(chunk.stream, chunk.start) for _, chunk in sent(scheduler)]
    firsts = [start for stream, start in order if stream == 'map'].index(8)
    assert [stream for stream, _ in order[:firsts]] == ['map'] * firsts
    assert order[firsts][0] == 'image' and order[-1][0] == 'map'


def test_a_stream_of_short_messages_gets_no_more_than_its_share_beside_others() -> None:
    scheduler, now, sizes = PacketScheduler(rate=1e6), 0.0, {'image': 0, 'short': 0}
    scheduler.set_share('image', 9e5)
    scheduler.set_share('short', 1e5)
    while now < 5.0:
        for name, count in (('image', 90), ('short', 3)):
            if scheduler.sending(name) is None:
                scheduler.put(name, name, [(count, 1000)])
        chunk = scheduler.take(now)
        if chunk is not None:
            sizes[chunk.stream] += chunk.size
        now += max(scheduler.wait(now), 1e-6)
    assert sizes['image'] / sizes['short'] == pytest.approx(9, rel=0.1)


def in_turns(puts: List[Tuple[str, float, int]], shares: Dict[str, float], rate: float) -> List[float]:
    """When each message has left, if all streams send at once, each by its share: [(stream, when, bytes), ...]."""
    queues: Dict[str, List[List[float]]] = {name: [] for name in shares}
    ends, now, coming = [math.inf] * len(puts), 0.0, list(enumerate(puts))
    while coming or any(queues.values()):
        sending = [name for name, queue in queues.items() if queue]
        part = {name: rate * shares[name] / sum(shares[other] for other in sending) for name in sending}
        step = min([queues[name][0][1] / part[name] for name in sending]
                   + [when - now for _, (_, when, _) in coming[:1]])
        now += step
        for name in sending:
            queues[name][0][1] -= step * part[name]
            if queues[name][0][1] <= 1e-6 * part[name]:
                ends[int(queues[name].pop(0)[0])] = now
        while coming and coming[0][1][1] <= now + 1e-9:
            number, (name, _, size) = coming.pop(0)
            queues[name].append([number, size])
    return ends


@given(st.lists(st.tuples(st.sampled_from('abc'), st.floats(0, 0.1), st.integers(1, 60)), max_size=20),
       st.lists(st.sampled_from([1e4, 1e5, 5e5]), min_size=3, max_size=3))
def test_no_message_leaves_later_than_in_turns(steps: List[Tuple[str, float, int]], given: List[float]) -> None:
    """But for chunks, and the base layers of the others."""
    rate, size, shares = 1e6, 1000, dict(zip('abc', given))
    now, puts = 0.0, []
    for name, pause, count in steps:
        now += pause
        puts.append((name, now, count * size))
    limits = in_turns(puts, shares, rate)
    scheduler, now, ends = PacketScheduler(rate), 0.0, [math.inf] * len(puts)
    for name, share in shares.items():
        scheduler.set_share(name, share)
    coming, waiting = list(enumerate(puts)), {name: [] for name in shares}
    while now < max([0.0, *limits]) + 0.2:
        while coming and coming[0][1][1] <= now:
            number, (name, _, bytes_) = coming.pop(0)
            waiting[name].append((number, bytes_))
        for name, queue in waiting.items():
            if queue and scheduler.sending(name) is None:
                scheduler.put(name, queue[0][0], [(queue[0][1] // size, size)])
        chunk = scheduler.take(now)
        if chunk is not None and scheduler.sending(chunk.stream) is None:
            ends[chunk.work] = now
            waiting[chunk.stream].pop(0)
        if not any(queue and scheduler.sending(name) is None for name, queue in waiting.items()):
            now = min([now + max(scheduler.wait(now), 1e-6), now + 0.1] + [when for _, (_, when, _) in coming[:1]])
    base = max(size, BASE_DURATION * rate) + CHUNK_DURATION * rate + size
    # each message that came meanwhile may have gone first with its base layer
    for (name, _, _), end, limit in zip(puts, ends, limits):
        others = sum(other != name and came <= limit for other, came, _ in puts)
        assert end <= limit + (others * base + 2 * size) / rate + 1e-3


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
    assert scheduler.takes('a') == 0
    scheduler.put('a', None, [(3, 100), (1, 50)])
    scheduler.put('b', None, [(1, 150)])
    assert scheduler.takes('a') == pytest.approx(0.5) and scheduler.takes('b') == pytest.approx(0.25)
    assert scheduler.take(0.0).stream == 'a'        # its base layer is shorter
    assert scheduler.takes('a') == pytest.approx(0.4) and scheduler.takes('b') == pytest.approx(0.15)
    scheduler.set_rate(None, 0.0)
    assert scheduler.takes('a') == 0


def test_whether_anything_of_a_message_has_left() -> None:
    scheduler = PacketScheduler(rate=1000)
    assert not scheduler.unsent('a')
    scheduler.put('a', None, [(1, 100), (1, 100)])
    assert scheduler.unsent('a') and not scheduler.unsent('b')
    assert scheduler.take(0.0) and not scheduler.unsent('a')
    scheduler.put('a', None, [(1, 100)])
    assert scheduler.unsent('a')
    assert scheduler.take(1.0) and not scheduler.unsent('a')


def test_a_datagram_larger_than_the_burst() -> None:
    scheduler = PacketScheduler(rate=1000, burst=10)
    scheduler.put('a', None, [(2, 100)])
    assert [when for when, _ in sent(scheduler)] == pytest.approx([0.0, 0.1])


@pytest.mark.parametrize('wrong', [{'rate': 0}, {'rate': -1.0}, {'rate': math.nan}, {'rate': math.inf}, {'burst': 0}])
def test_rates_and_bursts_must_be_positive_and_finite(wrong: Dict[str, float]) -> None:
    with pytest.raises(ValueError, match='must be positive'):
        PacketScheduler(**wrong)


def test_a_share_that_is_no_number_is_refused_and_starves_nobody() -> None:
    scheduler = PacketScheduler(1e4)
    with pytest.raises(ValueError, match='the share of a is nan'):
        scheduler.set_share('a', math.nan)
    scheduler.put('a', 'a', [(1, 1000)])
    scheduler.put('b', 'b', [(1, 1000)])
    assert [scheduler.take(now).stream for now in (0.0, 1.0)] == ['a', 'b']     # type: ignore[union-attr]


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
    assert {scheduler.take(0.1 * step).stream for step in range(20)} == {'picture', 'map'}
    for name in ('picture', 'map'):
        scheduler.set_share(name, 1000.0)
    scheduler.put('picture', None, [(10, 1000)])
    left = [scheduler.take(2.0 + 0.1 * step) for step in range(10)]
    assert sum(chunk.size for chunk in left if chunk.stream == 'picture') == 10 * 1000


@pytest.mark.parametrize('rate, wait', [(4000, 0.11), (1000, 0.38), (800, 0.47), (10, 0.5)])
def test_what_was_sent_past_it_stays_the_same_in_bytes_at_another_rate(rate: float, wait: float) -> None:
    scheduler = PacketScheduler(rate=2000, burst=1000)
    scheduler.put('a', None, [(1, 500)])
    scheduler.charge(400, 1.0)
    scheduler.charge(500, 1.0)
    scheduler.set_rate(rate, 1.25)          # 360 bytes and MAX_CATCH_UP are left, but MAX_DEBT at most
    before = PacketScheduler(rate=rate, burst=1000)
    before.put('a', None, [(1, 500)])
    before.charge(int(wait * rate), 1.25)
    assert scheduler.wait(1.25) == pytest.approx(before.wait(1.25), abs=1e-9)


def test_what_was_sent_past_it_holds_up_the_rest_for_a_moment_only() -> None:
    scheduler = PacketScheduler(rate=10000, burst=1000)
    for step in range(100):
        scheduler.charge(1000, 0.01 * step)         # ten times the rate
    scheduler.put('a', None, [(1, 500)])
    assert scheduler.wait(1.0) <= MAX_DEBT
    assert scheduler.wait(1.0 + MAX_DEBT) == 0.0


def test_a_train_does_not_wait_for_the_tokens_that_it_exceeds() -> None:
    scheduler = PacketScheduler(1e4)
    scheduler.set_tokens(3000.0, 3000.0, 0.0)
    scheduler.put('camera', 'image', [(5, 1000)])
    assert scheduler.take(0.0) is None
    scheduler.start_probe(1e6, 5000.0)
    scheduler.set_tokens(3000.0, 3000.0, 0.0)
    assert all(scheduler.take(0.01) is not None for _ in range(3))
