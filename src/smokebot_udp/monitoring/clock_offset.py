# SPDX-License-Identifier: BSD-3-Clause
"""Estimates the offset of another machine's clock, with its uncertainty, from echoes over a lossy link with queues.

The method is NTP's (RFC 5905, sections 8 and 10): a request is sent at `asked` and received at `received`, its reply is
sent at `answered` and received at `came`. The offset is exact if both directions take the same time, and never wrong
by more than half the round trip. The exchange with the shortest round trip is therefore the best one. Its uncertainty
grows with its age because clocks drift.
"""
import collections
import math
from typing import Counter, Deque, List, NamedTuple, Optional

from .clock_rate import EXCHANGES, ClockLine, Sample, clock_line

DRIFT = 1e-4
"""Maximum relative drift of two clocks: 50 ppm each, typical of cheap crystals [s/s]."""

SLACK = 1e-3
"""Tolerance beyond the uncertainty before two exchanges contradict each other: clocks are read late [s]."""

CONFIRMATIONS = 3
"""Number of consecutive exchanges that contradict the estimate, but not one another, that prove a clock jump."""

MAX_EXCHANGES = 128

MAX_ROUND_TRIP = 10.0
"""Exchanges with a longer round trip are refused: a clock jumped meanwhile, or they are useless [s]."""

MAX_EXTRAPOLATION = 10.0
"""The offset of a clock of another rate is unknown this long after an exchange [s]."""


class Exchange(NamedTuple):
    """One request and its reply."""
    offset: float
    """The other clock minus this one [s]."""
    round_trip: float
    """[s]"""
    at: float
    """When the reply was received, by the monotonic clock [s]."""

    def uncertainty(self, now: float) -> float:
        """Maximum error of the offset [s]."""
        return self.round_trip / 2 + DRIFT * (now - self.at)

    def contradicts(self, other: 'Exchange') -> bool:
        """Whether no pair of steadily running clocks explains both exchanges."""
        now = max(self.at, other.at)
        return abs(self.offset - other.offset) > self.uncertainty(now) + other.uncertainty(now) + SLACK


class ClockEstimate(NamedTuple):
    """The estimate of the other clock."""
    offset: float
    """The other clock minus this one [s]."""
    round_trip: float
    """Round-trip time of the exchange that gave the offset [s]."""
    uncertainty: float
    """Maximum error of the offset [s]."""


class ClockOffset:
    """Estimates the offset of the other machine's clock.

    :param window: maximum age of an exchange, and validity of the estimate [s]
    :param any_rate: whether the clocks may run at different rates, as a simulation's does
    """

    def __init__(self, window: float = 60.0, any_rate: bool = False) -> None:
        self._window, self._any_rate = window, any_rate
        self.refused: Counter[str] = collections.Counter()
        """Exchanges without effect, by reason: no time, order, round trip, contradiction."""
        self.jumps = 0
        """Number of detected clock jumps."""
        self._exchanges: Deque[Exchange] = collections.deque(maxlen=MAX_EXCHANGES)
        self._contradicting: List[Exchange] = []
        self.best: Optional[Exchange] = None
        """The exchange that gives the offset; None before the first good one."""
        self._last: Deque[Sample] = collections.deque(maxlen=EXCHANGES)     # also those that contradict
        self._line: Optional[ClockLine] = None
        self._refuted = 0       # exchanges in a row that contradict the estimate

    @property
    def refuted(self) -> bool:
        """Whether the last exchanges contradict all that could be an estimate."""
        return self._refuted >= CONFIRMATIONS and self._line is None

    @property
    def exchanges(self) -> int:
        """Number of exchanges kept."""
        return len(self._exchanges)

    @property
    def doubtful(self) -> bool:
        """Whether the last exchange contradicts the estimate: one of the clocks may have been set."""
        return bool(self._contradicting)

    def estimate(self, now: float) -> Optional[ClockEstimate]:
        """The estimate; None without a good exchange in the window, or where the last ones refute it."""
        line = self._line
        if line is not None and now - line.newest <= MAX_EXTRAPOLATION:
            return ClockEstimate(line.offset_at(now), 2 * self._last[-1].error, line.error_at(now))
        if self.best is None or self.refuted or not 0 <= now - self._exchanges[-1].at <= self._window:
            return None
        return ClockEstimate(self.best.offset, self.best.round_trip, self.best.uncertainty(now))

    def add(self, asked: float, received: float, answered: float, came: float, now: float) -> bool:
        """Add an exchange. Impossible ones are refused and counted; nothing is raised.

        :param asked, came: by this machine's clock [s since its epoch]
        :param received, answered: by the other machine's clock [s since its epoch]
        :param now: by this machine's monotonic clock [s]
        :return: whether the exchange is used
        """
        exchange = self._checked(asked, received, answered, came, now)
        return exchange is not None and self._use(exchange, now)

    def _checked(self, asked: float, received: float, answered: float, came: float, now: float) -> Optional[Exchange]:
        times = asked, received, answered, came
        if not (all(map(math.isfinite, times + (now,))) and all(0 < time < 2 ** 33 for time in times)):
            self.refused['no time'] += 1    # a ROS time is 0 if it was not set, and has at most 32 bits of seconds
        elif came < asked or answered < received:
            self.refused['order'] += 1
        elif not 0 <= (came - asked) - (answered - received) <= MAX_ROUND_TRIP:
            self.refused['round trip'] += 1
        else:
            return Exchange(((received - asked) + (answered - came)) / 2, (came - asked) - (answered - received), now)
        return None

    def _use(self, exchange: Exchange, now: float) -> bool:
        used = self._fits(exchange, now)
        self._refuted = 0 if used else self._refuted + 1
        if self._any_rate:
            self._last.append(Sample(exchange.at, exchange.offset, exchange.round_trip / 2))
            self._line = clock_line(self._last)
        return used or self._line is not None

    def _fits(self, exchange: Exchange, now: float) -> bool:
        """Whether an exchange is one of a clock of about this rate; the estimate then follows it."""
        while self._exchanges and now - self._exchanges[0].at > self._window:
            self._exchanges.popleft()
        if self._exchanges and self.best is not None and exchange.contradicts(self.best):
            if any(map(exchange.contradicts, self._contradicting)):
                self._contradicting.clear()
            self._contradicting.append(exchange)
            if len(self._contradicting) < CONFIRMATIONS:
                self.refused['contradiction'] += 1
                return False
            self.jumps += 1
            self._exchanges.clear()
            self._exchanges.extend(self._contradicting)
        else:
            self._exchanges.append(exchange)
        self._contradicting.clear()
        self.best = min(self._exchanges, key=lambda known: known.uncertainty(now))
        return True
