# SPDX-License-Identifier: BSD-3-Clause
"""Messages of one type and size as datagrams that are ready to be sent, one row each."""
from typing import Any, Iterator, Mapping, Optional, Sequence

import numpy as np

from ..arrays import Records, UInt8Array
from .datagram import HEADER, HEADER_DTYPE, OVERHEAD, UDP_MAX_PAYLOAD, Op
from .records import has_header, record_dtype, write_lengths


class Frame:
    """`count` messages of one type, whose fields of varying length have the given lengths.

    Write the messages into `records`; a publisher numbers and sends them. A frame may be filled and sent again: the
    publisher is done with it when `publish_frames` returns.

    :param message_class: a generated message class
    :param count: number of messages, at least 1
    :param lengths: {dotted field name: length}, see records.record_dtype
    :raises ValueError: if count is less than 1, or a message does not fit in one datagram
    :raises LayoutError: if the type has no record layout or no such field
    """

    def __init__(self, message_class: Any, count: int, lengths: Mapping[str, int]) -> None:
        if count < 1:
            raise ValueError('a frame needs at least one message, not %r' % count)
        dtype = record_dtype(message_class, lengths)
        if dtype.itemsize + OVERHEAD > UDP_MAX_PAYLOAD:
            raise ValueError('a %s of %d bytes does not fit in a datagram' % (message_class._type, dtype.itemsize))
        self.message_class = message_class
        self.rows: UInt8Array = np.zeros((count, OVERHEAD + dtype.itemsize), np.uint8)
        """(count, datagram size) uint8: the datagrams."""
        size = self.rows.shape[1]
        self.records: Records = np.ndarray((count,), dtype, self.rows, OVERHEAD, (size,))
        """(count,) structured: the messages, a view of the rows."""
        write_lengths(self.records, message_class)
        self.header: Records = np.ndarray((count,), HEADER_DTYPE, self.rows, 0, (size,))
        """(count,) of datagram.HEADER_DTYPE: the datagrams' headers, a view of the rows."""
        self.header['op'], self.header['block'] = Op.DATA0, 1
        np.ndarray((count,), '<u4', self.rows, HEADER.size, (size,))[:] = dtype.itemsize

    def number(self, first: int) -> None:
        """Number the messages in their headers, as publishers do, if they have any.

        :param first: the first message's sequence number
        """
        if has_header(self.message_class):
            self.records['header']['seq'] = first + np.arange(len(self))

    def part(self, start: int, stop: int) -> 'Frame':
        """The messages [start, stop) as a Frame on the same memory."""
        part = Frame.__new__(Frame)     # copy.copy takes several times as long
        part.message_class = self.message_class
        part.rows, part.records, part.header = self.rows[start:stop], self.records[start:stop], self.header[start:stop]
        return part

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def datagram_size(self) -> int:
        """Length of each datagram [byte of UDP payload]."""
        return int(self.rows.shape[1])

    def stream(self) -> bytes:
        """The messages as TCPROS writes them, each with its length in front."""
        written: bytes = self.rows[:, HEADER.size:].tobytes()
        return written


def first_messages(frames: Sequence[Frame], limit: Optional[int]) -> Iterator[Frame]:
    """The first messages of some frames; None: all."""
    left = sum(map(len, frames)) if limit is None else limit
    for frame in frames:
        if left > 0:
            yield frame if left >= len(frame) else frame.part(0, left)
        left -= len(frame)
