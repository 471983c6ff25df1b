# SPDX-License-Identifier: BSD-3-Clause
"""The other machine's clock, from echoes over a lossy link with queues: an offset, and how far it may be wrong.

As NTP (RFC 5905, 8 and 10): a question leaves here at `asked` and comes there at `received`, its answer leaves there at
`answered` and comes here at `came`. Where both ways take the same time the offset is exact; however unlike they are it
is wrong by at most half the round trip. So the exchange that says most is the one with the least round trip, and each
says less as it ages, for clocks drift apart.
"""
import collections
import math
from typing import NamedTuple

DRIFT = 1e-4
"""How fast two clocks may part: 50 ppm each, what cheap crystals keep [s/s]."""

SLACK = 1e-3
"""Exchanges that differ by no more than this beyond what they may are no contradiction: clocks are read late [s]."""

CONFIRMED = 3
"""So many exchanges in a row that contradict the estimate, but not one another, are right: a clock has jumped."""

KEPT = 128
"""Exchanges at most."""


class Exchange(NamedTuple):
    offset: float
    """The other clock minus this one [s]."""
    round_trip: float
    """[s]"""
    at: float
    """When its answer came, by the steady clock [s]."""

    def uncertainty(self, now):
        """How far the offset may be wrong [s]."""
        return self.round_trip / 2 + DRIFT * (now - self.at)

    def contradicts(self, other):
        """Whether no pair of clocks that run steadily makes both."""
        now = max(self.at, other.at)
        return abs(self.offset - other.offset) > self.uncertainty(now) + other.uncertainty(now) + SLACK


class ClockOffset:
    """Estimates the other machine's clock offset.

    :param window: exchanges older than this are forgotten, and the estimate is valid for so long [s]
    :param longest: longer round trips are refused: a clock jumped between asking and hearing, or they tell nothing [s]
    """

    def __init__(self, window=60.0, longest=10.0):
        self.window, self.longest = window, longest
        self.refused = collections.Counter()
        """Exchanges that changed nothing, by reason: no time, order, round trip, contradiction."""
        self.jumps = 0
        """So often a clock was found to have jumped."""
        self._exchanges = collections.deque(maxlen=KEPT)
        self._contradicting = []
        self._best = None

    @property
    def offset(self):
        """The other clock minus this one; None before the first good exchange [s]."""
        return self._best and self._best.offset

    @property
    def round_trip(self):
        """Of the exchange that the offset is from; None before the first [s]."""
        return self._best and self._best.round_trip

    def uncertainty(self, now):
        """How far the offset may be wrong; infinite before the first exchange [s]."""
        return self._best.uncertainty(now) if self._best else math.inf

    def valid(self, now):
        """Whether the offset is known, from an exchange in the window."""
        return self._best is not None and 0 <= now - self._exchanges[-1].at <= self.window

    def add(self, asked, received, answered, came, now):
        """Take an exchange; what is impossible is refused and counted, and nothing is raised.

        :param asked, came: by this machine's clock [s since its epoch]
        :param received, answered: by the other's [s since its epoch]
        :param now: by a steady clock of this machine, which does not jump [s]
        :return: whether it counts
        """
        exchange = self._checked(asked, received, answered, came, now)
        return exchange is not None and self._take(exchange, now)

    def _checked(self, asked, received, answered, came, now):
        times = asked, received, answered, came
        if not (all(map(math.isfinite, times + (now,))) and all(0 < time < 2 ** 33 for time in times)):
            self.refused['no time'] += 1    # ROS' time is 0 where it was not set, and never above 32 bits of seconds
        elif came < asked or answered < received:
            self.refused['order'] += 1
        elif not 0 <= (came - asked) - (answered - received) <= self.longest:
            self.refused['round trip'] += 1
        else:
            return Exchange(((received - asked) + (answered - came)) / 2, (came - asked) - (answered - received), now)
        return None

    def _take(self, exchange, now):
        while self._exchanges and now - self._exchanges[0].at > self.window:
            self._exchanges.popleft()
        if self._exchanges and exchange.contradicts(self._best):
            if any(map(exchange.contradicts, self._contradicting)):
                self._contradicting.clear()
            self._contradicting.append(exchange)
            if len(self._contradicting) < CONFIRMED:
                self.refused['contradiction'] += 1
                return False
            self.jumps += 1
            self._exchanges.clear()
            self._exchanges.extend(self._contradicting)
        else:
            self._exchanges.append(exchange)
        self._contradicting.clear()
        self._best = min(self._exchanges, key=lambda known: known.uncertainty(now))
        return True
