# SPDX-License-Identifier: BSD-3-Clause
"""Which concealment method there is time for: the requested one, or temporarily the cheapest. Without a clock."""
import math
from typing import Optional, Tuple

CHEAPEST = 'nearest'
"""Method of codecs.concealment.fill that is used in place of one that takes too long."""

STRIKES = 2
"""Consecutive frames that must take too long: a single one may only have been preempted."""

FALLBACK = 10.0
"""How long the cheapest method is used before the requested one is tried again, once [s]."""

REPORTED = 2
"""The fallback in a row that is worth a line in the log: while a node starts, all takes longer."""

LONGEST_PERIOD = 2.0
"""Longer intervals between frames do not count: some were lost, or the source paused [s]."""

SMOOTHING = 0.2
"""Weight of the newest interval in the smoothed frame period."""


class ConcealmentBudget:
    """Keeps the concealment of a stream's frames within a time limit, and within the frame period."""

    def __init__(self) -> None:
        self._period = math.inf     # smoothed [s]
        self._stamp: Optional[int] = None       # of the newest frame [ns]
        self._request: Optional[Tuple[str, float]] = None
        self._strikes = self._fallbacks = 0
        self._until = -math.inf     # end of the fallback [s]

    def frame_began(self, stamp: int) -> None:
        """Note a frame, whether it needs concealment or not.

        :param stamp: of its source [ns]
        """
        if self._stamp is not None and 0 < stamp - self._stamp <= LONGEST_PERIOD * 1e9:
            interval = (stamp - self._stamp) / 1e9
            period = interval if self._period == math.inf else self._period
            self._period = period + SMOOTHING * (interval - period)
        self._stamp = stamp

    def method(self, requested: str, limit: float, now: float) -> str:
        """The method for the next frame. Another request than before ends a fallback.

        :param requested: method of codecs.concealment.fill
        :param limit: how long it may take [s]
        :param now: by a steady clock [s]
        """
        if (requested, limit) != self._request:
            self._request, self._until = (requested, limit), -math.inf
            self._strikes = self._fallbacks = 0
        return CHEAPEST if self.falls_back(now) else requested

    def falls_back(self, now: float) -> bool:
        """Whether the cheapest method is used in place of the requested one."""
        return now < self._until

    def took(self, method: str, seconds: float, now: float) -> bool:
        """Note how long the concealment of the last frame took.

        :param method: as ``method`` returned it
        :return: whether a fallback begins that is to be reported
        """
        if method == CHEAPEST or self._request is None:
            return False
        if seconds <= min(self._request[1], self._period):
            self._strikes = self._fallbacks = 0
            return False
        self._strikes += 1
        if self._strikes < STRIKES:
            return False
        self._strikes, self._fallbacks = STRIKES - 1, self._fallbacks + 1
        self._until = now + FALLBACK
        return self._fallbacks == REPORTED
