# SPDX-License-Identifier: BSD-3-Clause
"""The messages that a Subscription delivers, over the loopback device."""
import time
from typing import Any, Iterator

import numpy as np
import pytest
from sensor_msgs.msg import Image
from std_msgs.msg import Empty
from subscription_peer import CONNECTION, SIZE, datagram, numbered, peers, serialised, text

from smokebot_udp.udpros.datagram import message_ids, split
from smokebot_udp.udpros.endpoints import DatagramSender
from smokebot_udp.udpros.frame import Frame


@pytest.fixture
def make() -> Iterator[Any]:
    yield from peers()


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
    assert sum(what[3] for what in reported) == 6 and len({number for number, *_ in reported}) == 1
    assert reported[0][1:4] == (10, len(short) + 12 + 28, 1) and reported[-1][1] in (14, 15)
    assert {seq for _, seq, *_ in reported} <= set(range(10, 16))
    whens = [what[4] for what in reported]
    assert whens == sorted(whens) and begun - 0.01 < whens[0] and whens[-1] <= time.monotonic()
    assert sum(size for _, _, size, *_ in reported) == 5 * (len(short) + 40) + len(long)


@pytest.mark.parametrize('batches', [False, True])
def test_marks_of_congested_queues_are_counted_once_for_each_message(make, batches) -> None:
    """One by one, in batches of more than are taken one by one, and in many blocks; of a stranger none."""
    marked = []
    peer = make(Image, batches, not batches, arrived=lambda *what: marked.append(what[-2])).start()
    last = 0
    for tos, count in ((0x88, 1), (0x8b, 1), (0x8a, 20), (3, 20)):
        peer.sender.tos = tos
        peer.send_and_wait(*(numbered(seq) for seq in range(last + 1, last + count + 1)))
        peer.send(numbered(last + 1))       # a duplicate
        last += count
    assert sum(marked) == 21
    peer.send_and_wait(numbered(last + 1, 'a' * 300))
    assert sum(marked) == 22
    stranger = DatagramSender('127.0.0.1', peer.receiver.address[1])
    stranger.tos = 3
    stranger.send_one(datagram(numbered(last + 2)))
    stranger.close()
    peer.sender.tos = 0
    peer.send_and_wait(numbered(last + 3))
    assert sum(marked) == 22


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
    """Only the first block of message 1 arrives. Its id is reused 255 messages later."""
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
