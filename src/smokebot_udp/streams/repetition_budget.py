# SPDX-License-Identifier: BSD-3-Clause
"""What a robot may send to protect its short messages: a part of the link, in a token bucket. Times are arguments."""
import math
from typing import Optional

from ..units import KBIT

SHARE = 0.03
"""Part of what is sent that may be spent on protection. Streams with a share of the link, such as images, hardly miss
it. It is no part of the rate that may be sent, which is overestimated where much is lost: 3 Mbit/s at 20 % loss on a
link of 2."""

UNUSED_SHARE, MAX_UNUSED = 0.1, 56 * KBIT
"""Part of the unused rate that may be spent instead, where that is more, and its maximum: three short messages of 10 Hz
that are repeated and copied take no more, 3 % of 2 Mbit/s [1, byte/s]."""

SPAN = 1.0
"""What was not used within this time is lost [s]."""

RESERVED = 0.5
"""Part of a full bucket that is reserved for repetitions within datagrams. A byte of them helps more than one of a
datagram of its own."""


class RepetitionBudget:
    """A token bucket; without a rate everything is granted."""

    def __init__(self) -> None:
        self._rate = math.inf   # [byte/s]
        self._level, self._at = 0.0, -math.inf

    def set_rate(self, rate: Optional[float], sent: float, now: float) -> None:
        """Follow the link.

        :param rate: that all together may be sent at; None: unlimited [byte/s]
        :param sent: what is sent, all together [byte/s]
        :param now: by a steady clock [s]
        """
        self._fill(now)
        if rate is None:
            self._rate = math.inf
            return
        self._rate = max(SHARE * min(rate, sent), min(UNUSED_SHARE * max(0.0, rate - sent), MAX_UNUSED))

    def take(self, size: int, now: float, can_wait: bool) -> bool:
        """Whether so much may be sent; then it counts as sent.

        :param size: [byte]
        :param can_wait: not from what is reserved
        """
        if self._rate == math.inf:
            return True
        self._fill(now)
        if self._level - size < (RESERVED * SPAN * self._rate if can_wait else 0.0):
            return False
        self._level -= size
        return True

    def _fill(self, now: float) -> None:
        if self._rate < math.inf:
            self._level = min(self._level + self._rate * max(0.0, now - self._at), SPAN * self._rate)
        self._at = now
