# SPDX-License-Identifier: BSD-3-Clause
import time
from typing import Any

import numpy as np
import pytest

from smokebot_udp import udpros
from smokebot_udp.udpros.endpoints import DatagramReceiver, DatagramSender
from smokebot_udp.udpros.loss_emulation import open_receiver

COUNT = 200


@pytest.fixture(autouse=True)
def no_loss_afterwards() -> Any:
    yield
    udpros.emulate_loss(0.0)


def survivors(topic) -> Any:
    """The numbers of the datagrams that a new receiver of a topic does not lose, of COUNT."""
    receiver = open_receiver(topic, '127.0.0.1', 100, 1 << 20)
    sender = DatagramSender('127.0.0.1', receiver.address[1])
    got = []
    try:
        for first in range(0, COUNT, 20):
            begun = time.monotonic()
            for number in range(first, first + 20):
                sender.send_one(bytes([number]) * (number % 7 + 1))
            for row in range(receiver.receive()):
                datagram = receiver.datagrams[row, :receiver.lengths[row]]
                assert datagram.tolist() == [datagram[0]] * (datagram[0] % 7 + 1)
                assert receiver.sources['port'][row] == sender.local[1]
                assert begun - 0.01 < receiver.arrival(row) <= time.monotonic()
                got.append(int(datagram[0]))
    finally:
        receiver.close()
        sender.close()
    return got


def test_no_loss_by_default() -> None:
    assert survivors('/a') == list(range(COUNT))


def test_loss_is_independent_and_repeatable_for_each_topic() -> None:
    udpros.emulate_loss(0.3, seed=5)
    first, other = survivors('/a'), survivors('/b')
    assert first == sorted(first) and 0.15 < 1 - len(first) / COUNT < 0.45      # 4.6 standard deviations
    assert first != other
    assert (survivors('/a'), survivors('/b')) == (first, other)
    udpros.emulate_loss(0.3, seed=6)
    assert survivors('/a') != first


def test_it_applies_to_later_connections_until_it_is_set_to_0() -> None:
    receiver = open_receiver('/a', '127.0.0.1', 100, 1 << 20)
    udpros.emulate_loss(1.0)
    assert type(receiver) is DatagramReceiver
    receiver.close()
    assert survivors('/a') == []
    udpros.emulate_loss(0.0)
    assert survivors('/a') == list(range(COUNT))


@pytest.mark.parametrize(('loss', 'seed'), [(-0.1, 0), (1.1, 0), (np.nan, 0), (0.5, -1), (0.5, 1 << 32)])
def test_values_out_of_range(loss, seed) -> None:
    with pytest.raises(ValueError, match='is from 0 to'):
        udpros.emulate_loss(loss, seed)
    assert survivors('/a') == list(range(COUNT))
