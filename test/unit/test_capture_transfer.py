# SPDX-License-Identifier: BSD-3-Clause
"""Transfers over a link that loses, delays, reorders and repeats, in simulated time."""
import heapq
import random
from typing import Any, List, Optional, Tuple

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from smokebot_udp.capture.receiving import MAX_BEGINNINGS, Receiving
from smokebot_udp.capture.sending import MAX_PIECES, MAX_SIZE, PAUSE_AFTER, Piece, Sending, piece_length
from smokebot_udp.capture.transfers import MAX_TRANSFERS, TIMEOUT, Batch, Load, Request, Transfers

REPORT_PERIOD = 0.1
DATA = bytes(random.Random(1).getrandbits(8) for _ in range(50000))


class Air:
    """Both directions of a link. Pieces occupy it one after the other; each datagram meets loss, delay, repetition."""

    def __init__(self, seed: int, loss: float, delay: float, jitter: float = 0.0, copies: float = 0.0) -> None:
        self._random = random.Random(seed)
        self._loss, self._delay, self._jitter, self._copies = loss, delay, jitter, copies
        self._flying: List[Any] = []
        self._count = 0

    def send(self, what: Any, now: float) -> None:
        for _ in range(1 + (self._random.random() < self._copies)):
            if self._random.random() >= self._loss:
                self._count += 1
                when = now + self._delay + self._jitter * self._random.random()
                heapq.heappush(self._flying, (when, self._count, what))

    def arrived(self, now: float) -> List[Any]:
        found = []
        while self._flying and self._flying[0][0] <= now:
            found.append(heapq.heappop(self._flying)[2])
        return found


def transfer(air: Air, data: bytes = DATA, length: int = 1400, spacing: float = 0.01, most: float = 60.0
             ) -> Tuple[Optional[bytes], float, int]:
    """(what came, when [s], pieces sent): one piece leaves at most each `spacing` [s]."""
    sending, receiving = Sending(data, length, 0.0), Receiving()
    steps = sent = 0
    while steps * spacing < most:
        now = steps * spacing
        steps += 1
        for what in air.arrived(now):
            if isinstance(what, Piece):
                receiving.take(what)
            else:
                sending.acknowledge(*what, now)
        if receiving.whole is not None:
            return receiving.whole, now, sent
        if steps % round(REPORT_PERIOD / spacing) == 0:
            air.send((receiving.received, receiving.order), now)
        piece = sending.take(now)
        if piece is not None:
            sent += 1
            air.send(piece, now)
    return None, most, sent


def test_without_loss_each_piece_is_sent_once() -> None:
    data, when, sent = transfer(Air(1, 0.0, 0.05))
    assert (data, sent) == (DATA, 36) and when < 0.5


@pytest.mark.parametrize('loss', [0.2, 0.5])
def test_only_what_lacks_is_sent_again(loss: float) -> None:
    found = [transfer(Air(seed, loss, 0.05)) for seed in range(10)]
    assert all(data == DATA for data, _, _ in found)
    # the end needs some that are sent on suspicion
    assert sum(sent for _, _, sent in found) / 10 < 1.25 * 36 / (1 - loss) + 10


def test_a_queue_is_no_reason_to_repeat() -> None:
    data, _, sent = transfer(Air(1, 0.0, 0.4))
    assert data == DATA and sent <= 2 * 36      # until the round trip is known, and at the end


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 1 << 30), st.floats(0, 0.8), st.floats(0, 0.3), st.floats(0, 0.2), st.floats(0, 0.5),
       st.integers(64, 3000), st.integers(1, 20000))
@example(1, 0.8, 0.0, 0.0, 0.0, 64, 2000)
def test_whatever_the_link_does_all_arrives(seed: int, loss: float, delay: float, jitter: float, copies: float,
                                            length: int, size: int) -> None:
    data, _, _ = transfer(Air(seed, loss, delay, jitter, copies), DATA[:size], length, most=200.0)
    assert data == DATA[:size]


def test_a_silent_operator_gets_nothing() -> None:
    sending = Sending(DATA, 1400, 0.0)
    assert sending.take(PAUSE_AFTER) is not None and sending.due(PAUSE_AFTER) < PAUSE_AFTER
    assert sending.take(PAUSE_AFTER + 0.1) is None and sending.due(PAUSE_AFTER + 0.1) == float('inf')
    sending.acknowledge(b'', 0, 5.0)
    assert sending.take(5.0) is not None


def test_reports_of_what_was_never_sent_are_refused() -> None:
    sending = Sending(DATA[:3000], 1400, 0.0)
    for received, order in ((b'\x08', 0), (bytes(10) + b'\1', 0), (b'', 1)):
        with pytest.raises(ValueError):
            sending.acknowledge(received, order, 0.0)


def test_the_length_of_pieces_is_that_of_a_datagram_unless_they_were_too_many() -> None:
    assert piece_length(250000, 1400, 1400) == 1400
    assert piece_length(250000, 300, 1400) == 300
    assert piece_length(MAX_PIECES * 1000, 300, 1400) == 1000
    for size in (MAX_PIECES * 1400 + 1, MAX_SIZE + 1):
        with pytest.raises(ValueError, match='ask for a region'):
            piece_length(size, 300, 1400)


def test_impossible_pieces_are_dropped() -> None:
    receiving = Receiving()
    good = Piece(10, 1, 0, 4, b'abcd')
    bad = [good._replace(size=0), good._replace(size=MAX_SIZE + 1, data=b'abcd'), good._replace(length=0),
           good._replace(order=0), good._replace(number=3), good._replace(data=b'abc'),
           good._replace(number=2, data=b'abcd'), good._replace(size=MAX_PIECES * 4 + 1)]
    for piece in bad:
        receiving.take(piece)
    assert receiving.dropped == len(bad) and receiving.size == 0 and receiving.received == b''
    for number, data in enumerate((b'abcd', b'efgh', b'ij')):
        assert receiving.whole is None
        receiving.take(good._replace(number=number, data=data, order=number + 1))
    assert receiving.whole == b'abcdefghij' and receiving.received == b'\7' and receiving.order == 3


def test_another_original_begins_anew_but_not_for_ever() -> None:
    receiving = Receiving()
    for size in range(5, 5 + MAX_BEGINNINGS + 3):
        receiving.take(Piece(size, 1, 0, 4, b'abcd'))
    assert receiving.size == 5 + MAX_BEGINNINGS - 1 and receiving.dropped == 3


REQUEST = Request(7, 'thermal', 0, (0, 0, 0, 0), True)


def test_each_operator_has_one_transfer_and_they_take_turns() -> None:
    transfers = Transfers()
    for operator in 'ab':
        transfers.request(operator, REQUEST, b'', 0, 0.0)
    loads = [transfers.poll(0.0), transfers.poll(0.0)]
    assert [load.operator for load in loads if isinstance(load, Load)] == ['a', 'b']
    assert transfers.poll(0.0) is None and transfers.deadline(0.0) == float('inf')
    for load in loads:
        assert isinstance(load, Load)
        transfers.loaded(load, DATA, 1400, 0.0)
    now, turns = 0.0, []
    for _ in range(4):
        now = max(now, transfers.deadline(now))
        batch = transfers.poll(now)
        assert isinstance(batch, Batch) and len(batch.pieces) == 1
        turns.append(batch.operator)
    assert turns == ['a', 'b', 'a', 'b'] and now > 0      # they are spread
    transfers.end('a', 7)
    transfers.request('a', REQUEST, b'', 0, now)    # a late one
    transfers.request('b', REQUEST._replace(id=8), b'', 0, now)     # another one in its place
    load = transfers.poll(now)
    assert load == Load('b', REQUEST._replace(id=8)) and transfers.left == 0


def test_transfers_are_bounded_and_forgotten() -> None:
    transfers = Transfers()
    for number in range(MAX_TRANSFERS + 1):
        transfers.request('operator %d' % number, REQUEST, b'', 0, 0.0)
    loads = []
    while transfers.deadline(0.0) <= 0:
        loads.append(transfers.poll(0.0))
    assert len(loads) == MAX_TRANSFERS
    transfers.request('another', REQUEST, b'', 0, TIMEOUT + 1)
    assert transfers.poll(TIMEOUT + 1) == Load('another', REQUEST)


def test_forged_reports_harm_nobody() -> None:
    transfers = Transfers()
    transfers.request('a', REQUEST, b'', 0, 0.0)
    load = transfers.poll(0.0)
    assert isinstance(load, Load)
    transfers.loaded(load, DATA, 1400, 0.0)
    transfers.request('a', REQUEST, b'\xff' * 2000, 0, 0.1)
    transfers.request('a', REQUEST, b'', 99, 0.1)
    assert transfers.refused == 2 and isinstance(transfers.poll(0.1), Batch)
