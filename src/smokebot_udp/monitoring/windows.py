# SPDX-License-Identifier: BSD-3-Clause
"""Sliding windows over counters and over samples, in bounded memory, and the limits they are held against.

Time is an argument, of a clock that is steady.
"""
import collections
import math
from dataclasses import dataclass, fields

OK, WARN, ERROR = 0, 1, 2
"""Levels, as diagnostic_msgs/DiagnosticStatus has them."""

WINDOW = 5.0
"""What is told is of so long [s]."""


class Rate:
    """How fast a counter grows, from its readings.

    A counter that reads less than before began anew, as one does whose connection was made again: what it reads then
    is how much it grew. The first reading only tells where it stands.

    :param window: [s]
    :param most: readings kept; where more come the window is shorter
    """

    def __init__(self, window=WINDOW, most=64):
        self._window = window
        self._points = collections.deque(maxlen=most)   # (when [s], how much it has grown since the first reading)
        self._last = None

    def read(self, total, now):
        """Take a reading.

        :param total: of the counter; None, where it cannot be read, is none
        :param now: [s]
        """
        if total is None:
            return
        grown = self._points[-1][1] if self._points else 0
        if self._last is not None:
            grown += total - self._last if total >= self._last else total
        self._last = total
        if self._points and now <= self._points[-1][0]:
            self._points[-1] = self._points[-1][0], grown
            return
        self._points.append((now, grown))
        # one point as old as the window stays: rates are between points
        while len(self._points) > 2 and self._points[1][0] <= now - self._window:
            self._points.popleft()

    @property
    def growth(self):
        """How much it grew in the window; 0 before the second reading."""
        return self._points[-1][1] - self._points[0][1] if self._points else 0

    @property
    def per_second(self):
        """How much it grows a second, over the window; None before the second reading."""
        if len(self._points) < 2:
            return None
        return self.growth / (self._points[-1][0] - self._points[0][0])


class Rates:
    """Several counters by name.

    :param names: of the counters
    """

    def __init__(self, *names):
        self._rates = {name: Rate() for name in names}

    def read(self, totals, now):
        """Take readings: {name: total}; names that are none of the counters are passed over."""
        for name, rate in self._rates.items():
            rate.read(totals.get(name), now)

    def growth(self, name):
        return self._rates[name].growth

    def per_second(self, name):
        return self._rates[name].per_second


def share(part, whole):
    """A part of a whole, 0..1; None where there is nothing."""
    return part / whole if whole else None


class Samples:
    """Percentiles of what came in the window.

    :param window: [s]
    :param most: samples kept, the newest
    """

    def __init__(self, window=WINDOW, most=512):
        self._window = window
        self._samples = collections.deque(maxlen=most)  # (when [s], value)

    def add(self, value, now):
        """Take a sample; None and what is not finite are none."""
        if value is not None and math.isfinite(value):
            self._samples.append((now, value))

    def percentile(self, percent, now):
        """The least value that so many percent of the samples do not exceed; None where there is none."""
        while self._samples and self._samples[0][0] < now - self._window:
            self._samples.popleft()
        values = sorted(value for _, value in self._samples)
        return values[max(0, math.ceil(len(values) * percent / 100) - 1)] if values else None


class Silence:
    """How long a counter has stood still, and whether that is longer than is usual for it.

    :param now: since when it is watched [s]
    :param usual: over so long it is learnt how often it counts [s]
    """

    def __init__(self, now, usual=30.0):
        self._total, self._since, self._usual = None, now, Rate(usual)

    def read(self, total, now):
        """Take a reading; None is none."""
        counted = total and total != self._total
        if counted:
            self._since = now
        if counted or self._total is None:
            self._usual.read(total, now)    # a silence that lasts must not become what is usual
        self._total = total

    def forgive(self, now):
        """Until now nothing was to be expected."""
        self._since = now

    def too_long(self, now, limit):
        """How long it has been silent, where that is longer than a limit and than three usual periods; else None.

        :param limit: [s]
        :return: [s]
        """
        usual, silence = self._usual.per_second, now - self._since
        return silence if silence > max(limit, 3 / usual if usual else 0) else None


@dataclass(frozen=True)
class Limits:
    """From where on a stream is no longer OK; units as in nodes/diagnostics.py's head."""
    warn_loss: float = 0.3
    error_loss: float = 0.7
    warn_completeness: float = 0.5
    warn_age: float = 0.5
    error_age: float = 2.0
    error_silence: float = 2.0

    def changed(self, values):
        """These limits, as far as values say no other.

        :param values: {name: value} as from the parameter server; names that are no limits are passed over
        :return: (Limits, [problem, ...]): what is no number from 0 on is left as it is
        """
        good, problems = {}, []
        for name in (field.name for field in fields(self)):
            value = values.get(name, 0.0)
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not (number and math.isfinite(value) and value >= 0):
                problems.append('%s is %r, must be a number from 0: %g is used' % (name, value, getattr(self, name)))
            elif name in values:
                good[name] = float(value)
        return Limits(**{**self.__dict__, **good}), problems


class Verdict:
    """The worst level, and all that is wrong."""

    def __init__(self):
        self.level, self.problems = OK, []

    def find(self, level, problem):
        """Something is wrong, in words."""
        self.level = max(self.level, level)
        self.problems.append(problem)

    def at_least(self, value, warn, error, problem, scale):
        """Judge a value; None is not judged.

        :param warn, error: the levels are these from here on
        :param problem: in words with one %f, the value times `scale`
        """
        if value is not None and value >= warn:
            self.find(ERROR if value >= error else WARN, problem % (value * scale))

    def __str__(self):
        return ', '.join(self.problems)
