# SPDX-License-Identifier: BSD-3-Clause
"""What was sent and when. A receiver only needs to name a datagram: the sender looks the rest up here.

A stream whose messages are numbered on several topics is in here, and in reports, as `<stream>` and `<stream>/<part>`.
"""
import bisect
import math
from typing import Dict, List, NamedTuple, Optional, Tuple

MAX_BURSTS = 4096
"""Number of bursts that are remembered of each stream: some seconds at full speed. At twice this number the older half
is forgotten."""

MAX_AGE, MIN_BURSTS = 20.0, 64
"""Age after which bursts are forgotten, and number of bursts of each stream that are remembered for longer. feedback.py
does not believe arrivals half as old [s, 1]."""

TOGETHER = 0.002
"""What is sent within this time is sent at the same time [s]."""

SEQ_MODULUS = 1 << 32
"""std_msgs/Header.seq wraps here."""


def stream_of(name: str) -> str:
    """The stream that a name in reports belongs to: itself, or what is before the slash."""
    return name.split('/', 1)[0]


class SentPacket(NamedTuple):
    """A datagram that was sent."""
    sent: float
    """By the sender's steady clock [s]."""
    size: int
    """On the air, IP and UDP headers included [byte]."""
    total: int
    """Bytes of all streams sent so far, this datagram included."""
    together: int
    """Bytes that were sent at the same time, up to this datagram."""


class _Burst(NamedTuple):
    """Datagrams of one stream that were sent together."""
    packets: int
    size: int
    """Size of each datagram [byte]."""
    sent: float
    total_before: int
    """Bytes of all streams sent before."""
    together: int
    """Those of them that were sent at the same time."""


class _Stream:
    """The bursts of one stream, in the order of their first sequence numbers."""

    def __init__(self) -> None:
        self.firsts: List[int] = []
        self.bursts: List[_Burst] = []
        self.count = self.bytes = 0

    @property
    def last(self) -> int:
        """The highest sequence number."""
        return self.firsts[-1] + self.bursts[-1].packets - 1

    def add(self, first: int, burst: _Burst) -> None:
        if self.firsts and first <= self.last:
            self.firsts, self.bursts = [], []       # the numbering started again
        self.firsts.append(first)
        self.bursts.append(burst)
        self.count += burst.packets
        self.bytes += burst.packets * burst.size
        half = len(self.firsts) // 2
        if half >= MAX_BURSTS or (half >= MIN_BURSTS and self.bursts[half].sent < burst.sent - MAX_AGE):
            del self.firsts[:half], self.bursts[:half]


class SentHistory:
    """Remembers what was sent, in bounded memory."""

    def __init__(self) -> None:
        self.total = 0
        """Bytes sent so far: of all streams, and besides."""
        self._streams: Dict[str, _Stream] = {}
        self._together = -math.inf, 0       # when what is sent at the same time began to leave [s], `total` before it

    def add(self, stream: str, first: int, count: int, size: int, now: float) -> None:
        """Record datagrams that were sent together.

        :param stream: its name
        :param first: sequence number of the first one; the others follow without a gap (Header.seq, not wrapped)
        :param count: number of datagrams
        :param size: of each on the air, IP and UDP headers included [byte]
        :param now: when, by a steady clock [s]
        """
        if now - self._together[0] > TOGETHER:
            self._together = now, self.total
        burst = _Burst(count, size, now, self.total, self.total - self._together[1])
        self._streams.setdefault(stream, _Stream()).add(first, burst)
        self.total += count * size

    def add_besides(self, size: int) -> None:
        """Record what no report names: it counts in `total` only.

        :param size: on the air, IP and UDP headers included [byte]
        """
        self.total += size

    def find(self, stream: str, seq: int) -> Optional[SentPacket]:
        """Look a datagram up; None: it was never sent, or too long ago.

        :param seq: its sequence number as in the message, modulo 2^32
        """
        known = self._streams.get(stream)
        if known is None:
            return None
        seq = self.unwrapped(stream, seq)
        index = bisect.bisect_right(known.firsts, seq) - 1
        if index < 0:
            return None
        burst = known.bursts[index]
        place = seq - known.firsts[index] + 1
        if place > burst.packets:
            return None
        until = place * burst.size
        return SentPacket(burst.sent, burst.size, burst.total_before + until, burst.together + until)

    def unwrapped(self, stream: str, seq: int) -> int:
        """The sequence number, of those equal to `seq` modulo 2^32, that the stream had last."""
        known = self._streams.get(stream)
        return known.last - (known.last - seq) % SEQ_MODULUS if known else seq

    def reached(self, stream: str, seq: int) -> bool:
        """Whether a stream's numbers have come as far as this one, modulo 2^32."""
        known = self._streams.get(stream)
        return known is not None and (known.last - seq) % SEQ_MODULUS < SEQ_MODULUS // 2

    def totals(self, stream: str) -> Tuple[int, int]:
        """(datagrams, bytes) of a stream sent so far."""
        known = self._streams.get(stream)
        return (known.count, known.bytes) if known else (0, 0)

    def bytes_of(self, stream: str) -> int:
        """Bytes of a stream sent so far, in all its parts."""
        return sum(known.bytes for name, known in self._streams.items() if stream_of(name) == stream)
