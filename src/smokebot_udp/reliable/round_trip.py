# SPDX-License-Identifier: BSD-3-Clause
"""When a segment without an acknowledgement is sent again: RFC 6298, by the measured round trip.

Acknowledgements name the very datagram that caused them, so each of them measures, also those of segments that were
sent several times (RFC 6298 has to leave these out). The timeout is not doubled with each loss: a lossy link is no
congested one. It grows with the time for which nothing was heard at all, so a link that is cut is asked rarely.
"""
import math
from typing import Optional

MIN_TIMEOUT, INITIAL_TIMEOUT, MAX_TIMEOUT = 0.02, 0.25, 1.0
"""Bounds of the timeout, and its value before anything is measured. MAX_TIMEOUT is exceeded only where the round trip
itself takes longer [s]."""

MAX_FACTOR = 1.5
"""The timeout may exceed MAX_TIMEOUT up to this multiple of the round trip. Otherwise everything that waits in a queue
would be sent again."""

GRANULARITY = 0.005
"""Timing granularity of the threads that send and receive [s]."""

ALPHA, BETA, K = 1 / 8, 1 / 4, 4
"""Constants of RFC 6298, section 2."""

SILENCE_FACTOR = 0.25
"""The interval between retransmissions is at least this part of the time for which nothing was heard."""

FORGETTING = 0.001
"""Part of the difference by which each sample raises the shortest round trip."""

MAX_SAMPLE = 10.0
"""A longer round trip is not believed [s]."""


class RoundTrip:
    """The round trip to one peer, and what follows from it."""

    def __init__(self) -> None:
        self.smoothed: Optional[float] = None
        """[s]; None: not measured yet."""
        self.least = math.inf
        """The shortest one; it follows slowly where the route has become longer [s]."""
        self._variation = 0.0

    def add(self, sample: float) -> None:
        """Take a measured round trip [s]; an impossible one has no effect."""
        if not 0 <= sample <= MAX_SAMPLE:
            return
        self.least = sample if sample < self.least else self.least + FORGETTING * (sample - self.least)
        if self.smoothed is None:
            self.smoothed, self._variation = sample, sample / 2
        else:
            self._variation += BETA * (abs(self.smoothed - sample) - self._variation)
            self.smoothed += ALPHA * (sample - self.smoothed)

    @property
    def timeout(self) -> float:
        """RFC 6298's retransmission timeout [s]."""
        if self.smoothed is None:
            return INITIAL_TIMEOUT
        timeout = self.smoothed + max(GRANULARITY, K * self._variation)
        return min(max(timeout, MIN_TIMEOUT), max(MAX_TIMEOUT, MAX_FACTOR * self.smoothed))

    def interval(self, silence: float) -> float:
        """Time until a segment is sent again [s].

        :param silence: time since the peer was heard, while it had something to answer [s]
        """
        return max(self.timeout, min(SILENCE_FACTOR * silence, MAX_TIMEOUT))
