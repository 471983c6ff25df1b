# SPDX-License-Identifier: BSD-3-Clause
"""When a stream has something to do: the newest message at a limited rate, and repeats in between.

Without threads or a clock: times are arguments [s, any steady clock].
"""
import math
from typing import Generic, Optional, TypeVar

from .rate import RateLimiter

Item = TypeVar('Item')


class Schedule(Generic[Item]):
    """Holds the newest item that waits; older ones are replaced, there is no backlog.

    A repeat is due one period after something was sent, by :meth:`sent`, or repeated, and after each :meth:`wake`.

    :param rate: maximum rate of items [Hz]
    :param repeat_period: [s]; None: never
    """

    def __init__(self, rate: float, repeat_period: Optional[float] = None) -> None:
        self.repeat_period = repeat_period
        """May change at any time [s]."""
        self.waiting: Optional[Item] = None
        self.replaced = 0
        """Number of items that were replaced by newer ones."""
        self._limiter = RateLimiter(rate)
        self._sent: Optional[float] = None      # when something was sent last; -inf: a repeat is due now

    def set_rate(self, rate: float) -> None:
        """Change the maximum rate of items [Hz]; what was taken before still counts."""
        self._limiter.rate = rate

    def put(self, item: Item) -> None:
        """An item is to be taken, in place of the one that waits."""
        self.replaced += self.waiting is not None and self.waiting is not item
        self.waiting = item

    def take(self, now: float) -> Optional[Item]:
        """The waiting item where it is due."""
        item = self.waiting
        if item is None or self._limiter.due > now:
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
        due = min(self._repeat_due(), math.inf if self.waiting is None else self._limiter.due)
        return None if due == math.inf else due

    def _repeat_due(self) -> float:
        return math.inf if self._sent is None or self.repeat_period is None else self._sent + self.repeat_period
