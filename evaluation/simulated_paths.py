# SPDX-License-Identifier: BSD-3-Clause
"""A path that link_lab's Channel is not: a Wi-Fi that sends in aggregates. It has a Channel's `fate`, `waits` and
`counts`. Time is an argument; what is random is seeded.
"""
import random
from typing import Iterator, Protocol, Tuple

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
