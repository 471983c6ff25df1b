# SPDX-License-Identifier: BSD-3-Clause
"""One socket and one thread for one side of a link.

The thread receives, opens and hands on; it also sends what the core and the tables of topics want sent. Publishers send
from their own threads, by the same socket: sending never waits for receiving.

The socket is bound to no interface and not connected: each packet leaves as its place says, see place.py. What cannot
be sent is counted, and tried again by whoever repeats it.
"""
import collections
import threading
import time
import traceback
from typing import Callable, Counter, Protocol

from ..udpros.depacketizer import Arrivals
from ..udpros.endpoints import BatchSender, DatagramReceiver
from .core import LinkCore
from .peer import Delivery, Event
from .place import address_of

COALESCE = 2e-3
"""Batches are received at most this often. A single datagram is handed on at once; those that follow it closely are
received together, which costs less, and a flood cannot take the time of the other threads [s]."""

MANY, FLOWING = 8, 0.1
"""After a batch of more datagrams than this, those of this time wait for COALESCE from the first one on: more are
coming [1, s]."""

MAX_WAIT, MIN_WAIT = 0.1, 1e-3
"""Between two looks at what other threads have changed, and between two at what is due [s]."""

MAX_BATCHES = 4
"""Received before anything else is done."""

CLOSE_TIMEOUT = 5.0
"""A callback that hangs must not keep the node from ending [s]."""


class Handler(Protocol):
    """What an Endpoint calls, in its thread."""

    def on_event(self, event: Event) -> None:
        """Something has happened to a peer; called before the peer's datagrams are handed on."""

    def on_delivery(self, delivery: Delivery, arrivals: Arrivals, now: float) -> None:
        """Datagrams of a peer have arrived."""

    def poll(self, now: float) -> float:
        """Let time pass; returns when to call it again, at the latest [s]."""


class Endpoint:
    """Runs a core.

    :param core: which nobody else uses from now on
    :param receiver: its socket, which `close` frees
    :param report: f(text), called with what went wrong in this program
    """

    def __init__(self, core: LinkCore, receiver: DatagramReceiver, handler: Handler,
                 report: Callable[[str], None]) -> None:
        self.receiver, self.sender = receiver, BatchSender(receiver.socket)
        self._arrivals = Arrivals(receiver.arrival, receiver.marked)
        self._core, self._handler, self._report = core, handler, report
        self._received = self._many = self._due = 0.0   # the last batch, the last one of MANY, the handler's deadline
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name='link', daemon=True)

    def start(self) -> None:
        """Begin to receive."""
        self._thread.start()

    def close(self) -> None:
        """Tell all peers, end the thread, and free the socket."""
        self._ended.set()
        self.receiver.wake()
        if self._thread.ident is not None and threading.current_thread() is not self._thread:
            self._thread.join(CLOSE_TIMEOUT)

    def dropped(self) -> Counter[str]:
        """{reason: packets} that were not taken, or could not be sent for the core; any thread."""
        dropped = collections.Counter(dict(self._core.dropped))
        dropped.update({'not sent: %s' % error: count for error, count in dict(self.sender.failures).items()})
        drops = None if self._ended.is_set() else self.receiver.kernel_drops()
        dropped.update({'receive buffer full': drops} if drops else {})
        return dropped

    def _run(self) -> None:
        try:
            while not self._ended.is_set():
                try:
                    self._step()
                except Exception:       # a bug of ours must not end the link
                    self._report('the link: %s' % traceback.format_exc())
                    time.sleep(MAX_WAIT)
            self._core.close(time.monotonic())
            self._send_outputs()
        finally:
            self.receiver.close()

    def _step(self) -> None:
        """Wait, and do what is due."""
        now = time.monotonic()
        left = min(self._core.deadline(now), self._due) - now
        readable = self.receiver.wait(min(max(left, MIN_WAIT), MAX_WAIT))
        if self._ended.is_set():
            return
        if readable:
            now = time.monotonic()
            begun = now if now - self._many < FLOWING else self._received
            if begun + COALESCE > now:
                time.sleep(begun + COALESCE - now)
            self._receive()
        now = time.monotonic()
        self._core.poll(now)
        self._hand_on_events()
        self._due = self._handler.poll(now)
        self._send_outputs()

    def _receive(self) -> None:
        receiver = self.receiver
        self._received = time.monotonic()
        for _ in range(MAX_BATCHES):
            count = receiver.receive()
            if count > MANY:
                self._many = self._received
            if count:
                self._take(count)
            if count < receiver.batch:
                return

    def _take(self, count: int) -> None:
        receiver, now = self.receiver, time.monotonic()
        deliveries = self._core.receive(
            receiver.datagrams[:count], receiver.lengths[:count], receiver.sources[:count], now)
        self._hand_on_events()
        for delivery in deliveries:
            self._handler.on_delivery(delivery, self._arrivals.part(delivery.rows), now)
        self._send_outputs()

    def _hand_on_events(self) -> None:
        for event in self._core.events():
            self._handler.on_event(event)

    def _send_outputs(self) -> None:
        for place, packet in self._core.outputs():
            self.sender.send_one(packet, to=address_of(place), via=place.via)
