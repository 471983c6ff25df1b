# SPDX-License-Identifier: BSD-3-Clause
import random
import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.udpros.datagram import HEADER, Op, split
from smokebot_udp.udpros.reassembly import (
    BLOCK_COST,
    PARTIAL_IDS,
    PARTIAL_LIFETIME,
    Inbox,
    Reassembler,
)

CONNECTION = 77
SIZE = 64
SLOT = SIZE + 1


def with_length(message) -> Any:
    return len(message).to_bytes(4, 'little') + message


def blocks(message, message_id, size=SIZE) -> Any:
    """The datagrams of a message, as `add` takes them."""
    joined = split(with_length(message), CONNECTION, message_id, size)
    for at in range(0, len(joined), size):
        _, op, number, block = HEADER.unpack_from(joined, at)
        yield op, number, block, joined[at + HEADER.size:at + size]


def feed(reassembler, datagrams, now=0.0) -> Any:
    return [message for message in (reassembler.add(*datagram, now) for datagram in datagrams) if message is not None]


def message_of(content, blocks) -> Any:
    return bytes([content]) * (56 * blocks - 4)


# -- Reassembler ---------------------------------------------------------------------------------------------


def test_in_order() -> None:
    reassembler = Reassembler()
    assert feed(reassembler, blocks(bytes(range(200)), 1)) == [bytes(range(200))]
    assert (reassembler.pending, reassembler.dropped) == (0, {})


@given(st.integers(1, 6), st.randoms(use_true_random=False))
def test_any_order_and_duplicates(count, shuffled) -> None:
    message = bytes(shuffled.randrange(256) for _ in range(56 * count - 4))
    datagrams = list(blocks(message, 9))
    arrivals = datagrams + [shuffled.choice(datagrams) for _ in range(5)]
    shuffled.shuffle(arrivals)
    reassembler = Reassembler()
    assert feed(reassembler, arrivals) == [message]
    assert reassembler.dropped == {'duplicate': 5}
    assert reassembler.pending == 0


def test_messages_may_interleave() -> None:
    reassembler = Reassembler()
    first, second = (list(blocks(message_of(content, 3), content)) for content in (1, 2))
    mixed = [datagram for pair in zip(first, second) for datagram in pair]
    assert feed(reassembler, mixed) == [message_of(1, 3), message_of(2, 3)]


def test_an_empty_message_of_two_blocks() -> None:
    reassembler = Reassembler()
    assert feed(reassembler, [(Op.DATAN, 1, 1, b''), (Op.DATA0, 1, 2, bytes(4))]) == [b'']


def test_a_reused_id_is_another_message() -> None:
    """A lost block 1 of message 5; 255 messages later, message 5 again."""
    reassembler = Reassembler()
    feed(reassembler, list(blocks(message_of(1, 2), 5))[:1])
    for message_id in [*range(6, 256), *range(1, 5)]:
        assert len(feed(reassembler, blocks(message_of(3, 2), message_id))) == 1
    assert feed(reassembler, list(blocks(message_of(2, 2), 5))[1:]) == []
    assert feed(reassembler, list(blocks(message_of(2, 2), 5))[:1]) == [message_of(2, 2)]
    assert reassembler.dropped == {'incomplete': 1}


def test_an_id_reused_after_the_lifetime_is_another_message() -> None:
    reassembler = Reassembler()
    first, second = (list(blocks(message_of(content, 3), 5)) for content in (1, 2))
    assert feed(reassembler, first[:1], 0.0) == []
    assert feed(reassembler, first[1:2], PARTIAL_LIFETIME * 0.9) == []
    assert feed(reassembler, second[2:], PARTIAL_LIFETIME * 1.1) == []
    assert reassembler.dropped == {'incomplete': 2}
    assert feed(reassembler, second[:2], PARTIAL_LIFETIME * 1.2) == [message_of(2, 3)]
    assert feed(reassembler, second, PARTIAL_LIFETIME * 1.3) == []
    assert feed(reassembler, first, PARTIAL_LIFETIME * 2.3) == [message_of(1, 3)]
    assert reassembler.dropped == {'incomplete': 2, 'duplicate': 3}


@pytest.mark.parametrize(('ahead', 'still'), [(1, True), (PARTIAL_IDS, True), (PARTIAL_IDS + 1, False), (128, False),
                                              (255 - PARTIAL_IDS - 1, False), (255 - PARTIAL_IDS, True)])
def test_how_far_an_id_may_lag(ahead, still) -> None:
    reassembler = Reassembler()
    first, last = blocks(message_of(1, 2), 250)
    feed(reassembler, [first])
    reassembler.overtake((250 + ahead - 1) % 255 + 1, 0.0)
    assert (feed(reassembler, [last]) == [message_of(1, 2)]) == still


@pytest.mark.parametrize('datagram', [
    (Op.DATA0, 0, 2, b'12'), (Op.DATAN, 0, 1, b'12'), (Op.DATA0, 1, 0, b'12'), (Op.DATAN, 1, 0, b'12')])
def test_impossible_headers(datagram) -> None:
    reassembler = Reassembler()
    assert feed(reassembler, [datagram]) == []
    assert (reassembler.dropped, reassembler.pending) == ({'header': 1}, 0)


def test_blocks_beyond_the_total() -> None:
    reassembler = Reassembler()
    assert feed(reassembler, [(Op.DATA0, 1, 2, b'x'), (Op.DATAN, 1, 2, b'y'), (Op.DATAN, 1, 65535, b'z')]) == []
    assert feed(reassembler, [(Op.DATAN, 2, 7, b'x'), (Op.DATA0, 2, 7, b'y')]) == []
    assert reassembler.dropped == {'block index': 3}


def test_a_length_that_is_not_the_messages() -> None:
    reassembler = Reassembler()
    assert feed(reassembler, [(Op.DATA0, 1, 2, b'\x09\0\0\0'), (Op.DATAN, 1, 1, b'12345678')]) == []
    assert feed(reassembler, [(Op.DATA0, 2, 2, b'\1'), (Op.DATAN, 2, 1, b'\0')]) == []
    assert reassembler.dropped == {'length': 4}


def test_messages_announced_too_long() -> None:
    reassembler = Reassembler(max_message_size=1000)
    assert feed(reassembler, [(Op.DATA0, 1, 18, bytes(56))]) == []      # 1008 bytes
    assert feed(reassembler, [(Op.DATA0, 2, 65535, b'')]) == []
    assert (reassembler.dropped, reassembler.pending) == ({'too long': 2}, 0)


def test_the_message_begun_first_is_given_up() -> None:
    reassembler = Reassembler(max_pending=3 * (56 + BLOCK_COST))
    one, two = (list(blocks(message_of(content, 3), content)) for content in (1, 2))
    feed(reassembler, one[:2] + two[:2])
    assert (reassembler.dropped, reassembler.pending) == ({'incomplete': 2}, 2 * (56 + BLOCK_COST))
    assert feed(reassembler, two[2:]) == [message_of(2, 3)]


def test_a_message_that_cannot_fit_is_given_up() -> None:
    reassembler = Reassembler(max_pending=2 * (56 + BLOCK_COST))
    assert feed(reassembler, blocks(message_of(1, 3), 1)) == []
    assert (reassembler.dropped, reassembler.pending) == ({'incomplete': 2, 'too long': 1}, 0)


def test_messages_of_65535_blocks_that_never_end() -> None:
    """Any number of empty blocks of any number of messages: the memory stays below the limit."""
    reassembler = Reassembler(max_pending=4 << 20)
    payload = np.zeros(0, np.uint8)
    tracemalloc.start()
    try:
        for message_id in (1, 2, 3):
            for block in range(1, 65535):
                reassembler.add(Op.DATAN, message_id, block, payload, 0.0)
                assert reassembler.pending <= reassembler.max_pending
        used, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert used < reassembler.max_pending
    held = reassembler.pending // BLOCK_COST
    assert sum(reassembler.dropped.values()) + held == 3 * 65534


def test_payloads_are_kept_without_their_buffer() -> None:
    """A block that is kept must not keep the whole batch alive."""
    reassembler = Reassembler()
    row = np.arange(60, dtype=np.uint8)
    reassembler.add(Op.DATAN, 1, 1, row[8:], 0.0)
    row[:] = 0
    assert reassembler.add(Op.DATA0, 1, 2, b'\x34\0\0\0', 0.0) == bytes(range(8, 60))


@given(st.lists(st.tuples(st.sampled_from([0, 1]), st.integers(0, 24), st.sampled_from([0, 1, 2, 3, 5, 65535]),
                          st.integers(0, 40), st.floats(0, 0.3)), max_size=150))
@settings(max_examples=200, deadline=None)
def test_memory_and_accounts_under_arbitrary_blocks(arrivals) -> None:
    reassembler = Reassembler(max_message_size=2000, max_pending=1500)
    now, finished = 0.0, 0
    for count, (op, message_id, block, size, pause) in enumerate(arrivals, 1):
        now += pause
        before = held_blocks(reassembler)
        dropped = sum(reassembler.dropped.values())
        if reassembler.add(op, message_id, block, bytes(size), now) is not None:
            finished += before + 1 - held_blocks(reassembler) - (sum(reassembler.dropped.values()) - dropped)
        assert reassembler.pending <= reassembler.max_pending
        assert reassembler.pending % BLOCK_COST <= 40 * held_blocks(reassembler)
        assert sum(reassembler.dropped.values()) + held_blocks(reassembler) + finished == count
    reassembler.overtake(1, now + 2 * PARTIAL_LIFETIME)
    assert reassembler.pending == 0 and not reassembler.remembers


def held_blocks(reassembler) -> Any:
    """How many blocks are held; their payloads, of at most 40 bytes each, are below BLOCK_COST together."""
    return reassembler.pending // BLOCK_COST


@given(st.integers(0, 2 ** 32), st.floats(0, 0.2), st.floats(0, 0.3), st.integers(0, 12))
@settings(max_examples=30, deadline=None)
def test_a_long_bad_link_delivers_no_message_wrong_or_twice(seed, loss, repeat, reorder) -> None:
    """600 messages of 1 to 4 blocks over a link that loses, repeats and delays datagrams."""
    chance = random.Random(seed)
    link = []
    for i in range(600):
        message = i.to_bytes(4, 'little') + bytes(chance.randrange(220))
        for datagram in blocks(message, i % 255 + 1):
            for _ in range(1 + (chance.random() < repeat)):
                if chance.random() >= loss:
                    link.append((len(link) + chance.uniform(0, reorder), datagram))
    inbox = Inbox(CONNECTION)
    got = []
    arrived = [datagram for _, datagram in sorted(link, key=lambda timed: timed[0])]
    for at in range(0, len(arrived), 7):
        batch = [HEADER.pack(CONNECTION, *datagram[:3]) + datagram[3] for datagram in arrived[at:at + 7]]
        whole, messages = inbox.sort(*as_batch(batch), np.ones(len(batch), bool), at * 1e-4)
        got += [batch[row][12:] for row in np.flatnonzero(whole)] + [message for _, message in messages]
    numbers = [int.from_bytes(message[:4], 'little') for message in got]
    assert all(message[4:] == bytes(len(message) - 4) for message in got)
    assert set(numbers) <= set(range(600))
    assembled = [number for number, message in zip(numbers, got) if len(message) > SIZE - 12]
    assert len(assembled) == len(set(assembled))
    if not loss:
        assert set(numbers) == set(range(600))


# -- Inbox ---------------------------------------------------------------------------------------------------


def as_batch(datagrams) -> Any:
    """(datagrams, lengths) as a DatagramReceiver leaves them: behind a datagram are bytes of an earlier one."""
    rows = np.tile(np.frombuffer(single(bytes(52)) + b'\0', np.uint8), (len(datagrams), 1))
    for row, datagram in zip(rows, datagrams):
        row[:min(len(datagram), SLOT)] = np.frombuffer(datagram[:SLOT], np.uint8)
    return rows, np.array([min(len(datagram), SLOT) for datagram in datagrams], np.int64)


def single(message=b'hello', message_id=1, connection_id=CONNECTION) -> Any:
    return bytes(split(with_length(message), connection_id, message_id, SIZE))


def test_a_batch_by_hand() -> None:
    many = split(with_length(bytes(100)), CONNECTION, 2, SIZE)
    batch = [single(), bytes(many[:SIZE]), single(message_id=3), bytes(many[SIZE:]), single(b'')]
    inbox = Inbox(CONNECTION)
    whole, messages = inbox.sort(*as_batch(batch), np.ones(5, bool), 0.0)
    assert whole.tolist() == [True, False, True, False, True]
    assert messages == [(3, bytes(100))]
    assert inbox.dropped == {}


@pytest.mark.parametrize(('datagram', 'reason'), [
    (b'', 'short'), (single()[:7], 'short'),
    (single()[:8], 'length'), (single()[:11], 'length'), (single()[:-1], 'length'), (single() + b'\0', 'length'),
    (single(bytes(52)) + b'\0', 'truncated'), (bytes(2000), 'truncated'),
    (HEADER.pack(CONNECTION, Op.DATA0, 1, 1) + with_length(bytes(SLOT - 12)), 'truncated'),
    (single(connection_id=CONNECTION + 1), 'connection id'), (single(connection_id=0xffffffff), 'connection id'),
    (HEADER.pack(CONNECTION, Op.PING, 1, 1), 'op'), (HEADER.pack(CONNECTION, Op.ERR, 1, 1) + bytes(20), 'op'),
    (HEADER.pack(CONNECTION, 255, 1, 1), 'op'),
    (single(message_id=0), 'header'), (HEADER.pack(CONNECTION, Op.DATA0, 1, 0) + bytes(4), 'header'),
    (HEADER.pack(CONNECTION, Op.DATAN, 1, 0) + bytes(4), 'header'),
], ids=lambda value: value if isinstance(value, str) else '%d' % len(value))
def test_reasons_to_drop(datagram, reason) -> None:
    inbox = Inbox(CONNECTION)
    whole, messages = inbox.sort(*as_batch([single(), datagram, single()]), np.ones(3, bool), 0.0)
    assert whole.tolist() == [True, False, True]
    assert messages == []
    assert inbox.dropped == {reason: 1}


def test_strangers() -> None:
    inbox = Inbox(CONNECTION)
    whole, messages = inbox.sort(*as_batch([single(), b'', single()]), np.array([False, False, True]), 0.0)
    assert whole.tolist() == [False, False, True]
    assert inbox.dropped == {'stranger': 2}


def test_messages_of_one_block_overtake_others_too() -> None:
    """Message 5 lost its second block; 255 messages later its id is reused, and the old first block is forgotten."""
    inbox = Inbox(CONNECTION)

    def sort(datagrams) -> Any:
        return inbox.sort(*as_batch(datagrams), np.ones(len(datagrams), bool), 0.0)

    def two(content) -> Any:
        joined = bytes(split(with_length(message_of(content, 2)), CONNECTION, 5, SIZE))
        return [joined[:SIZE], joined[SIZE:]]

    sort(two(1)[:1])
    for message_id in [*range(6, 256), *range(1, 5)]:
        assert sort([single(message_id=message_id)])[0].all()
    assert sort(two(2))[1] == [(1, message_of(2, 2))]
    sort([single(message_id=message_id) for message_id in [*range(6, 256), *range(1, 5)]])
    assert sort(two(3))[1] == [(1, message_of(3, 2))]       # nor is it taken for a duplicate
    assert sort([single(message_id=100)] + two(4))[1] == [(2, message_of(4, 2))]
    assert inbox.dropped == {'incomplete': 1}


def one_by_one(reassembler, batch, lengths, trusted, now) -> Any:
    """Inbox.sort, written simply."""
    whole, messages, dropped = [], [], []
    for row, (datagram, length, known) in enumerate(zip(batch, lengths, trusted)):
        whole.append(False)
        datagram = bytes(datagram[:length])
        if not known:
            dropped.append('stranger')
        elif length < 8:
            dropped.append('short')
        elif length >= SLOT:
            dropped.append('truncated')
        else:
            connection_id, op, message_id, block = HEADER.unpack_from(datagram)
            if connection_id != CONNECTION:
                dropped.append('connection id')
            elif op > 1:
                dropped.append('op')
            elif op == 0 and block == 1 and message_id > 0:
                if length >= 12 and int.from_bytes(datagram[8:12], 'little') == length - 12:
                    whole[-1] = True
                    reassembler.overtake(message_id, now)
                else:
                    dropped.append('length')
            else:
                message = reassembler.add(op, message_id, block, datagram[8:], now)
                if message is not None:
                    messages.append((row, message))
    return whole, messages, dropped


GOOD = [single(bytes(n), message_id) for n, message_id in ((0, 1), (5, 2), (52, 3), (30, 20))] + [
    bytes(joined[at:at + SIZE]) for joined in (split(with_length(bytes(n)), CONNECTION, message_id, SIZE)
                                              for n, message_id in ((60, 4), (100, 5), (200, 30)))
    for at in range(0, len(joined), SIZE)]


@st.composite
def mutated(draw) -> Any:
    datagram = bytearray(draw(st.sampled_from(GOOD)))
    for at, value in draw(st.lists(st.tuples(st.integers(0, 15), st.sampled_from([0, 1, 2, 3, 77, 255])), max_size=2)):
        if at < len(datagram):
            datagram[at] = value
    end = draw(st.one_of(st.just(len(datagram)), st.integers(0, len(datagram))))
    return bytes(datagram[:end]) + draw(st.sampled_from([b'', b'', b'', b'\0', bytes(80)]))


BATCH = st.lists(st.tuples(st.one_of(st.sampled_from(GOOD), mutated(), st.binary(max_size=SLOT + 5)),
                           st.sampled_from([True] * 5 + [False])), min_size=1, max_size=12)


@given(st.lists(st.tuples(BATCH, st.floats(0, 1)), max_size=6))
@settings(max_examples=300, deadline=None)
def test_a_batch_is_sorted_as_its_datagrams_one_by_one(batches) -> None:
    inbox, oracle, now = Inbox(CONNECTION), Reassembler(), 0.0
    for batch, pause in batches:
        now += pause
        datagrams, lengths = as_batch([datagram for datagram, _ in batch])
        trusted = np.array([known for _, known in batch])
        whole, messages = inbox.sort(datagrams, lengths, trusted, now)
        expected = one_by_one(oracle, datagrams, lengths.tolist(), trusted, now)
        assert (whole.tolist(), messages) == expected[:2]
        oracle.dropped.update(expected[2])
        assert inbox.dropped == oracle.dropped
