# SPDX-License-Identifier: BSD-3-Clause
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.link_lab.channel import Channel, Quality


def fates(quality, count=20000, every=0.001, size=1000, seed=1):
    """What becomes of so many packets: [(when, the times it comes out), ...], and the channel."""
    channel = Channel(quality, seed)
    return [(k * every, channel.fate(k * every, size)) for k in range(count)], channel


def runs(results):
    """The lengths of the runs of lost packets."""
    lengths, length = [], 0
    for _, out in results:
        if out:
            lengths += [length] * (length > 0)
            length = 0
        else:
            length += 1
    return lengths


def test_a_perfect_link_does_nothing():
    results, channel = fates(Quality())
    assert all(out == (when,) for when, out in results)
    assert (channel.counts.offered, channel.counts.delivered) == (20000, 20000)


@pytest.mark.parametrize('loss', [0.01, 0.2, 0.5, 0.95])
def test_independent_loss(loss):
    results, channel = fates(Quality(loss=loss))
    share = sum(not out for _, out in results) / len(results)
    assert share == pytest.approx(loss, abs=4 * (loss * (1 - loss) / 20000) ** 0.5)
    assert channel.counts.lost == 20000 - channel.counts.delivered
    lengths = runs(results)
    assert sum(lengths) / len(lengths) == pytest.approx(1 / (1 - loss), rel=0.1)


@pytest.mark.parametrize('loss, burst', [(0.05, 4), (0.2, 10), (0.5, 3)])
def test_bursts_have_their_share_and_their_mean_length(loss, burst):
    results, _ = fates(Quality(loss=loss, burst=burst), count=100000)
    assert sum(not out for _, out in results) / len(results) == pytest.approx(loss, rel=0.1)
    lengths = runs(results)
    assert sum(lengths) / len(lengths) == pytest.approx(burst, rel=0.1)


def test_delay_and_jitter_keep_the_order():
    results, _ = fates(Quality(delay=0.02, jitter=0.01))
    times = [out[0] for _, out in results]
    assert times == sorted(times)
    assert all(0.01 - 1e-9 <= out[0] - when <= 0.03 + 1e-9 for when, out in results)


def test_how_long_packets_waited_and_how_much_the_air_carried():
    # 8 ms each at 1 Mbit/s, three at once: they wait 0, 8 and 16 ms; the fourth finds more than 20 ms before it
    _, channel = fates(Quality(rate=1e6, queue=0.02, loss=1.0), count=4, every=0.0)
    assert channel.waited == {0: 1, 8: 1, 16: 1}
    assert (channel.counts.carried, channel.counts.dropped, channel.counts.lost) == (3000, 1, 3)


def test_the_rate_is_kept_and_a_full_queue_drops_its_tail():
    # 1000 bytes at 1 Mbit/s take 8 ms; one a millisecond is eight times too many
    results, channel = fates(Quality(rate=1e6, queue=0.1), count=2000)
    times = [out[0] for _, out in results if out]
    assert all(later - earlier == pytest.approx(0.008) for earlier, later in zip(times, times[1:]))
    assert max(out[0] - when for when, out in results if out) <= 0.1 + 0.008 + 1e-9
    assert channel.counts.dropped == 2000 - len(times) and channel.counts.lost == 0


def test_lost_packets_take_their_time_on_the_air():
    results, _ = fates(Quality(rate=1e6, queue=1e9, loss=0.5), count=1000)
    last = max(out[0] for _, out in results if out)
    assert last == pytest.approx(8.0, abs=0.1)


def test_some_overtake_and_some_come_twice():
    results, channel = fates(Quality(delay=0.02, reorder=0.1, duplicate=0.05))
    assert sum(out[0] == when for when, out in results) / 20000 == pytest.approx(0.1, rel=0.1)
    assert sum(len(out) == 2 for _, out in results) / 20000 == pytest.approx(0.05, rel=0.15)
    assert channel.counts.delivered == sum(len(out) for _, out in results)


def test_a_packet_meets_the_same_fate_whatever_else_is_set():
    lost = [[not out for _, out in fates(quality)[0]] for quality in (
        Quality(loss=0.3), Quality(loss=0.3, delay=0.1, jitter=0.05, reorder=0.2, duplicate=0.1))]
    assert lost[0] == lost[1]
    assert [not out for _, out in fates(Quality(loss=0.3), seed=2)[0]] != lost[0]


@pytest.mark.parametrize('values, words', [
    ({'loss': 1.5}, 'loss is 1.5'), ({'delay': -0.1}, 'delay is -0.1'), ({'rate': float('nan')}, 'rate is nan'),
    ({'queue': 'long'}, "queue is 'long'"), ({'loss': 0.5, 'burst': 1}, 'burst is 1'),
    ({'reorder': 2}, 'reorder is 2')])
def test_impossible_values_are_refused(values, words):
    with pytest.raises(ValueError, match=words):
        Quality(**values)


@given(st.floats(0, 1), st.floats(0, 50), st.integers(0, 5))
def test_every_chain_has_its_loss(loss, extra, seed):
    quality = Quality(loss=loss, burst=1 / (1 - loss) + extra if loss < 0.99 else 0)
    comes, stays = quality.chain
    assert 0 <= comes <= 1 and 0 <= stays <= 1
    if 0 < loss < 1:     # of a two-state chain
        assert comes / (comes + 1 - stays) == pytest.approx(loss)
