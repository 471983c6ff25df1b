# SPDX-License-Identifier: BSD-3-Clause
"""Paths that link_lab's Channel is not: a Wi-Fi that sends in aggregates, and a kernel's token bucket. They have a
Channel's `fate`, `waits` and `counts`. Time is an argument; what is random is seeded.
"""
import collections
import random
from typing import Deque, Iterator, Protocol, Tuple

from smokebot_udp.link_lab.channel import Counts

TURN = 0.004, 0.008
"""Duration of our station's turns on the air: an 802.11n aggregate of 4 ms, or two [s]."""

OTHERS_TURN = 0.003
"""Mean duration of the others' turns in between, exponentially distributed [s]."""

MAX_OTHERS_TURN = 0.03
"""[s]"""


class Path(Protocol):
    """What a simulated robot sends over."""

    @property
    def counts(self) -> Counts:
        """What became of the datagrams until now."""

    def fate(self, now: float, size: int) -> Tuple[float, ...]:
        """When a datagram of this size [byte] that enters now is delivered: no, one or more times [s]."""

    def waits(self, now: float) -> float:
        """How long a datagram that enters now waits for its transmission [s]."""


class AggregatingAir:
    """An air on which our station and others take turns. A turn's datagrams arrive together, at its end, as the
    receiver hands an aggregate up as a whole (802.11n, A-MPDU).

    :param rate: what our station can send, all turns included [bit/s]
    :param delay: one way [s]
    :param queue: length of the queue before the air; a full one drops new datagrams [s]
    """

    def __init__(self, rate: float, delay: float, queue: float, seed: object = 0) -> None:
        self.counts = Counts()
        self._draw = random.Random('%s turns' % seed)
        # the mean of an exponential distribution that is cut off is a little shorter
        duty = sum(TURN) / (sum(TURN) + 2 * OTHERS_TURN)
        self._rate, self._delay, self._queue = rate / 8 / duty, delay, queue
        self._turns = self._next_turns()
        self._turn = next(self._turns)
        self._idle_from = 0.0       # end of the transmission of all queued datagrams [s]

    def waits(self, now: float) -> float:
        """How long a datagram that enters now waits until those before it have been transmitted [s]."""
        return max(0.0, self._idle_from - now)

    def fate(self, now: float, size: int) -> Tuple[float, ...]:
        """When a datagram that enters now is delivered."""
        self.counts.offered += 1
        if self.waits(now) > self._queue:
            self.counts.dropped += 1
            return ()
        begins, left = max(now, self._idle_from), size / self._rate
        while max(begins, self._turn[0]) + left > self._turn[1]:
            left -= max(0.0, self._turn[1] - max(begins, self._turn[0]))
            self._turn = next(self._turns)
        self._idle_from = max(begins, self._turn[0]) + left
        self.counts.carried += size
        self.counts.delivered += 1
        return (self._turn[1] + self._delay,)

    def _next_turns(self) -> Iterator[Tuple[float, float]]:
        ends = 0.0
        while True:
            begins = ends + min(MAX_OTHERS_TURN, self._draw.expovariate(1 / OTHERS_TURN))
            ends = begins + self._draw.uniform(*TURN)
            yield begins, ends


class TokenBucket:
    """A shaper as the kernel's tbf: up to `burst` bytes pass at once, the rest at the rate; what does not fit its queue
    is dropped.

    :param rate: of the tokens [bit/s]
    :param burst: most tokens [byte]
    :param delay: one way [s]
    :param queue: what the queue holds beside the burst, at the rate: tbf's `latency` [s]
    :param loss: packet-loss ratio behind the shaper
    """

    def __init__(self, rate: float, burst: float, delay: float, queue: float, loss: float = 0.0,
                 seed: object = 0) -> None:
        self.counts = Counts()
        self.rate, self._burst, self._delay, self._queue = rate / 8, burst, delay, queue
        """Rate of the tokens, which may be changed at any time [byte/s]."""
        self._loss, self._draw = loss, random.Random('%s loss' % seed)
        self._tokens, self._at = burst, 0.0     # as they are when the last datagram has left
        self._waiting: Deque[Tuple[float, int]] = collections.deque()   # (when it leaves, size)

    def waits(self, now: float) -> float:
        """How long a datagram that enters now waits for those before it [s]."""
        return max(0.0, self._at - now)

    def fate(self, now: float, size: int) -> Tuple[float, ...]:
        """When a datagram that enters now is delivered."""
        self.counts.offered += 1
        while self._waiting and self._waiting[0][0] <= now:
            self._waiting.popleft()
        if sum(other for _, other in self._waiting) + size > self.rate * self._queue + self._burst:
            self.counts.dropped += 1
            return ()
        begins = max(now, self._at)
        tokens = min(self._burst, self._tokens + (begins - self._at) * self.rate)
        leaves = begins + max(0.0, size - tokens) / self.rate
        self._tokens, self._at = tokens + (leaves - begins) * self.rate - size, leaves
        self._waiting.append((leaves, size))
        self.counts.carried += size
        if self._draw.random() < self._loss:
            self.counts.lost += 1
            return ()
        self.counts.delivered += 1
        return (leaves + self._delay,)
