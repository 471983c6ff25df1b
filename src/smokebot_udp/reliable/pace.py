# SPDX-License-Identifier: BSD-3-Clause
"""How fast a node sends what is reliable: a token bucket that yields to everything else on the link.

As in LEDBAT (RFC 6817) a round trip that is longer than usual shows that a queue is filling: then the rate falls, long
before datagrams are lost. It recovers while there is no queue.
"""
import math

MAX_RATE = 128e3
"""Maximum rate, however fast the link is [byte/s]."""

BURST_DURATION = 0.1
"""After a pause, what the rate allows in this time may leave at once [s]."""

MIN_BURST, EXPEDITED_BURST = 3000.0, 12800.0
"""Size that may leave at once after a pause even at a low rate: usually, and where somebody waits for it [byte]."""

UNKNOWN_ROUND_TRIP = 0.2
"""Round trip that is assumed at most, and before it is measured [s]."""

TARGET = 0.06
"""Time that may be spent in queues; RFC 6817 allows 0.1 s [s]."""

SAMPLES, PERIOD = 10, 0.5
"""The shortest of this number of round trips at least, over this time, tells of a queue: a busy machine delays some of
them, as RFC 6817's CURRENT_FILTER has it [1, s]."""

MIN_DECREASE, DECREASE, INCREASE = 0.5, 0.8, 1.2
"""Factors of the rate, applied once in a PERIOD, or in a round trip where that is longer. MIN_DECREASE applies where
the queue is more than twice as long as it may be."""

MIN_WINDOW = 2800.0
"""Size of what may be on its way to one peer, at least: two long segments [byte]."""

MIN_RATE, MOST_LOSS = 16e3, 0.5
"""Minimum rate, however full the queue is: what 50 short messages a second take without loss. Losses are no sign of a
queue, and raise it: by as much as it takes to repeat what is lost, up to this loss [byte/s, 1]."""


class Pace:
    """Pace of all reliable segments of a node, acknowledgements included: these never wait, but count.

    :param limit: of the rate, without a queue [byte/s]; may be set at any time
    :param burst: what a pause lets through at once, if that is more [byte]
    """

    def __init__(self, limit: float = MAX_RATE, burst: float = MIN_BURST) -> None:
        self.limit, self._least_burst = limit, burst
        self.most_burst = math.inf
        """What a pause lets through at once, at most; but always a segment. May be set at any time [byte]."""
        self._factor, self._floor, self._next_change = 1.0, MIN_RATE, 0.0
        self._samples, self._excess = 0, math.inf   # since the last change
        self._level, self._at = self._burst, 0.0    # the level may be negative [byte]

    @property
    def rate(self) -> float:
        """Current rate [byte/s]."""
        return max(self.limit * self._factor, min(self._floor, self.limit))

    @property
    def _burst(self) -> float:
        return min(max(self._least_burst, BURST_DURATION * self.rate), self.most_burst)

    def observe(self, round_trip: float, least: float, loss: float, now: float) -> None:
        """Take a measured round trip.

        :param least: the shortest one of that peer [s]
        :param loss: of what is sent to it, 0..1
        """
        self._samples, self._excess = self._samples + 1, min(self._excess, round_trip - least)
        if now < self._next_change or self._samples < SAMPLES:
            return
        self._fill(now)
        change = INCREASE if self._excess <= TARGET else DECREASE if self._excess <= 2 * TARGET else MIN_DECREASE
        # as many are lost on the way back
        self._floor = MIN_RATE / (1 - min(loss, MOST_LOSS)) ** 2
        self._factor = min(1.0, max(self._floor / self.limit, self._factor * change))
        self._samples, self._excess, self._next_change = 0, math.inf, now + max(PERIOD, round_trip)

    def window(self, least: float) -> float:
        """What may be on its way to a peer: more could only wait in a queue [byte].

        :param least: its shortest round trip [s]; infinite: unknown
        """
        return max(MIN_WINDOW, self.rate * (min(least, UNKNOWN_ROUND_TRIP) + TARGET))

    def charge(self, size: int, now: float) -> None:
        """Count what was sent [byte]."""
        self._fill(now)
        self._level = max(self._level - size, -max(self._burst, size))

    def free(self, now: float) -> bool:
        """Whether more may be sent."""
        self._fill(now)
        return self._level > 0

    @property
    def free_at(self) -> float:
        """When more may be sent [s]."""
        return self._at if self._level > 0 else self._at + (1.0 - self._level) / self.rate

    def _fill(self, now: float) -> None:
        self._level = min(self._burst, self._level + max(0.0, now - self._at) * self.rate)
        self._at = max(self._at, now)
