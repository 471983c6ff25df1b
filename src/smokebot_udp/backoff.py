# SPDX-License-Identifier: BSD-3-Clause
"""How long to wait before something is tried again."""


class Backoff:
    """Intervals that double, from the first to the longest one [s]."""

    def __init__(self, first: float, longest: float) -> None:
        self._first, self._longest = first, longest
        self.interval = first
        """The next one [s]."""

    def take(self) -> float:
        """The next interval [s]; the one after it is longer."""
        interval, self.interval = self.interval, min(2 * self.interval, self._longest)
        return interval

    def reset(self) -> None:
        """Begin with the first interval again."""
        self.interval = self._first
