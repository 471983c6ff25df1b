# SPDX-License-Identifier: BSD-3-Clause
"""The subscriber's side of one connection: its socket, whom it trusts, and its thread."""
import math
import threading
import time
from typing import Any, Iterable, Optional

import numpy as np

from ..arrays import Array, BoolArray, Records
from .depacketizer import Arrivals, Arrived, Consumer, Depacketizer
from .endpoints import LOOPBACK, DatagramReceiver, addresses_of
from .negotiation import Reply

POLL_PERIOD = 0.25
"""How often a silent connection checks whether it has been stopped [s]; `stop` wakes it at once."""

SHORT = 0.25
"""After a silence, and after a batch of MANY datagrams, a batch grows for this part of `coalesce` only: most of an
image has come by then, and what waits grows old. Where datagrams come slowly each would be a batch of its own."""

MANY = 8

MAX_BATCHES = 4
"""Batches received before messages are delivered, so that the newest are among them."""


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


class Subscription:
    """Receives the datagrams of one connection and delivers their messages.

    :param receiver: its socket, which `run` closes
    :param reply: the publisher's answer
    :param hosts: host names or addresses of the publisher
    :param consumer: to which the messages are delivered, in the thread of `run` or `poll`
    :param message_class: the topic's
    :param queue_size: of messages that arrived together only this many, the newest, are delivered; None: all
    :param coalesce: how long to wait after the first datagram of a batch for more, at most [s], see SHORT. Fewer and
        larger batches cost less; 0 delivers single messages at once
    :param arrived: called for new messages, see Arrived; None: nothing is called
    """

    def __init__(self, receiver: DatagramReceiver, reply: Reply, hosts: Iterable[Optional[str]], consumer: Consumer,
                 message_class: Any, queue_size: Optional[int] = None, coalesce: float = 0.0,
                 arrived: Optional[Arrived] = None) -> None:
        self.receiver = receiver
        self.depacketizer = Depacketizer(reply.connection_id, consumer, message_class, queue_size, arrived)
        self._source = Source(hosts)
        self._arrivals = Arrivals(receiver.arrival, receiver.marked)
        self._coalesce = coalesce
        self._many = False      # whether the last batch was of MANY datagrams
        self._begun = time.monotonic()
        self._ended = threading.Event()

    @property
    def last_arrival(self) -> float:
        """When a datagram of the publisher was received last, at first when this began, by time.monotonic() [s]."""
        last = self.depacketizer.last_arrival
        return self._begun if last is None else last

    def run(self) -> None:
        """Receive and deliver until `stop`; then free the socket."""
        end = -math.inf     # of a batch that begins before it: one that follows another closely [s]
        try:
            while not self._ended.is_set():
                if not self.receiver.wait(POLL_PERIOD):
                    continue
                if self._coalesce:
                    now = time.monotonic()
                    time.sleep(end - now if now < end else SHORT * self._coalesce)
                end = -math.inf
                if self.poll():
                    end = time.monotonic() + (SHORT if self._many else 1) * self._coalesce
        finally:
            self.receiver.close()

    def poll(self) -> bool:
        """Receive and deliver what has arrived, without waiting; returns whether there was anything."""
        received = self._receive()
        self.depacketizer.deliver(self._ended.is_set)
        return received

    def stop(self) -> None:
        """End `run`, from any thread."""
        self._ended.set()
        self.receiver.wake()

    def _receive(self) -> bool:
        self._many = False
        for batch in range(MAX_BATCHES):
            count = self.receiver.receive()
            self._many |= count >= MANY
            start = self._take_singles(count) if count else 0
            if start < count:
                self._take(start, count)
            if count < self.receiver.batch:
                return batch + count > 0
        return True

    def _take_singles(self, count: int) -> int:
        """Take rows [0, count) one by one up to the first that is not as expected; returns its number."""
        receiver = self.receiver
        return self.depacketizer.take_singles(
            receiver.datagrams[:count], receiver.lengths[:count],
            lambda row: self._source.is_settled_on(receiver.sources[row]), self._arrivals, time.monotonic())

    def _take(self, start: int, stop: int) -> None:
        """Take rows [start, stop)."""
        receiver, sources = self.receiver, self.receiver.sources[start:stop]
        first = self.depacketizer.take(
            receiver.datagrams[start:stop], receiver.lengths[start:stop], self._source.trusts(sources),
            self._arrivals.part(np.arange(start, stop)), time.monotonic())
        if first is not None:
            self._source.settle(sources, first)
