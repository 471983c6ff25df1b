# SPDX-License-Identifier: BSD-3-Clause
"""Limits a byte rate; the clock is an argument [s, any steady clock]."""
import math

BURST = 0.1
"""After a pause, what the rate has in this time may leave at once [s]."""

AVERAGED = 3.0
"""What leaves is averaged over this time (time constant) [s]."""


class Pace:
    """A token bucket. A datagram may leave while anything is left in it, and is charged in full.

    :param rate: [byte/s], > 0
    """

    def __init__(self, rate: float) -> None:
        self.rate = rate
        """Changed by `set_rate` [byte/s]."""
        self._full_at = -math.inf       # when the bucket is full again, if nothing more leaves [s]
        self._average, self._averaged_at = 0.0, 0.0

    def set_rate(self, rate: float, now: float) -> None:
        """Change the rate [byte/s]; what left before still counts, in bytes."""
        missing = max(0.0, self._full_at - now)
        self._full_at = now + missing * self.rate / rate
        self.rate = rate

    def wait(self, now: float) -> float:
        """How long until a datagram may leave [s]."""
        return max(0.0, self._full_at - BURST - now)

    def take(self, size: int, now: float) -> None:
        """A datagram leaves now.

        :param size: on the air [byte]
        """
        self._full_at = max(now, self._full_at) + size / self.rate
        self._average, self._averaged_at = self.average(now) + size / AVERAGED, now

    def average(self, now: float) -> float:
        """What left, averaged [byte/s]."""
        return self._average * math.exp(-max(0.0, now - self._averaged_at) / AVERAGED)
