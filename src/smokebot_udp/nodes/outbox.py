# SPDX-License-Identifier: BSD-3-Clause
"""Sends the frames of all the robot's streams from one thread, as congestion/packet_scheduler.py decides."""
import math
import threading
import time
from typing import Any, Callable, Optional, Sequence

from ..congestion.packet_scheduler import Chunk, PacketScheduler
from ..congestion.sent_history import stream_of
from ..monitoring import stages
from ..paths import STRAIGHT, Route
from ..streams.relay.contents import size_of
from ..transport import Publisher
from ..udpros.datagram import IP_UDP_HEADERS, OVERHEAD
from ..udpros.frame import Frame
from .trace import TRACE
from .worker import RETRY_PERIOD

MAX_BACKLOG = 0.02
"""A newer message of a stream waits for the rest of the one before if that leaves within this time, unless its encoder
says otherwise [s]."""

MAX_WAIT = 0.5
"""Maximum time for which a newer message waits for the rest of the one before [s]."""

MAX_WHOLE_WAIT = 2.0
"""Maximum time for which a newer message waits where the one before is useless without all its datagrams [s]."""

Departed = Callable[[str, int, int, int, float, Route], None]
"""f(name, seq, count, size, now, route): `count` datagrams of `size` bytes each as IP packets left.

* name: of the stream, or of the part of it, in reports
* seq: of the first one
"""

Router = Callable[..., Route]
"""Decides who gets which datagrams, and by which path, see Controller.route."""


class Outbox:
    """Sends the frames of all streams of a node, because they share the air.

    :param scheduler: decides what leaves when
    :param departed: see Departed; called for all datagrams that left
    :param on_error: f(stream, exception), called where sending fails; the other streams go on
    :param route: called for all datagrams that leave
    :param overhead: of the transport, in each datagram [byte]
    :param besides: f(size [byte]), called with what is charged: no link report names it
    """

    def __init__(self, scheduler: Optional[PacketScheduler] = None, departed: Departed = lambda *_: None,
                 on_error: Callable[[str, Exception], None] = lambda *_: None,
                 route: Router = lambda *_, **__: STRAIGHT, overhead: int = 0,
                 besides: Callable[[int], None] = lambda size: None) -> None:
        self._scheduler = scheduler or PacketScheduler()
        self._departed, self._on_error, self._route, self._besides = departed, on_error, route, besides
        self._headers = IP_UDP_HEADERS + overhead
        self.protected = 0
        """What ever left at once [byte of IP packets]."""
        lock = threading.Lock()
        self._changed, self._left = threading.Condition(lock), threading.Condition(lock)
        self._ended = False
        self._thread = threading.Thread(target=self._run, name='outbox', daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify()
            self._left.notify_all()
        if self._thread.ident:
            self._thread.join()

    def put(self, name: str, publisher: Publisher, frames: Sequence[Frame], stamp: int = 0,
            only: Optional[str] = None, base: int = 1) -> None:
        """Send the frames of a message; what did not leave yet of the stream's last message is dropped.

        :param name: of the stream, or of the part of it that carries the message, as in Departed
        :param stamp: of the message, for its trace; 0: it is not traced [ns]
        :param only: the subscriber that it is for; None: all
        :param base: datagrams that show something of it, see PacketScheduler.put
        """
        parts = [(len(frame), frame.datagram_size + self._headers) for frame in frames]
        with self._changed:
            self._scheduler.put(stream_of(name), (name, publisher, frames, stamp, only), parts, base)
            self._changed.notify()

    def await_rest(self, stream: str, whole: bool = False, backlog: float = MAX_BACKLOG) -> None:
        """Wait until the last message of a stream has left, so that the next one does not cut it off, but only if
        it leaves within `backlog` [s]. A busy machine takes longer than the link: at most MAX_WAIT.

        :param whole: whether the message is useless without all its datagrams: it leaves then, if it can within
            MAX_WHOLE_WAIT
        """
        with self._left:
            if whole or self._scheduler.takes(stream) <= backlog:
                self._left.wait_for(lambda: self._ended or self._scheduler.sending(stream) is None,
                                    MAX_WHOLE_WAIT if whole else MAX_WAIT)

    def sending(self, stream: str) -> bool:
        """Whether frames of a stream are still leaving."""
        with self._changed:
            return self._scheduler.sending(stream) is not None

    def unsent(self, stream: str) -> bool:
        """Whether a stream's message waits, and no datagram of it has left."""
        with self._changed:
            return self._scheduler.unsent(stream)

    def takes(self, stream: str) -> float:
        """How long it takes until what is left of a stream's message has left [s]."""
        with self._changed:
            return self._scheduler.takes(stream)

    def publish(self, stream: str, publisher: Publisher, frame: Frame) -> None:
        """Send a frame at once, before everything that waits."""
        now = time.monotonic()      # before it leaves: it may arrive at once
        size = frame.datagram_size + self._headers
        route = self._route(stream, len(frame), size, now, whole=True)
        first = publisher.publish_frames(frame, second=route.second)
        with self._changed:
            self.protected += len(frame) * size
            self._scheduler.charge(len(frame) * size, now)
            self._departed(stream, first, len(frame), size, now, route)

    def charge(self, datagrams: int, size: int) -> None:
        """Count datagrams that were sent besides, at once, and that no link report names: they share the air, too.

        :param size: of all of them together, as Frame.datagram_size [byte]
        """
        total = size + datagrams * self._headers
        with self._changed:
            self.protected += total
            self._scheduler.charge(total, time.monotonic())
            self._besides(total)

    def publish_message(self, publisher: Publisher, message: Any) -> None:
        """Send a message to all at once, and charge it."""
        publisher.publish(message)
        datagrams = publisher.get_num_connections()
        self.charge(datagrams, datagrams * (size_of(message) + OVERHEAD))

    @property
    def rate(self) -> Optional[float]:
        """The rate of the link [byte/s]; None: unlimited."""
        return self._scheduler.rate

    def drop(self, stream: str) -> None:
        """Nothing more of a stream's message leaves."""
        with self._changed:
            self._scheduler.drop(stream)
            self._left.notify_all()

    def dropped(self, stream: str) -> int:
        """Number of datagrams of a stream that a newer message replaced."""
        return self._scheduler.dropped.get(stream, 0)

    def change(self, change: Callable[[PacketScheduler], Any]) -> None:
        """Call change(scheduler)."""
        with self._changed:
            change(self._scheduler)
            if self._scheduler.wait(time.monotonic()) < math.inf:
                self._changed.notify()

    def _run(self) -> None:
        while True:
            try:
                chunk = self._await_chunk()
            except Exception as error:      # at once it would fail again
                self._on_error('outbox', error)
                with self._changed:
                    self._changed.wait_for(lambda: self._ended, RETRY_PERIOD)
                continue
            if chunk is None:
                return
            try:
                self._send(chunk)
            except Exception as error:      # a fault of one stream must not stop the others
                self._on_error(chunk.stream, error)

    def _await_chunk(self) -> Optional[Chunk]:
        """What is to be sent now; None: the outbox was stopped."""
        with self._changed:
            while not self._ended:
                chunk: Optional[Chunk] = self._scheduler.take(time.monotonic())
                if chunk is not None:
                    if self._scheduler.sending(chunk.stream) is None:
                        self._left.notify_all()
                    return chunk
                wait = self._scheduler.wait(time.monotonic())
                self._changed.wait(None if wait == math.inf else wait)
            return None

    def _send(self, chunk: Chunk) -> None:
        name, publisher, frames, stamp, only = chunk.work
        frame = frames[chunk.part].part(chunk.start, chunk.stop)
        now, size = time.monotonic(), frame.datagram_size + self._headers
        route = self._route(chunk.stream, len(frame), size, now, chunk.start, chunk.total, chunk.waiting)
        if only is not None:
            others = {connection['peer'] for connection in publisher.connections()} - {only}
            route = route._replace(limits={**route.limits, **dict.fromkeys(others, 0)})
        if route.withheld:
            with self._changed:
                self._scheduler.charge(round(route.withheld), now)
        first = publisher.publish_frames(frame, limits=route.limits, second=route.second)
        self._departed(name, first, len(frame), size, now, route)
        if TRACE.on and stamp:
            if chunk.start == chunk.part == 0:
                TRACE.mark(chunk.stream, stamp, stages.FIRST_SENT, now)
            if chunk.stop == chunk.total and chunk.part == len(frames) - 1:
                TRACE.mark(chunk.stream, stamp, stages.LAST_SENT)
