# SPDX-License-Identifier: BSD-3-Clause
"""Which datagram leaves next, and when, of all streams together.

Datagrams are paced evenly at the link's rate by a token bucket (committed rate and burst size of RFC 2697), so that our
bursts overflow no queue on the path. Of a stream only the newest message counts: the rest of the one before is dropped,
never sent late.

An image is shown when all of it has come, so messages leave one after the other, not in turns. A message's deadline is
the virtual time at which it would have left if all streams with something to send had sent at once, each by its share:
generalised processor sharing (Parekh, Gallager: "A generalized processor sharing approach to flow control in integrated
services networks", IEEE/ACM Trans. Networking 1(3), 1993). The earliest deadline leaves first. Before that, the base
layer of each message leaves, the first datagrams, which show something, where its stream has had no more than its share
so far. But for these and a chunk, no message leaves later than it would in turns.
"""
import math
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

CHUNK_DURATION = 0.002
"""Datagrams that leave together occupy the link for this long at most [s]."""

BASE_DURATION = 0.005
"""What leaves within this time belongs to the base layer of a message [s]."""

BURST_DURATION = 0.005
"""After a pause, what the link carries in this time may leave at once; more where the path has a token bucket [s]."""

MAX_CATCH_UP = 0.02
"""While datagrams wait, a caller that is late may catch up on this long [s]."""

MIN_SHARE = 1.0
"""Smallest share of a stream [byte/s]."""

MAX_DEBT = 0.5
"""What was sent past the scheduler holds up the rest for this long, at most: where the rate falls, or was estimated too
low, that would be minutes otherwise [s]."""

MAX_CHUNK_SIZE = 65507
"""What a kernel accepts at once [byte]."""


class Chunk(NamedTuple):
    """Datagrams that leave together."""
    stream: str
    work: Any
    """The work that was passed to `put`."""
    part: int
    """Index of the part that they belong to."""
    start: int
    stop: int
    """Datagrams start .. stop - 1 of that part."""
    size: int
    """Size of all these datagrams together [byte]."""
    total: int
    """Number of datagrams of the part."""
    waiting: float = 0.0
    """Size of all that waits, these included [byte]."""


class _Flow:
    """One stream's message that is being sent."""

    def __init__(self) -> None:
        self.share = 1.0
        self.served = 0.0       # virtual time up to which it has had its share
        self.work: Any = None
        self.parts: List[Tuple[int, int]] = []
        self.part = self.at = 0
        self.left = self.base = 0.0     # bytes that have not left: all, and of the base layer

    def load(self, work: Any, parts: List[Tuple[int, int]], base: float) -> None:
        self.work, self.parts, self.part, self.at = work, parts, 0, 0
        self.left = sum(count * size for count, size in parts)
        self.base = min(base, self.left)

    @property
    def deadline(self) -> float:
        """The virtual time at which all of it has left if streams take turns by their shares."""
        return self.served + self.left / self.share

    @property
    def order(self) -> Tuple[bool, float]:
        """The least one leaves next."""
        return (False, self.served + self.base / self.share) if self.base > 0 else (True, self.deadline)

    def remaining(self) -> List[Tuple[int, int]]:
        """The parts (datagrams, bytes of each) that have not left."""
        if not self.parts:
            return []
        count, size = self.parts[self.part]
        return [(count - self.at, size), *self.parts[self.part + 1:]]

    def advance(self, count: int) -> None:
        size = count * self.parts[self.part][1]
        self.served += size / self.share
        self.left, self.base, self.at = self.left - size, max(0.0, self.base - size), self.at + count
        if self.at == self.parts[self.part][0]:
            self.part, self.at = self.part + 1, 0
        if self.part == len(self.parts):
            self.load(None, [], 0.0)


class PacketScheduler:
    """Paces and orders what streams send. Times are arguments, by a steady clock [s].

    :param rate: of the link [byte/s]; None: unlimited
    :param burst: bytes that may leave at once after a pause [byte]
    :raises ValueError: where they are not positive and finite
    """

    def __init__(self, rate: Optional[float] = None, burst: float = 16 * 1500) -> None:
        if not 0 < burst < math.inf:
            raise ValueError('burst is %r, must be positive and finite' % burst)
        self.burst, self.rate = burst, _checked(rate)
        self.dropped: Dict[str, int] = {}
        """{stream: datagrams that a newer message replaced}"""
        self._tokens = 0.0          # what the path lets pass at once after a pause [byte]
        self._probe_rate, self._probe_left = 0.0, 0.0
        self._backlogged = False        # whether datagrams were still waiting when the last one left
        self._full_at = -math.inf       # when the bucket is full again, if nothing more leaves
        self._flows: Dict[str, _Flow] = {}
        self._virtual = 0.0

    def set_rate(self, rate: Optional[float], now: float) -> None:
        """Pace at another rate from now on [byte/s]; None: unlimited. What was sent in advance stays the same in bytes,
        but for what takes no longer than MAX_CATCH_UP.

        :raises ValueError: where it is not positive and finite
        """
        before, self.rate = self.rate, _checked(rate)
        owed = self._full_at - now
        if before is not None and rate is not None and owed > MAX_CATCH_UP:
            self._full_at = now + min(MAX_CATCH_UP + (owed - MAX_CATCH_UP) * before / rate, max(owed, MAX_DEBT))

    def set_tokens(self, depth: float, missing: float, now: float) -> None:
        """What the path lets pass at once leaves at once: it waits nowhere. A packet train exceeds the tokens and does
        not wait for them.

        :param depth: of a token bucket on the path [byte]
        :param missing: tokens that are missing in it now [byte]
        """
        self._tokens = depth
        if self.rate is not None and self._probe_left <= 0:
            self._full_at = max(self._full_at, now + min(missing, depth) / self.rate)

    def set_share(self, stream: str, share: float) -> None:
        """Set a stream's share of the link beside others that have something to send [byte/s].

        :raises ValueError: where it is not a number: no stream would ever have its turn again
        """
        if math.isnan(share):
            raise ValueError('the share of %s is %r' % (stream, share))
        flow, share = self._flow(stream), max(share, MIN_SHARE)
        # its lead over the others stays the same in bytes: what was sent at a tiny share must not block it for long
        flow.served = self._virtual + (flow.served - self._virtual) * flow.share / share
        flow.share = share

    def start_probe(self, rate: float, size: float) -> None:
        """Send the next ``size`` bytes at another rate [byte/s], from now on: a trains.Train."""
        self._probe_rate, self._probe_left = rate, size
        if self._tokens:
            self._full_at = -math.inf

    def put(self, stream: str, work: Any, parts: Sequence[Tuple[int, int]], base: int = 1) -> None:
        """Send a stream's new message; the rest of the one before is dropped.

        :param work: passed on in each Chunk
        :param parts: [(datagrams, bytes of each), ...]
        :param base: datagrams of the base layer, at least
        """
        flow = self._flow(stream)
        if flow.parts:
            self._clear(stream)     # it has waited, and keeps its place
        else:
            flow.served = max(flow.served, self._virtual)
        parts = [part for part in parts if part[0]]
        largest = max((size for _, size in parts), default=0)
        had_more = flow.served > self._virtual
        flow.load(work, parts, 0.0 if had_more else max(base * largest, BASE_DURATION * (self.rate or 0.0)))

    def drop(self, stream: str) -> None:
        """Drop the rest of a stream's message."""
        self._clear(stream)
        self._backlogged &= self._waiting()

    def sending(self, stream: str) -> Any:
        """The work of a stream that is being sent; None: nothing."""
        return self._flow(stream).work

    def unsent(self, stream: str) -> bool:
        """Whether a stream's message waits, and no datagram of it has left."""
        flow = self._flow(stream)
        return bool(flow.parts) and not flow.part and not flow.at

    def takes(self, stream: str) -> float:
        """How long it takes until the message of a stream has left, if nothing else comes, at the present rate [s]."""
        flow = self._flow(stream)
        if self.rate is None or not flow.parts:
            return 0.0
        return sum(other.left if other.deadline <= flow.deadline else other.base
                   for other in self._flows.values()) / self.rate

    def charge(self, size: int, now: float) -> None:
        """Account for bytes sent past the scheduler. What waits here makes room for them, but for MAX_DEBT at most."""
        if self.rate is not None:
            before = self._full_at
            self._spend(size, now, self.rate)
            self._full_at = min(self._full_at, max(before, now + MAX_DEBT))

    def wait(self, now: float) -> float:
        """How long until something may leave [s]; infinite where nothing waits."""
        return self._next(now)[0]

    def take(self, now: float) -> Optional[Chunk]:
        """The chunk that leaves now; None: nothing may."""
        wait, name, count = self._next(now)
        if wait > 0:
            return None
        flow, rate = self._flows[name], self._pacing_rate()
        size = count * flow.parts[flow.part][1]
        waiting = math.fsum(other.left for other in self._flows.values())
        chunk = Chunk(name, flow.work, flow.part, flow.at, flow.at + count, size, flow.parts[flow.part][0], waiting)
        self._pass_time(size)
        flow.advance(count)
        if rate is not None:
            self._spend(size, now, rate)
            self._probe_left -= size
        self._backlogged = self._waiting()
        return chunk

    def _next(self, now: float) -> Tuple[float, str, int]:
        """(time until it may leave [s], stream, number of datagrams)"""
        waiting = [(*flow.order, name) for name, flow in self._flows.items() if flow.parts]
        if not waiting:
            return math.inf, '', 0
        name = min(waiting)[-1]
        flow, rate = self._flows[name], self._pacing_rate()
        count, size = flow.parts[flow.part]
        if rate is None:
            return 0.0, name, min(count - flow.at, MAX_CHUNK_SIZE // size or 1)
        most = min(MAX_CHUNK_SIZE, self.burst, rate * CHUNK_DURATION)
        count = max(1, min(count - flow.at, int(most // size)))
        bucket = max(count * size, min(self.burst, rate * BURST_DURATION), self._tokens)
        return max(0.0, self._full_at + (count * size - bucket) / rate - now), name, count

    def _pacing_rate(self) -> Optional[float]:
        return self._probe_rate if self.rate is not None and self._probe_left > 0 else self.rate

    def _spend(self, size: int, now: float, rate: float) -> None:
        self._full_at = max(now - MAX_CATCH_UP * self._backlogged, self._full_at) + size / rate

    def _pass_time(self, size: float) -> None:
        """Let virtual time pass while bytes leave: in turns, the streams that were still sending would get them."""
        while size > 0:
            sending = [flow for flow in self._flows.values() if flow.deadline > self._virtual]
            if not sending:
                return
            shares, until = sum(flow.share for flow in sending), min(flow.deadline for flow in sending)
            room = (until - self._virtual) * shares
            self._virtual = until if room <= size else self._virtual + size / shares
            size -= room

    def _waiting(self) -> bool:
        return any(flow.parts for flow in self._flows.values())

    def _clear(self, stream: str) -> None:
        flow = self._flow(stream)
        if flow.parts:
            self.dropped[stream] = self.dropped.get(stream, 0) + sum(count for count, _ in flow.remaining())
            flow.load(None, [], 0.0)

    def _flow(self, stream: str) -> _Flow:
        return self._flows.setdefault(stream, _Flow())


def _checked(rate: Optional[float]) -> Optional[float]:
    if rate is not None and not 0 < rate < math.inf:
        raise ValueError('rate is %r, must be positive and finite' % rate)
    return rate
