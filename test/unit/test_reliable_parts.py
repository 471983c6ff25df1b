# SPDX-License-Identifier: BSD-3-Clause
"""The two ends of a reliable channel, and what measures the link, one by one."""
import math
import zlib
from typing import Any, List, Optional

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.packed import DEFLATED, pack, unpack
from smokebot_udp.reliable.bounds import Bounds
from smokebot_udp.reliable.loss import EXPEDITED, ORDINARY, LossMeter
from smokebot_udp.reliable.pace import MIN_BURST, MIN_RATE, Pace
from smokebot_udp.reliable.receiver import ReliableReceiver
from smokebot_udp.reliable.round_trip import INITIAL_TIMEOUT, MAX_TIMEOUT, MIN_TIMEOUT, RoundTrip
from smokebot_udp.reliable.segment import WINDOW, Kind, Segment
from smokebot_udp.reliable.sender import COPY_SPACING, REFUSED_PERIOD, ReliableSender

ROOM = 100
INTERVAL = 0.2


def data(number: int, first: int = 1, part: int = 0, parts: int = 1, content: bytes = b'x' * ROOM) -> Segment:
    return Segment(Kind.DATA, 5, number, first, part, parts, data=content)


def made_sender(**bounds: Any) -> ReliableSender:
    return ReliableSender(5, Bounds(**bounds), ROOM)


def drained(sender: ReliableSender, now: float, copies: int = 1) -> List[Segment]:
    """All that a sender sends now."""
    found: List[Segment] = []
    while True:
        segment = sender.take(now, INTERVAL, copies)
        if segment is None:
            return found
        found.append(segment)


# the sender

def test_messages_are_cut_and_numbered() -> None:
    sender = made_sender()
    for message in (b'', b'a' * 100, b'b' * 250):
        sender.send(message, 0.0)
    assert sender.due() == -math.inf
    assert drained(sender, 0.0) == [
        data(1, content=b''), data(2, content=b'a' * 100),
        data(3, part=0, parts=3, content=b'b' * 100), data(4, part=1, parts=3, content=b'b' * 100),
        data(5, part=2, parts=3, content=b'b' * 50)]
    assert sender.due() == INTERVAL and sender.waiting == 3


def test_a_message_is_cut_by_the_room_that_there_was_when_it_came() -> None:
    sender = made_sender()
    sender.send(b'a' * 150, 0.0)
    sender.room = 60
    sender.send(b'b' * 120, 0.0)
    first = [data(1, part=0, parts=2, content=b'a' * 100), data(2, part=1, parts=2, content=b'a' * 50),
             data(3, part=0, parts=2, content=b'b' * 60), data(4, part=1, parts=2, content=b'b' * 60)]
    assert drained(sender, 0.0) == first
    assert drained(sender, INTERVAL) == first
    sender.acknowledge(5, b'', 0.0)
    assert sender.acknowledged == 2 and sender.flying == 0


def test_what_is_not_acknowledged_is_sent_again() -> None:
    sender = made_sender()
    for _ in range(3):
        sender.send(b'', 0.0)
    drained(sender, 0.0)
    assert drained(sender, INTERVAL - 0.001) == []
    sender.acknowledge(1, b'\x02', 0.0)      # 3 came, 1 and 2 did not
    assert [segment.number for segment in drained(sender, INTERVAL)] == [1, 2]
    sender.acknowledge(4, b'', 0.0)
    assert (sender.waiting, sender.acknowledged, sender.due()) == (0, 3, math.inf)


def test_copies_are_spread_and_end_with_the_acknowledgement() -> None:
    sender = made_sender()
    sender.send(b'', 0.0)
    times: List[float] = []
    while len(times) < 8:
        now = max(sender.due(), 0.0)
        times += [now] * len(drained(sender, now, 3))
    once = [0.0, COPY_SPACING, 2 * COPY_SPACING]
    assert times == pytest.approx(once + [INTERVAL + at for at in once] + [2 * INTERVAL, 2 * INTERVAL + COPY_SPACING])
    sender.acknowledge(2, b'', 0.0)
    assert sender.due() == math.inf


def test_the_window_bounds_what_is_on_its_way() -> None:
    sender = made_sender(bytes=ROOM * 1000)
    sender.send(b'x' * ROOM * 1000, 0.0)
    assert len(drained(sender, 0.0)) == WINDOW
    sender.acknowledge(11, b'', 0.0)
    assert [segment.number for segment in drained(sender, 0.0)] == list(range(WINDOW + 1, WINDOW + 11))


@pytest.mark.parametrize('bounds, reason', [({'messages': 3}, 'count'), ({'bytes': 300}, 'bytes')])
def test_beyond_the_bounds_the_oldest_are_given_up(bounds: Any, reason: str) -> None:
    sender = made_sender(**bounds)
    for number in range(5):
        sender.send(b'%d' % number * 100, 0.0)
    assert sender.given_up == {reason: 2} and sender.waiting == 3
    assert [segment.data[:1] for segment in drained(sender, 0.0)] == [b'2', b'3', b'4']
    with pytest.raises(ValueError, match='it has 2000000 bytes'):
        sender.send(bytes(2000000), 0.0)


def test_what_is_old_is_given_up_and_the_receiver_is_told() -> None:
    sender = made_sender(age=5.0)
    sender.send(b'old', 0.0)
    sender.send(b'new', 1.0)
    drained(sender, 1.0)
    sender.acknowledge(1, b'\x01', 0.0)      # the new one came, and waits for the old one
    assert sender.expires() == 5.0
    sender.expire(5.0)
    assert (sender.given_up, sender.waiting) == ({'age': 1}, 0)
    assert drained(sender, 5.0) == [Segment(Kind.ADVANCE, 5, first=3)]
    assert drained(sender, 5.0 + INTERVAL) == [Segment(Kind.ADVANCE, 5, first=3)]
    sender.acknowledge(3, b'', 0.0)
    assert sender.due() == math.inf


def test_what_is_latched_does_not_get_old() -> None:
    sender = made_sender(age=1.0, keeps_last=True)
    sender.send(b'old', 0.0)
    sender.send(b'new', 0.5)
    sender.take(0.5, INTERVAL)
    assert sender.expires() == 1.0
    sender.expire(100.0)
    assert sender.given_up == {'age': 1} and sender.waiting == 1 and sender.expires() == math.inf
    assert sender.take(100.0, INTERVAL) == data(2, first=2, content=b'new')


def test_a_new_session_gets_only_what_the_old_one_cannot_have() -> None:
    sender = made_sender(bytes=ROOM * 1000)
    sender.send(b'x' * ROOM * WINDOW, 0.0)
    sender.send(b'new', 0.0)
    drained(sender, 0.0)
    sender.renew()
    assert sender.given_up == {'restart': 1}
    assert drained(sender, 0.0) == [data(1, content=b'new')]


def test_what_is_for_one_session_is_not_sent_in_the_next_one() -> None:
    sender = made_sender(one_session=True)
    sender.send(b'not sent yet', 0.0)
    sender.renew()
    assert sender.given_up == {'restart': 1} and drained(sender, 0.0) == []


def test_a_peer_without_the_channel_is_asked_rarely() -> None:
    sender = made_sender()
    sender.send(b'', 0.0)
    drained(sender, 0.0)
    sender.refused(0.1)
    assert drained(sender, 0.1 + REFUSED_PERIOD / 2) == [] and sender.due() == 0.1 + REFUSED_PERIOD
    assert len(drained(sender, 0.1 + REFUSED_PERIOD)) == 1


@pytest.mark.parametrize('next_, received', [(0, b''), (4, b''), (2 ** 32 - 1, b''), (1, b'\x04'), (3, b'\x01'),
                                             (1, b'\xff' * 32), (2, b'\x00' * 31 + b'\x80')])
def test_acknowledgements_of_what_was_never_sent_are_refused(next_: int, received: bytes) -> None:
    sender = made_sender()
    sender.send(b'', 0.0)
    sender.send(b'', 0.0)
    drained(sender, 0.0)
    with pytest.raises(ValueError, match='never sent'):
        sender.acknowledge(next_, received, 0.0)
    assert sender.waiting == 2


# the receiver

def received(*segments: Segment, ordered: bool = True, max_bytes: int = 1 << 20) -> List[Optional[List[bytes]]]:
    receiver = ReliableReceiver(ordered, max_bytes)
    return [receiver.take(segment) for segment in segments]


def test_segments_are_joined_in_order() -> None:
    two = data(2, part=0, parts=2, content=b'b' * 20), data(3, part=1, parts=2, content=b'c')
    assert received(*two, data(1, content=b'a')) == [[], [], [b'a', b'b' * 20 + b'c']]
    assert received(*two, data(1, content=b'a'), ordered=False) == [[], [b'b' * 20 + b'c'], [b'a']]


def test_what_has_come_is_acknowledged() -> None:
    receiver = ReliableReceiver(True, 1 << 20)
    for number in (1, 3, 4, 12):
        receiver.take(data(number))
    assert (receiver.next, receiver.received) == (2, b'\x03\x02')
    receiver.take(data(2))
    assert (receiver.next, receiver.received) == (5, b'\x40')


def test_what_is_repeated_is_taken_once() -> None:
    assert received(data(2), data(2), data(1), data(1), data(2), ordered=False) == [
        [b'x' * ROOM], [], [b'x' * ROOM], [], []]


def test_a_receiver_does_not_wait_for_what_is_given_up() -> None:
    receiver = ReliableReceiver(True, 1 << 20)
    receiver.take(data(1, part=0, parts=3))     # a message that never ends
    receiver.take(data(5, content=b'five'))     # waits for 4
    assert receiver.advance(6) == [b'five'] and receiver.next == 6 and receiver.held == 0
    assert receiver.take(data(2, part=1, parts=3)) == []
    assert receiver.take(data(7, first=7, content=b'seven')) == [b'seven']


@pytest.mark.parametrize('segment, reason', [
    (data(0), 'malformed'), (data(1, first=0), 'malformed'), (data(5, first=6), 'malformed'),
    (data(1, part=1, parts=1), 'malformed'), (data(1, parts=0), 'malformed'), (data(1, part=1, parts=2), 'malformed'),
    (data(1, parts=2, content=b''), 'malformed'), (data(1, parts=65535), 'malformed'),
    (data(1 + WINDOW), 'far ahead'),
    (data(2 ** 31, first=2 ** 31 - WINDOW), 'far ahead'), (data(2 ** 32 - 1, first=2 ** 32 - 1), 'malformed')])
def test_segments_that_nobody_sends_are_refused(segment: Segment, reason: str) -> None:
    receiver = ReliableReceiver(True, 10000)
    assert receiver.take(segment) is None
    assert receiver.dropped == {reason: 1} and receiver.next == 1


def test_one_message_has_one_number_of_parts() -> None:
    receiver = ReliableReceiver(True, 10000)
    receiver.take(data(1, part=0, parts=3))
    receiver.take(data(2, part=1, parts=2, content=b'x'))
    assert receiver.dropped['inconsistent'] == 1 and receiver.next == 2


def test_a_message_that_is_too_long_is_not_kept() -> None:
    receiver = ReliableReceiver(True, 1000)
    assert [receiver.take(data(1 + part, part=part, parts=12)) for part in range(12)] == [[]] * 12
    assert receiver.dropped['too long'] == 2 and receiver.held == 0 and receiver.next == 13
    assert receiver.take(data(13, first=13, content=b'next')) == [b'next']


@given(st.lists(st.builds(
    data, number=st.one_of(st.integers(0, 600), st.integers(0, 2 ** 32 - 1)),
    first=st.one_of(st.integers(0, 600), st.integers(0, 2 ** 32 - 1)), part=st.integers(0, 40),
    parts=st.integers(0, 40), content=st.binary(max_size=300)), max_size=60), st.booleans())
def test_whatever_comes_memory_is_bounded_and_numbers_grow(segments: List[Segment], ordered: bool) -> None:
    receiver = ReliableReceiver(ordered, 4000)
    for segment in segments:
        before = receiver.next
        receiver.take(segment)
        assert receiver.next >= before and len(receiver.received) <= WINDOW // 8
        assert receiver.held <= 4000 + WINDOW * 300


@pytest.mark.parametrize('ordered', [True, False])
@pytest.mark.parametrize('shape', [
    lambda number: data(number, part=0, parts=2),       # each begins a message that never ends
    lambda number: data(number, part=number % 2, parts=2 + number % 3),
    lambda number: data(number, part=0, parts=200),
    lambda number: data(number, part=min(number - 1, 1), parts=2 if number % 3 else 1),
    lambda number: data(number, part=number - 1 if number < 60 else 0, parts=60 if number < 60 else 1),
    lambda number: data(number, part=number - 1 if number < 61 else 0, parts=60 if number < 61 else 1)])
def test_memory_is_bounded_while_the_peer_never_moves_on(shape: Any, ordered: bool) -> None:
    receiver = ReliableReceiver(ordered, 4000)
    for _ in range(3):      # what is refused is sent again
        for number in range(1, 3000):
            receiver.take(shape(number))
    assert receiver.held <= 4000 + WINDOW * ROOM


def test_a_message_that_is_too_long_does_not_hold_up_those_behind_it() -> None:
    receiver = ReliableReceiver(True, 1000)
    for part in range(12):
        receiver.take(data(1 + part, part=part, parts=12))
    assert receiver.take(data(13, content=b'next')) == [b'next']


# what measures the link

def test_the_timeout_follows_the_round_trip() -> None:
    # RFC 6298: SRTT = R, RTTVAR = R / 2, RTO = SRTT + 4 RTTVAR; then RTTVAR = 3/4 RTTVAR + 1/4 |SRTT - R'|, ...
    measured = RoundTrip()
    assert measured.timeout == INITIAL_TIMEOUT
    measured.add(0.1)
    assert measured.timeout == pytest.approx(0.3)
    measured.add(0.14)
    assert measured.timeout == pytest.approx(0.105 + 4 * (0.75 * 0.05 + 0.25 * 0.04))
    for _ in range(100):
        measured.add(0.001)
    assert measured.timeout == MIN_TIMEOUT
    measured.add(-1.0)
    measured.add(math.nan)
    measured.add(1e9)
    assert measured.timeout == MIN_TIMEOUT
    assert measured.interval(0.0) == MIN_TIMEOUT and measured.interval(2.0) == 0.5
    assert measured.interval(1e3) == MAX_TIMEOUT


@pytest.mark.parametrize('loss, expedited, ordinary', [(0.0, 1, 1), (0.2, 3, 1), (0.5, 6, 2), (0.9, 6, 3)])
def test_the_loss_is_that_which_the_peer_counts(loss: float, expedited: int, ordinary: int) -> None:
    meter = LossMeter()
    for seq in range(10, 2000, 10):
        meter.add(seq, round(seq * (1 - loss)))
    assert meter.loss == pytest.approx(loss, abs=0.01)
    assert (meter.copies(EXPEDITED), meter.copies(ORDINARY)) == (expedited, ordinary)
    meter.add(5, 5)         # overtaken
    meter.add(3000, 0)      # impossible
    assert meter.loss == pytest.approx(loss, abs=0.01)


def test_the_pace_is_that_of_a_token_bucket() -> None:
    pace, now, sent = Pace(10000.0), 0.0, 0
    while now < 10.0:
        assert pace.free(now)
        pace.charge(1000, now)
        sent += 1000
        now = max(now, pace.free_at)
    assert sent == pytest.approx(100000 + MIN_BURST, rel=0.02)


def test_on_a_slow_link_segments_do_not_leave_together() -> None:
    pace, now, left = Pace(10000.0), 10.0, []
    pace.most_burst = 300.0
    for _ in range(5):
        assert pace.free(now)
        pace.charge(500, now)
        left.append(now)
        now = max(now, pace.free_at)
    gaps = [after - before for before, after in zip(left, left[1:])]
    assert gaps == pytest.approx([0.02, 0.05, 0.05, 0.05], abs=1e-3)


def test_the_pace_yields_to_a_queue_but_not_to_a_busy_machine() -> None:
    pace, now = Pace(100000.0), 0.0
    for number in range(1000):
        now += 0.05
        pace.observe(0.1 if number % 5 == 0 else 0.4, 0.1, 0.0, now)
    assert pace.rate == 100000.0
    for _ in range(200):
        now += 0.05
        pace.observe(0.2, 0.1, 0.0, now)
    assert pace.rate == MIN_RATE
    for _ in range(20):
        now += 0.05
        pace.observe(0.2, 0.1, 0.25, now)
    assert pace.rate == pytest.approx(MIN_RATE * 16 / 9)
    for _ in range(200):
        now += 0.05
        pace.observe(0.11, 0.1, 0.0, now)
    assert pace.rate == 100000.0


@given(st.binary(max_size=2000), st.integers(0, 20))
def test_what_is_packed_is_unpacked(content: bytes, repeated: int) -> None:
    message = content * repeated
    assert unpack(pack(message), len(message)) == message
    assert len(pack(message)) <= len(message) + 1


@pytest.mark.parametrize('packed', [b'', b'\2abc', b'\1abc', pack(bytes(10000))[:-6], b'\0' + bytes(5001),
                                    pack(bytes(5001)), DEFLATED + zlib.compress(bytes(10 ** 7)),
                                    pack(bytes(900)) + b'x'])
def test_nothing_else_is_unpacked(packed: bytes) -> None:
    with pytest.raises(ValueError):
        unpack(packed, 5000)
