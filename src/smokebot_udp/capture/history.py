# SPDX-License-Identifier: BSD-3-Clause
"""The last originals of the robot's streams, within bounds of age and memory. Times are by a steady clock [s]."""
import collections
import threading
from typing import Any, Deque, Dict, NamedTuple

MAX_DISTANCE = 1.0
"""An original this far from the time that is asked for is not the one that is meant [s]."""

MESSAGE_OVERHEAD = 2048
"""What a message takes besides its data [byte]."""


class Original(NamedTuple):
    """A message as it came from its source."""
    message: Any
    """A message with a header and `data`. It is not to be changed."""
    stamp: int
    """Time stamp of the message by its source [ns]."""
    received: float
    """Time at which the message was received [s]."""

    @property
    def size(self) -> int:
        """The size of the message in memory [byte]."""
        return len(self.message.data) + MESSAGE_OVERHEAD


class Histories:
    """The originals of all streams, which share the memory: where it is full, the oldest one of any stream goes. Any
    thread.

    :param max_bytes: of all originals together
    """

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes, self._bytes = max_bytes, 0
        self._streams: Dict[str, Deque[Original]] = {}
        self._lock = threading.Lock()

    @property
    def bytes(self) -> int:
        """What all originals take now."""
        return self._bytes

    def add(self, stream: str, message: Any, stamp: int, period: float, now: float) -> None:
        """Keep a message, and forget those of its stream that are older than a period.

        :param stamp: of its source [ns]
        :param period: [s]; 0: nothing is kept
        """
        with self._lock:
            kept = self._streams.setdefault(stream, collections.deque())
            if period > 0:
                kept.append(Original(message, stamp, now))
                self._bytes += kept[-1].size
            while kept and (period <= 0 or kept[0].received < now - period):
                self._forget(kept)
            while self._bytes > self._max_bytes:
                self._forget(min((other for other in self._streams.values() if other),
                                 key=lambda other: other[0].received))

    def find(self, stream: str, stamp: int) -> Original:
        """The original nearest to a stamp [ns]; 0: the newest one.

        :raises ValueError: there is none, in one sentence
        """
        with self._lock:
            kept = list(self._streams.get(stream, ()))
        if not kept:
            raise ValueError("the robot keeps no original of stream '%s': its setting history is 0, or nothing came"
                             % stream)
        if not stamp:
            return kept[-1]
        nearest = min(kept, key=lambda original: abs(original.stamp - stamp))
        if abs(nearest.stamp - stamp) > MAX_DISTANCE * 1e9:
            stamps = [original.stamp for original in kept]
            raise ValueError("the robot keeps originals of stream '%s' from %.3f to %.3f, none within %g s of %.3f" % (
                stream, min(stamps) / 1e9, max(stamps) / 1e9, MAX_DISTANCE, stamp / 1e9))
        return nearest

    def _forget(self, kept: Deque[Original]) -> None:
        self._bytes -= kept.popleft().size
