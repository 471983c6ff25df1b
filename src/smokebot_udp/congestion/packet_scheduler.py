# SPDX-License-Identifier: BSD-3-Clause
"""Which datagrams leave next, and when, of all streams together.

They leave evenly at the link's rate: a token bucket (RFC 2697's committed rate and burst size), so that no queue on the
way overflows from our bursts. Streams that have something to send take turns by their shares: start-time fair queueing
(P. Goyal, H. Vin, H. Cheng, "Start-time Fair Queueing", 1996). Of a stream only the newest message counts: what did not
leave of the one before is dropped, never sent late.
"""
import math
from typing import Any, NamedTuple

CHUNK_LASTS = 0.002
"""Datagrams leave together that fill the link for so long at most [s],"""

BURST_LASTS = 0.005
"""and after a pause no longer than this."""

LATE = 0.02
"""While datagrams wait, who asks later than they might have left may catch up on so much [s]."""

LEAST_SHARE = 1.0
"""[byte/s]"""

LONGEST_CHUNK = 65507
"""A chunk has so many bytes at most: what a kernel takes at once."""


class Chunk(NamedTuple):
    """Datagrams that leave together."""
    stream: str
    work: Any
    """As it was put."""
    part: int
    """Which of its parts they are of."""
    start: int
    stop: int
    """Which of that part's datagrams: start .. stop - 1."""
    size: int
    """Of all of them [byte]."""


class _Flow:
    """One stream's message that is leaving."""

    def __init__(self):
        self.share, self.start = 1.0, 0.0       # start: the virtual time at which it is its turn
        self.work, self.parts = None, []
        self.part = self.at = 0

    @property
    def left(self):
        """Datagrams."""
        return sum(count for count, _ in self.parts[self.part:]) - self.at

    def advance(self, count):
        self.at += count
        if self.at == self.parts[self.part][0]:
            self.part, self.at = self.part + 1, 0
        if self.part == len(self.parts):
            self.work, self.parts, self.part = None, [], 0


class Pace:
    """What is to be sent, by streams' names. Time is an argument [s, on a steady clock].

    :param rate: of the link [byte/s]; None: unlimited
    :param burst: bytes that may leave at once after a pause [byte]
    :raises ValueError: where they are not positive and finite
    """

    def __init__(self, rate=None, burst=16 * 1500):
        if not 0 < burst < math.inf:
            raise ValueError('burst is %r, must be positive and finite' % burst)
        self.burst = burst
        self.set_rate(rate)
        self.dropped = {}
        """{stream: datagrams that a newer message replaced}"""
        self._train_rate, self._train_left = None, 0.0
        self._waited = False            # whether something was left to send when something was sent last
        self._full_at = -math.inf       # when the bucket is full again, if nothing more leaves
        self._flows = {}
        self._virtual = 0.0

    def set_rate(self, rate):
        """From now on."""
        if rate is not None and not 0 < rate < math.inf:
            raise ValueError('rate is %r, must be positive and finite' % rate)
        self.rate = rate

    def set_share(self, stream, share):
        """How much of the link a stream gets beside others that have something to send [byte/s]."""
        flow, share = self._flow(stream), max(share, LEAST_SHARE)
        # what it was ahead of the others stays so many bytes: a datagram that left at a tiny share is no long wait
        flow.start = self._virtual + (flow.start - self._virtual) * flow.share / share
        flow.share = share

    def train(self, rate, size):
        """The next `size` bytes leave at another rate, to see whether the link carries it [byte/s]."""
        self._train_rate, self._train_left = rate, size

    def put(self, stream, work, parts):
        """A new message of a stream; of the one before nothing more leaves.

        :param parts: [(datagrams, bytes of each), ...]
        """
        flow = self._flow(stream)
        self._forget(stream)
        flow.start = max(flow.start, self._virtual)
        flow.work, flow.parts, flow.part, flow.at = work, [part for part in parts if part[0]], 0, 0

    def drop(self, stream):
        """Nothing more of a stream's message leaves."""
        self._forget(stream)
        self._waited &= self._waiting()

    def _forget(self, stream):
        flow = self._flow(stream)
        if flow.parts:
            self.dropped[stream] = self.dropped.get(stream, 0) + flow.left
            flow.work, flow.parts, flow.part, flow.at = None, [], 0, 0

    def sending(self, stream):
        """What is leaving of a stream, as it was put; None: nothing."""
        return self._flow(stream).work

    def takes(self):
        """How long all that waits takes to leave, at the rate there is now [s]."""
        left = sum((count if part > flow.part else count - flow.at) * size for flow in self._flows.values()
                   for part, (count, size) in enumerate(flow.parts) if part >= flow.part)
        return left / self.rate if self.rate is not None else 0.0

    def charge(self, size, now):
        """Bytes left by another way, past the queue."""
        if self.rate is not None:
            self._spend(size, now, self.rate)

    def wait(self, now):
        """How long until something may leave [s]; infinite where there is nothing."""
        return self._next(now)[0]

    def take(self, now):
        """The Chunk that leaves now; None where nothing may."""
        wait, name, count = self._next(now)
        if wait > 0:
            return None
        flow, rate = self._flows[name], self._rate()
        size = count * flow.parts[flow.part][1]
        chunk = Chunk(name, flow.work, flow.part, flow.at, flow.at + count, size)
        flow.advance(count)
        self._virtual = flow.start
        flow.start += size / flow.share
        if rate is not None:
            self._spend(size, now, rate)
            self._train_left -= size
        self._waited = self._waiting()
        return chunk

    def _next(self, now):
        """(how long until it may leave [s], stream, how many datagrams)"""
        waiting = [(flow.start, name) for name, flow in self._flows.items() if flow.parts]
        if not waiting:
            return math.inf, None, 0
        _, name = min(waiting)
        flow, rate = self._flows[name], self._rate()
        count, size = flow.parts[flow.part]
        if rate is None:
            return 0.0, name, min(count - flow.at, LONGEST_CHUNK // size or 1)
        most = min(LONGEST_CHUNK, self.burst, rate * CHUNK_LASTS)
        count = max(1, min(count - flow.at, int(most // size)))
        bucket = max(count * size, min(self.burst, rate * BURST_LASTS))
        return max(0.0, self._full_at + (count * size - bucket) / rate - now), name, count

    def _waiting(self):
        return any(flow.parts for flow in self._flows.values())

    def _spend(self, size, now, rate):
        self._full_at = max(now - LATE * self._waited, self._full_at) + size / rate

    def _rate(self):
        return self._train_rate if self.rate is not None and self._train_left > 0 else self.rate

    def _flow(self, stream):
        return self._flows.setdefault(stream, _Flow())
