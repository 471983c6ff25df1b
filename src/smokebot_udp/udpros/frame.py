# SPDX-License-Identifier: BSD-3-Clause
"""A frame's messages of one type and size as datagrams ready to be sent: one row each."""
import copy

import numpy as np

from .datagram import HEADER, HEADER_DTYPE, OVERHEAD, UDP_MAX_PAYLOAD, Op
from .records import record_dtype, write_lengths


class Frame:
    """`count` messages of message_class whose varying fields have the given lengths.

    Write the messages into `records`; a publisher numbers and sends them. A frame may be filled and sent
    again and again: the publisher is done with it when its call returns.

    :param lengths: {dotted field name: length}, see records.record_dtype
    :raises ValueError: where one message does not fit in one datagram, or there is none
    """

    def __init__(self, message_class, count, lengths):
        if count < 1:
            raise ValueError('a frame needs messages, not %r' % count)
        dtype = record_dtype(message_class, lengths)
        if dtype.itemsize + OVERHEAD > UDP_MAX_PAYLOAD:
            raise ValueError('a %s of %d bytes fits in no datagram' % (message_class._type, dtype.itemsize))
        self.message_class = message_class
        self.rows = np.zeros((count, OVERHEAD + dtype.itemsize), np.uint8)
        """(count, datagram size) uint8: the datagrams."""
        size = self.rows.shape[1]
        self.records = np.ndarray((count,), dtype, self.rows, OVERHEAD, (size,))
        """(count,) structured: the messages, in place."""
        write_lengths(self.records, message_class)
        self.header = np.ndarray((count,), HEADER_DTYPE, self.rows, 0, (size,))
        self.header['op'], self.header['block'] = Op.DATA0, 1
        np.ndarray((count,), '<u4', self.rows, HEADER.size, (size,))[:] = dtype.itemsize

    def part(self, start, stop):
        """Some of its messages, as a Frame on the same memory."""
        part = copy.copy(self)
        part.rows, part.records, part.header = (
            array[start:stop] for array in (self.rows, self.records, self.header))
        return part

    def __len__(self):
        return len(self.rows)

    @property
    def datagram_size(self):
        """Bytes of UDP payload of each datagram."""
        return self.rows.shape[1]

    def stream(self):
        """The messages as TCPROS writes them: bytes, each with its length before it."""
        return self.rows[:, HEADER.size:].tobytes()
