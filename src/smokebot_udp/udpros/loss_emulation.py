# SPDX-License-Identifier: BSD-3-Clause
"""Deliberate packet loss on reception, to demonstrate a bad link on a good one."""
import zlib
from typing import Tuple

import numpy as np

from ..arrays import IntArray
from .endpoints import DatagramReceiver

_emulated: Tuple[float, int] = 0.0, 0
"""Loss and seed for the connections of this process."""


def emulate_loss(loss: float, seed: int = 0) -> None:
    """Lose received datagrams, in every connection that this process makes after this call.

    A lost datagram leaves no trace but the gap in the sequence numbers. The same seed loses the same datagrams of each
    topic again. For a node's main, before its subscribers are made.

    :param loss: probability to lose a datagram, independently of the others, 0..1; 0: lose none
    :param seed: 0 .. 2^32 - 1
    :raises ValueError: if loss or seed is out of range
    """
    global _emulated
    if not 0.0 <= loss <= 1.0:
        raise ValueError('loss is from 0 to 1, not %r' % loss)
    if not 0 <= seed < 1 << 32:
        raise ValueError('seed is from 0 to 2^32 - 1, not %r' % seed)
    _emulated = loss, seed


def open_receiver(topic: str, address: str, max_datagram_size: int, receive_buffer: int,
                  port: int = 0) -> DatagramReceiver:
    """The receiver of a new connection, which loses datagrams as `emulate_loss` says.

    :param topic: of the connection, by which it loses others than the connections of other topics
    :raises OSError: as DatagramReceiver
    """
    loss, seed = _emulated
    if not loss:
        return DatagramReceiver(address, max_datagram_size, receive_buffer, port=port)
    return LossyReceiver(address, max_datagram_size, receive_buffer, port, loss=loss,
                         seed=(seed, zlib.crc32(topic.encode())))


class LossyReceiver(DatagramReceiver):
    """A DatagramReceiver that loses each datagram with the same probability.

    :param loss: the probability, 0..1
    :param seed: of the random numbers, one or more of 0 .. 2^32 - 1
    :raises OSError: as DatagramReceiver
    """

    def __init__(self, address: str, max_datagram_size: int, receive_buffer: int = 4 << 20, port: int = 0, *,
                 loss: float, seed: Tuple[int, ...]) -> None:
        super().__init__(address, max_datagram_size, receive_buffer, port=port)
        self._loss, self._random = loss, np.random.RandomState(list(seed))
        self._kept: IntArray = np.zeros(0, int)   # the rows of the last batch that were not lost

    def receive(self) -> int:
        """As DatagramReceiver; the datagrams not lost are in the first rows."""
        count = super().receive()
        if not count:
            return 0
        self._kept = kept = np.flatnonzero(self._random.random_sample(count) >= self._loss)
        if len(kept) < count:
            for array in (self.datagrams, self.lengths, self.sources):
                array[:len(kept)] = array[kept]
        return len(kept)

    def arrival(self, row: int) -> float:
        return super().arrival(int(self._kept[row]))

    def marked(self, rows: IntArray) -> int:
        return super().marked(self._kept[rows])
