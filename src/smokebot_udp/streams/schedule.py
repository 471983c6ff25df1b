# SPDX-License-Identifier: BSD-3-Clause
"""When a stream has something to do: the newest message at a limited rate, and repeats in between.

Without threads or a clock: times are arguments [s, any steady clock].
"""
import math
from typing import Generic, Optional, TypeVar

from .rate import RateLimiter

Item = TypeVar('Item')

MAX_AGE = 0.03
"""Where an item of a steady source has waited for its turn for longer than this part of the time between its items, the
next one, which is fresh, is awaited instead,"""

PATIENCE = 1.3
"""until it is late by more than a part of that time."""


class Schedule(Generic[Item]):
    """Holds the newest item that waits; older ones are replaced, there is no backlog.

    A repeat is due one period after something was sent, by :meth:`sent`, or repeated, and after each :meth:`wake`.

    A source may have just the maximum rate. If one of its items had to wait for its turn, then so would all later ones,
    for as long. Leaving out one of them ends that.

    :param rate: maximum rate of items [Hz]
    :param repeat_period: [s]; None: never
    :param steady: whether a newer item can be expected
    """

    def __init__(self, rate: float, repeat_period: Optional[float] = None, steady: bool = False) -> None:
        self.repeat_period = repeat_period
        """May change at any time [s]."""
        self.waiting: Optional[Item] = None
        self.replaced = 0
        """Number of items that were replaced by newer ones."""
        self._limiter = RateLimiter(rate)
        self._steady = steady
        self._put, self._gap = -math.inf, 0.0   # when the newest item was put, and how long after the one before
        self._sent: Optional[float] = None      # when something was sent last; -inf: a repeat is due now

    def set_rate(self, rate: float) -> None:
        """Change the maximum rate of items [Hz]; what was taken before still counts."""
        self._limiter.rate = rate

    def put(self, item: Item, now: float) -> None:
        """An item is to be taken, in place of the one that waits."""
        self.replaced += self.waiting is not None and self.waiting is not item
        self.waiting = item
        self._put, self._gap = now, max(0.0, now - self._put)

    def take(self, now: float) -> Optional[Item]:
        """The waiting item where it is due."""
        item = self.waiting
        if item is None or self._item_due() > now:
            return None
        self._limiter.take(now)
        self.waiting = None
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
        due = min(self._repeat_due(), math.inf if self.waiting is None else self._item_due())
        return None if due == math.inf else due

    def _item_due(self) -> float:
        due = self._limiter.due
        if not self._steady or due - self._put <= MAX_AGE * self._gap:
            return due
        return max(due, self._put + PATIENCE * min(self._gap, 1 / self._limiter.rate))

    def _repeat_due(self) -> float:
        return math.inf if self._sent is None or self.repeat_period is None else self._sent + self.repeat_period
