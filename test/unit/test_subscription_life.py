# SPDX-License-Identifier: BSD-3-Clause
"""Whom a Subscription trusts, what it bears, and how it ends, over the loopback device."""
import os
import random
from typing import Any, Iterator

import numpy as np
import pytest
from sensor_msgs.msg import Image
from std_msgs.msg import String
from subscription_peer import CONNECTION, SIZE, WAIT, datagram, numbered, peers, text

from smokebot_udp.udpros import subscription
from smokebot_udp.udpros.datagram import HEADER, Op, split
from smokebot_udp.udpros.endpoints import DatagramSender
from smokebot_udp.udpros.loss_emulation import LossyReceiver


@pytest.fixture
def make() -> Iterator[Any]:
    yield from peers()


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
    assert sum(what[3] for what in arrived) == len(expected)


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
