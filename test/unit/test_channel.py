# SPDX-License-Identifier: BSD-3-Clause
import socket
from typing import Any, Dict, List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.link_lab.carrier import flow_of
from smokebot_udp.link_lab.channel import Air, Channel, Counts, LinkConditions
from smokebot_udp.link_lab.ecn import is_capable, marked

Fates = List[Tuple[float, Tuple[float, ...]]]


def fates(conditions: LinkConditions, count: int = 20000, every: float = 0.001, size: int = 1000,
          seed: int = 1) -> Tuple[Fates, Channel]:
    """[(when each packet enters, when it is delivered)], and the channel."""
    channel = Channel(conditions, seed)
    return [(k * every, channel.fate(k * every, size)) for k in range(count)], channel


def runs(results: Fates) -> List[int]:
    """The lengths of the runs of lost packets."""
    lengths, length = [], 0
    for _, out in results:
        if out:
            lengths += [length] * (length > 0)
            length = 0
        else:
            length += 1
    return lengths


def test_a_perfect_link_does_nothing() -> None:
    results, channel = fates(LinkConditions())
    assert all(out == (when,) for when, out in results)
    assert (channel.counts.offered, channel.counts.delivered) == (20000, 20000)


@pytest.mark.parametrize('loss', [0.01, 0.2, 0.5, 0.95])
def test_independent_loss(loss: float) -> None:
    results, channel = fates(LinkConditions(loss=loss))
    share = sum(not out for _, out in results) / len(results)
    assert share == pytest.approx(loss, abs=4 * (loss * (1 - loss) / 20000) ** 0.5)
    assert channel.counts.lost == 20000 - channel.counts.delivered
    lengths = runs(results)
    assert sum(lengths) / len(lengths) == pytest.approx(1 / (1 - loss), rel=0.1)


@pytest.mark.parametrize('loss, burst', [(0.05, 4), (0.2, 10), (0.5, 3)])
def test_bursts_have_their_ratio_and_their_mean_length(loss: float, burst: float) -> None:
    results, _ = fates(LinkConditions(loss=loss, burst=burst), count=100000)
    assert sum(not out for _, out in results) / len(results) == pytest.approx(loss, rel=0.1)
    lengths = runs(results)
    assert sum(lengths) / len(lengths) == pytest.approx(burst, rel=0.1)


def test_aggregates_are_4_to_8_ms_apart_and_hold_all_that_was_transmitted_meanwhile() -> None:
    results, _ = fates(LinkConditions(aggregate=0.006, delay=0.02), every=0.0005)
    assert all(0 < out[0] - when - 0.02 <= 0.008 for when, out in results)
    ends = sorted({out[0] for _, out in results})
    gaps = [after - before for before, after in zip(ends, ends[1:])]
    assert min(gaps) >= 0.004 and max(gaps) <= 0.008 and sum(gaps) / len(gaps) == pytest.approx(0.006, rel=0.02)


def test_an_aggregate_after_a_silence_is_no_later_than_others() -> None:
    channel = Channel(LinkConditions(aggregate=0.006))
    assert channel.fate(0.0, 100)[0] <= 0.008
    assert 1000.0 < channel.fate(1000.0, 100)[0] <= 1000.008


def test_aggregates_change_neither_the_rate_nor_the_order_nor_what_is_lost() -> None:
    alone, _ = fates(LinkConditions(rate=1e6, queue=100.0, loss=0.2), count=5000)
    gathered, _ = fates(LinkConditions(rate=1e6, queue=100.0, loss=0.2, aggregate=0.006), count=5000)
    assert [bool(out) for _, out in gathered] == [bool(out) for _, out in alone]
    late = [b[0] - a[0] for (_, a), (_, b) in zip(alone, gathered) if a]
    assert min(late) >= 0 and max(late) <= 0.008
    times = [out[0] for _, out in gathered if out]
    assert times == sorted(times)
def test_packets_that_are_too_long_are_lost_and_the_others_are_not() -> None:
    for size, lost in ((1200, 0), (1201, 100)):
        _, channel = fates(LinkConditions(longest=1200.0), count=100, size=size)
        assert channel.counts.lost == lost and channel.counts.carried == 100 * size


def test_delay_and_jitter_keep_the_order() -> None:
    results, _ = fates(LinkConditions(delay=0.02, jitter=0.01))
    times = [out[0] for _, out in results]
    assert times == sorted(times)
    assert all(0.01 - 1e-9 <= out[0] - when <= 0.03 + 1e-9 for when, out in results)


def test_queueing_times_and_carried_bytes_are_counted() -> None:
    # 8 ms each at 1 Mbit/s, three at once: they wait 0, 8 and 16 ms; the fourth finds more than 20 ms before it
    _, channel = fates(LinkConditions(rate=1e6, queue=0.02, loss=1.0), count=4, every=0.0)
    assert channel.waited == {0: 1, 8: 1, 16: 1}
    assert (channel.counts.carried, channel.counts.dropped, channel.counts.lost) == (3000, 1, 3)


def test_flows_wait_for_each_other_and_are_counted_apart() -> None:
    # 8 ms each at 1 Mbit/s: the fourth finds more than 20 ms before it, whoever sent these
    channel = Channel(LinkConditions(rate=1e6, queue=0.02))
    assert channel.counts == Counts()
    times = [channel.fate(0.0, 1000, flow) for flow in ('udp', 'tcp', 'udp', 'udp')]
    assert times == [pytest.approx((0.008 * k,)) for k in (1, 2, 3)] + [()]
    assert channel.flows == {'udp': Counts(offered=3, dropped=1, delivered=2, carried=2000),
                             'tcp': Counts(offered=1, delivered=1, carried=1000)}
    assert channel.counts == Counts(offered=4, dropped=1, delivered=3, carried=3000)


def test_packets_are_counted_by_their_protocol() -> None:
    def packet(protocol: int) -> bytes:     # 28 bytes, TTL 64, from 10.77.0.1 to 10.77.0.2
        return bytes.fromhex('4500001c00004000 40 %02x 0000 0a4d0001 0a4d0002' % protocol) + bytes(8)
    assert [flow_of(packet(number)) for number in (socket.IPPROTO_UDP, socket.IPPROTO_TCP, socket.IPPROTO_ICMP)] == [
        'udp', 'tcp', 'other']


def test_the_rate_is_kept_and_a_full_queue_drops_its_tail() -> None:
    # 1000 bytes at 1 Mbit/s take 8 ms; one a millisecond is eight times too many
    results, channel = fates(LinkConditions(rate=1e6, queue=0.1), count=2000)
    times = [out[0] for _, out in results if out]
    assert all(later - earlier == pytest.approx(0.008) for earlier, later in zip(times, times[1:]))
    assert max(out[0] - when for when, out in results if out) <= 0.1 + 0.008 + 1e-9
    assert channel.counts.dropped == 2000 - len(times) and channel.counts.lost == 0


def test_packets_that_wait_for_long_are_marked() -> None:
    # 8 ms each at 1 Mbit/s, all at once: the third waits for 16 ms, which is the threshold, and the fourth for longer
    channel, marked = Channel(LinkConditions(rate=1e6, ecn_threshold=0.016, queue=0.03)), []
    for _ in range(5):
        marked.append(channel.marks(0.0, 'udp'))
        channel.fate(0.0, 1000, 'udp')
    assert marked == [False, False, False, True, True]
    assert channel.counts == Counts(offered=5, dropped=1, delivered=4, carried=4000, marked=2)
    assert not channel.marks(0.05) and not Channel(LinkConditions(rate=1e6)).marks(0.0)
    policed = Channel(LinkConditions(rate=1e6, ecn_threshold=0.001, bucket=3000))
    assert [bool(policed.fate(0.0, 1000)) for _ in range(3)] == [True] * 3 and not policed.marks(0.0)


def test_a_mark_keeps_the_header_valid() -> None:
    def total(header: bytes) -> int:
        """RFC 1071's sum: 0xffff where the checksum is right."""
        value = sum(int.from_bytes(header[k:k + 2], 'big') for k in range(0, 20, 2))
        while value > 0xffff:
            value = (value & 0xffff) + (value >> 16)
        return value

    # from 10.77.0.1 to 10.77.0.2, worked by hand: 4502 + 001c + 4000 + 4011 + 0a4d + 0001 + 0a4d + 0002 = d9cc
    ect = bytes.fromhex('4502001c00004000401126330a4d00010a4d0002') + bytes(8)
    assert total(ect) == 0xffff and is_capable(ect) and not is_capable(b'\x45\x88' + ect[2:])
    assert marked(ect) == bytes.fromhex('4503001c00004000401126320a4d00010a4d0002') + bytes(8)
    assert marked(marked(ect)) == marked(ect)
    assert not is_capable(b'\x62' + ect[1:])        # IPv6


@given(st.binary(min_size=20, max_size=40), st.sampled_from([1, 2]))
def test_any_header_stays_as_valid_as_it_was(packet: bytes, ecn: int) -> None:
    def total(header: bytes) -> int:
        return sum(int.from_bytes(header[k:k + 2], 'big') for k in range(0, 20, 2)) % 0xffff

    packet = b'\x45' + bytes([packet[1] & 0xfc | ecn]) + packet[2:]
    after = marked(packet)
    assert total(after) == total(packet) and after[1] == packet[1] | 3
    assert after[2:10] == packet[2:10] and after[12:] == packet[12:]


def test_directions_that_share_an_air_wait_for_each_other() -> None:
    # 8 ms each at 1 Mbit/s: a packet back, between two there, is the third; without packets there it does not wait
    air, conditions = Air(), LinkConditions(rate=1e6, delay=0.05)
    there, back = (Channel(conditions, seed, air) for seed in (1, 2))
    times = [channel.fate(0.001 * k, 1000) for k, channel in enumerate((there, there, back, there))]
    assert times == [pytest.approx((0.058 + 0.008 * k,)) for k in range(4)]
    assert back.waits(0.004) == pytest.approx(0.028) and there.waits(0.032) == 0
    assert back.fate(1.0, 1000) == pytest.approx((1.058,))


def test_a_policer_passes_a_bucket_at_once_and_then_its_rate() -> None:
    # 1000 bytes a millisecond at 1 Mbit/s: a bucket of 3 passes, then 125 bytes come each ms, 1000 in 8 ms
    results, channel = fates(LinkConditions(rate=1e6, bucket=3000, delay=0.02), count=32)
    passed = [round(1e3 * when) for when, out in results if out]
    assert passed == [0, 1, 2, 8, 16, 24]       # at 3 ms the bucket has 375 bytes; at 8 ms, 1000
    assert all(out == (when + 0.02,) for when, out in results if out)
    assert (channel.counts.carried, channel.counts.dropped) == (6000, 26) and not channel.waited
    assert channel.waits(0.031) == 0
    # after a second the bucket is full again, and not fuller
    assert [len(channel.fate(1.0, 1000)) for _ in range(5)] == [1, 1, 1, 0, 0]


def test_a_bucket_of_one_packet_passes_it_at_any_time() -> None:
    channel = Channel(LinkConditions(rate=3e6, bucket=1500))
    assert all(channel.fate(1e6 + 0.37 * k, 1500) for k in range(1000)) and not channel.fate(1e6 + 369.63, 1500)


@given(st.lists(st.tuples(st.floats(0, 0.1), st.integers(20, 1500)), min_size=1, max_size=60),
       st.floats(1e5, 1e7), st.integers(1500, 20000))
def test_a_policer_drops_what_a_token_bucket_drops(packets: List[Tuple[float, int]], rate: float, bucket: int) -> None:
    """The bucket as RFC 2697 has it, but for packets that differ from its content by less than a bit."""
    channel, tokens, now = Channel(LinkConditions(rate=rate, bucket=bucket)), float(bucket), 0.0
    for pause, size in packets:
        now += pause
        tokens = min(bucket, tokens + rate / 8 * pause)
        passed = channel.fate(now, size) == (now,)
        assert passed == (size <= tokens) or abs(size - tokens) < 1 / 8
        tokens -= size * passed


def test_lost_packets_take_air_time() -> None:
    results, _ = fates(LinkConditions(rate=1e6, queue=1e9, loss=0.5), count=1000)
    last = max(out[0] for _, out in results if out)
    assert last == pytest.approx(8.0, abs=0.1)


def test_reordering_and_duplication() -> None:
    results, channel = fates(LinkConditions(delay=0.02, reorder=0.1, duplicate=0.05))
    assert sum(out[0] == when for when, out in results) / 20000 == pytest.approx(0.1, rel=0.1)
    assert sum(len(out) == 2 for _, out in results) / 20000 == pytest.approx(0.05, rel=0.15)
    assert channel.counts.delivered == sum(len(out) for _, out in results)


def test_effects_are_independent_of_each_other() -> None:
    lost = [[not out for _, out in fates(conditions)[0]] for conditions in (
        LinkConditions(loss=0.3), LinkConditions(loss=0.3, delay=0.1, jitter=0.05, reorder=0.2, duplicate=0.1))]
    assert lost[0] == lost[1]
    assert [not out for _, out in fates(LinkConditions(loss=0.3), seed=2)[0]] != lost[0]


@pytest.mark.parametrize('values, words', [
    ({'loss': 1.5}, 'loss is 1.5'), ({'delay': -0.1}, 'delay is -0.1'), ({'rate': float('nan')}, 'rate is nan'),
    ({'queue': 'long'}, "queue is 'long'"), ({'loss': 0.5, 'burst': 1}, 'burst is 1'),
    ({'reorder': 2}, 'reorder is 2'), ({'rate': 1e6, 'bucket': -1}, 'bucket is -1'),
    ({'bucket': 3000}, 'bucket is 3000, needs a rate'), ({'ecn_threshold': -1}, 'ecn_threshold is -1')])
def test_impossible_values_are_refused(values: Dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        LinkConditions(**values)


@given(st.floats(0, 1), st.floats(0, 50), st.integers(0, 5))
def test_every_markov_chain_has_its_loss_ratio(loss: float, extra: float, seed: int) -> None:
    conditions = LinkConditions(loss=loss, burst=1 / (1 - loss) + extra if loss < 0.99 else 0)
    comes, stays = conditions.chain
    assert 0 <= comes <= 1 and 0 <= stays <= 1
    if 0 < loss < 1:     # of a two-state chain
        assert comes / (comes + 1 - stays) == pytest.approx(loss)
