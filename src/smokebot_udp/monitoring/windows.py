# SPDX-License-Identifier: BSD-3-Clause
"""Sliding windows over counters and over samples, in bounded memory.

Time is an argument: seconds of a monotonic clock.
"""
import collections
import math
from typing import Deque, Dict, Mapping, Optional, Tuple

import numpy as np

WINDOW = 5.0
"""Default length of a window [s]."""


class Rate:
    """The rate at which a counter grows, from its readings.

    A reading below the last one means that the counter restarted from 0, for example with a new connection. The first
    reading is the reference and adds no growth.

    :param window: [s]
    :param max_readings: the window is shorter if more readings than these come in it
    """

    def __init__(self, window: float = WINDOW, max_readings: int = 64) -> None:
        self._window = window
        self._points: Deque[Tuple[float, int]] = collections.deque(maxlen=max_readings)
        """(time [s], growth since the first reading)"""
        self._last: Optional[int] = None

    def read(self, total: Optional[int], now: float) -> None:
        """Take a reading of the counter; None, an unknown value, is ignored."""
        if total is None:
            return
        growth = self._points[-1][1] if self._points else 0
        if self._last is not None:
            growth += total - self._last if total >= self._last else total
        self._last = total
        if self._points and now <= self._points[-1][0]:
            self._points[-1] = self._points[-1][0], growth
            return
        self._points.append((now, growth))
        # a rate needs two points: the newest of those that have left the window stays
        while len(self._points) > 2 and self._points[1][0] <= now - self._window:
            self._points.popleft()

    @property
    def growth(self) -> int:
        """Growth within the window; 0 before the second reading."""
        return self._points[-1][1] - self._points[0][1] if self._points else 0

    @property
    def per_second(self) -> Optional[float]:
        """Mean growth per second within the window; None before the second reading."""
        if len(self._points) < 2:
            return None
        return self.growth / (self._points[-1][0] - self._points[0][0])


class Growths:
    """The growth of several counters within the window."""

    def __init__(self) -> None:
        self._rates: Dict[str, Rate] = {}

    def update(self, totals: Mapping[str, int], now: float) -> Dict[str, int]:
        """{name: growth} of the counters that have grown within the window, sorted by name; a new one begins at 0."""
        for name, total in totals.items():
            if name not in self._rates:
                self._rates[name] = Rate()
                self._rates[name].read(0, now - WINDOW)
            self._rates[name].read(total, now)
        return {name: rate.growth for name, rate in sorted(self._rates.items()) if rate.growth}


class Samples:
    """Percentiles of the samples within the window.

    :param window: [s]
    :param max_samples: number of samples kept, the newest ones
    """

    def __init__(self, window: float = WINDOW, max_samples: int = 512) -> None:
        self._window = window
        self._samples: Deque[Tuple[float, float]] = collections.deque(maxlen=max_samples)   # (time [s], value)

    def add(self, value: Optional[float], now: float) -> None:
        """Add a sample; None and values that are not finite are ignored."""
        if value is not None and math.isfinite(value):
            self._samples.append((now, value))

    def percentile(self, percent: float, now: float) -> Optional[float]:
        """The percentile, linearly interpolated; None without samples."""
        while self._samples and self._samples[0][0] < now - self._window:
            self._samples.popleft()
        return float(np.percentile([value for _, value in self._samples], percent)) if self._samples else None


class Silence:
    """How long a counter has not changed, compared with how often it usually changes.

    :param now: start of the observation [s]
    :param window: period over which the usual rate is measured [s]
    """

    def __init__(self, now: float, window: float = 30.0) -> None:
        self._total: Optional[int] = None
        self._since, self._usual = now, Rate(window)

    def read(self, total: int, now: float) -> None:
        """Take a reading of the counter."""
        changed = total != 0 and total != self._total
        if changed:
            self._since = now
        if changed or self._total is None:
            self._usual.read(total, now)    # a lasting silence must not lower the usual rate
        self._total = total

    def reset(self, now: float) -> None:
        """Start the silence anew: until now no change was expected."""
        self._since = now

    def too_long(self, now: float, limit: float) -> Optional[float]:
        """The length of the silence if it exceeds both `limit` and three usual periods, otherwise None [s].

        :param limit: [s]
        """
        usual, silence = self._usual.per_second, now - self._since
        return silence if silence > max(limit, 3 / usual if usual else 0) else None
