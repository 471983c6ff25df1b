# SPDX-License-Identifier: BSD-3-Clause
"""From the datagrams of one connection to the topic's messages, whatever the socket they came from."""
import collections
import functools
import itertools
import struct
from typing import Any, Callable, Deque, Dict, List, NamedTuple, Optional, Protocol, Tuple

import numpy as np

from ..arrays import Array, BoolArray, DType, IntArray, Records, UInt8Array
from .batches import BatchReader
from .datagram import HEADER, IP_UDP_HEADERS, LENGTH, OVERHEAD, Op
from .reassembly import MAX_MESSAGE_SIZE, Inbox, Reassembler
from .records import has_header
from .sequence import SequenceTracker

SEQ: DType = np.dtype('<u4')
"""std_msgs/Header.seq, the first field of a message that has a header."""

EXPECTED = struct.Struct(HEADER.format + LENGTH.format[1:] + 'I')
"""A datagram's header, the length of its message, and the message's sequence number."""

MIN_MESSAGE_SIZE = EXPECTED.size - OVERHEAD

Arrived = Callable[[int, int, int, int, float, int, int], None]
"""f(connection, seq, size, count, when, marked, path): `count` new messages of a topic whose messages have a header
arrived together.

* connection: a number that is higher for a later connection of this process
* seq: the sequence number of one of them, usually the highest
* size: their total size as IP packets; of messages of many blocks, the size of the messages only [byte]
* when: when that message reached this machine, by time.monotonic() [s]
* marked: how many of them a congested queue has marked (ECN)
* path: by which they came, see Arrivals
"""

BatchCallback = Callable[[Records, BoolArray], None]
"""f(records, mask): messages that arrived together, (n,) structured, see records.py, and (n,) bool, those that are
valid. Both exist during the call only."""


class Arrivals(NamedTuple):
    """How the datagrams of a batch arrived."""
    when: Callable[[int], float]
    """f(row): when a row's datagram reached this machine, by time.monotonic() [s]."""
    marked: Callable[[IntArray], int]
    """f(rows): how many of some rows' datagrams a congested queue has marked (ECN)."""
    path: int = 0
    """Index of the path by which all of them came, of the two that a transport may have."""

    def part(self, rows: IntArray) -> 'Arrivals':
        """Those of some rows of the batch, in the order given."""
        return Arrivals(lambda row: self.when(int(rows[row])), lambda some: self.marked(rows[some]), self.path)


_numbers = itertools.count()


class Consumer(Protocol):
    """What a Depacketizer delivers to."""

    @property
    def wants_batches(self) -> bool:
        """Whether take_records is to be called."""

    @property
    def wants_messages(self) -> bool:
        """Whether take_message is to be called."""

    def take_records(self, records: Records, mask: BoolArray) -> None:
        """Messages that arrived together: (n,) structured, and (n,) bool, those that are valid."""

    def take_message(self, data: bytes) -> None:
        """One serialised message."""


MAX_SINGLES = 8
"""Up to this many messages of one block are faster taken one by one than by numpy."""


class Depacketizer:
    """Turns the datagrams of one connection into messages, counts them, and delivers them.

    Messages as records are delivered at once; serialised ones wait for `deliver`, so that the newest can replace older
    ones.

    :param connection_id: of its datagrams
    :param consumer: to which the messages are delivered
    :param message_class: the topic's
    :param queue_size: of messages that wait only this many, the newest, are delivered; None: all
    :param arrived: called for new messages, see Arrived; None: nothing is called
    :param headers: what each datagram has in front of it on the air [byte]
    :param max_message_size: longer ones are refused; twice as much is kept of unfinished ones [byte]
    """

    def __init__(self, connection_id: int, consumer: Consumer, message_class: Any, queue_size: Optional[int] = None,
                 arrived: Optional[Arrived] = None, headers: int = IP_UDP_HEADERS,
                 max_message_size: int = MAX_MESSAGE_SIZE) -> None:
        self.inbox = Inbox(connection_id, Reassembler(max_message_size))
        self.sequence = SequenceTracker() if has_header(message_class) else None
        """Counts of messages; None if the topic's messages have no header."""
        self.bytes = self.datagrams = 0
        """Received from the publisher [byte, datagrams]."""
        self.last_arrival: Optional[float] = None
        """The `now` at which a datagram was taken last [s]."""
        self._consumer = consumer
        self._arrived = functools.partial(arrived, next(_numbers)) if arrived is not None else None
        self._headers = headers
        self._reader = BatchReader(message_class)
        self._waiting: Deque[bytes] = collections.deque(maxlen=queue_size)

    def stats(self) -> Dict[str, Any]:
        """What was received, with the names of udpros.Subscriber.connections."""
        return {'datagrams': self.datagrams, 'bytes': self.bytes, 'received': self.sequence and self.sequence.received,
                'lost': self.sequence and self.sequence.lost, 'dropped': dict(self.inbox.dropped)}

    def take_singles(self, datagrams: UInt8Array, lengths: IntArray, trusted: Callable[[int], bool], arrivals: Arrivals,
                     now: float) -> int:
        """Take the first few datagrams one by one, as far as each holds the next message, whole.

        This costs a tenth of `take` with a batch of one.

        :param trusted: f(row) -> whether it comes from the publisher; the others are as of `take`
        :return: the number of rows taken; the rest is for `take`
        """
        count = len(lengths)
        if count > MAX_SINGLES or self._consumer.wants_batches or self.inbox.remembers:
            return 0
        for row in range(count):
            length = int(lengths[row])
            if not (length < datagrams.shape[1] and trusted(row)
                    and self._take_next(datagrams[row, :length].tobytes(), row, arrivals, now)):
                return row
        return count

    def _take_next(self, datagram: bytes, row: int, arrivals: Arrivals, now: float) -> bool:
        """Take a datagram if it holds the next message, whole; returns whether it does."""
        size = len(datagram) - OVERHEAD
        if size < MIN_MESSAGE_SIZE:
            return False
        connection_id, op, message_id, block, announced, seq = EXPECTED.unpack_from(datagram)
        if ((connection_id, op, block, announced) != (self.inbox.connection_id, Op.DATA0, 1, size) or not message_id
                or (self.sequence is not None and not self.sequence.add_next(seq))):
            return False
        self.last_arrival = now
        self.datagrams += 1
        self.bytes += len(datagram)
        self._waiting.append(datagram[OVERHEAD:])
        if self._arrived is not None and self.sequence is not None:
            self._arrived(seq, len(datagram) + self._headers, 1, arrivals.when(row), arrivals.marked(np.array([row])),
                          arrivals.path)
        return True

    def take(self, datagrams: UInt8Array, lengths: IntArray, trusted: BoolArray, arrivals: Arrivals,
             now: float) -> Optional[int]:
        """Sort a batch; deliver its records, and keep its messages for `deliver`.

        :param datagrams: (n, slot) uint8, C-contiguous; datagram i is the first lengths[i] bytes of row i
        :param lengths: (n,) int; a length of `slot` means that the datagram did not fit
        :param trusted: (n,) bool, those from the publisher
        :param now: by time.monotonic() [s]
        :return: the row that completed the first message; None: there is none
        """
        whole, messages = self.inbox.sort(datagrams, lengths, trusted, now)
        count = int(np.count_nonzero(trusted))
        if not count:
            return None
        self.last_arrival = now
        self.datagrams += count
        self.bytes += int(lengths @ trusted)
        rows = np.flatnonzero(whole)
        if not len(rows) and not messages:
            return None
        first = int(rows[0]) if len(rows) else messages[0][0]
        if self.sequence is not None:
            rows = self._new_rows(self.sequence, datagrams, lengths, rows, arrivals)
            messages = self._new_messages(self.sequence, messages, trusted & ~whole, arrivals) if messages else []
        self._sort_out(datagrams, lengths, rows, messages)
        return first

    def deliver(self, ended: Callable[[], bool] = lambda: False) -> None:
        """Deliver the messages that wait.

        :param ended: f() -> whether to stop
        """
        while self._waiting and not ended():
            self._consumer.take_message(self._waiting.popleft())

    def _sort_out(self, datagrams: UInt8Array, lengths: IntArray, rows: IntArray,
                  messages: List[Tuple[int, bytes]]) -> None:
        """Deliver messages as records, and let serialised ones wait, as the consumer wants them."""
        if self._consumer.wants_batches:
            mask = np.zeros(len(datagrams), bool)
            mask[rows] = True
            self._deliver_records(datagrams, lengths, mask)
            for _, message in messages:
                row = np.frombuffer(bytes(OVERHEAD) + message, np.uint8)[np.newaxis]
                self._deliver_records(row, np.array([row.shape[1]]), np.ones(1, bool))
        if self._consumer.wants_messages:
            singles = [(row, datagrams[row, OVERHEAD:lengths[row]].tobytes()) for row in rows.tolist()]
            self._waiting.extend(message for _, message in sorted(singles + messages))

    def _new_rows(self, sequence: SequenceTracker, datagrams: UInt8Array, lengths: IntArray, rows: IntArray,
                  arrivals: Arrivals) -> IntArray:
        """Count the messages of one block; returns the rows of those that are not duplicates."""
        if lengths.min() < OVERHEAD + SEQ.itemsize:
            numbered = lengths[rows] >= OVERHEAD + SEQ.itemsize
            self.inbox.dropped['message'] += int(np.count_nonzero(~numbered))
            rows = rows[numbered]
        seqs: Array = np.ndarray((len(datagrams),), SEQ, datagrams, OVERHEAD, (datagrams.shape[1],))[rows]
        new = sequence.add(seqs)
        rows = rows[new]
        if self._arrived is not None and len(rows):
            self._arrived(int(seqs[new][-1]), int(lengths[rows].sum()) + self._headers * len(rows), len(rows),
                          arrivals.when(int(rows[-1])), arrivals.marked(rows), arrivals.path)
        return rows

    def _new_messages(self, sequence: SequenceTracker, messages: List[Tuple[int, bytes]], blocks: BoolArray,
                      arrivals: Arrivals) -> List[Tuple[int, bytes]]:
        """Count the messages of many blocks; returns those that are not duplicates.

        :param blocks: (n,) bool, the rows of the batch that are parts of messages
        """
        seqs = [int.from_bytes(message[:SEQ.itemsize], 'little') for _, message in messages]
        new = sequence.add(seqs).tolist()
        messages = list(itertools.compress(messages, new))
        if self._arrived is not None and messages:
            marked = min(arrivals.marked(np.flatnonzero(blocks)), len(messages))     # as many as are counted
            self._arrived(list(itertools.compress(seqs, new))[-1], sum(len(message) for _, message in messages),
                          len(messages), arrivals.when(len(blocks) - 1), marked, arrivals.path)
        return messages

    def _deliver_records(self, datagrams: UInt8Array, lengths: IntArray, rows: BoolArray) -> None:
        views, bad = self._reader.read(datagrams, lengths, rows)
        if bad:
            self.inbox.dropped['message'] += bad
        for records, mask in views:
            self._consumer.take_records(records, mask)
