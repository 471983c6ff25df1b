# SPDX-License-Identifier: BSD-3-Clause
"""Limits the rate of messages; the clock is an argument [s, any steady clock]."""


class RateLimiter:
    """Lets `rate` messages a second through on average; one period of slack absorbs the jitter of a source.

    The rate may change at any time. What was let through before still counts: a new rate takes effect from the last
    message on, so that frequent changes let nothing more through.

    :param rate: [Hz], > 0
    """

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self._last = float('-inf')      # when the last message was due

    @property
    def due(self) -> float:
        """When the next message may go [s]."""
        return self._last + 1.0 / self.rate

    def wait(self, now: float) -> float:
        """How long until the next message may go [s]."""
        return max(0.0, self.due - now)

    def take(self, now: float) -> None:
        """A message goes now."""
        # a clock that stepped back must not hold messages for longer than a period
        self._last = min(max(self.due, now - 1.0 / self.rate), now)
