# SPDX-License-Identifier: BSD-3-Clause
"""When the overview of a map leaves: at once where it is the faster way to see something, and so often that it arrives.

Nobody acknowledges it. Times are by a steady clock [s].
"""
import math

from ...copies import copies
from .copies import MAX_COPIES, ROUND_TRIP

RESIDUAL = 0.02
"""Probability that all copies of a datagram of an overview are lost."""

PERIOD = 0.5
"""Time from one overview to the next, at least [s]."""

REFRESH = 1.0
"""While operators who report lack more than the overview costs, it leaves this often [s]."""

PART = 0.5
"""Part of the bitrate that overviews take at most while a map goes on changing, so that tiles leave as well."""

DENSE = 0.06
"""Copies that follow each other in a shorter time must not wait for tiles [s]."""

MAX_DATAGRAMS = 4


def datagrams(loss: float) -> int:
    """Number of datagrams of an overview, at most. At a high loss it is smaller, as each datagram needs many copies."""
    return max(1, round(MAX_DATAGRAMS * (1 - loss) ** 2))


class OverviewSchedule:
    """Counts the copies that are due."""

    def __init__(self) -> None:
        self._left = 0              # copies of the present one
        self._copy_at = math.inf    # when the next copy is due
        self._wanted = False        # whether a new one is to leave
        self._began = -math.inf     # when the first copy of the present one left
        self._last = -math.inf      # when the last copy left
        self._takes = 0.0           # how long the copies of the present one take [s]
        self._copy_takes = 0.0      # likewise the last one
        self.dense = False
        """Whether many copies are still to follow each other closely."""

    def want(self) -> None:
        """An overview is of use: it begins as soon as PERIOD allows."""
        self._wanted = True

    def due(self) -> float:
        """When a copy leaves next."""
        begin = self._next_begin() if self._wanted else math.inf
        return min(begin, self._copy_at)

    def refresh_due(self) -> float:
        """When a copy is due where one is still of use."""
        return self._last + max(REFRESH, self._copy_takes / PART)

    def sent(self, loss: float, now: float, takes: float = 0.0) -> None:
        """A copy leaves now.

        :param loss: packet-loss ratio that is expected
        :param takes: its size by the bitrate [s]
        """
        count = copies(loss, RESIDUAL, MAX_COPIES)
        if self._wanted and now >= self._next_begin():
            self._wanted, self._began, self._left, self._takes = False, now, count, 0.0
        self._left -= 1
        self._takes, self._copy_takes = self._takes + takes, takes
        self._copy_at = now + ROUND_TRIP / count if self._left > 0 else math.inf
        self.dense = self._left > 0 and ROUND_TRIP / count <= DENSE
        self._last = now

    def _next_begin(self) -> float:
        """When the next overview may begin."""
        return self._began + max(PERIOD, self._takes / PART)
