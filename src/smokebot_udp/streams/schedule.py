# SPDX-License-Identifier: BSD-3-Clause
"""When a stream has something to do: the newest message at a limited rate, and repeats in between.

Without threads or a clock: times are arguments [s, any steady clock].
"""
import math
from typing import Generic, Optional, TypeVar

from ..newest import Newest
from .rate import RateLimiter
from .segments import MAX_SOURCES

Item = TypeVar('Item')

MAX_AGE = 0.03
"""An item of a steady source that waits for its turn for more than this part of the time between its items is held
back: the next one, which is fresh, is awaited instead."""

GAP_FACTOR = 1.3
"""An item that is held back leaves this many times the time between items, or the period of the maximum rate if that is
shorter, after it was put."""

ACTIVE = 5.0
"""A source that put nothing for longer is not counted any more [s]."""


class _Source(Generic[Item]):
    """What waits of one source, and when it was put."""

    def __init__(self, rate: float) -> None:
        self.waiting: Optional[Item] = None
        self.limiter = RateLimiter(rate)
        self.put, self.gap = -math.inf, 0.0     # when the newest item was put, and how long after the one before

    def due(self, steady: bool) -> float:
        """When what waits is due; infinite: nothing waits [s]."""
        if self.waiting is None:
            return math.inf
        due = self.limiter.due
        if not steady or due - self.put <= MAX_AGE * self.gap:
            return due
        return max(due, self.put + GAP_FACTOR * min(self.gap, 1 / self.limiter.rate))


class Schedule(Generic[Item]):
    """Holds the newest item of each source that waits; older ones are replaced, there is no backlog.

    Most streams have one source; those that share a stream have a name each, and its rate.

    A repeat is due one period after something was sent, by :meth:`sent`, or repeated, and after each :meth:`wake`.

    A source may have just the maximum rate. If one of its items had to wait for its turn, then so would all later ones,
    for as long. Leaving out one of them ends that.

    :param rate: maximum rate of the items of a source [Hz]
    :param repeat_period: [s]; None: never
    :param steady: whether a newer item can be expected
    """

    def __init__(self, rate: float, repeat_period: Optional[float] = None, steady: bool = False) -> None:
        self.repeat_period = repeat_period
        """May change at any time [s]."""
        self.replaced = 0
        """Number of items that were replaced by newer ones."""
        self._rate, self._steady = rate, steady
        self._sources: Newest[str, _Source[Item]] = Newest(MAX_SOURCES)
        self._sent: Optional[float] = None      # when something was sent last; -inf: a repeat is due now

    def set_rate(self, rate: float) -> None:
        """Change the maximum rate of items [Hz]; what was taken before still counts."""
        self._rate = rate
        for source in list(self._sources.values()):
            source.limiter.rate = rate

    def waiting(self, name: str = '') -> Optional[Item]:
        """What waits of a source."""
        return self._source(name).waiting

    def active(self, now: float) -> int:
        """How many sources put something not long ago; at least 1."""
        return max(1, sum(now - source.put < ACTIVE for source in self._sources.values()))

    def put(self, item: Item, now: float, name: str = '') -> None:
        """An item of a source is to be taken, in place of the one that waits."""
        source = self._source(name)
        self.replaced += source.waiting is not None and source.waiting is not item
        source.waiting = item
        source.put, source.gap = now, max(0.0, now - source.put)

    def take(self, now: float) -> Optional[Item]:
        """The waiting item where it is due; of several sources that which was due first."""
        source = self._first()
        if source is None or source.due(self._steady) > now:
            return None
        source.limiter.take(now)
        item, source.waiting = source.waiting, None
        return item

    def sent(self, now: float) -> None:
        """Something was sent now, so the next repeat is a period away."""
        self._sent = now

    def wake(self) -> None:
        """A repeat is due at once."""
        self._sent = -math.inf

    def take_repeat(self, now: float) -> bool:
        """Whether a repeat is due; the next one is a period away then."""
        if self._repeat_due() > now:
            return False
        self._sent = now
        return True

    def deadline(self) -> Optional[float]:
        """When `take` or `take_repeat` has something next; None: not before something is put [s]."""
        source = self._first()
        due = min(self._repeat_due(), math.inf if source is None else source.due(self._steady))
        return None if due == math.inf else due

    def _source(self, name: str) -> _Source[Item]:
        return self._sources.of(name, lambda: _Source(self._rate))

    def _first(self) -> Optional[_Source[Item]]:
        """The source whose item is due first; None: there is no source."""
        sources = self._sources.values()
        return min(sources, key=lambda source: (source.due(self._steady), source.put)) if sources else None

    def _repeat_due(self) -> float:
        return math.inf if self._sent is None or self.repeat_period is None else self._sent + self.repeat_period
