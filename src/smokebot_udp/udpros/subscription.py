# SPDX-License-Identifier: BSD-3-Clause
"""The subscriber's side of one connection: from the socket to the topic's callbacks."""
import collections
import functools
import itertools
import struct
import threading
import time
from typing import Any, Callable, Deque, Iterable, List, Optional, Protocol, Tuple

import numpy as np

from ..arrays import Array, BoolArray, IntArray, Records, UInt8Array
from .batches import BatchReader
from .datagram import HEADER, IP_UDP_HEADERS, LENGTH, OVERHEAD, Op
from .endpoints import LOOPBACK, DatagramReceiver, addresses_of
from .negotiation import Reply
from .reassembly import Inbox
from .records import has_header
from .sequence import SequenceTracker

POLL_PERIOD = 0.25
"""How often a silent connection checks whether it has been stopped [s]; `stop` wakes it at once."""

SEQ = np.dtype('<u4')
"""std_msgs/Header.seq, the first field of a message that has a header."""

EXPECTED = struct.Struct(HEADER.format + LENGTH.format[1:] + 'I')
"""A datagram's header, the length of its message, and the message's sequence number."""

MIN_MESSAGE_SIZE = EXPECTED.size - OVERHEAD

MAX_SINGLES = 8
"""Up to this many messages of one block are faster taken one by one than by numpy."""

MAX_BATCHES = 4
"""Batches received before messages are delivered, so that the newest are among them."""

Arrived = Callable[[int, int, int, int, float], None]
"""f(connection, seq, size, count, when): `count` new messages of a topic whose messages have a header arrived together.

* connection: a number that is higher for a later connection of this process
* seq: the sequence number of one of them, usually the highest
* size: their total size as IP packets; of messages of many blocks, the size of the messages only [byte]
* when: when that message reached this machine, by time.monotonic() [s]
"""


class Source:
    """The trusted sender: the publisher's host, and after its first good datagram only that socket.

    :param hosts: host names or addresses of the publisher
    """

    def __init__(self, hosts: Iterable[Optional[str]]) -> None:
        self._addresses = np.array(sorted(set().union(*map(addresses_of, hosts))), np.uint32)
        # on one machine a host name may stand for 127.0.1.1 while the kernel sends from 127.0.0.1
        self._local = bool((self._addresses & LOOPBACK[1] == LOOPBACK[0]).any())
        self._endpoint: Optional[Array] = None   # (1,) uint64
        self._endpoint_bytes = b''

    @property
    def settled(self) -> bool:
        """Whether one socket is known to be the publisher's."""
        return self._endpoint is not None

    def trusts(self, sources: Records) -> BoolArray:
        """(n,) bool for (n,) senders of dtype endpoints.SOCKADDR_IN."""
        if self._endpoint is not None:
            return _endpoints(sources) == self._endpoint
        known: BoolArray = np.isin(sources['address'], self._addresses)
        if self._local:
            known |= sources['address'] & LOOPBACK[1] == LOOPBACK[0]
        return known

    def is_settled_on(self, source: Any) -> bool:
        """Whether one sender is the socket that has been settled on."""
        return bool(source.tobytes()[:8] == self._endpoint_bytes)

    def settle(self, sources: Records, row: int) -> None:
        """Trust only this row's socket from now on, unless one has been settled on before."""
        if self._endpoint is None:
            self._endpoint = _endpoints(sources)[row:row + 1].copy()
            self._endpoint_bytes = self._endpoint.tobytes()


def _endpoints(sources: Records) -> Array:
    """(n,) uint64: family, port and address as one number, which is four times faster to compare."""
    return sources.view(np.uint64)[::2]


_numbers = itertools.count()


class Consumer(Protocol):
    """What a Subscription delivers to."""

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


class Subscription:
    """Receives the datagrams of one connection and delivers their messages.

    :param receiver: its socket, which `run` closes
    :param reply: the publisher's answer
    :param hosts: host names or addresses of the publisher
    :param consumer: to which the messages are delivered, in the thread of `run` or `poll`
    :param message_class: the topic's
    :param queue_size: of messages that arrived together only this many, the newest, are delivered; None: all
    :param coalesce: how long to wait after the first datagram of a batch for more [s]. Fewer and larger batches cost
        less; 0 delivers single messages at once
    :param arrived: called for new messages, see Arrived; None: nothing is called
    """

    def __init__(self, receiver: DatagramReceiver, reply: Reply, hosts: Iterable[Optional[str]], consumer: Consumer,
                 message_class: Any, queue_size: Optional[int] = None, coalesce: float = 0.0,
                 arrived: Optional[Arrived] = None) -> None:
        self.receiver = receiver
        self.inbox = Inbox(reply.connection_id)
        self.sequence = SequenceTracker() if has_header(message_class) else None
        """Counts of messages; None if the topic's messages have no header."""
        self.bytes = self.datagrams = 0
        """Received from the publisher [byte of UDP payload, datagrams]."""
        self.last_arrival = time.monotonic()
        """When a datagram of the publisher was received last, by time.monotonic() [s]."""
        self._source = Source(hosts)
        self._consumer = consumer
        self._coalesce = coalesce
        self._arrived = functools.partial(arrived, next(_numbers)) if arrived is not None else None
        self._reader = BatchReader(message_class)
        self._waiting: Deque[bytes] = collections.deque(maxlen=queue_size)
        self._ended = threading.Event()

    def run(self) -> None:
        """Receive and deliver until `stop`; then free the socket."""
        flowing = False
        try:
            while not self._ended.is_set():
                if not flowing and not self.receiver.wait(POLL_PERIOD):
                    continue
                if self._coalesce:
                    time.sleep(self._coalesce)
                flowing = self.poll() and self._coalesce > 0   # more will have arrived after the next sleep
        finally:
            self.receiver.close()

    def poll(self) -> bool:
        """Receive and deliver what has arrived, without waiting; returns whether there was anything."""
        received = self._receive()
        while self._waiting and not self._ended.is_set():
            self._consumer.take_message(self._waiting.popleft())
        return received

    def stop(self) -> None:
        """End `run`, from any thread."""
        self._ended.set()
        self.receiver.wake()

    def _receive(self) -> bool:
        for batch in range(MAX_BATCHES):
            count = self.receiver.receive()
            start = self._take_singles(count) if 0 < count <= MAX_SINGLES and self._expects_singles() else 0
            if start < count:
                self._take(start, count)
            if count < self.receiver.batch:
                return batch + count > 0
        return True

    def _expects_singles(self) -> bool:
        return self._source.settled and not self._consumer.wants_batches and not self.inbox.remembers

    def _take_singles(self, count: int) -> int:
        """Take rows [0, count) one by one up to the first that is not as expected; returns its number."""
        for row in range(count):
            if not self._take_expected(row):
                return row
        return count

    def _take_expected(self, row: int) -> bool:
        """Take a row if it holds the next message, whole. This costs a tenth of `_take` with a batch of one."""
        length = int(self.receiver.lengths[row])
        if not MIN_MESSAGE_SIZE <= length - OVERHEAD <= self.receiver.max_datagram_size - OVERHEAD:
            return False
        datagram = self.receiver.datagrams[row, :length].tobytes()
        connection_id, op, message_id, block, announced, seq = EXPECTED.unpack_from(datagram)
        if ((connection_id, op, block, announced) != (self.inbox.connection_id, Op.DATA0, 1, length - OVERHEAD)
                or not message_id or not self._source.is_settled_on(self.receiver.sources[row])
                or (self.sequence is not None and not self.sequence.add_next(seq))):
            return False
        self.last_arrival = time.monotonic()
        self.datagrams += 1
        self.bytes += length
        self._waiting.append(datagram[OVERHEAD:])
        if self._arrived is not None and self.sequence is not None:
            self._arrived(seq, length + IP_UDP_HEADERS, 1, self.receiver.arrival(row))
        return True

    def _take(self, start: int, stop: int) -> None:
        """Sort rows [start, stop); deliver their records, and keep their messages for `poll`."""
        datagrams, lengths = self.receiver.datagrams[start:stop], self.receiver.lengths[start:stop]
        sources = self.receiver.sources[start:stop]
        trusted = self._source.trusts(sources)
        now = time.monotonic()
        whole, messages = self.inbox.sort(datagrams, lengths, trusted, now)
        count = int(np.count_nonzero(trusted))
        if not count:
            return
        self.last_arrival = now
        self.datagrams += count
        self.bytes += int(lengths @ trusted)
        rows = np.flatnonzero(whole)
        if not len(rows) and not messages:
            return
        self._source.settle(sources, int(rows[0]) if len(rows) else messages[0][0])
        if self.sequence is not None:
            rows = self._new_rows(self.sequence, datagrams, lengths, rows, start)
            messages = self._new_messages(self.sequence, messages, stop - 1) if messages else []
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
                  start: int) -> IntArray:
        """Count the messages of one block; returns the rows of those that are not duplicates.

        :param rows: the rows of a batch that begins at the receiver's row `start`
        """
        if lengths.min() < OVERHEAD + SEQ.itemsize:
            numbered = lengths[rows] >= OVERHEAD + SEQ.itemsize
            self.inbox.dropped['message'] += int(np.count_nonzero(~numbered))
            rows = rows[numbered]
        seqs: Array = np.ndarray((len(datagrams),), SEQ, datagrams, OVERHEAD, (datagrams.shape[1],))[rows]
        new = sequence.add(seqs)
        rows = rows[new]
        if self._arrived is not None and len(rows):
            self._arrived(int(seqs[new][-1]), int(lengths[rows].sum()) + IP_UDP_HEADERS * len(rows), len(rows),
                          self.receiver.arrival(start + int(rows[-1])))
        return rows

    def _new_messages(self, sequence: SequenceTracker, messages: List[Tuple[int, bytes]],
                      last: int) -> List[Tuple[int, bytes]]:
        """Count the messages of many blocks; returns those that are not duplicates.

        :param last: the last of the receiver's rows in the batch
        """
        seqs = [int.from_bytes(message[:SEQ.itemsize], 'little') for _, message in messages]
        new = sequence.add(seqs).tolist()
        messages = list(itertools.compress(messages, new))
        if self._arrived is not None and messages:
            self._arrived(list(itertools.compress(seqs, new))[-1], sum(len(message) for _, message in messages),
                          len(messages), self.receiver.arrival(last))
        return messages

    def _deliver_records(self, datagrams: UInt8Array, lengths: IntArray, rows: BoolArray) -> None:
        views, bad = self._reader.read(datagrams, lengths, rows)
        if bad:
            self.inbox.dropped['message'] += bad
        for records, mask in views:
            self._consumer.take_records(records, mask)
