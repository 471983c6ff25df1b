# SPDX-License-Identifier: BSD-3-Clause
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.packet_scheduler import BURST_LASTS, CHUNK_LASTS, LATE, Chunk, Pace


def sent(pace, until=math.inf):
    """[(when, Chunk), ...] of all that leaves, each as soon as it may."""
    now, chunks = 0.0, []
    while now + pace.wait(now) <= until and pace.wait(now) < math.inf:
        now += pace.wait(now)
        chunks.append((now, pace.take(now)))
        assert chunks[-1][1] is not None
    return chunks


def test_without_a_rate_all_leaves_at_once():
    pace = Pace()
    pace.put('a', 'work', [(50, 1000), (1, 10)])
    assert sent(pace) == [(0.0, Chunk('a', 'work', 0, 0, 50, 50000)), (0.0, Chunk('a', 'work', 1, 0, 1, 10))]


def test_datagrams_leave_evenly():
    pace = Pace(rate=100000, burst=3000)        # a datagram each 10 ms
    pace.put('a', None, [(100, 1000)])
    chunks = sent(pace)
    assert [chunk.start for _, chunk in chunks] == list(range(100))
    assert [when for when, _ in chunks] == pytest.approx([0.01 * n for n in range(100)])


def test_at_high_rates_they_leave_in_chunks():
    pace = Pace(rate=1e7, burst=16000)
    pace.put('a', None, [(160, 1000)])
    sizes = [chunk.size for _, chunk in sent(pace)]
    assert sizes == [16000] * 10 and 1e7 * CHUNK_LASTS > 16000


def test_a_newer_message_replaces_what_did_not_leave():
    pace = Pace(rate=1000)
    pace.put('a', 'old', [(5, 100), (2, 50)])
    assert pace.take(0.0).work == 'old'
    assert pace.sending('a') == 'old'
    pace.put('a', 'new', [(1, 100)])
    assert pace.dropped == {'a': 6}
    assert [chunk.work for _, chunk in sent(pace)] == ['new']
    assert pace.sending('a') is None


def test_streams_take_turns_by_their_shares():
    pace = Pace(rate=100000)
    pace.set_share('much', 3.0)
    pace.put('much', None, [(400, 100)])
    pace.put('little', None, [(400, 100)])
    first = [chunk.stream for _, chunk in sent(pace)][:200]
    assert 149 <= first.count('much') <= 151
    longest = max(len(run) for run in ''.join('m' if name == 'much' else ' ' for name in first).split())
    assert longest <= 4


def test_who_was_silent_has_no_claim_on_the_past():
    pace = Pace(rate=100000)
    pace.put('a', None, [(1000, 100)])
    for _ in range(500):
        now = pace.wait(0.0)
        pace.take(now)
    pace.put('b', None, [(100, 100)])
    rest = [chunk.stream for _, chunk in sent(pace)][:100]
    assert 45 <= rest.count('b') <= 55


def test_what_left_past_the_queue_counts():
    pace = Pace(rate=1000)
    pace.charge(500, 0.0)
    pace.put('a', None, [(1, 100)])
    assert pace.wait(0.0) == pytest.approx(0.5)
    assert pace.take(0.4) is None


def test_a_train_leaves_faster():
    pace = Pace(rate=10000, burst=100)
    pace.train(40000, 400)
    pace.put('a', None, [(8, 100)])
    whens = [when for when, _ in sent(pace)]
    steps = [later - earlier for earlier, later in zip(whens, whens[1:])]
    assert steps == pytest.approx([0.0025] * 4 + [0.01] * 3)


def test_who_asks_late_catches_up_on_what_waited_but_not_after_a_pause():
    pace = Pace(rate=100000, burst=1000)        # a datagram each 10 ms
    pace.put('a', None, [(100, 1000)])
    assert pace.take(0.0) and pace.take(0.005) is None
    assert pace.take(0.025) and pace.take(0.025) and pace.take(0.025) is None and pace.take(0.03)
    pace.drop('a')
    pace.put('a', None, [(1, 1000)])
    assert pace.take(2.0)
    pace.put('a', None, [(3, 1000)])
    assert pace.take(3.0) and pace.take(3.0) is None


def test_how_long_all_takes_that_waits():
    pace = Pace(rate=1000)
    assert pace.takes() == 0
    pace.put('a', None, [(3, 100), (1, 50)])
    pace.put('b', None, [(1, 150)])
    assert pace.takes() == pytest.approx(0.5)
    pace.take(0.0)
    assert pace.takes() == pytest.approx(0.4)
    pace.set_rate(None)
    assert pace.takes() == 0


def test_a_datagram_larger_than_the_burst():
    pace = Pace(rate=1000, burst=10)
    pace.put('a', None, [(2, 100)])
    assert [when for when, _ in sent(pace)] == pytest.approx([0.0, 0.1])


@pytest.mark.parametrize('wrong', [{'rate': 0}, {'rate': -1.0}, {'rate': math.nan}, {'rate': math.inf}, {'burst': 0}])
def test_what_is_no_rate(wrong):
    with pytest.raises(ValueError, match='must be positive'):
        Pace(**wrong)


@given(st.floats(1e3, 1e8), st.integers(1, 100000), st.lists(
    st.tuples(st.sampled_from('abc'), st.floats(0, 1), st.lists(st.tuples(st.integers(0, 30), st.integers(1, 2000)),
                                                                max_size=3)), max_size=20))
def test_no_more_leaves_than_rate_and_burst(rate, burst, puts):
    """In no span of time: what leaves in it is at most the rate's bytes, the bucket, and one chunk."""
    pace, now, left = Pace(rate, burst), 0.0, []
    for name, pause, parts in puts:
        until = now + pause
        while now + pace.wait(now) < until:
            now += pace.wait(now)
            left.append((now, pace.take(now).size))
        now = until
        pace.put(name, None, parts)
    bucket = max([min(burst, rate * BURST_LASTS), *(size for _, size in left)])
    for i in range(len(left)):
        total = 0
        for when, size in left[i:]:
            total += size
            assert total <= rate * (when - left[i][0]) + bucket + LATE * rate + 1e-6 * rate + 1


def test_what_left_at_a_tiny_share_does_not_hold_a_stream_back_later():
    pace = Pace(rate=1e6)
    for name in ('picture', 'map'):
        pace.set_share(name, 0.0)
        pace.put(name, name, [(1000, 1000)])
    assert {pace.take(now).stream for now in (0.0, 0.1)} == {'picture', 'map'}
    pace.set_share('picture', 1000.0)
    pace.take(0.2)
    pace.set_share('map', 1000.0)
    left = [pace.take(0.3 + 0.1 * step).stream for step in range(20)]
    assert 9 <= left.count('picture') <= 11
