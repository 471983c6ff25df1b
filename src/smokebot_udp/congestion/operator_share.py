# SPDX-License-Identifier: BSD-3-Clause
"""What one of several operators gets of the datagrams that are sent: as much as its own link carries.

All operators get the same frames, as fast as the best link carries them. Most datagrams are samples of a whole message,
so for a slower link some are left out, and its operator sees the same messages less complete. A message that is useless
without all its datagrams (a long relayed one) is left out as a whole or not at all: its operator gets fewer of them.
"""
import bisect
from array import array
from typing import Collection, Dict, Mapping, NamedTuple, Optional, Tuple

from .sent_history import MAX_AGE, SEQ_MODULUS, SentHistory, SentPacket

MAX_RANGES = 4096
"""Number of ranges of left-out datagrams that are remembered of each stream. At twice this number the older half is
forgotten."""

MIN_RANGES = 128
"""Number of ranges that are remembered of each stream even if they are older than sent_history.MAX_AGE."""

BURST_DURATION = 0.05
"""After a pause, what the link carries in this time may leave at once [s]."""

MAX_DEBT = 0.1
"""Longest time for which streams that keep all their datagrams, or messages that leave anyway, delay others [s]."""

MAX_WHOLE_DEBT = 0.25
"""Longest time for which a message that is sent as a whole delays others. Its datagrams arrive at the pace of the best
link and wait before the slower one. A message that takes longer would overflow many queues, and is never sent to this
operator [s]."""


class _Begun(NamedTuple):
    """A message that has begun to leave."""
    admitted: bool
    next: int
    """Index of its next datagram."""


class Policer:
    """Decides which datagrams an operator gets: a part of each stream's, and not too many at once (a token bucket, RFC
    2697).

    :param now: by a steady clock [s]
    """

    def __init__(self, now: float) -> None:
        self.parts: Mapping[str, float] = {}
        """{stream: part of its datagrams to keep, 0..1}; of others all."""
        self.whole: Collection[str] = ()
        """The streams whose messages are useless without all their datagrams."""
        self._credit: Dict[str, float] = {}         # {stream: datagrams}
        self._begun: Dict[str, _Begun] = {}         # {whole stream: its last message}
        self._tokens, self._updated = 0.0, now      # [byte], [s]
        self._max_debt = MAX_DEBT                   # MAX_WHOLE_DEBT while a whole message waits before the link
        self._probe_rate = self._probe_left = 0.0

    def start_probe(self, rate: float, size: float) -> None:
        """Let the next ``size`` bytes pass at another rate [byte/s]: a trains.Train."""
        self._probe_rate, self._probe_left = rate, size

    def conforming(self, stream: str, count: int, size: int, rate: float, now: float, start: int = 0,
                   total: int = 1) -> int:
        """How many of a stream's `count` datagrams may be sent now; of a whole stream's all or none.

        :param size: of each on the air [byte]
        :param rate: of the operator's link [byte/s]
        :param start: of a whole stream: index in its message of the first one
        :param total: of a whole stream: datagrams of the message
        """
        part = self.parts.get(stream, 1.0)
        if stream in self.whole:
            self._refill(size, rate, now)
            begun = self._begun.get(stream)
            if start == 0:
                admitted = self._admits(stream, part, total, size, rate)
            else:       # where the link was not slower than others at first, everything has passed until now
                admitted = begun.admitted if begun is not None and begun.next == start else True
            self._begun[stream] = _Begun(admitted, start + count)
            return count if admitted else 0
        if self._probe_left > 0:
            part, rate = 1.0, max(rate, self._probe_rate)
        self._refill(size, rate, now)
        credit = min(self._credit.get(stream, 0.0), 1.0) + part * count
        room = self._tokens + (rate * MAX_DEBT if part >= 1 else 0.0)
        number = max(0, min(count, int(credit + 1e-9), int(room // size)))
        self._credit[stream] = credit - number
        return number

    def _refill(self, size: int, rate: float, now: float) -> None:
        depth = max(size, rate * BURST_DURATION)
        self._tokens = min(depth, max(self._tokens, -rate * self._max_debt) + rate * (now - self._updated))
        self._updated = now
        if self._tokens >= 0:
            self._max_debt = MAX_DEBT

    def _admits(self, stream: str, part: float, total: int, size: int, rate: float) -> bool:
        """Whether a message of `total` datagrams passes; its stream saves for one message, and not for two."""
        credit = min(self._credit.get(stream, 0.0), total) + part * total
        admitted = credit + 1e-9 >= total and self._tokens + rate * MAX_WHOLE_DEBT >= total * size
        self._credit[stream] = credit - total if admitted else credit
        if admitted:
            self._max_debt = MAX_WHOLE_DEBT
        return admitted

    def spend(self, size: int) -> None:
        """Account for bytes that were sent."""
        self._tokens -= size
        self._probe_left -= size


class _LeftOut:
    """Ranges of a growing number that were left out, and how much of it that is. 32 bytes each."""

    def __init__(self) -> None:
        self.amount = 0
        self._forget()

    def __len__(self) -> int:
        return len(self._starts)

    def add(self, start: int, length: int, now: float) -> None:
        if self._starts and start <= self._starts[-1]:
            self._forget()      # the numbering started again
        self._starts.append(start)
        self._lengths.append(length)
        self._before.append(self.amount)
        self._times.append(now)
        self.amount += length
        half = len(self._starts) // 2
        if half >= MAX_RANGES or (half >= MIN_RANGES and self._times[half] < now - MAX_AGE):
            for column in (self._starts, self._lengths, self._before, self._times):
                del column[:half]

    def until(self, end: int) -> int:
        """How much was left out before `end`."""
        index = bisect.bisect_left(self._starts, end) - 1
        if index < 0:
            return self._before[0] if self._before else 0
        return self._before[index] + min(self._lengths[index], end - self._starts[index])

    def _forget(self) -> None:
        self._starts, self._lengths = array('Q'), array('Q')
        self._before = array('Q')       # left out before the range
        self._times = array('d')        # when it was [s]


class OperatorHistory:
    """What one operator was sent: a SentHistory without what was left out.

    :param history: what was sent to all
    """

    def __init__(self, history: SentHistory) -> None:
        self._history = history
        self._bytes = _LeftOut()                    # of all streams
        self._seqs: Dict[str, _LeftOut] = {}        # of each stream
        self._sizes: Dict[str, int] = {}            # {stream: bytes}

    @property
    def total(self) -> int:
        """Bytes of all streams sent so far."""
        return self._history.total - self._bytes.amount

    @property
    def ranges(self) -> int:
        """Number of ranges remembered, of all streams."""
        return len(self._bytes) + sum(map(len, self._seqs.values()))

    def leave_out(self, stream: str, first: int, count: int, size: int, now: float) -> None:
        """Record that of the datagrams which were added to the history last, the last ones were left out.

        :param first: sequence number of the first one left out (not wrapped)
        :param count: number of datagrams
        :param size: of each on the air [byte]
        :param now: when [s]
        """
        self._bytes.add(self._history.total - count * size, count * size, now)
        self._seqs.setdefault(stream, _LeftOut()).add(first, count, now)
        self._sizes[stream] = self._sizes.get(stream, 0) + count * size

    def find(self, stream: str, seq: int) -> Optional[SentPacket]:
        """As SentHistory.find; None also for what was left out."""
        packet = self._history.find(stream, seq)
        if packet is None or self._missing(stream, seq) > self._missing(stream, seq - 1):
            return None
        left_out, before = (self._bytes.until(packet.total - less) for less in (0, packet.together))
        return packet._replace(total=packet.total - left_out, together=packet.together - (left_out - before))

    def reached(self, stream: str, seq: int) -> bool:
        """As SentHistory.reached."""
        return self._history.reached(stream, seq)

    def sent_between(self, stream: str, first: int, last: int) -> int:
        """Number of datagrams of a stream after one sequence number, up to and with another one, modulo 2^32."""
        return (last - first) % SEQ_MODULUS - self._missing(stream, last) + self._missing(stream, first)

    def totals(self, stream: str) -> Tuple[int, int]:
        """(datagrams, bytes) of a stream sent so far."""
        count, size = self._history.totals(stream)
        left_out = self._seqs.get(stream)
        return (count - left_out.amount, size - self._sizes[stream]) if left_out else (count, size)

    def _missing(self, stream: str, seq: int) -> int:
        """Number of datagrams of a stream left out, up to and with a sequence number."""
        left_out = self._seqs.get(stream)
        return left_out.until(self._history.unwrapped(stream, seq) + 1) if left_out else 0
