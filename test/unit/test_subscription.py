# SPDX-License-Identifier: BSD-3-Clause
"""A publisher of arbitrary bytes, a Subscription, and the loopback device between them."""
import io
import os
import random
import threading
import time
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import Image
from std_msgs.msg import Empty, Header, String

from smokebot_udp.udpros import subscription
from smokebot_udp.udpros.datagram import HEADER, Op, message_ids, split
from smokebot_udp.udpros.endpoints import DatagramReceiver, DatagramSender
from smokebot_udp.udpros.frame import Frame
from smokebot_udp.udpros.loss_emulation import LossyReceiver
from smokebot_udp.udpros.negotiation import Reply
from smokebot_udp.udpros.subscription import Subscription

CONNECTION = 5
SIZE = 200
WAIT = 10.0     # longer than any of it takes [s]


def serialised(message) -> Any:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


class Topic:
    """Keeps what is delivered."""

    def __init__(self, batches, messages) -> None:
        self.wants_batches, self.wants_messages = batches, messages
        self.batches, self.messages = [], []
        self._new = threading.Condition()

    def take_records(self, records, mask) -> None:
        with self._new:
            self.batches.append([record.tobytes() for record in records[mask]])
            self._new.notify_all()

    def take_message(self, message) -> None:
        with self._new:
            self.messages.append(message)
            self._new.notify_all()

    @property
    def records(self) -> Any:
        return [record for batch in self.batches for record in batch]

    def wait_for(self, last) -> None:
        with self._new:
            assert self._new.wait_for(lambda: (last in self.messages or not self.wants_messages) and
                                      (last in self.records or not self.wants_batches), WAIT)


class Peer:
    """A subscription, its thread if it is started, and the publisher's socket."""

    def __init__(self, message_class=String, batches=False, messages=True, hosts=('127.0.0.1',), receiver=None,
                 **options) -> None:
        self.receiver = receiver or DatagramReceiver('127.0.0.1', SIZE)
        self.sender = DatagramSender('127.0.0.1', self.receiver.address[1])
        self.topic = Topic(batches, messages)
        self.subscription = Subscription(self.receiver, Reply('127.0.0.1', 1, CONNECTION, SIZE, {}), hosts, self.topic,
                                         message_class, **options)
        self.counted = self.subscription.depacketizer
        self.thread = threading.Thread(target=self.subscription.run, daemon=True)
        self._last_id = 0

    def start(self) -> Any:
        self.thread.start()
        return self

    def send(self, *messages) -> None:
        for message in messages:
            self._last_id = self._last_id % 255 + 1
            data = split(len(message).to_bytes(4, 'little') + message, CONNECTION, self._last_id, SIZE)
            assert self.sender.send(data, SIZE, -(-len(data) // SIZE))

    def send_and_wait(self, *messages) -> None:
        """Send messages, the last one unique, and wait until it has arrived."""
        self.send(*messages)
        self.topic.wait_for(messages[-1])

    def close(self) -> None:
        self.subscription.stop()
        if self.thread.ident is not None:
            self.thread.join(WAIT)
            assert not self.thread.is_alive()
        self.receiver.close()
        self.sender.close()


@pytest.fixture
def make() -> Any:
    made = []

    def make_one(*args, **kwargs) -> Any:
        made.append(Peer(*args, **kwargs))
        return made[-1]

    yield make_one
    for peer in made:
        peer.close()


def text(n, length=0) -> Any:
    return serialised(String(('%d' % n).ljust(length, '.')))


def datagram(message, connection_id=CONNECTION, message_id=1) -> Any:
    return bytes(split(len(message).to_bytes(4, 'little') + message, connection_id, message_id, SIZE))


def numbered(seq, frame_id='x') -> Any:
    return serialised(Image(header=Header(seq=seq, frame_id=frame_id)))


# -- messages ------------------------------------------------------------------------------------------------


def test_messages_of_one_and_of_many_blocks_in_their_order(make) -> None:
    peer = make()
    messages = [text(n, 10 if n % 3 else 500) for n in range(60)]
    peer.send(*messages[:-1])       # before anyone reads: they come as one batch
    peer.start().send_and_wait(messages[-1])
    assert peer.topic.messages == messages
    assert peer.counted.datagrams == sum(1 if n % 3 else 3 for n in range(60))
    assert peer.counted.bytes == sum(len(m) + 4 + (8 if n % 3 else 24) for n, m in enumerate(messages))
    assert peer.counted.inbox.dropped == {}
    assert peer.counted.sequence is None


def test_empty_messages(make) -> None:
    peer = make(Empty).start()
    peer.send_and_wait(b'')
    assert peer.topic.messages == [b'']


def test_the_queue_keeps_the_newest(make) -> None:
    peer = make(queue_size=3)
    messages = [text(n) for n in range(300)]
    peer.send(*messages)            # three batches wait when the reading begins
    peer.start().topic.wait_for(messages[-1])
    assert peer.topic.messages == messages[-3:]


def test_sequence_numbers_count_loss_and_stop_repeats(make) -> None:
    peer = make(Image).start()
    peer.send_and_wait(*(numbered(seq) for seq in (10, 11, 11, 13, 12, 16)))
    assert [int.from_bytes(message[:4], 'little') for message in peer.topic.messages] == [10, 11, 13, 12, 16]
    sequence = peer.counted.sequence
    assert (sequence.received, sequence.lost) == (5, 2)


@pytest.mark.parametrize('batches', [False, True])
def test_each_arrival_is_reported_once(make, batches) -> None:
    """One by one, in batches, and in many blocks."""
    reported = []
    peer = make(Image, batches, not batches, arrived=lambda *what: reported.append(what)).start()
    begun = time.monotonic()
    short, long = numbered(0), numbered(0, 'a' * 300)
    peer.send_and_wait(numbered(10))
    peer.send_and_wait(numbered(12), numbered(11), numbered(12), numbered(13))
    peer.send_and_wait(numbered(14, 'a' * 300), numbered(14, 'a' * 300), numbered(15))
    assert sum(count for *_, count, _ in reported) == 6 and len({number for number, *_ in reported}) == 1
    assert reported[0][1:4] == (10, len(short) + 12 + 28, 1) and reported[-1][1] in (14, 15)
    assert {seq for _, seq, *_ in reported} <= set(range(10, 16))
    whens = [when for *_, when in reported]
    assert whens == sorted(whens) and begun - 0.01 < whens[0] and whens[-1] <= time.monotonic()
    assert sum(size for _, _, size, *_ in reported) == 5 * (len(short) + 40) + len(long)


def test_repeats_of_long_messages_stop_too(make) -> None:
    peer = make(Image).start()
    peer.send_and_wait(numbered(1, 'a' * 300), numbered(1, 'b' * 300), numbered(2))
    assert peer.topic.messages == [numbered(1, 'a' * 300), numbered(2)]


def test_a_truncated_header_has_no_sequence_number(make) -> None:
    peer = make(Image).start()
    peer.send_and_wait(numbered(1 << 30), b'', b'\5\0\0', numbered((1 << 30) + 1))
    assert peer.topic.messages == [numbered(1 << 30), numbered((1 << 30) + 1)]
    assert peer.counted.inbox.dropped == {'message': 2}
    assert peer.counted.sequence.lost == 0


def test_a_reused_id_is_another_message(make) -> None:
    """Of message 1 only the first block arrives; 255 messages later its id is reused."""
    peer = make()
    old, new = (bytes(split(len(message).to_bytes(4, 'little') + message, CONNECTION, 1, SIZE))
                for message in (text(1, 300), text(2, 300)))
    new = [new[:SIZE], new[SIZE:]]
    others = [datagram(text(n), message_id=n) for n in range(2, 256)]
    for data in [old[:SIZE]] + others + new + others + new:
        peer.sender.send_one(data)
        peer.subscription.poll()        # one by one
    assert peer.topic.messages == 2 * ([text(n) for n in range(2, 256)] + [text(2, 300)])
    assert peer.counted.inbox.dropped == {'incomplete': 1}


@pytest.mark.parametrize('few', [True, False], ids=['one by one', 'in batches'])
def test_few_and_many_are_handled_alike(make, few) -> None:
    """Datagrams that the path for single messages does not expect are sorted like any others."""
    peer = make(Image)
    arrivals = [datagram(numbered(seq), message_id=1 + n) for n, seq in enumerate((1, 2, 2, 5, 6, 4, 7))]
    arrivals += [b'', arrivals[0][:20], datagram(numbered(8), CONNECTION + 1), datagram(numbered(8), message_id=0),
                 datagram(numbered(8)) + bytes(SIZE), datagram(b'ab'), datagram(numbered(9))]
    for data in arrivals:
        peer.sender.send_one(data)
        if few:
            peer.subscription.poll()
    peer.subscription.poll()
    assert peer.topic.messages == [numbered(seq) for seq in (1, 2, 5, 6, 4, 7, 9)]
    assert peer.counted.inbox.dropped == {
        'short': 1, 'length': 1, 'connection id': 1, 'header': 1, 'truncated': 1, 'message': 1}
    sequence = peer.counted.sequence
    assert (sequence.received, sequence.lost) == (7, 2)
    assert peer.counted.datagrams == len(arrivals)
    assert peer.counted.bytes == sum(min(len(data), SIZE + 1) for data in arrivals)


# -- batches -------------------------------------------------------------------------------------------------


def test_a_frame_comes_as_one_batch(make) -> None:
    peer = make(Image, batches=True, messages=False)
    frame = Frame(Image, 100, {'data': 9})
    frame.header['connection_id'], frame.header['message_id'] = CONNECTION, message_ids(0, 100)
    frame.records['header']['seq'] = np.arange(100)
    frame.records['data'] = np.arange(900).reshape(100, 9) % 256
    peer.sender.send(frame.rows, frame.datagram_size, 100)
    expected = [record.tobytes() for record in frame.records]
    peer.start().topic.wait_for(expected[-1])
    assert peer.topic.batches == [expected]
    assert peer.topic.messages == []


def test_each_layout_is_a_batch_of_its_own(make) -> None:
    messages = [text(n, 5 + n % 3 * 20) for n in range(12)]
    peer = make(batches=True, messages=True)
    peer.send(*messages)
    peer.start().topic.wait_for(messages[-1])
    assert peer.topic.batches == [messages[0::3], messages[1::3], messages[2::3]]
    assert peer.topic.messages == messages


def test_layouts_of_one_length_are_distinguished(make) -> None:
    images = [serialised(Image(encoding='a' * n, data=bytes(9 - n))) for n in (3, 4, 3, 5, 4)]
    images = [int(n).to_bytes(4, 'little') + image[4:] for n, image in enumerate(images)]
    peer = make(Image, batches=True, messages=False)
    peer.send(*images)
    peer.start().topic.wait_for(images[3])
    peer.topic.wait_for(images[4])
    assert peer.topic.batches == [[images[0], images[2]], [images[1], images[4]], [images[3]]]


def test_long_messages_come_as_records_too(make) -> None:
    peer = make(batches=True, messages=False).start()
    peer.send_and_wait(text(1, 700), text(2))
    peer.topic.wait_for(text(1, 700))
    assert sorted(peer.topic.records) == sorted([text(1, 700), text(2)])


def test_bytes_that_are_no_such_message(make) -> None:
    peer = make(batches=True, messages=False).start()
    peer.send_and_wait(text(1), b'\xff\xff\xff\xffabc', b'', b'\3\0\0\0ab', text(2, 900)[:-1], text(3))
    peer.close()
    assert peer.topic.records == [text(1), text(3)]
    assert peer.counted.inbox.dropped == {'message': 4}


# -- strangers -----------------------------------------------------------------------------------------------




def test_only_the_publishers_socket_counts(make) -> None:
    peer = make().start()
    peer.send_and_wait(text(1))
    stranger = DatagramSender('127.0.0.1', peer.receiver.address[1])
    for n in range(20):
        stranger.send_one(datagram(text(100 + n)))
    arrival = peer.subscription.last_arrival
    peer.send_and_wait(text(2))
    assert peer.topic.messages == [text(1), text(2)]
    assert peer.counted.inbox.dropped == {'stranger': 20}
    assert (peer.counted.datagrams, peer.counted.bytes) == (2, 2 * len(datagram(text(1))))
    assert peer.subscription.last_arrival > arrival
    stranger.close()


def test_a_strangers_datagrams_do_not_count_as_arrivals(make) -> None:
    peer = make()
    peer.send(text(1))
    assert peer.subscription.poll()
    arrival = peer.subscription.last_arrival
    stranger = DatagramSender('127.0.0.1', peer.receiver.address[1])
    stranger.send_one(datagram(text(2)))
    assert peer.subscription.poll()
    assert peer.subscription.last_arrival == arrival
    stranger.close()


def test_only_the_publishers_host_counts_from_the_beginning(make) -> None:
    peer = make(hosts=('192.0.2.7', 'no.such.host.invalid'))
    peer.send(*(text(n) for n in range(5)))
    assert peer.subscription.poll()
    assert peer.counted.inbox.dropped == {'stranger': 5}
    assert peer.counted.datagrams == len(peer.topic.messages) == 0


def test_a_host_that_calls_itself_127_0_1_1(make) -> None:
    """Debian's /etc/hosts; the kernel sends from 127.0.0.1."""
    peer = make(hosts=('127.0.1.1',)).start()
    peer.send_and_wait(text(1))
    assert peer.topic.messages == [text(1)]


def test_an_old_connections_datagrams(make) -> None:
    peer = make().start()
    peer.sender.send_one(datagram(text(0), CONNECTION + 1))
    peer.send_and_wait(text(1))
    assert peer.topic.messages == [text(1)]
    assert peer.counted.inbox.dropped == {'connection id': 1}


# -- a bad link, and hostile bytes ---------------------------------------------------------------------------


@pytest.mark.parametrize('batches', [True, False], ids=['batches', 'messages'])
def test_emulated_loss_counts_as_lost(make, batches) -> None:
    """Each datagram is lost or delivered as the receiver's random numbers say, with its own time of arrival."""
    loss, count = 0.4, 50
    survives = np.random.RandomState([10]).random_sample(count + 1) >= loss
    assert survives[0] and survives[count]     # the first and the last number, between which losses are counted
    arrived = []
    peer = make(Image, batches=batches, messages=not batches, arrived=lambda *what: arrived.append(what),
                receiver=LossyReceiver('127.0.0.1', SIZE, loss=loss, seed=(10,)))
    peer.send(*(numbered(seq) for seq in range(count)))
    assert peer.subscription.poll()
    peer.send(numbered(count))
    assert peer.subscription.poll()
    expected = np.flatnonzero(survives).tolist()
    assert peer.topic.records + peer.topic.messages == [numbered(seq) for seq in expected]
    assert peer.counted.sequence.lost == count + 1 - len(expected)
    assert peer.counted.datagrams == len(expected)
    assert peer.counted.inbox.dropped == {}
    assert sum(number for *_, number, _ in arrived) == len(expected)


def test_all_may_be_lost(make) -> None:
    peer = make(receiver=LossyReceiver('127.0.0.1', SIZE, loss=1.0, seed=(0,)))
    peer.send(text(1), text(2))
    assert not peer.subscription.poll()
    assert (peer.counted.datagrams, peer.topic.messages, peer.counted.inbox.dropped) == (0, [], {})


def garbage(chance, good) -> Any:
    """Bytes like `good` ones, but not quite."""
    data = bytearray(chance.choice(good))
    for _ in range(chance.randrange(1, 4)):
        at = chance.randrange(min(len(data), 40))
        data[at] = chance.choice((0, 1, 2, 3, 255, chance.randrange(256)))
    return bytes(data[:chance.choice((len(data), chance.randrange(len(data) + 1)))]) + bytes(
        chance.choice((0, 0, 0, 1, 150)))


@pytest.mark.parametrize('message_class', [String, Image])
def test_garbage_from_the_publisher_itself_stops_nothing(make, message_class) -> None:
    chance = random.Random(1)
    messages = [text(1), text(2, 50), text(3, 700)] if message_class is String else [
        numbered(1), numbered(2, 'xyz'), numbered(3, 'x' * 400)]
    good = []
    for message in messages:
        data = split(len(message).to_bytes(4, 'little') + message, CONNECTION, 1, SIZE)
        good += [bytes(data[at:at + SIZE]) for at in range(0, len(data), SIZE)]
    peer = make(message_class, batches=True, messages=True).start()
    sent = 0
    for begin in range(40):
        bad = [garbage(chance, good) for _ in range(50)]
        bad += [HEADER.pack(CONNECTION, chance.choice(list(Op)), chance.randrange(256), chance.randrange(65536))]
        for data in bad:
            sent += peer.sender.send_one(data)
        last = text(10 ** 6 + begin) if message_class is String else numbered((1 << 31) - 100 + begin, 'good')
        peer.send_and_wait(last)
        sent += 1
    assert sent == 40 * 52 == peer.counted.datagrams
    assert {'short', 'truncated', 'connection id', 'op', 'length', 'header'} <= set(peer.counted.inbox.dropped)


# -- life and death ------------------------------------------------------------------------------------------


def open_files() -> Any:
    return len(os.listdir('/proc/self/fd'))


def test_stop_ends_the_thread_and_frees_the_socket(make, monkeypatch) -> None:
    monkeypatch.setattr(subscription, 'POLL_PERIOD', 3600.0)      # at once, not at the next check
    before = open_files()
    peers = [make().start() for _ in range(10)]
    assert open_files() == before + 20
    for peer in peers:
        peer.subscription.stop()
    for peer in peers:
        peer.thread.join(WAIT)
        assert not peer.thread.is_alive()
        assert peer.receiver.socket.fileno() == -1
        peer.sender.close()
    assert open_files() == before


def test_stop_within_a_callback(make) -> None:
    peer, seen = make(), []

    def take_message(message) -> None:
        seen.append(message)
        peer.subscription.stop()

    peer.topic.take_message = take_message
    peer.send(text(1), text(2))
    peer.start().thread.join(WAIT)
    assert not peer.thread.is_alive()
    assert seen == [text(1)]


def test_stop_before_the_beginning(make) -> None:
    peer = make()
    peer.subscription.stop()
    peer.start().thread.join(WAIT)
    assert not peer.thread.is_alive() and peer.receiver.socket.fileno() == -1
