# SPDX-License-Identifier: BSD-3-Clause
"""One publisher's datagrams on the subscriber's side: from the socket to the topic's callbacks."""
import collections
import functools
import itertools
import struct
import threading
import time

import numpy as np

from .datagram import HEADER, LENGTH, OVERHEAD, Op
from .endpoints import IP_UDP_HEADERS, addresses_of
from .reassembly import Inbox
from .records import LayoutError, has_header, lengths_of, record_dtype, same_layout
from .sequence import SequenceTracker

POLL = 0.25
"""How often a silent connection looks whether it is to end [s]; `stop` wakes it at once."""

SEQ = np.dtype('<u4')
"""std_msgs/Header.seq, a message's first field where it has a header."""

EXPECTED = struct.Struct(HEADER.format + LENGTH.format[1:] + 'I')
"""A datagram's header, its message's length and sequence number."""

MESSAGE_SIZE_MIN = EXPECTED.size - OVERHEAD

FEW = 8
"""Up to so many single messages are quicker taken one by one than by numpy."""

DRAIN = 4
"""Batches taken from the socket before messages are delivered, so that the newest are among them."""

MAX_LAYOUTS = 256
"""Layouts kept at hand; a stream of ever new lengths has no use for them, and must not fill the memory."""

LOOPBACK = 0x7f000000, 0xff000000


class Source:
    """Whose datagrams count: the publisher's host, and from its first good datagram on that very socket."""

    def __init__(self, hosts):
        """:param hosts: names or addresses the publisher goes by"""
        self._addresses = set().union(*map(addresses_of, hosts))
        # on one machine a host's name may mean 127.0.1.1 where the kernel sends from 127.0.0.1
        self._local = any(address & LOOPBACK[1] == LOOPBACK[0] for address in self._addresses)
        self._endpoint = None

    def trusts(self, sources):
        """(n,) bool for (n,) of endpoints.SOCKADDR_IN."""
        if self._endpoint is not None:
            return _endpoints(sources) == self._endpoint
        known = np.isin(sources['address'], np.array(list(self._addresses), np.uint32))
        if self._local:
            known |= sources['address'] & LOOPBACK[1] == LOOPBACK[0]
        return known

    @property
    def settled(self):
        return self._endpoint is not None

    def is_settled_on(self, source):
        """Whether one of endpoints.SOCKADDR_IN is the endpoint that counts."""
        return source.tobytes()[:8] == self._endpoint_bytes

    def settle(self, sources, row):
        """From now on only this row's endpoint counts."""
        if self._endpoint is None:
            self._endpoint = _endpoints(sources)[row]
            self._endpoint_bytes = self._endpoint.tobytes()


def _endpoints(sources):
    """(n,) uint64: family, port and address as one number, four times quicker to compare."""
    return sources.view(np.uint64)[::2]


_numbers = itertools.count()


class Subscription:
    """Receives one connection's datagrams in a thread of its own and hands over what they carry.

    :param receiver: endpoints.DatagramReceiver
    :param reply: negotiation.Reply, the publisher's
    :param deliver: object with `wants_batches`, `take_records(records, mask)` and `take_message(bytes)`
    :param queue_size: of the messages that came together, only so many of the newest are delivered; None: all
    :param coalesce: wait so long after the first datagram of a batch for more of them [s]: fewer, larger
        batches cost less; 0 where single messages are to come at once
    :param drop: None, or a function of n that gives (n,) bool of datagrams to lose, for demonstrations
    :param arrived: None, or f(number, seq, size, count, when), told of numbered messages that came together and never
        before: the connection's number, which later ones have higher,
        one of their sequence numbers, mostly the highest, their bytes as packets of IP (of those of many blocks: the
        messages' own), how many they are, and when that one reached this machine, by time.monotonic() [s]
    """

    def __init__(self, receiver, reply, hosts, deliver, message_class, queue_size=None, coalesce=0.0, drop=None,
                 arrived=None):
        self.receiver = receiver
        self.inbox = Inbox(reply.connection_id)
        self.sequence = SequenceTracker() if has_header(message_class) else None
        self.bytes = self.datagrams = 0
        self.last_arrival = time.monotonic()
        self._source = Source(hosts)
        self._deliver, self._message_class = deliver, message_class
        self._coalesce, self._drop = coalesce, drop
        self._arrived = arrived and functools.partial(arrived, next(_numbers))
        self._waiting = collections.deque(maxlen=queue_size)
        self._layouts = {}   # {datagram length: dtype last seen with it}
        self._ended = threading.Event()

    def run(self):
        """Receive until `stop`; then free the socket."""
        flowing = False
        try:
            while not self._ended.is_set():
                if not flowing and not self.receiver.wait(POLL):
                    continue
                if self._coalesce:
                    time.sleep(self._coalesce)
                flowing = self._drain() and self._coalesce > 0   # more will have come by the next time: no need to ask
                while self._waiting and not self._ended.is_set():
                    self._deliver.take_message(self._waiting.popleft())
        finally:
            self.receiver.close()

    def _drain(self):
        """Take what has come; returns whether there was anything."""
        for batch in range(DRAIN):
            count = self.receiver.receive()
            if 0 < count <= FEW and self._expects_messages():
                self._take_few(count)
            elif count:
                self._take(count)
            if count < self.receiver.batch:
                return batch + count > 0
        return True

    def stop(self):
        self._ended.set()
        self.receiver.wake()

    def _expects_messages(self):
        return (self._drop is None and self._source.settled and not self._deliver.wants_batches
                and not self.inbox.remembers)

    def _take_few(self, count):
        """Single messages as they are expected next; what is not is sorted with all that follows it."""
        for row in range(count):
            if not self._take_expected(row):
                self._take(count, row)
                return

    def _take_expected(self, row):
        """Take one datagram if it holds the next message, whole: a tenth of the cost of sorting a batch of one."""
        length = int(self.receiver.lengths[row])
        if not MESSAGE_SIZE_MIN <= length - OVERHEAD <= self.receiver.max_datagram_size - OVERHEAD:
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

    def _take(self, count, first=0):
        datagrams, lengths = self.receiver.datagrams[first:count], self.receiver.lengths[first:count]
        sources, slots = self.receiver.sources[first:count], range(first, count)
        trusted = self._source.trusts(sources)
        if self._drop is not None:
            lost = self._drop(count)
            self.inbox.dropped['demonstration'] += int(np.count_nonzero(lost))
            kept = np.flatnonzero(~lost)
            if not len(kept):
                return
            datagrams, lengths, sources, trusted = datagrams[kept], lengths[kept], sources[kept], trusted[kept]
            slots = kept + first
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
        self._source.settle(sources, rows[0] if len(rows) else messages[0][0])
        if self.sequence is not None:
            rows, messages = self._drop_repeated(datagrams, lengths, rows, messages, slots)
        if self._deliver.wants_batches:
            left = np.zeros(len(datagrams), bool)
            left[rows] = True
            self._take_records(datagrams, lengths, left)
            for _, message in messages:
                self._take_records(*_as_datagram(message))
        if self._deliver.wants_messages:
            singles = [(row, datagrams[row, OVERHEAD:lengths[row]].tobytes()) for row in rows.tolist()]
            self._waiting.extend(message for _, message in sorted(singles + messages))

    def _drop_repeated(self, datagrams, lengths, rows, messages, slots):
        """Count the sequence numbers; return the rows and the messages without those seen before.

        :param slots: where the receiver has each row
        """
        if lengths.min() < OVERHEAD + SEQ.itemsize:
            numbered = lengths[rows] >= OVERHEAD + SEQ.itemsize
            self.inbox.dropped['message'] += int(np.count_nonzero(~numbered))
            rows = rows[numbered]
        seqs = np.ndarray((len(datagrams),), SEQ, datagrams, OVERHEAD, (datagrams.shape[1],))[rows]
        fresh = self.sequence.add(seqs)
        rows = rows[fresh]
        if self._arrived is not None and len(rows):
            self._arrived(int(seqs[fresh][-1]), int(lengths[rows].sum()) + IP_UDP_HEADERS * len(rows), len(rows),
                          self.receiver.arrival(slots[rows[-1]]))
        if messages:
            seqs = [int.from_bytes(message[:SEQ.itemsize], 'little') for _, message in messages]
            fresh = self.sequence.add(seqs)
            messages, seqs = ([one for one, new in zip(of_all, fresh) if new] for of_all in (messages, seqs))
            if self._arrived is not None and messages:
                self._arrived(seqs[-1], sum(len(message) for _, message in messages), len(messages),
                              self.receiver.arrival(slots[-1]))
        return rows, messages

    def _take_records(self, datagrams, lengths, left):
        """Hand over the batch's messages, those of one layout at a time."""
        while left.any():
            first = int(left.argmax())
            length = int(lengths[first])
            try:
                records, mask = self._see(datagrams, lengths, left, first, length)
            except LayoutError:
                self.inbox.dropped['message'] += 1
                left[first] = False
                continue
            left ^= mask
            self._deliver.take_records(records, mask)

    def _see(self, datagrams, lengths, left, first, length):
        """The batch through row `first`'s layout, and a mask of the rows of `left` that have it too."""
        for known in (True, False):
            if not known:
                if len(self._layouts) >= MAX_LAYOUTS:
                    self._layouts.clear()
                layout = lengths_of(self._message_class, datagrams[first, OVERHEAD:length].tobytes())
                self._layouts[length] = record_dtype(self._message_class, layout)
            elif length not in self._layouts:
                continue
            records = np.ndarray((len(datagrams),), self._layouts[length], datagrams, OVERHEAD, (datagrams.shape[1],))
            mask = left & (lengths == length) & same_layout(records, self._message_class)
            if mask[first]:
                break
        return records, mask


def _as_datagram(message):
    row = np.frombuffer(bytes(OVERHEAD) + message, np.uint8)[np.newaxis]
    return row, np.array([row.shape[1]]), np.ones(1, bool)
