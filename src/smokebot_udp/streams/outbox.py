# SPDX-License-Identifier: BSD-3-Clause
"""The robot's way out: one thread sends what all streams have to send, as supervisor/pace.py decides."""
import math
import threading
import time

from ..congestion.packet_scheduler import Pace
from ..udpros.datagram import OVERHEAD
from ..udpros.endpoints import IP_UDP_HEADERS

SOON = 0.02
"""What leaves in so long at the link's rate is not cut off by a newer message [s],"""

PATIENCE = 0.5
"""but no newer message waits longer than this [s]."""


def size_of(frames):
    """Bytes of udpros.Frames on the air: of whole IP packets."""
    return sum(len(frame) * (frame.datagram_size + IP_UDP_HEADERS) for frame in frames)


class Outbox:
    """Shared by a node's streams: they share the air.

    :param pace: a supervisor.pace.Pace
    :param departed: f(stream, seq, count, size, now), told of numbered datagrams that left: the first one's
        sequence number (None: it has none), how many they are, and the bytes of each as a packet of IP
    :param on_error: f(stream, exception), called for what sending raises; the others go on
    """

    def __init__(self, pace=None, departed=lambda *_: None, on_error=lambda *_: None):
        self._pace = pace or Pace()
        self._departed, self._on_error = departed, on_error
        self.protected = 0
        """Bytes that ever left at once."""
        lock = threading.Lock()
        self._changed, self._left = threading.Condition(lock), threading.Condition(lock)
        self._ended = False
        self._thread = threading.Thread(target=self._run, name='outbox', daemon=True)

    def start(self):
        self._thread.start()

    def stop(self):
        with self._changed:
            self._ended = True
            self._changed.notify()
            self._left.notify_all()
        if self._thread.ident:
            self._thread.join()

    def put(self, stream, publisher, frames):
        """Send a message's udpros.Frames; what did not leave yet of the stream's last message never does."""
        parts = [(len(frame), frame.datagram_size + IP_UDP_HEADERS) for frame in frames]
        with self._changed:
            self._pace.put(stream, (publisher, frames), parts)
            self._changed.notify()

    def await_rest(self, stream):
        """Where all that waits leaves soon, wait until a stream's message has left whole: else the next one cuts it
        off. On a machine that is late this takes longer than on the link, but never longer than PATIENCE."""
        with self._left:
            if self._pace.takes() <= SOON:
                self._left.wait_for(lambda: self._ended or self._pace.sending(stream) is None, PATIENCE)

    def sends(self, stream, frames):
        """Whether these very frames are still leaving."""
        with self._changed:
            leaving = self._pace.sending(stream)
            return leaving is not None and leaving[1] is frames

    def publish(self, stream, publisher, message, size):
        """Send one message at once, before all that waits: small ones are never held back.

        :param size: of the serialised message [byte]
        """
        publisher.publish(message)
        size += OVERHEAD + IP_UDP_HEADERS
        with self._changed:
            now = time.monotonic()
            self.protected += size
            self._pace.charge(size, now)
            self._departed(stream, publisher.impl.seq if message._has_header else None, 1, size, now)

    def drop(self, stream):
        """Nothing more of a stream's message leaves."""
        with self._changed:
            self._pace.drop(stream)
            self._left.notify_all()

    def dropped(self, stream):
        """Datagrams of a stream that a newer message replaced."""
        return self._pace.dropped.get(stream, 0)

    def change(self, change):
        """Call change(pace)."""
        with self._changed:
            change(self._pace)
            self._changed.notify()

    def _run(self):
        while True:
            with self._changed:
                wait = self._pace.wait(time.monotonic())
                while wait > 0 and not self._ended:
                    self._changed.wait(None if wait == math.inf else wait)
                    wait = self._pace.wait(time.monotonic())
                if self._ended:
                    return
                chunk = self._pace.take(time.monotonic())
                if self._pace.sending(chunk.stream) is None:
                    self._left.notify_all()
            try:
                self._send(chunk)
            except Exception as error:      # one stream's fault is not the others'
                self._on_error(chunk.stream, error)

    def _send(self, chunk):
        publisher, frames = chunk.work
        frame = frames[chunk.part].part(chunk.start, chunk.stop)
        now = time.monotonic()
        first = publisher.publish_frames(frame)
        self._departed(chunk.stream, first, len(frame), frame.datagram_size + IP_UDP_HEADERS, now)
